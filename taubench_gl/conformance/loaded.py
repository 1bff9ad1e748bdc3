"""Whether an engine drew the scene as it is written, and what differs: decided before any vector is looked at."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from taubench_gl.animation import pose_vertices
from taubench_gl.animation.surface import nearest_points
from taubench_gl.conformance.cases import FRAMES
from taubench_gl.conformance.frames import EngineFrame
from taubench_gl.conformance.poses import base_shape, bind_pose
from taubench_gl.conformance.truth import Frame, Pose, Truth

Array = np.ndarray
NEAR, PLACED_PX = 0.005, 0.3
"""Distance up to which two surface points agree: a share of their depth, and what so many pixels beside the center show
of the surface, as rasterizers snap vertices to a grid; a step of the stored positions is added."""

ENOUGH, ENOUGH_EDGES = 0.98, 0.9
"""Share of pixels that must agree, also to name what differs: away from outlines, and at them where a case is about
them."""

FEWEST = 50
NORMAL_COSINE = 0.94
SAMPLED = 200
Explanation = tuple[str, Callable[[int], float]]
"""What could differ, and the share of the pixels of a frame that this explains."""


def agreement(frame: Frame, engine: EngineFrame, points: Array | None = None) -> Array:
    """Pixels (h, w) where the engine shows the surface point of the truth, or both show the sky.

    ``points``: (h, w, 3) world, NaN for sky, in place of the truth's.
    """
    points = frame.position if points is None else points
    sky = ~np.isfinite(points).all(axis=-1)
    with np.errstate(invalid="ignore", over="ignore"):
        if engine.points is None:
            same = np.abs((engine.normal * frame.normal).sum(axis=-1)) >= NORMAL_COSINE
        else:
            relative = points - frame.view.position
            depth = relative @ -frame.view.world_from_view[:, 2]
            tolerance = NEAR * depth + PLACED_PX * _spread(points) + engine.step_m
            same = np.linalg.norm(engine.points - relative, axis=-1) <= tolerance
    return np.where(sky, engine.sky, same & ~engine.sky)


def _spread(points: Array) -> Array:
    """How far apart the points (h, w, 3) of neighboring pixels are, (h, w) meters: the nearer neighbor of each axis."""
    total = np.zeros(points.shape[:2])
    for axis in (0, 1):
        steps = np.linalg.norm(np.diff(points, axis=axis), axis=-1)
        ends = [np.insert(steps, end, np.inf, axis=axis) for end in (0, steps.shape[axis])]
        nearer = np.fmin(*ends)
        total += np.where(np.isfinite(nearer), nearer, 0.0)
    return total


def difference(truth: Truth, engine: list[EngineFrame]) -> str:
    """What differs from the scene as written, as text; "" where nothing does."""
    if not all(frame.judgeable for frame in engine):
        return "there is no position, depth or normal pass to tell"
    shares = [_share(truth, k, agreement(truth.frame(k), engine[k])) for k in range(FRAMES)]
    enough = ENOUGH_EDGES if truth.case.edges else ENOUGH
    wrong = [k for k, share in enumerate(shares) if share < enough]
    if not wrong:
        return ""
    of_frames = "" if len(wrong) == FRAMES else f", in frame {', '.join(map(str, wrong))}"
    for text, explained in _explanations(truth, engine, wrong):
        if all(explained(k) >= enough for k in wrong):
            return text + of_frames
    return f"{100 * (1 - min(shares)):.0f} % of the pixels show something else{of_frames}"


def _share(truth: Truth, number: int, agrees: Array) -> float:
    """Smallest share of the compared pixels of a class: those away from outlines, or in cases of thin things at them.

    Classes of fewer than ``FEWEST`` pixels count with the others alone.
    """
    frame = truth.frame(number)
    where = frame.edge if truth.case.edges else ~frame.edge
    of_class = [where & (frame.kind == kind) for kind in np.unique(frame.kind)]
    counted = [where] * bool(where.any()) + [pixels for pixels in of_class if pixels.sum() >= FEWEST]
    return min((float(agrees[pixels].mean()) for pixels in counted), default=1.0)


def _explanations(truth: Truth, engine: list[EngineFrame], wrong: list[int]) -> Iterator[Explanation]:
    """What could differ, the simplest first."""

    def changed(change: Callable[[EngineFrame, int], EngineFrame]) -> Callable[[int], float]:
        return lambda k: _share(truth, k, agreement(truth.frame(k), change(engine[k], k)))

    def seen(points: Callable[[int], Array]) -> Callable[[int], float]:
        return lambda k: _share(truth, k, agreement(truth.frame(k), engine[k], points(k)))

    placed, world = engine[0].points is not None, engine[0].world
    yield "rows: the first row of an image is its lowest", changed(lambda frame, k: _flipped(frame))
    if placed:
        for origin in (True, False):
            scale = _scale(truth, engine, wrong, origin)
            text = f"units: lengths are {scale:.4g} times those of the file"
            yield text, changed(partial(_turned, truth, np.eye(3) / scale, origin))
        for matrix in _axes():
            names = [f"{'-' if row.sum() < 0 else ''}{'xyz'[np.abs(row).argmax()]}" for row in matrix]
            text = f"axes: x, y, z of the scene are {', '.join(names)} of the positions"
            for origin in (True, False):
                yield text, changed(partial(_turned, truth, matrix, origin))
    for shift, word in ((-1, "before"), (1, "after")):
        at = partial(lambda k, by: _points_of_frame(truth, world, k, k + by), by=shift)
        yield f"pose: every frame shows the pose of the one {word} it", seen(at)
    for other in range(FRAMES):
        at = partial(_points_of_frame, truth, world, other=other)
        yield f"pose: frames show the pose of frame {other}", seen(at)
    yield "alpha: what an alpha mask cuts out is drawn", seen(partial(_points, truth, masked=False))
    yield "visibility: what is hidden is drawn", seen(partial(_points, truth, hidden=True))
    yield "skin: the bind pose is drawn", seen(partial(_points, truth, pose=bind_pose))
    yield "morph: the base shape is drawn", seen(partial(_points, truth, pose=base_shape))
    for node in sorted({int(n) for k in wrong for n in np.unique(truth.frame(k).node) if n >= 0}):
        name = truth.scene.nodes.names[node]
        yield f"mesh: {name!r} is missing", seen(partial(_points, truth, without=node))
        if placed:
            yield f"pose: {name!r} is elsewhere, all else is not", partial(_elsewhere, truth, engine, node)
    if placed and world:
        yield "camera: the surfaces are the scene's, seen by another camera", partial(_on_surfaces, truth, engine)


def _points(
    truth: Truth, number: int, pose: Pose = pose_vertices, masked: bool = True, hidden: bool = False, without: int = -1
) -> Array:
    """Points that the camera sees of a scene drawn wrongly, as ``Truth.cast`` has it: (h, w, 3) world, NaN for sky."""
    hits = truth.drawn(number, pose, masked, hidden, without)
    return truth.at(hits, truth.vertices(number, pose)).reshape(*truth.size[::-1], 3)


def _flipped(frame: EngineFrame) -> EngineFrame:
    values = {name: getattr(frame, name) for name in ("sky", "points", "normal", "step_m")}
    return replace(frame, **{name: value[::-1] for name, value in values.items() if np.ndim(value)})


def _turned(truth: Truth, matrix: Array, origin: bool, frame: EngineFrame, number: int) -> EngineFrame:
    """The frame with its points multiplied by ``matrix`` about the origin of the world, else about the camera."""
    at = truth.view(number).position * origin
    with np.errstate(invalid="ignore", over="ignore"):
        return replace(frame, points=(frame.points + at) @ matrix.T - at)


def _scale(truth: Truth, engine: list[EngineFrame], wrong: list[int], origin: bool) -> float:
    """Median ratio of the lengths of the engine's points and the right ones, from the world's origin or the camera."""
    ratios = []
    for k in wrong:
        frame = truth.frame(k)
        at, both = frame.view.position * origin, ~engine[k].sky & (frame.node >= 0)
        right = frame.position[both] - frame.view.position + at
        ratios.append(np.linalg.norm(engine[k].points[both] + at, axis=-1) / np.linalg.norm(right, axis=-1))
    return float(np.nanmedian(np.concatenate([np.ones(1), *ratios]))) or 1.0


def _axes() -> list[Array]:
    """The signed permutations of three axes, less the first, which is the identity: 47 matrices."""
    orders, signs = itertools.permutations(np.eye(3)), list(itertools.product((1.0, -1.0), repeat=3))
    return [np.array(order) * np.reshape(sign, (3, 1)) for order in orders for sign in signs][1:]


def _points_of_frame(truth: Truth, world: bool, number: int, other: int) -> Array:
    """What frame ``other`` shows, (h, w, 3); points that are no ``world`` positions are moved along with the camera."""
    shown = truth.frame(int(np.clip(other, 0, FRAMES - 1)))
    if world:
        return shown.position
    view, now = shown.view, truth.view(number)
    return (shown.position - view.position) @ view.world_from_view @ now.world_from_view.T + now.position


def _elsewhere(truth: Truth, engine: list[EngineFrame], node: int, number: int) -> float:
    """Share of the pixels that agree if ``node`` may be anywhere before the rest of the scene; 0 where it is right."""
    frame, without = truth.frame(number), _points(truth, number, without=node)
    its = frame.node == node
    if not its.any() or agreement(frame, engine[number])[its].mean() > 0.5:
        return 0.0
    forward = -frame.view.world_from_view[:, 2]
    with np.errstate(invalid="ignore"):
        before = engine[number].points @ forward < np.nan_to_num((without - frame.view.position) @ forward, nan=1e9)
    return _share(truth, number, agreement(frame, engine[number], without) | (before & ~engine[number].sky))


def _on_surfaces(truth: Truth, engine: list[EngineFrame], number: int) -> float:
    """Share of the engine's surface points that lie on a triangle of the scene in that frame."""
    eye = truth.view(number).position
    there = ~engine[number].sky & np.isfinite(engine[number].points).all(axis=-1)
    if there.sum() < SAMPLED // 10:
        return 0.0
    points = engine[number].points[there][:: max(1, int(there.sum()) // SAMPLED)] + eye
    corners = truth.vertices(number)[truth.triangles]
    distances = np.array([nearest_points(corners - point)[0].min() for point in points])
    depth = np.linalg.norm(points - eye, axis=-1)
    return float((distances <= NEAR * depth + np.max(engine[number].step_m)).mean())
