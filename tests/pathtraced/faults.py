"""Wrong conventions and wrong motion vectors, injected into frames of any program by array transforms.

Frames are as their mapping reads them: motion previous - current in pixels, +y down.  What still surfaces do is
projected here once more, in NumPy, independently of the package.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from taubench_gl.pathtraced.passes import to_y_up

JITTER = ((0.31, -0.17), (-0.19, 0.33), (0.07, 0.11), (-0.4, -0.3), (0.2, 0.4))  # of frame number modulo 5


class Corrupted:
    """A sequence with other frames."""

    def __init__(self, sequence, frames, mapping=None):
        self._sequence, self._frames, self.mapping = sequence, frames, mapping or sequence.mapping

    def __getattr__(self, name):
        return getattr(self._sequence, name)

    @property
    def frames(self):
        return tuple(self._frames)

    def read(self, number, *, geometry=True):
        return self._frames[number]


# Wrong conventions: frames, camera matrices by number, mapping -> frames and matrices that are wrong.


def motion(change):
    """``change``: motion (h, w, 2), frame number, (2,) size, (2,) what a stored (1, 1) is read as -> motion."""

    def spoil(frames, camera, mapping):
        size = np.array(next(iter(frames.values())).size)
        unit = mapping.motion.factors(tuple(size)).astype(float)
        return {n: replace(f, motion=change(f.motion.astype(float), n, size, unit).astype(np.float32))
                for n, f in frames.items()}, camera  # fmt: skip

    return spoil


def points(change):
    """``change``: positions (h, w, 3), the matrix of the camera that they belong to, the frame, the mapping."""

    def spoil(frames, camera, mapping):
        out = {}
        for n, f in frames.items():
            given = {"position": (f.position, n), "prev_position": (f.prev_position, max(n - 1, min(frames)))}
            out[n] = replace(f, **{name: change(values, camera[at], f, mapping).astype(np.float32)
                                   for name, (values, at) in given.items() if values is not None})  # fmt: skip
        return out, camera

    return spoil


def cameras(change):
    return lambda frames, camera, mapping: (frames, {n: change(matrix) for n, matrix in camera.items()})


def depths(change):
    """``change``: the planar depth (h, w) with 1 for the sky, distances likewise, the frame -> depth of surfaces."""

    def spoil(frames, camera, mapping):
        out = {}
        for n, f in frames.items():
            offset = f.position - (0.0 if f.relative else camera[n][:3, 3])
            planar = np.where(f.sky, 1.0, offset @ -camera[n][:3, 2])
            away = np.where(f.sky, 1.0, np.linalg.norm(offset, axis=-1))
            out[n] = replace(f, depth=np.where(f.sky, f.depth, change(planar, away, f)).astype(np.float32))
        return out, camera

    return spoil


def scaled(factor):
    def spoil(frames, camera, mapping):
        frames, camera = points(lambda p, *_: p * np.float32(factor))(frames, camera, mapping)
        depth = {n: {"depth": f.depth * np.float32(factor), "depth_offset": f.depth_offset * factor}
                 for n, f in frames.items() if f.depth is not None}  # fmt: skip
        return {n: replace(f, **depth.get(n, {})) for n, f in frames.items()}, camera

    return spoil


def flipped(frames, camera, mapping):
    names = ("position", "prev_position", "depth", "sky", "motion")
    return {n: replace(f, **{k: getattr(f, k)[::-1] for k in names if getattr(f, k) is not None})
            for n, f in frames.items()}, camera  # fmt: skip


def renumbered(of_frame, of_camera):
    """Which file or camera stands under each number, of the sum of the first and the last number."""

    def spoil(frames, camera, mapping):
        whole = min(frames) + max(frames)
        return {n: frames[of_frame(n, whole)] for n in frames}, {
            n: camera[of_camera(n, whole)] for n in camera if of_camera(n, whole) in camera
        }

    return spoil


def backwards(n, whole):
    return whole - n


def same(n, whole):
    return n


def turned(up):
    """Positions and normals whose axes are those of ``up``, read as those of the mapping."""

    def turn(vectors, mapping):
        return (vectors @ to_y_up(np.eye(3), up).T @ to_y_up(np.eye(3), mapping.up)).astype(np.float32)

    def spoil(frames, camera, mapping):
        frames, camera = points(lambda p, *_: turn(p, mapping))(frames, camera, mapping)
        if mapping.normals == "view":
            return frames, camera
        return {n: f if f.normal is None else replace(f, normal=turn(f.normal, mapping))
                for n, f in frames.items()}, camera  # fmt: skip

    return spoil


def normals(frames, camera, mapping):
    """World normals in the axes of the view, or the other way round."""
    turned = {n: camera[n][:3, :3] if mapping.normals == "world" else camera[n][:3, :3].T for n in frames}
    return {n: f if f.normal is None else replace(f, normal=(f.normal @ turned[n]).astype(np.float32))
            for n, f in frames.items()}, camera  # fmt: skip


def rotation(matrix):
    out = matrix.copy()
    out[:3, :3] = out[:3, :3].T
    return out


def horizontal(yfov, size):
    return 2 * np.arctan(np.tan(yfov / 2) * size[0] / size[1])


MISTAKES = {
    # name: (function, convention -> value if the mapping is that of an export), in the order of application
    "distance": (depths(lambda z, r, f: r if f.depth_kind == "planar" else z), {"depth": "distance"}),
    "depth unit": (depths(lambda z, r, f: f.depth * 1000), {"depth": "planar x 1000"}),
    "reversed z": (depths(lambda z, r, f: 0.1 / z), {"depth": "buffer, reversed"}),
    "z buffer": (depths(lambda z, r, f: 1.001 - 0.1001 / z), {"depth": "buffer, not reversed"}),
    "jitter": (
        motion(lambda m, n, *_: m + np.subtract(JITTER[(n - 1) % 5], JITTER[n % 5])), {"jitter": "left in"},
    ),
    "sign": (motion(lambda m, *_: -m), {"direction": "current-previous"}),
    "y up": (motion(lambda m, *_: m * [1, -1]), {"y": "up"}),
    "x": (motion(lambda m, *_: m * [-1, 1]), {"direction": "current-previous", "y": "up"}),
    "uv": (motion(lambda m, n, size, unit: m / size if abs(unit[0]) == 1 else m * abs(unit)), {"unit": "uv"}),
    "clip space": (motion(lambda m, n, size, unit: 2 * m / size if abs(unit[0]) == 1 else 2 * m), {"unit": "ndc"}),
    "half": (motion(lambda m, *_: m / 2), {"unit": "half"}),
    "double": (motion(lambda m, *_: m * 2), {"unit": "double"}),
    "from 0.5": (
        motion(lambda m, n, size, unit: (m / size if abs(unit[0]) == 1 else m) + 0.5 * unit),
        {"unit": "uv", "zero": "0.5"},
    ),
    "exchanged": (motion(lambda m, *_: m[..., ::-1]), {"components": "yx"}),
    "world": (
        points(lambda p, m, f, _: p + m[:3, 3] * (1 if f.relative else -1)), {"positions": "world"},
    ),
    "view": (points(lambda p, m, f, _: (p - (0 if f.relative else m[:3, 3])) @ m[:3, :3]), {"positions": "view"}),
    "normals": (normals, {"normals": "view"}),
    "z": (turned("z"), {"up": "z"}),
    "z-left": (turned("z-left"), {"up": "z-left"}),
    "y-left": (turned("y-left"), {"up": "y-left"}),
    "centimeters": (scaled(100), {"meters": "0.01"}),
    "camera in feet": (scaled(0.3048), {"meters": "1/0.3048"}),
    "rows": (flipped, {"rows": "bottom first"}),
    "columns": (cameras(lambda m: m.T), {"matrix": "transposed"}),
    "rotation": (cameras(rotation), {"matrix": "rotation transposed"}),
    "inverse": (cameras(np.linalg.inv), {"matrix": "inverse"}),
    "inverse columns": (cameras(lambda m: np.linalg.inv(m).T), {"matrix": "inverse transposed"}),
    "OpenCV": (cameras(lambda m: m @ np.diag([1, -1, -1, 1])), {"matrix": "y down, z forward"}),
    "fov": (None, {"lens": "horizontal"}),
    "files backwards": (renumbered(backwards, same), {"order": "files backwards"}),
    "camera backwards": (renumbered(same, backwards), {"order": "camera backwards"}),
    "all backwards": (renumbered(backwards, backwards), {"order": "next"}),
    "camera ahead": (renumbered(same, lambda n, _: n + 1), {"order": "ahead"}),
    "camera behind": (renumbered(same, lambda n, _: n - 1), {"order": "behind"}),
}  # fmt: skip
"""Name of a wrong convention -> what makes it, and what names it."""


def world_points(frame, view):
    """(h, w, 3) float64, from positions or depth."""
    if frame.position is not None:
        return frame.position.astype(float) + (view.position if frame.relative else 0.0)
    height, width = frame.depth.shape
    column, row = np.meshgrid(np.arange(width), np.arange(height))
    tangent = np.tan(view.camera.yfov / 2)
    ray = np.stack([(2 * column + 1 - width) / height * tangent, (height - 1 - 2 * row) / height * tangent,
                    -np.ones_like(column, dtype=float)], axis=-1)  # fmt: skip
    ray = ray / np.linalg.norm(ray, axis=-1, keepdims=True) if frame.depth_kind == "distance" else ray
    return view.position + (ray * frame.depth[..., None]) @ view.world_from_view.T


def projected(points, view, size):
    """Column and row of world points, (h, w, 2); NaN behind the camera."""
    x, y, z = np.moveaxis((points - view.position) @ view.world_from_view, -1, 0)
    scale = 0.5 * size[1] / np.tan(view.camera.yfov / 2) / np.where(z < 0, -z, np.nan)
    return np.stack([0.5 * (size[0] - 1) + x * scale, 0.5 * (size[1] - 1) - y * scale], axis=-1)


def still_vectors(frames, views, number, now=0, before=-1):
    """Vectors of still surfaces of frame ``number`` from the camera of ``number + before`` to ``number + now``."""
    frame = frames[number]
    points = world_points(frame, views[number])
    ends = (projected(points, views[number + step], frame.size) for step in (before, now))
    return np.subtract(*ends)


def _each(change):
    """Injects ``change`` (frames, views, number) -> motion of surfaces; frames without what it needs keep theirs."""

    def inject(frames, views):
        out = {}
        for n, frame in frames.items():
            try:
                motion = np.where(frame.sky[..., None], frame.motion, change(frames, views, n))
                out[n] = replace(frame, motion=np.where(np.isfinite(frame.motion), motion, np.nan).astype(np.float32))
            except KeyError:  # no frame or camera before it
                out[n] = frame
        return out

    return inject


def _random(frames, views, n):
    return np.random.default_rng(n).normal(0, 5, frames[n].motion.shape)


def _previous_camera(frames, views, n):
    """The object's own motion is kept, the camera's is that of the frame before."""
    return frames[n].motion - still_vectors(frames, views, n) + still_vectors(frames, views, n, -1, -2)


INJECTED = {
    "object motion missing": _each(still_vectors),
    "halved": _each(lambda frames, views, n: 0.5 * frames[n].motion),
    "zero": _each(lambda frames, views, n: 0 * frames[n].motion),
    "one frame late": _each(lambda frames, views, n: frames[n - 1].motion),
    "object motion halved": _each(
        lambda frames, views, n: 0.5 * (frames[n].motion + still_vectors(frames, views, n))
    ),
    "previous frame's camera": _each(_previous_camera),
    "constant": _each(lambda frames, views, n: np.full_like(frames[n].motion, 1.7)),
    "random": _each(_random),
}  # fmt: skip
"""Name of a fault -> (frames by number, views by number) -> frames with it."""
