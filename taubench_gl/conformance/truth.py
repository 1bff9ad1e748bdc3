"""Right values of every pixel of a case, in float64: exact rays against the posed triangles of its file.

A pixel is the point of the image at its center plus the frame's offset.  Triangles are met by the ray through that
point alone; vectors are between the projections of one surface point in two frames.  Nothing is stored: the scorer
computes it from the file and the frame times.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import FileCamera, FrameState, Poser, View, pose_normals, pose_vertices
from taubench_gl.animation.pose import present_nodes
from taubench_gl.conformance.cases import FPS, FRAMES, Case, scene_of
from taubench_gl.conventions import GUARD_PX, Visibility
from taubench_gl.pathtraced.cameras import points_at
from taubench_gl.scene.model import Primitive, Scene

Array = np.ndarray
CLASSES = ("still", "rigid", "skinned", "morphed", "sky")
"""What a pixel shows, by the number in ``Frame.kind``; ``rigid``: a node that moves at any time of the case."""

JUMP_PX = 1.0
"""Difference of the vectors of two neighbors of one object from which on an outline is between them."""

Pose = Callable[[Scene, FrameState, int, Primitive, int | None], Array]
"""A way to pose the vertices of a primitive of a node, as ``pose_vertices``: -> (V, 3) world."""


@dataclass(frozen=True, slots=True)
class _Part:
    """One primitive of one node or instance: its vertices from ``first`` on, triangles (T, 3) into all vertices."""

    node: int
    primitive: Primitive
    instance: int | None
    first: int
    triangles: Array


@dataclass(frozen=True, slots=True)
class Hits:
    """What rays meet: triangle (N,), -1 where none; barycentric weights (N, 3); planar depth (N,)."""

    triangle: Array
    weights: Array
    depth: Array


@dataclass(frozen=True, slots=True)
class Frame:
    """Truth of one frame, row 0 at the top.  The previous frame of frame 0 is itself."""

    number: int
    view: View
    previous: View
    hits: Hits
    position: Array  # (h, w, 3) float64, world, meters; NaN: sky
    prev_position: Array  # (h, w, 3) of the same surface point in the previous frame; NaN: it was not there, sky
    normal: Array  # (h, w, 3) unit, world, facing the viewer; 0: sky
    depth: Array  # (h, w) planar, meters; 0: sky
    motion: Array  # (h, w, 2) previous - current, pixels, +x right, +y down, no jitter; NaN: no place in that frame
    visibility: Array  # (h, w) conventions.Visibility of the point in the previous frame; 0: no previous frame
    kind: Array  # (h, w) number of a class; -1: sky of a parallel camera, which has no vector
    node: Array  # (h, w), -1: sky
    exact: Array  # (h, w) bool: neither the point nor the camera has moved, so that the vector is exactly zero
    edge: Array  # (h, w) bool, within 1 px of an outline

    @property
    def valid(self) -> Array:
        """(h, w) bool: the previous frame shows the same surface point."""
        return self.visibility == Visibility.VISIBLE


class Truth:
    """Right values of a case at ``size``, (width, height) in pixels.  ``frame(k)`` computes those of one frame."""

    def __init__(self, case: Case, size: tuple[int, int]):
        self.case, self.size, self.scene = case, size, scene_of(case.name)
        self._poser = Poser(self.scene, FPS)
        self._camera = FileCamera(self.scene, int(self.scene.camera_nodes[0]))
        self._offsets = case.offsets(size)
        self._parts = _parts(self.scene)
        self.triangles = np.concatenate([p.triangles for p in self._parts])
        self.node_of = np.repeat([p.node for p in self._parts], [len(p.triangles) for p in self._parts])
        self._frames: dict[int, Frame] = {}
        self._posed: dict[tuple, Array] = {}
        self._drawn: dict[tuple, Hits] = {}

    def state(self, frame: float) -> FrameState:
        """The scene at ``frame``; before the first frame it is as at the first."""
        return self._poser.sample(max(frame, 0) / FPS)

    def view(self, frame: int) -> View:
        """The camera of ``frame``, sampled at the frame's offset."""
        view = self._camera.view_at(self.state(frame))
        return replace(view, jitter_px=self._offsets[min(max(frame, 0), FRAMES - 1)])

    def vertices(self, frame: float, pose: Pose = pose_vertices) -> Array:
        """World positions of all vertices of the case at ``frame``, posed by ``pose``, (V, 3) float64, meters."""
        key = (max(frame, 0), pose)
        if key not in self._posed:
            state = self.state(frame)
            posed = [pose(self.scene, state, p.node, p.primitive, p.instance) for p in self._parts]
            self._posed[key] = np.concatenate(posed)
        return self._posed[key]

    def frame(self, number: int) -> Frame:
        """The truth of frame ``number``, 0 to FRAMES - 1."""
        if number not in self._frames:
            self._frames[number] = self._frame(number)
        return self._frames[number]

    def frames(self) -> list[Frame]:
        """The truth of all frames."""
        return [self.frame(number) for number in range(FRAMES)]

    def at(self, hits: Hits, vertices: Array) -> Array:
        """The point of ``vertices`` (V, k) at each hit, (N, k); NaN without one."""
        corners = vertices[self.triangles[hits.triangle]]
        points = np.einsum("nk,nki->ni", hits.weights, corners)
        points[hits.triangle < 0] = np.nan
        return points

    @cached_property
    def pixels(self) -> Array:
        """Column and row of every pixel, row by row, (h * w, 2) float64."""
        width, height = self.size
        return np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2).astype(np.float64)

    def drawn(
        self, number: int, pose: Pose = pose_vertices, masked: bool = True, hidden: bool = False, without: int = -1
    ) -> Hits:
        """What the camera of frame ``number`` sees of a scene that is drawn as ``cast`` draws it; computed once."""
        key = number, pose, masked, hidden, without
        if key not in self._drawn:
            self._drawn[key] = self.cast(number, self.view(number), self.pixels, pose, masked, hidden, without)
        return self._drawn[key]

    def cast(
        self, frame: int, view: View, pixels: Array, pose: Pose = pose_vertices, masked: bool = True,
        hidden: bool = False, without: int = -1,
    ) -> Hits:  # fmt: skip
        """What the rays through ``pixels`` (N, 2: column, row) of ``view`` meet in ``frame``.

        ``pose``: how vertices are posed; ``masked``: alpha masks make holes; ``hidden``: hidden nodes are drawn;
        ``without``: a node that is not drawn.
        """
        relative = self.vertices(frame, pose) - view.position
        along = relative @ -view.world_from_view[:, 2]
        present = (hidden or present_nodes(self.scene, self.state(frame))[self.node_of]) & (self.node_of != without)
        rays = ((2 * pixels + 1) / np.array(self.size) - 1) * [1.0, -1.0]
        c = self.clip(view, relative)[self.triangles]
        facing = np.linalg.det(c)
        seen = np.flatnonzero(present & (facing != 0) & (facing * self._sides >= 0))
        c = c[seen]
        # b: sum of b_i (x, y, w)_i = (ray, 1).  Only rays in the box of a triangle in front of the camera can meet it.
        inverse, front = np.linalg.inv(c), (c[:, :, 2] > 1e-6).all(axis=1)
        ndc = c[:, :, :2] / np.where(front[:, None, None], c[:, :, 2:], 1.0)
        low = np.where(front[:, None], ndc.min(axis=1) - 1e-9, -np.inf)
        high = np.where(front[:, None], ndc.max(axis=1) + 1e-9, np.inf)
        hits = Hits(np.full(len(pixels), -1), np.zeros((len(pixels), 3)), np.full(len(pixels), np.inf))
        for i in np.flatnonzero((low <= rays.max(axis=0)).all(axis=1) & (high >= rays.min(axis=0)).all(axis=1)):
            triangle = int(seen[i])
            inside = np.flatnonzero(((rays >= low[i]) & (rays <= high[i])).all(axis=1))
            b = rays[inside] @ inverse[i, :2] + inverse[i, 2]
            total = b.sum(axis=1)
            ok = (b >= -1e-12).all(axis=1) & (total > 0)
            inside, b = inside[ok], b[ok] / total[ok, None]
            z = b @ along[self.triangles[triangle]]
            ok = (z >= view.camera.znear) & (z <= view.camera.zfar) & (z < hits.depth[inside])
            if masked and triangle in self._masks:
                ok &= self._masks[triangle](b)
            inside = inside[ok]
            hits.triangle[inside], hits.weights[inside], hits.depth[inside] = triangle, b[ok], z[ok]
        return hits

    @cached_property
    def _sides(self) -> Array:
        """Sign of the determinant of triangles that are seen, (T,): 0 where both sides are."""
        mirrored = np.linalg.det(self.state(0).world[:, :3, :3]) < 0
        sides = np.where(mirrored, -1, 1)[self.node_of]
        both = [self.scene.materials[p.primitive.material].double_sided for p in self._parts]
        return np.where(np.repeat(both, [len(p.triangles) for p in self._parts]), 0, sides)

    @cached_property
    def _masks(self) -> dict[int, Callable[[Array], Array]]:
        """Whether points (N, 3 barycentric) of a triangle with an alpha mask are there, by triangle."""
        masks, first = {}, 0
        for part in self._parts:
            material = self.scene.materials[part.primitive.material]
            if material.alpha_mode == "MASK":
                alpha = self.scene.images[material.base_color_texture.image].decode()[..., 3] / 255.0
                uv = part.primitive.texcoords[0].astype(np.float64)
                for k, corners in enumerate(part.triangles - part.first):
                    masks[first + k] = partial(_is_there, alpha, uv[corners], material.alpha_cutoff)
            first += len(part.triangles)
        return masks

    def motion(self, point: Array, prev_point: Array, view: View, previous: View) -> Array:
        """Vectors (N, 2) of surface points (N, 3, world) that were at ``prev_point``; NaN: behind, or not there.

        Exactly zero where neither the point nor the camera has moved.
        """
        now, then = view.centered(), previous.centered()
        at, before = self.project(now, point - now.position), self.project(then, prev_point - then.position)
        before[(prev_point - then.position) @ -then.world_from_view[:, 2] < then.camera.znear] = np.nan
        return before - at

    def clip(self, view: View, points: Array, w: float = 1.0) -> Array:
        """Clip coordinates x, y and w (N, 3) of points relative to the camera; ``w`` 0: of directions."""
        clip_from_relative = view.clip_from_relative(*self.size)[[0, 1, 3]]
        return points @ clip_from_relative[:, :3].T + w * clip_from_relative[:, 3]

    def project(self, view: View, relative: Array, w: float = 1.0, *, divide: bool = True) -> Array:
        """Column and row (N, 2) of points relative to the camera of ``view``, also behind it.

        ``w`` 0: of directions; ``divide`` False: of the clip coordinates as they are.
        """
        clip = self.clip(view, relative, w)
        with np.errstate(divide="ignore", invalid="ignore"):
            ndc = clip[:, :2] / (clip[:, 2:] if divide else 1.0)
        return (ndc * [1.0, -1.0] + 1) * 0.5 * np.array(self.size) - 0.5

    def directions(self, view: View) -> Array:
        """View directions (h * w, 3) of the pixels of a perspective ``view``, planar depth 1, world axes."""
        return points_at(view, self.pixels, np.ones(len(self.pixels)), "planar", self.size)

    def jitter_motion(self, number: int) -> Array:
        """What vectors that contain the offsets have more than those without, (2,) pixels, +x right, +y down."""
        before, now = self._offsets[max(number - 1, 0)], self._offsets[number]
        return (now - before) * [1.0, -1.0]

    def sky_motion(self, view: View, previous: View) -> Array:
        """Vectors (h * w, 2) of the sky, infinitely far away; NaN: behind the previous camera."""
        now, then, ray = view.centered(), previous.centered(), self.directions(view)
        before = self.project(then, ray, 0.0)
        before[ray @ -then.world_from_view[:, 2] <= 0] = np.nan
        return before - self.project(now, ray, 0.0)

    def _frame(self, number: int) -> Frame:
        view, previous = self.view(number), self.view(number - 1)
        hits, parallel = self.drawn(number), view.camera.kind != "perspective"
        sky, node = hits.triangle < 0, np.where(hits.triangle < 0, -1, self.node_of[hits.triangle])
        position = self.at(hits, self.vertices(number))
        prev_position = self.at(hits, self.vertices(number - 1))
        prev_position[~present_nodes(self.scene, self.state(number - 1))[node]] = np.nan
        motion = self.motion(position, prev_position, view, previous)
        if not parallel:
            motion[sky] = self.sky_motion(view, previous)[sky]
        same = number == 0 or _same_view(view.centered(), previous.centered())
        exact = same & (sky | (position == prev_position).all(axis=-1))
        motion[exact] = 0.0  # by definition, not by rounding
        normal = np.nan_to_num(math3d.normalize(self.at(hits, self._normals(number))))
        kind = np.where(sky, -1 if parallel else CLASSES.index("sky"), self._classes[node])
        visibility = self._visibility(number, hits, prev_position, motion)
        depth = np.where(sky, 0.0, hits.depth)
        values = (position, prev_position, normal, depth, motion, visibility, kind, node, exact)
        images = [value.reshape(*self.size[::-1], *value.shape[1:]) for value in values]
        return Frame(number, view, previous, hits, *images, edge=_outlines(images[7], images[4]))

    def _visibility(self, number: int, hits: Hits, prev: Array, motion: Array) -> Array:
        """What the ray from the previous camera to each point finds, (N,) of Visibility."""
        if number in (0, self.case.cut):
            return np.zeros(len(motion), dtype=int)
        sky, previous = hits.triangle < 0, self.view(number - 1)
        # Where the point is in the sampled previous image: with the offset of that frame, as the current one has its.
        at = self.pixels + motion + (self.view(number).jitter_px - previous.jitter_px) * [1, -1]
        new, gone = ~sky & ~np.isfinite(prev).all(axis=-1), ~np.isfinite(motion).all(axis=-1)
        outside = ((at < -GUARD_PX) | (at > np.array(self.size) - 1 + GUARD_PX)).any(axis=-1)
        found = self.cast(number - 1, previous, np.where(gone[:, None], -1e9, at))
        depth = np.where(sky, np.inf, (prev - previous.position) @ -previous.world_from_view[:, 2])
        with np.errstate(invalid="ignore"):
            occluded = found.depth < depth * (1 - 1e-4)
        # the first that applies
        reasons = {Visibility.NEW: new, Visibility.BEHIND: gone, Visibility.OUTSIDE: outside,
                   Visibility.OCCLUDED: occluded}  # fmt: skip
        return np.select(list(reasons.values()), [int(reason) for reason in reasons], int(Visibility.VISIBLE))

    def _normals(self, frame: int) -> Array:
        """World normals of all vertices, (V, 3)."""
        state = self.state(frame)
        return np.concatenate([pose_normals(self.scene, state, p.node, p.primitive, p.instance) for p in self._parts])

    @cached_property
    def _classes(self) -> Array:
        """Number of the class of every node, (N,)."""
        worlds = np.array([self.state(k).world for k in range(FRAMES + 1)])
        out = np.where((worlds != worlds[0]).any(axis=(0, 2, 3)), CLASSES.index("rigid"), CLASSES.index("still"))
        for part in self._parts:
            if part.primitive.joints is not None:
                out[part.node] = CLASSES.index("skinned")
            elif part.primitive.targets:
                out[part.node] = CLASSES.index("morphed")
        return out


def _parts(scene: Scene) -> list[_Part]:
    parts, first = [], 0
    for node in scene.mesh_nodes.tolist():
        for primitive in scene.meshes[scene.nodes.mesh[node]].primitives:
            for instance in range(len(scene.nodes.instances[node])) if node in scene.nodes.instances else (None,):
                parts.append(_Part(node, primitive, instance, first, primitive.triangles.astype(np.int64) + first))
                first += len(primitive.positions)
    return parts


def _is_there(alpha: Array, uv: Array, cutoff: float, weights: Array) -> Array:
    """Whether points (N, 3 barycentric) of a triangle with ``uv`` (3, 2) are there, by the nearest texel, (N,) bool."""
    columns, rows = np.floor((weights @ uv) * alpha.shape[::-1]).astype(int).T
    return alpha[rows % alpha.shape[0], columns % alpha.shape[1]] >= cutoff


def _same_view(view: View, previous: View) -> bool:
    same = np.array_equal(view.position, previous.position)
    return same and np.array_equal(view.world_from_view, previous.world_from_view) and view.camera == previous.camera


def _outlines(node: Array, motion: Array) -> Array:
    """Pixels with a neighbor of another object, or of a part of the same one that moves otherwise, (h, w) bool."""
    edge = np.zeros(node.shape, dtype=bool)
    values = np.nan_to_num(motion, nan=1e6)
    for rows, columns in ((1, 0), (0, 1), (1, 1), (1, -1)):
        a = tuple(slice(max(-s, 0), n - max(s, 0)) for s, n in zip((rows, columns), node.shape))
        b = tuple(slice(max(s, 0), n - max(-s, 0)) for s, n in zip((rows, columns), node.shape))
        differs = (node[a] != node[b]) | (np.abs(values[a] - values[b]).max(axis=-1) > JUMP_PX)
        edge[a] |= differs
        edge[b] |= differs
    return edge
