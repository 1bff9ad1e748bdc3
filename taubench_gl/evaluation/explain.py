"""One pixel of a pair explained: current values, history, distances against thresholds, and the reason in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np

from taubench_gl.conventions import FRUSTUM, GUARD_PX, NOT_COMPARABLE, Reason
from taubench_gl.features import BY_BIT, FEATURE, FEATURE_BIT, FEATURES, GEOMETRY
from taubench_gl.frame.passes.masks import ComparedSource
from taubench_gl.frame.targets import read_texel, read_texels
from taubench_gl.glossary import label_of
from taubench_gl.gpu.context import Gpu
from taubench_gl.metrics.masks import compare, sample_history, value_of
from taubench_gl.metrics.reprojection import NEAR_GUARD, Reprojection
from taubench_gl.settings import Settings

Array = np.ndarray


@runtime_checkable
class KnowsPreviousPosition(Protocol):
    """A source that has the scene, so that it can follow a surface point."""

    def previous_position(self, position: Array) -> Array | None:
        """Where the surface points at ``position`` were in the frame before; None where nothing is known of them."""


@dataclass(frozen=True, slots=True)
class MaskedPair:
    """A pair whose masks were computed, as it lies on the GPU."""

    gpu: Gpu
    source: ComparedSource  # channels of both frames
    mask: Any  # texture of mask words (r32ui)
    motion: Any  # texture of motion (rg32f), GL rows
    pair: Reprojection
    settings: Settings  # sampling and exposure of the masks
    thresholds: Mapping[str, float]  # of the masks, position in scene units


@dataclass(frozen=True, slots=True)
class FeatureValues:
    """Values of one feature at one pixel, now and in its history; ``distance`` is None if they are not comparable."""

    current: Array  # (3,) float64
    history: Array | None
    distance: float | None  # in the unit of the feature; position: scene units
    threshold: float
    discarded: bool


@dataclass(frozen=True, slots=True)
class Explanation:
    """Why one pixel can or cannot be reused; ``str(...)`` is the reason in words.

    Pixels are (x, row from the top); ``at``, the history position, is None where there is none.
    """

    pixel: tuple[int, int]
    word: int  # bits of conventions.Reason
    motion_px: tuple[float, float]  # previous - current, +y down
    at: tuple[float, float] | None
    features: Mapping[str, FeatureValues]
    reason: str
    object_motion_m: float | None = None  # distance by which the surface point itself moved; None: not determined
    motion_word: int | None = None  # ``word`` under motion reprojection, bits of the comparison; None: not determined
    vector_px: tuple[float, float] | None = None  # as ``motion_px``, the motion that files store; None: they have none
    history: str = "frame"  # or ``eye``: the image compared with

    def __str__(self) -> str:
        return self.reason


def explain_pixel(images: MaskedPair, x: int, row: int) -> Explanation:
    """Explain pixel (x, row) of a pair.  Distances are those of the float64 reference (``metrics.masks``)."""
    source, pair, thresholds = images.source, images.pair, images.thresholds
    up = pair.height - 1 - row
    names = [n for n in (*GEOMETRY, *source.radiance, *source.others) if FEATURE[n].channel in source.current]
    now = {n: value_of(n, read_texel(images.gpu, source.current[FEATURE[n].channel], x, up)[None]) for n in names}
    word = int(read_texel(images.gpu, images.mask, x, up)[0])
    motion = read_texel(images.gpu, images.motion, x, up)
    comparable = not word & (Reason.FIRST | Reason.CUT | Reason.INVALID | FRUSTUM)
    at_up = (x + float(motion[0]), up + float(motion[1]))
    before: dict[str, Array] | None = None
    distances: dict[str, Array] = {}
    if comparable:
        surface = now["position"][0, 3] > 0
        before = _history(images, names, at_up, surface)
        q = now["position"][:, :3] + pair.camera_delta
        if source.reprojection == "motion" and surface:
            q = read_texel(images.gpu, source.current["prev_position"], x, up)[None, :3].astype(np.float64)
        _, distances = compare(now, q, before, thresholds, images.settings.lighting.exposure_factor)
    features = {}
    for name in FEATURES:
        if name not in now:
            continue
        distance = float(distances[name][0]) if name in distances else np.nan
        features[name] = FeatureValues(
            now[name][0, :3],
            None if before is None else before[name][0, :3],
            None if np.isnan(distance) else distance,
            thresholds[name],
            bool(word & FEATURE_BIT[name]),
        )
    behind = bool(word & (Reason.BEHIND | Reason.FIRST | Reason.CUT | Reason.INVALID))
    at = None if behind else (at_up[0], pair.height - 1 - at_up[1])
    history = images.settings.metrics.history
    moved = (float(motion[0]), -float(motion[1]) + 0.0)
    explanation = Explanation((x, row), word, moved, at, features, in_words(word, history), history=history)
    if "vectors" in source.current:
        stored = read_texel(images.gpu, source.current["vectors"], x, up)
        explanation = replace(explanation, vector_px=(float(stored[0]), -float(stored[1]) + 0.0))
    if comparable and source.reprojection == "camera" and word & (Reason.POSITION | Reason.NORMAL):
        return _with_object_motion(explanation, images, now)
    return explanation


def with_light(geometry: Explanation, light: Explanation) -> Explanation:
    """The explanation ``geometry`` with the features of light of the same place in a coarser image of the pair."""
    parts = ((geometry, False), (light, True))
    values = {n: f for part, lit in parts for n, f in part.features.items() if FEATURE[n].light == lit}
    features = {n: values[n] for n in FEATURES if n in values}
    if geometry.word & NOT_COMPARABLE:
        return replace(geometry, features=features)
    bits = sum(int(bit) for n in values if FEATURE[n].light for bit in (FEATURE_BIT[n], *FEATURE[n].details))
    word = geometry.word | light.word & bits
    reason, history = geometry.reason, geometry.history
    if reason == in_words(geometry.word, history):
        reason = in_words(word, history)
    return replace(geometry, word=word, features=features, reason=reason)


def _with_object_motion(explanation: Explanation, images: MaskedPair, now: Mapping[str, Array]) -> Explanation:
    """``explanation`` with what motion reprojection would give.

    Without motion vectors, a surface that moves is compared with what was at its place, often itself: no occluder.
    """
    source, pair = images.source, images.pair
    p = now["position"][0, :3]
    if not now["position"][0, 3] > 0 or not isinstance(source, KnowsPreviousPosition):
        return explanation
    previous = source.previous_position(p)
    if previous is None:
        return explanation
    motion = float(np.linalg.norm(previous - p))
    meters = motion / images.settings.metrics.unit_scale
    q = previous + pair.camera_delta
    word = _motion_word(images, explanation.pixel, now, q)
    threshold = images.thresholds["position"]
    helps = not word & (FRUSTUM | Reason.POSITION | Reason.NORMAL)
    words = explanation.reason
    if motion > 1e-3 * threshold and (helps or motion > threshold):
        then = f": {in_words(word, explanation.history)}" if word else " it would be reusable"
        words = f"it moved {meters:.3g} m itself; with motion vectors{then}"
    return replace(explanation, reason=words, object_motion_m=meters, motion_word=word)


def _motion_word(images: MaskedPair, pixel: tuple[int, int], now: Mapping[str, Array], q: Array) -> int:
    """Reason bits of a pixel whose surface point was at ``q``, relative to the previous camera."""
    pair = images.pair
    if q @ pair.prev_forward <= pair.prev_near * (1.0 - NEAR_GUARD):
        return int(Reason.BEHIND)
    size = np.array([pair.width, pair.height])
    ends = [(pair.clip_from_current, now["position"][0, :3]), (pair.prev_clip_from_prev, q)]
    clips = [matrix @ np.append(point, 1.0) for matrix, point in ends]
    motion = 0.5 * size * (clips[1][:2] / clips[1][3] - clips[0][:2] / clips[0][3])
    at = np.array([pixel[0], pair.height - 1 - pixel[1]]) + motion
    if np.any(at < -GUARD_PX) or np.any(at > size - 1 + GUARD_PX):
        return int(Reason.OUTSIDE)
    before = _history(images, list(now), (float(at[0]), float(at[1])), True)
    bits, _ = compare(now, q[None], before, images.thresholds, images.settings.lighting.exposure_factor)
    return int(bits[0])


def _history(images: MaskedPair, names: list[str], at_up: tuple[float, float], surface: bool) -> dict[str, Array]:
    """History at a position, y up, sampled as in the masks from the four pixels around it.  {name: (1, n)}."""
    width, height = images.pair.width, images.pair.height
    x0 = min(max(int(np.floor(at_up[0])), 0), max(width - 2, 0))
    y0 = min(max(int(np.floor(at_up[1])), 0), max(height - 2, 0))
    across, rows = min(2, width), min(2, height)
    block = {}
    for name in names:
        texture = images.source.previous[FEATURE[name].channel]
        # GL's row 0 is at the bottom
        block[name] = value_of(name, read_texels(images.gpu, texture, x0, y0, across, rows)[::-1])
    local = np.array([[at_up[0] - x0, (rows - 1) - (at_up[1] - y0)]])
    return sample_history(images.settings.metrics.sampling, block, local, np.array([surface]))


def in_words(word: int, history: str = "frame") -> str:
    """A reason mask as a phrase with the labels of the glossary.  Sky is named first; it is neither reused nor not."""
    r, words = Reason(word), _reasons_in_words(word, "other eye" if history == "eye" else "previous frame")
    if not r & Reason.SKY or words.startswith("sky"):
        return words or "reusable"
    return f"sky; {words}" if words else "sky"


def _reasons_in_words(word: int, image: str) -> str:
    """The reasons of the mask ``word`` in words, an empty text for none; ``image``: what history is, in words."""
    r = Reason(word)
    for reason in (Reason.FIRST, Reason.CUT, Reason.INVALID):
        if r & reason:
            return f"not classified: {label_of(reason)}"
    for reason in (Reason.BEHIND, Reason.OUTSIDE):
        if r & reason:
            return f"frustum: {label_of(reason)} in the {image}"
    parts = []
    if r & Reason.SKY and not r & Reason.HISTORY_SKY:
        parts.append("sky, a surface in history")
    elif r & Reason.HISTORY_SKY and not r & Reason.SKY:
        parts.append("a surface, sky in history")
    for feature in BY_BIT:
        if r & feature.bit and not (feature.name in GEOMETRY and r & (Reason.SKY | Reason.HISTORY_SKY)):
            detail = [label_of(d) for d in feature.details if r & d]
            parts.append(f"{feature.name}: {detail[0] if detail else 'above the threshold'}")
    return "; ".join(parts)
