"""Small EXR files in the layouts that renderers write."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import OpenEXR

from taubench_gl.animation import View
from taubench_gl.pathtraced.evaluation import PathTracedOptions
from taubench_gl.scene.model import Camera

WIDTH, HEIGHT = 12, 8
YFOV = math.radians(60.0)


def view_at(x: float) -> View:
    """A camera at (x, 1, 5) that looks along -Z."""
    return View(np.array([x, 1.0, 5.0]), np.eye(3), Camera(yfov=YFOV))


def options(folder: Path, **more) -> PathTracedOptions:
    return PathTracedOptions(camera_file=folder / "camera.json", **more)


def window(x0: int, y0: int, x1: int, y1: int) -> tuple[np.ndarray, np.ndarray]:
    return np.array([x0, y0], dtype=np.int32), np.array([x1, y1], dtype=np.int32)


def write(path: Path, channels: dict[str, np.ndarray], *, parts: bool = False, compression=None, **header) -> Path:
    """One part with all channels, or one part per pass named after it as Blender 5 does."""
    header = {"compression": compression or OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | header
    if parts:
        groups: dict[str, dict[str, np.ndarray]] = {}
        for name, values in channels.items():
            groups.setdefault(name.rpartition(".")[0], {})[name] = values
        OpenEXR.File([OpenEXR.Part(dict(header), group, name) for name, group in groups.items()]).write(str(path))
    else:
        OpenEXR.File(dict(header), dict(channels)).write(str(path))
    return path


def planes(values: np.ndarray, name: str, letters: str) -> dict[str, np.ndarray]:
    """(h, w, n) -> {"name.X": (h, w), ...}, contiguous float32."""
    return {f"{name}.{c}": np.ascontiguousarray(values[..., i], dtype=np.float32) for i, c in enumerate(letters)}


OLD = dict(Direct="Dir", Indirect="Ind", Color="Col", Diffuse="Diff", Glossy="Gloss", Transmission="Trans")
"""Words in pass names: Blender 5 -> Blender 2.8."""


def pass_name(lobe: str, what: str, modern: bool) -> str:
    return f"{lobe} {what}" if modern else OLD[lobe] + OLD[what]


def blender_frame(
    view_position=(0.0, 1.0, 5.0), *, layer: str = "ViewLayer", modern: bool = False, seed: int = 0
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """A floor at y = 0 and sky above it, viewed along -Z with yfov 60 degrees.

    Returns channels with Blender's names, and the same quantities in glTF axes with canonical names.
    """
    rng = np.random.default_rng(seed)
    camera = np.asarray(view_position, dtype=np.float64)
    tangent = np.tan(np.radians(30.0))
    x = (2.0 * np.arange(WIDTH) + 1 - WIDTH) / HEIGHT * tangent
    y = (HEIGHT - 1 - 2.0 * np.arange(HEIGHT)) / HEIGHT * tangent
    rays = np.stack(np.broadcast_arrays(x[None, :], y[:, None], -1.0), axis=-1)
    sky = np.broadcast_to((y >= 0)[:, None], (HEIGHT, WIDTH)).copy()
    depth = np.where(sky, 1e10, -camera[1] / np.where(sky, -1.0, rays[..., 1]))
    position = np.where(sky[..., None], 0.0, camera + rays * depth[..., None])
    normal = np.where(sky[..., None], 0.0, [0.0, 1.0, 0.0])

    def to_blender(v):
        return np.stack([v[..., 0], -v[..., 2], v[..., 1]], axis=-1)

    channels = planes(to_blender(position), f"{layer}.Position", "XYZ")
    channels |= planes(to_blender(normal), f"{layer}.Normal", "XYZ")
    channels |= planes(depth[..., None], f"{layer}.Depth", "Z")
    expected = {"position": position, "normal": normal, "depth": depth, "sky": sky}
    total = np.zeros((HEIGHT, WIDTH, 3), dtype=np.float32)
    for lobe in ("Diffuse", "Glossy", "Transmission"):
        color = rng.random((HEIGHT, WIDTH, 3), dtype=np.float32)
        channels |= planes(color, f"{layer}.{pass_name(lobe, 'Color', modern)}", "RGB")
        for what in ("Direct", "Indirect"):
            light = rng.random((HEIGHT, WIDTH, 3), dtype=np.float32)
            channels |= planes(light, f"{layer}.{pass_name(lobe, what, modern)}", "RGB")
            expected[f"{lobe.lower()}_{what.lower()}"] = light * color
            total += light * color
    for what in ("direct", "indirect"):
        expected[what] = sum(expected[f"{lobe}_{what}"] for lobe in ("diffuse", "glossy", "transmission"))
    expected["combined"] = total
    channels |= planes(total, f"{layer}.Combined", "RGB")
    vector = rng.normal(size=(HEIGHT, WIDTH, 4))
    channels |= planes(vector, f"{layer}.Vector", "XYZW")
    expected["motion"] = vector[..., :2] * [1, -1]
    return channels, expected
