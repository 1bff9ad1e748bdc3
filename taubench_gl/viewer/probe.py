"""One pixel: current values, history, distances against thresholds, and the reason in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import moderngl
import numpy as np

from taubench_gl.conventions import FEATURES, FRUSTUM, Reason
from taubench_gl.glossary import label_of
from taubench_gl.gpu.context import Gpu
from taubench_gl.metrics.masks import SAMPLERS, compare
from taubench_gl.viewer.engine import ViewerEngine
from taubench_gl.viewer.state import ViewerState

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class FeatureProbe:
    """One feature at one pixel; ``distance`` is None if the pixel is not comparable."""

    current: Array
    history: Array | None
    distance: float | None
    threshold: float
    discarded: bool


@dataclass(frozen=True, slots=True)
class Probe:
    """``pixel`` and its history position ``at`` as (x, row from the top), pixels; ``at`` is None without one."""

    pixel: tuple[int, int]
    word: int
    motion_px: tuple[float, float]  # previous - current, +y down
    at: tuple[float, float] | None
    features: Mapping[str, FeatureProbe]
    reason: str


def probe_pixel(engine: ViewerEngine, state: ViewerState, x: int, row: int) -> Probe:
    """Probe pixel (x, row) of the current pair.  Distances are those of the float64 reference (``metrics.masks``)."""
    source, evaluator, gpu = engine.feed.source, engine.evaluator, engine.gpu
    _, height = engine.feed.size
    up = height - 1 - row
    names = [n for n in ("position", "normal", *source.radiance) if n in source.current]
    now = {n: texel(gpu, source.current[n], x, up)[None].astype(np.float64) for n in names}
    word = int(texel(gpu, evaluator.mask_texture, x, up)[0])
    motion = texel(gpu, evaluator.motion_texture, x, up)
    comparable = not word & (Reason.FIRST | Reason.CUT | Reason.INVALID | FRUSTUM)
    at_up = (x + float(motion[0]), up + float(motion[1]))
    before: dict[str, Array] | None = None
    distances: dict[str, Array] = {}
    if comparable:
        before = _history(engine, names, at_up, now["position"][0, 3] > 0)
        q = now["position"][:, :3] + engine.pair.camera_delta
        if source.reprojection == "motion" and now["position"][0, 3] > 0:
            q = texel(gpu, source.current["prev_position"], x, up)[None, :3].astype(np.float64)
        cut = {n: v if n == "position" else v[:, :3] for n, v in now.items()}
        then = {n: v if n == "position" else v[:, :3] for n, v in before.items()}
        _, distances = compare(cut, q, then, state.thresholds, engine.feed.settings.lighting.exposure_factor)
    features = {}
    for name in FEATURES:
        if name not in now:
            continue
        distance = float(distances[name][0]) if name in distances else np.nan
        features[name] = FeatureProbe(
            now[name][0, :3],
            None if before is None else before[name][0, :3],
            None if np.isnan(distance) else distance,
            state.thresholds[name],
            bool(word & Reason[name.upper()]),
        )
    behind = bool(word & (Reason.BEHIND | Reason.FIRST | Reason.CUT | Reason.INVALID))
    at = None if behind else (at_up[0], height - 1 - at_up[1])
    moved = (float(motion[0]), -float(motion[1]) + 0.0)
    return Probe((x, row), word, moved, at, features, in_words(word))


def texel(gpu: Gpu, texture: moderngl.Texture, x: int, y: int) -> Array:
    """One texel, y up.  (components,) in the type of the texture."""
    framebuffer = gpu.ctx.framebuffer([texture])
    kind = {"f4": np.float32, "f2": np.float16, "u4": np.uint32}[texture.dtype]
    data = framebuffer.read((x, y, 1, 1), components=texture.components, dtype=texture.dtype, alignment=1)
    gpu.unbind_framebuffer()
    framebuffer.release()
    return np.frombuffer(data, dtype=kind)


def _history(engine: ViewerEngine, names: list[str], at_up: tuple[float, float], surface: bool) -> dict[str, Array]:
    """History at a position, y up, sampled as in the masks from the four pixels around it.  {name: (1, n)}."""
    width, height = engine.feed.size
    x0 = min(max(int(np.floor(at_up[0])), 0), max(width - 2, 0))
    y0 = min(max(int(np.floor(at_up[1])), 0), max(height - 2, 0))
    across, rows = min(2, width), min(2, height)
    block = {}
    for name in names:
        texture = engine.feed.source.previous[name]
        taps = [[texel(engine.gpu, texture, x0 + i, y0 + j) for i in range(across)] for j in reversed(range(rows))]
        block[name] = np.array(taps, dtype=np.float64)[..., : 4 if name == "position" else 3]
    local = np.array([[at_up[0] - x0, (rows - 1) - (at_up[1] - y0)]])
    return SAMPLERS[engine.feed.settings.metrics.sampling](block, local, np.array([surface]))


def in_words(word: int) -> str:
    """A reason mask as a phrase with the labels of the glossary."""
    r = Reason(word)
    for reason in (Reason.FIRST, Reason.CUT, Reason.INVALID):
        if r & reason:
            return f"not classified: {label_of(reason)}"
    for reason in (Reason.BEHIND, Reason.OUTSIDE):
        if r & reason:
            return f"frustum: {label_of(reason)} in the previous frame"
    parts = []
    if r & Reason.SKY and not r & Reason.HISTORY_SKY:
        parts.append("sky, a surface in history")
    elif r & Reason.HISTORY_SKY and not r & Reason.SKY:
        parts.append("a surface, sky in history")
    elif r & Reason.POSITION:
        detail = [label_of(d) for d in (Reason.DISOCCLUDED, Reason.OCCLUDING) if r & d]
        parts.append(f"position: {detail[0] if detail else 'above the threshold'}")
    if r & Reason.NORMAL and not r & (Reason.SKY | Reason.HISTORY_SKY):
        parts.append("normal: above the threshold")
    if r & Reason.DIRECT:
        detail = [label_of(d) for d in (Reason.LIT, Reason.SHADOWED) if r & d]
        parts.append(f"direct: {detail[0] if detail else 'above the threshold'}")
    parts += [f"{label_of(reason)}: above the threshold" for reason in (Reason.INDIRECT, Reason.COLOR) if r & reason]
    return "; ".join(parts) or "reusable"
