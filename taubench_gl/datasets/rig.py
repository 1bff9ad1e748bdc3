"""The nodes and tracks a generated camera is written as."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from taubench_gl.datasets.camera_path import CameraPath, quat_about

Array = np.ndarray


def add_rig(
    path: CameraPath, node: Callable[..., int], camera: int, name: str, keep_still: bool = False
) -> list[tuple]:
    """Nodes for position, yaw, pitch and roll, one inside the other, the camera on the innermost.

    One axis per node: a turn between two keys stays a turn about that axis, and an angle nobody turns is exactly 0.
    ``node(name, parent, **properties)`` adds a node and returns its index.  ``keep_still``: what never
    changes is keyed too, so that the file is as long as the path.  Returns tracks (node, path, times, values,
    interpolation).
    """
    parts: list[tuple[str, str, Array]] = [("position", "translation", path.position)]
    parts += [
        (axis_name, "rotation", quat_about(axis, angles))
        for axis_name, axis, angles in zip(("yaw", "pitch", "roll"), "yxz", path.angles.T, strict=True)
    ]
    tracks: list[tuple] = []
    parent: int | None = None
    for part, channel, values in parts:
        last = part == "roll"
        rest: dict[str, Any] = {channel: values[0].tolist()}
        if last:
            rest["camera"] = camera
        parent = node(name if last else f"{name} {part}", parent, **rest)
        if np.any(values != values[0]) or keep_still:
            tracks.append((parent, channel, path.times, values, "LINEAR"))
    return tracks
