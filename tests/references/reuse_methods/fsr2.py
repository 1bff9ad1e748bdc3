"""Stages of a temporal upscaler of the class of FSR2 (AMD, documentation of FidelityFX Super Resolution 2).

Unlike in the other modules, row 0 of images and points is at the bottom and y points up, as in the shaders.  Sizes are
(width, height); ``at`` (h, w, 2) is (x, y) in pixel indices; ``jitter`` (2,) is that of the samples, in input pixels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from references.reuse_methods.history import inside, nearest_surface, neighbors, sample_history, shifted
from references.reuse_methods.taa import rgb_from_ycocg, ycocg_from_rgb
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray

BLOCK = 16
"""Side of the blocks of the shading change detection, input pixels."""

MOST_MOVING, MEAN_WEIGHT, FLICKER = 3.0, 0.74, 1 / 255
"""Largest weight of the history of a moving pixel; mean weight of a frame; smallest change of luminance that counts."""

FLICKER_BOX, STEADY = 0.1 * FLICKER ** (1 / 6), 0.1
"""Smallest deviation of an unstable luminance; most disocclusion, composition and shading change of a steady pixel."""

STILL_PX, FULL_SHARE = 0.01, 0.01
"""Motion of a still pixel, input pixels; motion at which its divergence in the image counts fully, of the image."""

TRUST_WEIGHT = 12.0
"""Weight of upsampled colors after which a lock is fully trusted."""


@dataclass(frozen=True)
class Grids:
    """Sizes (width, height) of the inputs and of the result."""

    inputs: tuple[int, int]
    output: tuple[int, int]

    @property
    def scale(self) -> Array:
        """(2,) output pixels per input pixel."""
        return np.array(self.output) / np.array(self.inputs)

    def input_from_output(self, at: Array) -> Array:
        return (at + 0.5) / self.scale - 0.5

    def output_from_input(self, at: Array) -> Array:
        return (at + 0.5) * self.scale - 0.5


def pixels(size: tuple[int, int]) -> Array:
    """(h, w, 2) coordinates of the pixels."""
    return np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).astype(np.float64)


def fetch(values: Array, at: Array) -> Array:
    """Values at integer points, those outside at the nearest pixel."""
    h, w = values.shape[:2]
    x, y = at[..., 0].astype(np.int64), at[..., 1].astype(np.int64)
    return values[np.clip(y, 0, h - 1), np.clip(x, 0, w - 1)]


def _taps(at: Array):
    base = np.floor(at)
    f = at - base
    for i in range(4):
        offset = np.array([i & 1, i >> 1])
        yield base + offset, np.where(offset == 1, f, 1 - f).prod(axis=-1)


def _inside(at: Array, size: tuple[int, int]) -> Array:
    return np.all((at >= 0) & (at < np.array(size)), axis=-1)


def lanczos2(x: Array) -> Array:
    """sinc(x) sinc(x / 2) for |x| < 2, else 0."""
    return np.where(np.abs(x) < 2, np.sinc(x) * np.sinc(np.asarray(x) / 2), 0.0)


def fsr2_tone_mapped(radiance: Array) -> Array:
    """c / (1 + max c).  (..., 3) -> (..., 3)."""
    c = np.maximum(radiance, 0.0)
    return c / (1 + c.max(axis=-1, keepdims=True))


def fsr2_radiance(rgb: Array) -> Array:
    """The inverse of the tone map of colors limited to 0 .. 1."""
    return rgb / np.maximum(1 - rgb.max(axis=-1, keepdims=True), 1e-5)


def fsr2_block_luminance(radiance: Array) -> Array:
    """Compute luminance pyramid: mean logarithm of the luminance of each block.  -> (block rows, block columns)."""
    logs = np.log(np.maximum(radiance @ LUMINANCE, 1e-4))
    h, w = logs.shape
    return np.array(
        [[logs[y : y + BLOCK, x : x + BLOCK].mean() for x in range(0, w, BLOCK)] for y in range(0, h, BLOCK)]
    )


def fsr2_shading_luminance(blocks: Array, at: Array) -> Array:
    """Geometric mean luminance around points ``at`` of the inputs, bilinear between the centers of blocks."""
    return np.exp(sample_history(blocks[..., None], (at + 0.5) / BLOCK - 0.5)[..., 0])


def fsr2_dilate(depth: Array, values: Mapping[str, Array]) -> dict[str, Array]:
    """Reconstruct & dilate: ``depth`` (h, w), 0 = sky, and ``values`` of the nearest surface of 3x3 pixels.

    Ties: the pixel itself, then rows from the bottom, then columns from the left.
    """
    found = nearest_surface(depth[::-1])[::-1] * [1, -1] + [0, len(depth) - 1]
    return {name: fetch(value, found) for name, value in {**values, "depth": depth}.items()}


def fsr2_depth_clip(at: Array, expected: Array, before: Array, tolerance: float) -> Array:
    """Depth clip: share of the footprint of ``at`` in the dilated previous depth without a nearer surface.

    ``expected``, ``before`` (h, w) planar depth, 0 = sky.  -> (h, w), 1 visible, 0 disoccluded or outside.
    """
    size = before.shape[::-1]
    sums, total = np.zeros(expected.shape), np.zeros(expected.shape)
    for point, weight in _taps(at):
        depth = fetch(before, point)
        with np.errstate(divide="ignore", invalid="ignore"):
            clear = np.where(
                (depth > 0) & (expected > depth), np.minimum(tolerance * depth / (expected - depth), 1), 1.0
            )
        clear = np.where(expected <= 0, depth <= 0, clear)
        weight = np.where(_inside(point, size), weight, 0.0)
        sums += weight * clear
        total += weight
    return sums / np.where(total > 0, total, 1.0)


def fsr2_motion_divergence(motion: Array, dilated: Mapping[str, Array], before: Array | None, grids: Grids) -> Array:
    """Depth clip of AMD's shader: divergence of the motion in the image and in time, (h, w) in 0 .. 1.

    ``motion`` (h, w, 2) input pixels; ``dilated``: motion and depth of fsr2_dilate; ``before``: dilated motion of the
    previous frame, None without history.
    """
    share = motion / np.array(grids.inputs)
    most, least = np.linalg.norm(share, axis=-1), np.ones(motion.shape[:2])
    for other in neighbors(share).values():  # rows from the bottom, as in the shader
        most = np.maximum(most, np.linalg.norm(other, axis=-1))
        least = np.minimum(least, (other * share).sum(axis=-1) / np.maximum(most, 1e-12) ** 2)
    space = np.clip(1 - least, 0, 1) * np.clip(most / FULL_SHARE, 0, 1)
    space = np.where(np.linalg.norm(motion, axis=-1) > STILL_PX, space, 0.0)
    if before is None:
        return space
    moved = dilated["motion"]
    at = np.clip(pixels(grids.inputs) + moved, 0, np.array(grids.inputs) - 1)
    lengths = [np.linalg.norm(m / np.array(grids.inputs), axis=-1) for m in (sample_history(before, at), moved)]
    slower = np.clip(lengths[0] / np.maximum(lengths[1], 1e-12), 0, 1)
    distance = np.linalg.norm(moved * grids.scale, axis=-1)
    time = np.where(distance > 1, (1 - slower) * np.clip((distance / 20) ** 3, 0, 1), 0.0)
    depths = np.stack(list(neighbors(dilated["depth"][..., None]).values()))[..., 0]
    step = np.where((depths > 0).all(axis=0), 1 - depths.min(axis=0) / np.maximum(depths.max(axis=0), 1e-12), 0.0)
    return np.maximum(space, np.clip(time - step, 0, 1))


def fsr2_thin_features(luminance: Array, ratio: float) -> Array:
    """Create locks: lines and dots of a luminance (h, w) -> (h, w) bool.

    A pixel brighter or darker than all dissimilar neighbors, in no 2x2 square of similar pixels."""
    around = {k: v[..., 0] for k, v in neighbors(luminance[..., None]).items()}
    similar = {k: np.maximum(luminance, v) < ratio * np.minimum(luminance, v) for k, v in around.items()}
    similar[0, 0] = np.ones(luminance.shape, dtype=bool)
    low = np.min([np.where(similar[k], 1e30, around[k]) for k in around], axis=0)
    high = np.max([np.where(similar[k], 0.0, around[k]) for k in around], axis=0)
    square = np.zeros(luminance.shape, dtype=bool)
    for y in (-1, 0):
        for x in (-1, 0):
            square |= similar[y, x] & similar[y + 1, x] & similar[y, x + 1] & similar[y + 1, x + 1]
    return ((luminance < low) | (luminance > high)) & ~square


def fsr2_new_locks(thin: Array, grids: Grids, jitter: Array) -> Array:
    """Create locks: the pixels of the result that contain the sample of a thin feature.  -> (h, w) bool."""
    locks = np.zeros(grids.output[::-1], dtype=bool)
    holder = np.floor(grids.output_from_input(pixels(grids.inputs) + jitter) + 0.5).astype(np.int64)
    holder = holder[thin & _inside(holder, grids.output)]
    locks[holder[:, 1], holder[:, 0]] = True
    return locks


def fsr2_sample_history(color: Array, at: Array) -> Array:
    """Lanczos sample of 4x4 pixels, limited to the range of the nearest 2x2.  (h, w, c) -> (..., c)."""
    base = np.floor(at)
    f = at - base
    sums, total, nearest = 0.0, 0.0, []
    for dy in range(-1, 3):
        for dx in range(-1, 3):
            tap = fetch(color, base + [dx, dy])
            weight = (lanczos2(dx - f[..., 0]) * lanczos2(dy - f[..., 1]))[..., None]
            sums, total = sums + weight * tap, total + weight
            if 0 <= dx <= 1 and 0 <= dy <= 1:
                nearest.append(tap)
    return np.clip(sums / total, np.min(nearest, axis=0), np.max(nearest, axis=0))


def fsr2_upsample(prepared: Array, at: Array, jitter: Array, sharp: Array) -> tuple[Array, Array, dict[str, Array]]:
    """Upsampling with a Lanczos kernel over 4x4 jittered samples, and the box of 3x3 of them.

    Samples outside the image repeat those at the border in the color, and have no weight.
    ``prepared`` (h, w, 3); ``at`` points of the inputs; ``sharp`` scales the kernel.  -> color (..., 3), weight (...),
    box (..., 3): least, most in RGB, between which the color is; low, high, middle, deviation in YCoCg.
    """
    size = prepared.shape[1::-1]
    pixel = at - jitter
    base, nearest = np.floor(pixel), np.floor(pixel + 0.5)
    sums, total, there = np.zeros((*at.shape[:-1], 3)), np.zeros(at.shape[:-1]), np.zeros(at.shape[:-1])
    for dy in range(-1, 3):
        for dx in range(-1, 3):
            q = base + [dx, dy]
            weight = lanczos2(sharp * np.linalg.norm(q - pixel, axis=-1))
            sums += weight[..., None] * fetch(prepared, q)
            total += weight
            there += np.where(_inside(q, size), weight, 0.0)
    m1, m2, weights = np.zeros_like(sums), np.zeros_like(sums), np.zeros_like(total)
    low, high = np.full_like(sums, np.inf), np.full_like(sums, -np.inf)
    least, most = low.copy(), high.copy()
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            q = nearest + [dx, dy]
            exists, rgb = _inside(q, size), fetch(prepared, q)
            c = ycocg_from_rgb(rgb)
            weight = np.where(exists, np.exp(-3 * ((q - pixel) ** 2).sum(axis=-1)), 0.0)
            m1, m2, weights = m1 + weight[..., None] * c, m2 + weight[..., None] * c**2, weights + weight
            least = np.where(exists[..., None], np.minimum(least, rgb), least)
            most = np.where(exists[..., None], np.maximum(most, rgb), most)
            low = np.where(exists[..., None], np.minimum(low, c), low)
            high = np.where(exists[..., None], np.maximum(high, c), high)
    middle = m1 / weights[..., None]
    deviation = np.sqrt(np.maximum(m2 / weights[..., None] - middle**2, 0.0))
    enough = total > 1e-3
    color = np.where(enough[..., None], sums / np.where(enough, total, 1.0)[..., None], rgb_from_ycocg(middle))
    box = {"least": least, "most": most, "low": low, "high": high, "middle": middle, "deviation": deviation}
    return np.clip(color, least, most), np.where(enough, np.maximum(there, 0.0), 0.0), box


def fsr2_weight_limit(reactivity: Array, moving: Array, clear: Array, change: Array, max_weight: float) -> Array:
    """Largest weight of the history.  All (...) in 0 .. 1: reactivity, motion, depth clip, shading change."""
    least = MOST_MOVING / max_weight
    limit = np.minimum(1 - reactivity, 1 + moving * (least - 1))
    limit = np.minimum(limit, np.minimum(clear, np.maximum(least, 1 - change)))
    return max_weight * np.minimum(limit, (1 - change) ** 2)


def fsr2_unstable(now: Array, deviation: Array, before: Array) -> Array:
    """Luminance (...) that returns to an older one.

    ``deviation``: of its box; ``before`` (..., 4), newest first, 0 unknown."""
    change = np.abs(now - before[..., 0])
    returns = (before[..., 1:] > 0) & (np.abs(now[..., None] - before[..., 1:]) <= 0.5 * change[..., None])
    return (before[..., 0] > 0) & (change >= FLICKER) & (deviation > FLICKER_BOX) & returns.any(axis=-1)


def fsr2_rectified(history: Array, box: Mapping[str, Array], scale: float, keep: Array, clear: Array) -> Array:
    """Rectification: history (..., 3) in RGB is drawn into the variance box, in part.

    The part of the difference that stays is, per component, the share of the distance to the middle that is inside the
    box, plus ``keep`` (locks, instability), times the square of the depth clip.  The result lies, in RGB, between the
    history and a color in the range of the samples.
    """
    reach = box["deviation"] * (1 + 0.5 * (scale - 1))
    low = np.maximum(box["low"], box["middle"] - reach)
    before = ycocg_from_rgb(history)
    clamped = np.clip(before, low, np.minimum(box["high"], box["middle"] + reach))
    apart = np.abs(before - box["middle"])
    part = np.where(clamped == before, 1.0, np.abs(clamped - box["middle"]) / np.maximum(apart, 1e-9))
    part = np.clip((part + keep[..., None]) * (clear**2)[..., None], 0, 1)
    near = np.clip(rgb_from_ycocg(clamped), box["least"], box["most"])
    kept = rgb_from_ycocg(clamped + part * (before - clamped))
    return np.clip(kept, np.minimum(near, history), np.maximum(near, history))


@dataclass(frozen=True)
class Prepared:
    """What the stages on the grid of the inputs leave: tone-mapped color, thin features, dilated values, masks."""

    color: Array  # (h, w, 3)
    thin: Array  # (h, w) bool
    motion: Array  # (h, w, 2)
    clear: Array  # (h, w)
    depth: Array  # (h, w)
    reactive: Array  # (h, w)
    transparency: Array  # (h, w)
    blocks: Array  # of fsr2_block_luminance


@dataclass(frozen=True)
class Accumulated:
    """History on the grid of the result."""

    color: Array  # (h, w, 4): tone-mapped, weight
    lock: Array  # (h, w, 3): lifetime, luminance, trust
    luminances: Array  # (h, w, 4)
    kept: Array  # (h, w): weight of history in the frame


def fsr2_accumulate(
    frame: Prepared, before: Accumulated | None, grids: Grids, jitter: Array, max_weight: float, shading_change: float
) -> Accumulated:
    """Reproject & accumulate: the state after a frame.  ``before``: None without history."""
    p, scale = pixels(grids.output), float(grids.scale.max())
    at = grids.input_from_output(p)
    pixel = at - jitter
    sample = np.floor(pixel + 0.5)
    motion = fetch(frame.motion, sample) * grids.scale
    moving = np.clip(10 * np.linalg.norm(motion, axis=-1), 0, 1)
    clear = np.clip(sample_history(frame.clear[..., None], pixel)[..., 0], 0, 1)
    reactivity = 1 - (1 - fetch(frame.reactive, sample)) ** 3
    composed = sample_history(frame.transparency[..., None], pixel)[..., 0]
    exists = inside(p + motion, grids.output) & (before is not None)
    color, lock, earlier = np.zeros((*p.shape[:2], 4)), np.zeros((*p.shape[:2], 3)), np.zeros((*p.shape[:2], 4))
    if before is not None:
        there, known = p + np.where(exists[..., None], motion, 0), exists[..., None]
        color = np.where(known, fsr2_sample_history(before.color, there), 0)
        lock = np.where(known, sample_history(before.lock, there), 0)
        earlier = np.where(known, fetch(before.luminances, np.floor(there + 0.5)), 0)
    life, luminance, trust = (lock[..., i] for i in range(3))
    shading = fsr2_shading_luminance(frame.blocks, at)
    luminance = np.where(luminance > 0, luminance, shading)
    change = 1 - np.minimum(shading, luminance) / np.maximum(shading, luminance)
    luminance = 0.5 * (luminance + shading)
    fresh, locked = fsr2_new_locks(frame.thin, grids, jitter), trust > 0
    life = np.where(fresh, np.where(life > 0, 2.0, 1.0), life)
    life = np.where((change > shading_change) | (~fresh & (clear < 0.99)), 0.0, life)
    limit = fsr2_weight_limit(reactivity, moving, clear, change, max_weight)
    weight = np.minimum(color[..., 3], np.where(fresh & ~locked, MOST_MOVING, limit))
    trust = np.minimum(trust, np.minimum(1 - np.cbrt(reactivity), clear))
    bias = np.clip((weight - 0.5) / 3, 0, 1) * (1 - composed)
    sharp = 1 + (scale - 1) * bias * np.minimum(trust, 1 - reactivity)
    sharp = np.where(exists, np.minimum(sharp * (0.5 + 0.5 * clear), 1.99), 1.0)
    new, new_weight, box = fsr2_upsample(frame.color, at, jitter, sharp)
    luma = ycocg_from_rgb(new)[..., 0]
    keep = np.clip(4 * life, 0, 1) * (1 - reactivity) * (composed < 0.9)
    steady = np.max([1 - clear, composed, change], axis=0) < STEADY
    keep = np.maximum(keep, steady & fsr2_unstable(luma, box["deviation"][..., 0], earlier))
    history = np.where((weight > 0)[..., None], fsr2_rectified(color[..., :3], box, scale, keep, clear), color[..., :3])
    total = weight + new_weight
    share = np.where(weight > 0, new_weight / np.where(total > 0, total, 1), 1.0)
    mixed = history + share[..., None] * (new - history)
    total = np.minimum(total, max_weight + moving * (MOST_MOVING - max_weight))
    total = np.maximum(total - new_weight * reactivity, 0)
    life = np.maximum(life - new_weight / (MEAN_WEIGHT * np.ceil(8 * grids.scale.prod())), 0)
    trust = np.minimum(1, trust + new_weight / TRUST_WEIGHT)
    return Accumulated(
        np.dstack([mixed, total]),
        np.dstack([life, luminance, trust]),
        np.dstack([luma, earlier[..., :3]]),
        1 - share,
    )


def fsr2_rcas(rgb: Array, sharpness: float) -> Array:
    """Robust Contrast Adaptive Sharpening of colors in 0 .. 1.  (h, w, 3) -> (h, w, 3).

    White is halfway from the brightest of the five pixels to 1."""
    cross = np.stack([shifted(rgb, dx, dy)[0] for dx, dy in ((-1, 0), (1, 0), (0, -1), (0, 1))])
    low, high = cross.min(axis=0), cross.max(axis=0)
    to_black = np.minimum(low, rgb) / np.maximum(4 * high, 1e-6)
    bright = np.maximum(high, rgb)
    white = 0.5 + 0.5 * bright.max(axis=-1, keepdims=True)
    to_white = (white - bright) / np.minimum(4 * low - 4 * white, -1e-6)
    lobe = np.clip(np.maximum(-to_black, to_white).max(axis=-1, keepdims=True), -3 / 16, 0)
    lobe = lobe * 2.0 ** (-2 * (1 - sharpness))
    return np.clip((lobe * cross.sum(axis=0) + rgb) / (4 * lobe + 1), 0, white)


def fsr2_shown(color: Array, sharpness: float | None) -> Array:
    """The result of the accumulated color (h, w, >= 3): radiance, sharpened unless ``sharpness`` is None."""
    rgb = np.clip(color[..., :3], 0, 1)
    return fsr2_radiance(rgb if sharpness is None else fsr2_rcas(rgb, sharpness))
