"""A small analytic scene with every input of INPUTS, for ``reuse check`` and for tests.

A checkered floor, a moving ball, sky, and a camera that moves and turns.  Ray-traced in NumPy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import DEFAULT_THRESHOLD, Reason
from taubench_gl.features import FEATURES
from taubench_gl.frame.targets import write_channel
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.owner import Owner
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.metrics.reprojection import Reprojection, reproject
from taubench_gl.reuse.frame import FAR_AWAY_PX, INPUTS, MIN_ALBEDO, FrameInputs
from taubench_gl.scene.model import Camera
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray

FPS = 24.0
LENS = Camera(yfov=math.radians(60.0), znear=0.1, zfar=100.0)
FLOOR_Y, BALL_RADIUS = -1.0, 0.8
SPECULAR_ALBEDO = 0.05
_THRESHOLDS = dict.fromkeys(FEATURES, DEFAULT_THRESHOLD)


@dataclass(frozen=True, slots=True)
class Step:
    """One frame as arrays: ``inputs`` contains every name of INPUTS, (h, w, components), row 0 at the top."""

    index: int
    inputs: dict[str, Array]
    clean: Array  # (h, w, 3) radiance without noise
    pair: Reprojection
    view: View
    prev_view: View
    cut: bool


def camera_at(time: float, speed: float = 1.0) -> View:
    """A camera that moves forward and turns: 1 m/s and 20 degrees per second times ``speed``."""
    yaw, pitch = math.radians(20.0) * speed * time, math.radians(-8.0)
    cy, sy, cx, sx = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    rotation = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]]) @ np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    return View(np.array([0.2 * speed * time, 0.6, -speed * time]), rotation, LENS)


def ball_at(time: float, speed: float = 1.0) -> Array:
    """Center of the ball, world, meters."""
    return np.array([math.sin(2.0 * speed * time), -0.2, -4.0])


def render_view(view: View, time: float, size: tuple[int, int], speed: float = 1.0) -> dict[str, Array]:
    """Geometry and noise-free radiance at ``time``; also ``world`` positions and ``ball`` (h, w) bool."""
    width, height = size
    pair = reprojection(view, view, width, height)
    x, y = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height - 1, -1, -1, dtype=np.float64))
    ray = (pair.sky_origin + x[..., None] * pair.sky_dx + y[..., None] * pair.sky_dy)[..., :3]
    forward = -view.world_from_view[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = (FLOOR_Y - view.position[1]) / ray[..., 1]
    floor = np.where((floor > 0) & (floor < LENS.zfar), floor, np.inf)
    away = view.position - ball_at(time, speed)
    a, b, c = (ray**2).sum(-1), ray @ away, away @ away - BALL_RADIUS**2
    root = b * b - a * c
    hit = (-b - np.sqrt(np.maximum(root, 0))) / a
    hit = np.where((root > 0) & (hit > 0), hit, np.inf)
    ball, distance = hit < floor, np.minimum(hit, floor)
    surface = np.isfinite(distance)
    relative = ray * np.where(surface, distance, 0.0)[..., None]
    world = relative + view.position
    normal = np.where(ball[..., None], (world - ball_at(time, speed)) / BALL_RADIUS, [0.0, 1.0, 0.0])
    checker = (np.floor(world[..., 0]) + np.floor(world[..., 2])) % 2
    albedo = np.where(ball[..., None], [0.8, 0.3, 0.2], (0.3 + 0.4 * checker)[..., None])
    light = np.maximum(normal @ (np.array([1.0, 2.0, 1.0]) / math.sqrt(6.0)), 0.0)
    sky = np.array([0.3, 0.5, 0.9])
    direct = np.where(surface[..., None], albedo * light[..., None], sky)
    radiance = np.where(surface[..., None], albedo * (0.2 + light)[..., None], sky)
    return {
        "position": np.concatenate([relative, np.where(surface, relative @ forward, 0.0)[..., None]], axis=-1),
        "normal": np.where(surface[..., None], normal, 0.0),
        "base_color": np.concatenate([np.where(surface[..., None], albedo, 0.0), surface[..., None]], axis=-1),
        "emission": np.zeros((height, width, 3)),
        "ids": np.where(surface[..., None], np.where(ball[..., None], [2, 2], [1, 1]), 0).astype(np.uint32),
        "radiance": radiance,
        "direct": direct,
        "material": np.where(surface[..., None], [0.0, 0.5, 1.0, 1.0], 0.0),
        "hit_distance": np.where(surface, 2.0, 0.0)[..., None],
        "world": world,
        "ball": ball,
    }


def synthetic_steps(
    size: tuple[int, int],
    count: int,
    *,
    speed: float = 1.0,
    noise: float = 0.1,
    seed: int = 1,
    cut_at: int | None = None,
) -> Iterator[Step]:
    """Frames 0 to ``count`` - 1 of the scene at 24 fps.

    ``noise``: standard deviation of radiance relative to itself, gamma distributed, so never negative; ``cut_at``:
    frame at which the camera jumps, declared as a cut; ``speed`` 0: a still scene.
    """
    rng = np.random.default_rng(seed)

    def view_at(index: int) -> View:
        return camera_at(index / FPS + (3.0 if cut_at is not None and index >= cut_at else 0.0), speed)

    before = None
    for index in range(count):
        time, prev_time = index / FPS, max(index - 1, 0) / FPS
        view, prev_view = view_at(index), view_at(max(index - 1, 0))
        now = render_view(view, time, size, speed)
        before = now if before is None else before
        pair = reprojection(view, prev_view, *size)
        shift = ball_at(prev_time, speed) - ball_at(time, speed)
        prev_world = now["world"] + np.where(now["ball"][..., None], shift, 0.0)
        cut = index == cut_at
        inputs = _inputs(now, before, prev_world - prev_view.position, pair, cut, index == 0)
        clean = now["radiance"]
        if noise > 0:
            shape = 1.0 / noise**2
            factor = rng.gamma(shape, 1.0 / shape, clean.shape[:2])[..., None]
            inputs["radiance"][..., :3] = clean * factor
            inputs["direct"][..., :3] = now["direct"] * factor
        inputs |= _light(now, inputs["radiance"], noise)
        yield Step(index, inputs, clean, pair, view, prev_view, cut)
        before = now


def _light(now: Mapping[str, Array], radiance: Array, noise: float) -> dict[str, Array]:
    """Inputs that are parts of ``radiance``: a tenth of the light of a surface is specular.  No light is re-shaded."""
    surface = now["position"][..., 3:] > 0
    shaded = radiance[..., 3:]
    light = np.where(surface, radiance[..., :3], 0.0)
    specular = np.where(surface, SPECULAR_ALBEDO, MIN_ALBEDO) * np.ones(3)
    diffuse = np.maximum(now["base_color"][..., :3], MIN_ALBEDO)
    parts = {"diffuse": 0.9 * light, "specular": 0.1 * light}
    parts |= {"diffuse_demodulated": parts["diffuse"] / diffuse, "specular_demodulated": parts["specular"] / specular}
    out = {name: np.concatenate([rgb, shaded], axis=-1) for name, rgb in parts.items()}
    out["emitted"] = np.where(surface, 0.0, radiance[..., :3])
    out |= {"diffuse_albedo": diffuse, "specular_albedo": specular}
    out |= {"material": now["material"], "hit_distance": now["hit_distance"], "sample_count": shaded}
    out["variance"] = (noise * light @ LUMINANCE)[..., None] ** 2
    out |= {name: np.zeros_like(shaded) for name in ("reactive", "transparency")}
    return out | {name: np.zeros_like(radiance) for name in ("reshaded", "reshaded_direct", "reshaded_before")}


def _inputs(
    now: Mapping[str, Array], before: Mapping[str, Array], prev_position: Array, pair: Reprojection, cut: bool,
    first: bool,
) -> dict[str, Array]:  # fmt: skip
    geometry = {n: now[n] for n in ("position", "normal")} | {"prev_position": prev_position}
    history = {n: before[n] for n in ("position", "normal")}
    motion = reproject(pair, now["position"], prev_position).motion_px
    masks = []
    for extra in ((), ("direct",)):
        current = geometry | {n: now["radiance"] for n in extra}
        previous = history | {n: before["radiance"] for n in extra}
        mask = pair_masks(current, previous, pair, _THRESHOLDS, reprojection="motion").mask
        if cut or first:
            mask = np.full_like(mask, Reason.CUT if cut else Reason.FIRST)
        masks.append(mask)
    shaded = np.ones((*now["ball"].shape, 1))
    return {
        **{n: np.concatenate([now[n], shaded], axis=-1) for n in ("radiance", "direct")},
        **geometry,
        "base_color": now["base_color"],
        "emission": now["emission"],
        "ids": now["ids"],
        "history_position": before["position"],
        "history_normal": before["normal"],
        "history_ids": before["ids"],
        "motion": np.nan_to_num(motion, nan=FAR_AWAY_PX),
        "mask": masks[0],
        "exact_mask": masks[1],
        "reference": np.concatenate([now["radiance"], shaded], axis=-1),
    }


class Uploader(Owner):
    """Textures of every input at one size, updated for each frame."""

    def __init__(self, gpu: Gpu, size: tuple[int, int]):
        super().__init__()
        self.textures: dict[str, moderngl.Texture] = {
            name: self.own(gpu.ctx.texture(size, info.components, dtype=info.dtype)) for name, info in INPUTS.items()
        }

    def frame(self, step: Step, exposure: float = 1.0) -> FrameInputs:
        """The frame on the GPU; valid until the next call."""
        for name, values in step.inputs.items():
            write_channel(self.textures[name], name, values)
        still = np.zeros(2)
        return FrameInputs(
            step.index, step.index / FPS, self.textures, step.pair, step.view, step.prev_view, still, still, exposure,
            step.cut,
        )  # fmt: skip
