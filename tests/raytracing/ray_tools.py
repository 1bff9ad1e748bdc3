"""Structures of scenes, rays over them, and answers to compare with: float64, and Embree's."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from ray_caster import gather
from ray_query import Hits, RayQuery

from taubench_gl.frame.raytracing.attributes import HitAttributes
from taubench_gl.frame.raytracing.structure import SceneStructure
from taubench_gl.frame.renderer import Renderer
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.scene.model import Camera, Scene

Array = np.ndarray


@dataclass
class Traced:
    """A renderer, its structure and queries against it."""

    renderer: Renderer
    structure: SceneStructure
    query: RayQuery
    attributes: HitAttributes | None  # of a structure that tests alpha

    def at(self, time: float, previous: float | None = None) -> Traced:
        """Draw and update the frame at ``time``."""
        self.renderer.draw(time, time if previous is None else previous)
        self.structure.update(self.renderer.frame)
        if self.attributes is not None:
            self.attributes.update(self.renderer.frame)
        return self


@contextmanager
def traced(
    gpu: Gpu, scene: Scene, camera=None, *, size=(8, 8), alpha_test: bool = False, keep_previous: bool = False
) -> Iterator[Traced]:
    """The structure of ``scene`` at time 0, seen from ``camera`` (None: the origin of the world)."""
    from frame_tools import still_camera

    channels = {"position", "geometric_normal", *("prev_position",) * keep_previous}
    with Owner() as owner:
        context = owner.own(GpuContext(gpu))
        renderer = owner.own(Renderer(context, scene, camera or still_camera(Camera()), size, channels))
        structure = owner.own(SceneStructure(renderer, alpha_test=alpha_test, keep_previous=keep_previous))
        attributes = owner.own(HitAttributes(renderer)) if alpha_test else None
        query = owner.own(RayQuery(context, structure, attributes))
        yield Traced(renderer, structure, query, attributes).at(0.0)
    gpu.collect()


@dataclass(frozen=True)
class TriangleList:
    """All visible triangles of a frame, camera-relative, in scene order; those under a mirror wind the other way."""

    corners: Array  # (T, 3, 3) float64
    draw: Array  # (T,)

    @property
    def box(self) -> tuple[Array, Array]:
        return self.corners.min(axis=(0, 1)), self.corners.max(axis=(0, 1))

    def index(self, hits: Hits) -> Array:
        """Triangles that were hit, as rows of ``corners``; -1: none.  (N,)."""
        first = np.full(int(self.draw.max()) + 1, -1)
        first[self.draw[::-1]] = np.arange(len(self.draw))[::-1]
        return np.where(hits.draw >= 0, first[hits.draw] + hits.triangle, -1)


def visible_triangles(renderer: Renderer) -> TriangleList:
    """From the float64 pose, independent of the structure."""
    state = renderer.frame.state
    found = gather(renderer.scene, state, state)
    return TriangleList(found.corners - renderer.frame.view.position, found.record - 1)


def directions(count: int, seed: int = 1) -> Array:
    """Uniform on the sphere, (N, 3) float32."""
    d = np.random.default_rng(seed).normal(size=(count, 3))
    return (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)


def some_rays(triangles: TriangleList, count: int, seed: int = 1) -> tuple[Array, Array]:
    """Half of them leave surfaces, as light does; the others start anywhere in its box.  (N, 3) float32 each."""
    rng = np.random.default_rng(seed)
    low, high = triangles.box
    half = count // 2
    at = triangles.corners[rng.integers(len(triangles.corners), size=half)]
    on = np.einsum("nk,nkc->nc", rng.dirichlet([1, 1, 1], half), at)
    anywhere = low + (high - low) * rng.random((count - half, 3))
    d = directions(count, seed + 1)
    return (np.concatenate([on, anywhere]) + 1e-3 * (high - low).max() * d).astype(np.float32), d


def planes(corners: Array, origins: Array, ray: Array) -> tuple[Array, Array]:
    """Float64: where rays meet the planes of triangles (N, 3, 3), and how far outside of its edges; negative: inside.

    (N,) distance along the ray and (N,) distance in the plane, both in scene units.
    """
    o, d = origins.astype(np.float64), ray.astype(np.float64)
    a = corners[:, 0]
    n = np.cross(corners[:, 1] - a, corners[:, 2] - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.sum((a - o) * n, axis=1) / np.sum(d * n, axis=1)
        p = o + t[:, None] * d
        out = np.full(len(t), -np.inf)
        for k in range(3):
            v, w = corners[:, k], corners[:, (k + 1) % 3]
            side = np.cross(w - v, n)
            out = np.maximum(out, np.sum((p - v) * side, axis=1) / np.linalg.norm(side, axis=1))
    return t, out


@dataclass(frozen=True)
class Disagreement:
    """Rays for which two casters name different primitives at different distances."""

    rays: Array  # (K,) all of them
    unexplained: Array  # (K',) those beyond the band in which float32 cannot tell
    theirs: Array  # (K'',) beyond the band, but the float64 answer is that of the structure


def compare(
    triangles: TriangleList, o: Array, d: Array, mine: Array, t: Array, other: Array, other_t: Array, band: float
) -> Disagreement:
    """``mine``, ``other`` (N,): rows of ``triangles`` or -1; ``band``: scene units."""
    close = (mine >= 0) & (other >= 0) & (np.abs(t - other_t) <= 1e-5 * np.maximum(other_t, 1e-30))
    rays = np.flatnonzero(~((mine == other) | close))
    unexplained, theirs = [], []
    for i in rays.tolist():
        answers = []
        for row in (mine[i], other[i]):
            if row < 0:
                answers.append((np.inf, np.inf))
                continue
            at, outside = planes(triangles.corners[row : row + 1], o[i : i + 1], d[i : i + 1])
            # In a grazing plane an error across it is a larger one along the ray.
            n = np.cross(*(triangles.corners[row, 1:] - triangles.corners[row, 0]))
            cosine = abs(np.dot(n, d[i])) / max(np.linalg.norm(n), 1e-300)
            answers.append((at[0], outside[0], band / max(cosine, 1e-3)))
        (t1, out1, *s1), (t2, out2, *s2) = answers
        slack = band + sum(s1 + s2)
        edge = any(np.isfinite(x) and abs(x) <= slack for x in (out1, out2))
        same_place = abs(t1 - t2) <= slack or min(abs(t1), abs(t2)) <= slack
        if edge or same_place:
            continue
        # The float64 answer: the nearer of those that are really met.
        met = [at if outside < 0 and at > 0 else np.inf for at, outside in ((t1, out1), (t2, out2))]
        right = met[0] < met[1] or (mine[i] < 0 and np.isinf(met[1]))
        (theirs if right else unexplained).append(i)
    return Disagreement(rays, np.array(unexplained, int), np.array(theirs, int))
