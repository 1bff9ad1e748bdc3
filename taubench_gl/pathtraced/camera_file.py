"""Cameras of a path-traced sequence: the JSON sidecar, and the fit to a position pass where there is none.

Sidecar (schema ``taubench-gl/camera/1``), glTF axes (+Y up, the camera looks along its local -Z), metres, radians::

    {"schema": "taubench-gl/camera/1", "fps": 24.0, "width": 320, "height": 180,
     "camera": {"kind": "perspective", "yfov": 0.8, "znear": 0.1, "zfar": null},
     "frames": {"12": {"world_from_view": [[...], [...], [...], [...]]},
                "13": {"position": [x, y, z], "rotation": [x, y, z, w], "yfov": 0.7}}}

Each frame has ``world_from_view`` (4x4, rows) or ``position`` and ``rotation`` (xyzw); the keys of ``camera``
may be overridden per frame.  ``kind`` is perspective (``yfov``) or orthographic (``ymag``, half the height in metres).
``zfar`` null is infinity; ``fps``, ``width`` and ``height`` are optional and checked where given.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl import math3d
from taubench_gl.errors import PathTracedError

Array = np.ndarray
CAMERA_SCHEMA = "taubench-gl/camera/1"
_INTRINSICS = ("kind", "yfov", "ymag", "znear", "zfar")


@dataclass(frozen=True, slots=True)
class CameraPose:
    """One camera at one frame, as a sidecar or a fit gives it."""

    position: Array  # (3,) float64, world, metres
    world_from_view: Array  # (3, 3) float64, rotation
    kind: str = "perspective"  # perspective | orthographic
    yfov: float = math.pi / 4  # radians
    ymag: float = 1.0  # metres, half the height
    znear: float = 0.1
    zfar: float = math.inf


@dataclass(frozen=True, slots=True)
class CameraFile:
    """A whole sidecar."""

    poses: dict[int, CameraPose]
    fps: float | None = None
    size: tuple[int, int] | None = None


def read_camera_file(path: str | Path) -> CameraFile:
    """Read a sidecar.  Raises PathTracedError with a JSON pointer to what is wrong."""
    path = Path(path)
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        what = f"is no camera file: {getattr(error, 'strerror', None) or error}"
        raise PathTracedError(what, where=str(path), hint="give JSON as 'reference render' writes it") from None
    if not isinstance(values, dict) or values.get("schema") != CAMERA_SCHEMA:
        got = values.get("schema") if isinstance(values, dict) else type(values).__name__
        raise PathTracedError(f"schema is {got!r}, expected {CAMERA_SCHEMA!r}", where=str(path))
    frames, shared = values.get("frames"), values.get("camera", {})
    if not isinstance(frames, dict) or not frames or not isinstance(shared, dict):
        raise PathTracedError("has no frames", where=f"{path}#/frames", hint="one entry per frame number")
    poses = {}
    for key, entry in frames.items():
        where = f"{path}#/frames/{key}"
        if not key.lstrip("-").isdecimal() or not isinstance(entry, dict):
            raise PathTracedError("is no frame", where=where, hint='write "12": {"world_from_view": ...}')
        poses[int(key)] = _pose(shared | entry, where)
    fps = _number(values, "fps", str(path), None)
    width, height = (_number(values, name, str(path), None) for name in ("width", "height"))
    return CameraFile(poses, fps, None if width is None or height is None else (int(width), int(height)))


def camera_file_text(poses: dict[int, CameraPose], fps: float, size: tuple[int, int], **more: Any) -> str:
    """The sidecar as JSON; ``more`` are further top-level keys."""
    frames = {}
    for frame, pose in sorted(poses.items()):
        matrix = math3d.affine(pose.world_from_view, pose.position).tolist()
        lens = {"yfov": pose.yfov} if pose.kind == "perspective" else {"ymag": pose.ymag}
        zfar = pose.zfar if math.isfinite(pose.zfar) else None
        frames[str(frame)] = {"world_from_view": matrix, "kind": pose.kind, **lens, "znear": pose.znear, "zfar": zfar}
    head = {"schema": CAMERA_SCHEMA, "fps": fps, "width": size[0], "height": size[1]}
    return json.dumps(head | more | {"frames": frames}, indent=1) + "\n"


def _pose(entry: dict[str, Any], where: str) -> CameraPose:
    if "world_from_view" in entry:
        matrix = _array(entry["world_from_view"], (4, 4), f"{where}/world_from_view")
        rotation, position = matrix[:3, :3], matrix[:3, 3]
    elif "position" in entry and "rotation" in entry:
        position = _array(entry["position"], (3,), f"{where}/position")
        rotation = math3d.mat3_from_quat(_array(entry["rotation"], (4,), f"{where}/rotation"))
    else:
        raise PathTracedError("has no pose", where=where, hint="give world_from_view, or position and rotation")
    if abs(np.linalg.det(rotation) - 1) > 1e-3 or np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3:
        raise PathTracedError("is not a rotation", where=where, hint="right-handed and without scale; -Z looks forward")
    kind = entry.get("kind", "perspective")
    if kind not in ("perspective", "orthographic"):
        raise PathTracedError(f"kind is {kind!r}", where=where, hint="choose from perspective, orthographic")
    lens = "yfov" if kind == "perspective" else "ymag"
    values = {name: _number(entry, name, where, None) for name in _INTRINSICS[1:]}
    if values[lens] is None:
        raise PathTracedError(
            f"has no {lens}", where=where, hint="radians" if lens == "yfov" else "half the height, metres"
        )
    if not 0 < values[lens] < (math.pi if lens == "yfov" else math.inf):
        raise PathTracedError(f"{lens} is {values[lens]}", where=where, hint="give a usable lens")
    given = {name: value for name, value in values.items() if value is not None}
    if kind == "orthographic":
        given.setdefault("zfar", 1e4)
    pose = CameraPose(position, math3d.orthonormal(rotation), kind, **given)
    if not 0 <= pose.znear < pose.zfar:
        raise PathTracedError(f"znear {pose.znear} is not below zfar {pose.zfar}", where=where)
    return pose


def _array(value: Any, shape: tuple[int, ...], where: str) -> Array:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.shape != shape or not np.isfinite(array).all():
        raise PathTracedError(f"is not {'x'.join(map(str, shape))} finite numbers", where=where)
    return array


def _number(values: dict[str, Any], name: str, where: str, default: float | None) -> float | None:
    value = values.get(name, default)
    if value is None:
        return default
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise PathTracedError(f"{name} is {value!r}, expected a number", where=where)
    return float(value)
