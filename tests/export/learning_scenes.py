"""Scenes with motion in closed form for data of learning, and a reader of safetensors by its description."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from fixed import fixed_settings

from taubench_gl.scene.builder import SceneBuilder, quad, turn_y
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

FPS = 24.0
WALL, NEAR = 6.0, 3.0
"""Distances of the two planes from the camera at time 0, meters."""
STEPS = {"pan": (0.3, 0.12, 0.0), "turn": (0.0, 0.0, 0.0), "dolly": (0.05, -0.03, -0.2)}
"""Scene -> step of the camera in a frame, meters."""
TURN = -2.0
"""Degrees about +Y in a frame of the scene ``turn``."""
YFOV = np.radians(50.0)


def moving(kind: str, *, cut_at: int | None = None) -> Scene:
    """A wall of random shades, columns before it and sky above; a camera that moves.  ``cut_at``: it jumps there."""
    b, rng = SceneBuilder(), np.random.default_rng(3)
    shades = [
        b.material(base_color=(*color, 1.0), metallic=0.0, roughness=1.0, specular=0.0)
        for color in rng.uniform(0.1, 0.9, (12, 3))
    ]
    for depth, columns, rows, size in ((WALL, 30, 9, 0.7), (NEAR, 12, 12, 0.3)):
        for i in range(columns):
            for j in range(rows):
                x = (i - columns / 2 + 0.5) * size * (1.0 if depth == WALL else 4.0)
                tile = b.mesh(quad(size, size, material=shades[rng.integers(12)]))
                b.node(mesh=tile, translation=(x, (j - rows / 2) * size - 1.1, -depth))
    for place in ((3.0, 4.0, 2.0), (-4.0, 2.0, 1.0)):
        b.light(translation=place, intensity=60.0)
    camera = b.camera(yfov=YFOV, znear=0.1)
    keys = np.arange(48)
    jump = 9.0 * (keys >= (99 if cut_at is None else cut_at))[:, None]
    places = keys[:, None] * np.array(STEPS[kind]) + jump * np.array([1.0, 0.0, 0.0])
    b.animate(camera, "translation", keys / FPS, places, "STEP")
    if kind == "turn":
        b.animate(camera, "rotation", keys / FPS, [turn_y(TURN * k) for k in keys], "STEP")
    return b.build()


def settings(size: tuple[int, int], **more) -> Settings:
    given = {"width": size[0], "height": size[1], "frames": (0, 5), "indirect": "none", "shadow_size": 64, "camera": 0}
    return fixed_settings(**(given | more))


def pose(kind: str, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,) and rotation (3, 3), columns right, up, backward, of the camera."""
    a = np.radians(TURN * frame) if kind == "turn" else 0.0
    return frame * np.array(STEPS[kind]), np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])


def previous_pixels(kind: str, frame: int, size: tuple[int, int], depth: np.ndarray, jitter=(0.0, 0.0)) -> np.ndarray:
    """Where the points at planar ``depth`` (h, w), 0: sky, of pixels i + ``jitter`` were in the frame before."""
    width, height = size
    focal = 0.5 * height / np.tan(0.5 * YFOV)
    y, x = np.mgrid[:height, :width]
    ray = np.stack([x + jitter[0] - (width - 1) / 2, (height - 1) / 2 - y - jitter[1], -focal + 0 * x], axis=-1) / focal
    (position, rotation), (before, rotation_before) = pose(kind, frame), pose(kind, frame - 1)
    world = ray @ rotation.T * np.where(depth > 0, depth, 1.0)[..., None]
    world += np.where(depth[..., None] > 0, position - before, 0.0)
    there = world @ rotation_before
    pixel = focal * there[..., :2] / -there[..., 2:] * [1, -1] + [(width - 1) / 2, (height - 1) / 2]
    return pixel - np.stack([x + jitter[0], y + jitter[1]], axis=-1)


def read_safetensors(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Tensors and text of a file, by the description of the format: 8 bytes of length, JSON, data without gaps."""
    data = path.read_bytes()
    size = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + size])
    text = header.pop("__metadata__")
    types = {"F32": "<f4", "F64": "<f8", "I32": "<i4", "BOOL": "?"}
    out, end = {}, 0
    for name, one in sorted(header.items(), key=lambda item: item[1]["data_offsets"]):
        first, last = one["data_offsets"]
        assert first == end and (8 + size + first) % np.dtype(types[one["dtype"]]).itemsize == 0
        out[name] = np.frombuffer(data[8 + size + first : 8 + size + last], types[one["dtype"]]).reshape(one["shape"])
        end = last
    assert 8 + size + end == len(data) and size % 8 == 0
    return out, text
