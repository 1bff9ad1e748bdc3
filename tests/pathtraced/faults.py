"""Faults of motion vectors, injected into frames of any program by array transforms.

Frames are as their mapping reads them: motion previous - current in pixels, +y down.  What still surfaces do is
projected here once more, in NumPy, independently of the package.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np


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
    "random": _each(_random),
    "one frame late": _each(lambda frames, views, n: frames[n - 1].motion),
    "previous frame's camera": _each(_previous_camera),
    "constant": _each(lambda frames, views, n: np.full_like(frames[n].motion, 1.7)),
    "object motion halved": _each(
        lambda frames, views, n: 0.5 * (frames[n].motion + still_vectors(frames, views, n))
    ),
}  # fmt: skip
"""Name of a fault -> (frames by number, views by number) -> frames with it."""
