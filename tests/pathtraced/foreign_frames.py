"""Frames of a made-up engine in closed form: a wall that moves to the right before a floor and a sky."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from exr_files import planes, write

from taubench_gl.animation import View
from taubench_gl.pathtraced.cameras import camera_file_text, project
from taubench_gl.scene.model import Camera

SIZE = WIDTH, HEIGHT = 48, 32
STEP, WALL_STEP = 0.1, 0.35  # meters a frame: the camera, the wall
MAPPING = {
    "up": "y",
    "motion": {"y": "down"},
    "passes": {"combined": [""], "depth": "Depth", "position": "Pos", "prev_position": "PrevPos", "normal": "Normal",
               "motion": "Velocity"},
}  # fmt: skip
"""How ``passes_of`` stores its passes, as a mapping file."""


def view_at(frame: int) -> View:
    """The camera: it moves along +X and looks along -Z."""
    return View(np.array([STEP * frame, 1.0, 5.0]), np.eye(3), Camera(yfov=math.radians(50.0), znear=0.05))


def passes_of(frame: int, shift_px: tuple[float, float] = (0.0, 0.0)) -> dict[str, np.ndarray]:
    """Canonical passes of a frame, float64, row 0 at the top; samples are ``shift_px`` (right, down) off center."""
    view, tangent = view_at(frame), math.tan(math.radians(25.0))
    x = (2.0 * (np.arange(WIDTH) + shift_px[0]) + 1 - WIDTH) / HEIGHT * tangent
    y = (HEIGHT - 1 - 2.0 * (np.arange(HEIGHT) + shift_px[1])) / HEIGHT * tangent
    rays = np.stack(np.broadcast_arrays(x[None, :], y[:, None], -1.0), axis=-1)
    floor = np.where(rays[..., 1] < 0, -view.position[1] / np.minimum(rays[..., 1], -1e-9), np.inf)
    at_wall = view.position + 4.0 * rays
    wall = (np.abs(at_wall[..., 0] - WALL_STEP * frame) < 1.0) & (np.abs(at_wall[..., 1] - 1.0) < 0.8)
    depth = np.where(wall & (floor > 4.0), 4.0, np.where(floor < 40.0, floor, np.inf))
    wall, sky = depth == 4.0, np.isinf(depth)
    position = view.position + rays * np.where(sky, 1.0, depth)[..., None]
    previous = position - np.where(wall[..., None], [WALL_STEP, 0.0, 0.0], 0.0)
    flat = [project(v, p.reshape(-1, 3), SIZE) for v, p in ((view_at(frame - 1), previous), (view, position))]
    motion = (flat[0] - flat[1]).reshape(HEIGHT, WIDTH, 2)
    normal = np.where(wall[..., None], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0])
    light = np.where(wall, 0.8, 0.2)[..., None] * [1.0, 0.5, 0.25]
    none = sky[..., None]
    return {
        "sky": sky, "wall": wall, "depth": np.where(sky, 0.0, depth), "position": np.where(none, 0.0, position),
        "prev_position": np.where(none, 0.0, previous), "normal": np.where(none, 0.0, normal),
        "motion": np.where(none, 0.0, motion), "combined": np.where(none, 0.0, light),
    }  # fmt: skip


def channels_of(passes: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The passes as channels that MAPPING names, float32."""
    out = planes(passes["position"], "Pos", "XYZ") | planes(passes["prev_position"], "PrevPos", "XYZ")
    out |= planes(passes["normal"], "Normal", "XYZ") | planes(passes["motion"], "Velocity", "XY")
    out |= planes(passes["depth"][..., None], "Depth", "Z")
    return out | {name[1:]: plane for name, plane in planes(passes["combined"], "", "RGB").items()}


def write_frames(folder: Path, frames=range(1, 4), change=lambda channels, frame: channels, **shape) -> Path:
    """Files of ``frames`` with their camera; ``change`` makes other channels of those of a frame."""
    folder.mkdir(exist_ok=True)
    for frame in frames:
        channels = change(channels_of(passes_of(frame, **shape)), frame)
        write(folder / f"f_{frame:03d}.exr", {name: np.ascontiguousarray(v) for name, v in channels.items()})
    views = {frame: view_at(frame) for frame in frames}
    (folder / "camera.json").write_text(camera_file_text(views, 24.0, SIZE))
    return folder
