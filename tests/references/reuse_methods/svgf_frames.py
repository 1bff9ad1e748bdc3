"""The stages of SVGF (Schied et al. 2017) around its filter, and whole frames of it.

``Svgf`` composes the stages as taubench_gl/reuse/methods/svgf does; each stage is a function of its own, here or in
``svgf``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from references.reuse_methods.history import (
    consistent_blend,
    exponential_average,
    inside,
    nearest_surface,
    previous_px,
    sample_history,
)
from references.reuse_methods.svgf import EdgeStopping, atrous_level, moments_variance, spatial_variance
from references.reuse_methods.taa import clip_to_box, neighborhood_box, rgb_from_ycocg, ycocg_from_rgb
from taubench_gl.metrics.color import TONE_MAPS
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray
Accept = Callable[[Array, Array], Array]

ALBEDO_FLOOR = 0.01
"""Black surfaces still have highlights, which the division by albedo must preserve."""

MAX_FRAMES, MAX_MAPPED = 256.0, 0.999999


def albedo_of(inputs: Mapping[str, Array]) -> Array:
    """Albedo for demodulation and modulation, at least ALBEDO_FLOOR.  -> (h, w, 3)."""
    return np.maximum(inputs["base_color"][..., :3].astype(np.float64), ALBEDO_FLOOR)


def demodulated(inputs: Mapping[str, Array], exposure: float) -> tuple[Array, Array]:
    """Section 4: direct and indirect light divided by albedo, without emission; on sky pixels radiance and 0.

    ``inputs``: names of reuse.frame.INPUTS, row 0 at the top.  -> direct, indirect (h, w, 3).
    """
    surface = inputs["position"][..., 3:] > 0
    radiance, direct = (inputs[n][..., :3].astype(np.float64) for n in ("radiance", "direct"))
    indirect = radiance - exposure * inputs["emission"][..., :3] - direct
    albedo = albedo_of(inputs)
    return np.where(surface, direct / albedo, direct), np.where(surface, indirect / albedo, 0.0)


def consistent_history(
    inputs: Mapping[str, Array], prev_forward: Array, depth_limit: float, normal_limit: float, check_ids: bool = True
) -> Accept:
    """Section 4.1: which history pixel shows the surface of a pixel.

    ``prev_forward`` (3,): unit view direction of the previous camera.  -> function of row, column (h, w) int each.
    """
    i = {n: np.asarray(inputs[n], dtype=np.float64) for n in ("prev_position", "history_position", "normal",
                                                              "history_normal")}  # fmt: skip
    surface = inputs["position"][..., 3] > 0
    expected = i["prev_position"][..., :3] @ prev_forward

    def accept(row: Array, column: Array) -> Array:
        depth = i["history_position"][row, column, 3]
        good = np.abs(depth - expected) <= depth_limit * expected
        good &= (i["history_normal"][row, column, :3] * i["normal"][..., :3]).sum(-1) >= normal_limit
        if check_ids:
            good &= inputs["history_ids"][row, column, 0] == inputs["ids"][..., 0]
        return ((depth > 0) == surface) & (good | ~surface)

    return accept


def reprojected(values: Array, at: Array, accept: Accept, has_history: bool) -> tuple[Array, Array]:
    """Section 4.1: 2x2 taps; where none is accepted, the mean of the accepted ones of 3x3.

    -> history (h, w, c), 0 where there is none, and where there is one (h, w) bool.
    """
    h, w = values.shape[:2]
    seen = inside(at, (w, h)) & has_history
    at = np.where(seen[..., None], at, 0.0)
    kept, total = consistent_blend(values, at, accept)
    middle = np.floor(at[..., 0] + 0.5).astype(int), (h - 1) - np.floor((h - 1) - at[..., 1] + 0.5).astype(int)
    sums, count = np.zeros_like(kept), np.zeros(total.shape)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            column, row = middle[0] + dx, middle[1] + dy
            there = (column >= 0) & (row >= 0) & (column < w) & (row < h)
            column, row = np.clip(column, 0, w - 1), np.clip(row, 0, h - 1)
            good = there & accept(row, column)
            sums += good[..., None] * values[row, column]
            count += good
    kept = np.where((total > 0)[..., None], kept, sums / np.maximum(count, 1)[..., None])
    alive = seen & ((total > 0) | (count > 0))
    return np.where(alive[..., None], kept, 0.0), alive


def new_weight(count: Array, alive: Array, alpha: Array | float) -> Array:
    """Weight of the new frame as the ``count``-th of a mean: max(1 / count, alpha), and 1 without history."""
    return np.where(alive, np.maximum(1.0 / count, alpha), 1.0)


def luminance_moments(light: Array) -> Array:
    """Section 4.2: luminance and its square.  (h, w, 3) -> (h, w, 2)."""
    luminance = light @ LUMINANCE
    return np.stack([luminance, luminance**2], axis=-1)


def modulated(inputs: Mapping[str, Array], light: Array, exposure: float) -> Array:
    """Section 4: light times albedo, plus emission; on sky pixels the light.  -> (h, w, 3) linear."""
    surface = inputs["position"][..., 3:] > 0
    return np.where(surface, light * albedo_of(inputs) + exposure * inputs["emission"][..., :3], light)


def tone_mapped(linear: Array) -> Array:
    """Reinhard et al. 2002, Eq. (3), per channel, of radiance up to 1e6."""
    return TONE_MAPS["reinhard"](np.clip(linear, 0.0, 1e6))


def tone_unmapped(mapped: Array) -> Array:
    """The inverse."""
    mapped = np.clip(mapped, 0.0, MAX_MAPPED)
    return mapped / (1.0 - mapped)


def antialiased(
    mapped: Array,
    before: Array,
    inputs: Mapping[str, Array],
    alpha: float,
    has_history: bool,
    filtering: str = "catmull_rom",
) -> tuple[Array, Array]:
    """Karis 2014, on tone-mapped colors: history of the nearest surface, clipped to the rounded box of 3x3 colors.

    -> color (h, w, 3), where history was used (h, w) bool.
    """
    h, w = mapped.shape[:2]
    nearest = nearest_surface(inputs["position"][..., 3])
    at = previous_px(inputs["motion"][nearest[..., 1], nearest[..., 0]])
    seen = inside(at, (w, h)) & has_history
    low, high = neighborhood_box(mapped)
    history = sample_history(before, np.where(seen[..., None], at, 0.0), filtering)
    history = clip_to_box(low, high, ycocg_from_rgb(history))
    blend = exponential_average(mapped, rgb_from_ycocg(history), alpha)
    return np.where(seen[..., None], blend, mapped), seen


@dataclass
class Svgf:
    """Frames of SVGF in order; the settings are those of the method.

    ``state``: history of the next frame, (h, w, c) each: direct and indirect light, moments, frames, anti-aliased
    color.
    """

    alpha: float = 0.2
    alpha_moments: float = 0.2
    levels: int = 5
    sigma_z: float = 1.0
    sigma_n: float = 128.0
    sigma_l: float = 4.0
    depth_limit: float = 0.02
    normal_limit: float = 0.9
    check_ids: bool = True
    taa: bool = False
    taa_alpha: float = 0.1
    taa_filtering: str = "catmull_rom"
    state: dict[str, Array] = field(default_factory=dict)

    def frame(self, inputs: Mapping[str, Array], prev_forward: Array, exposure: float = 1.0) -> Array:
        """The result: linear radiance and the weight of history.  -> (h, w, 4)."""
        lights = demodulated(inputs, exposure)
        had = bool(self.state)
        lights, moments, count, share = self.temporal_filter(inputs, prev_forward, lights)
        lights = self.filtered(inputs, lights, moments, count)
        self.state["frames"] = count[..., None]
        self.state["moments"] = np.concatenate(moments, axis=-1)
        return self.finished(inputs, lights, share, exposure, had)

    def new_frame_weights(self, frames: Array, alive: Array) -> tuple[Array, Array, Array]:
        """Frames that count as history, and weights of the new frame in light and moments.  (h, w) each."""
        light, moments = (new_weight(frames + 1.0, alive, alpha) for alpha in (self.alpha, self.alpha_moments))
        return frames, light, moments

    def temporal_filter(
        self, inputs: Mapping[str, Array], prev_forward: Array, lights: tuple[Array, Array]
    ) -> tuple[list[Array], list[Array], Array, Array]:
        """Section 4.1.  -> lights (h, w, 3), their moments (h, w, 2), frames (h, w), weight of the new frame (h, w)."""
        h, w = lights[0].shape[:2]
        accept = consistent_history(inputs, prev_forward, self.depth_limit, self.normal_limit, self.check_ids)
        names = ("direct", "indirect", "moments", "frames")
        widths = (3, 3, 4, 1)
        before = [self.state.get(n, np.zeros((h, w, c))) for n, c in zip(names, widths)]
        kept, alive = reprojected(
            np.concatenate(before, axis=-1), previous_px(inputs["motion"]), accept, bool(self.state)
        )
        kept_direct, kept_indirect, kept_moments, kept_frames = np.split(kept, np.cumsum(widths)[:-1], axis=-1)
        frames, share, share_moments = self.new_frame_weights(kept_frames[..., 0], alive)
        count = frames + 1.0
        blended = [exponential_average(now, old, share[..., None])
                   for now, old in zip(lights, (kept_direct, kept_indirect))]  # fmt: skip
        moments = [exponential_average(luminance_moments(now), old, share_moments[..., None])
                   for now, old in zip(lights, (kept_moments[..., :2], kept_moments[..., 2:]))]  # fmt: skip
        return blended, moments, np.minimum(count, MAX_FRAMES), share

    def filtered(
        self, inputs: Mapping[str, Array], lights: list[Array], moments: list[Array], count: Array
    ) -> list[Array]:
        """Sections 4.2 to 4.4: variance estimates and a-trous levels; the first level becomes history."""
        position, normal = (np.asarray(inputs[n], dtype=np.float64) for n in ("position", "normal"))
        edges = EdgeStopping(position[..., 3], normal[..., :3], self.sigma_z, self.sigma_n, self.sigma_l)
        few, out = count <= 3.5, []
        for name, light, moment in zip(("direct", "indirect"), lights, moments):
            variance = np.where(few, spatial_variance(moment, edges), moments_variance(moment[..., 0], moment[..., 1]))
            for level in range(self.levels):
                light, variance = atrous_level(light, variance, edges, level)
                if level == 0:
                    self.state[name] = light
            out.append(light)
        return out

    def finished(
        self, inputs: Mapping[str, Array], lights: list[Array], share: Array, exposure: float, has_history: bool
    ) -> Array:
        """Modulation, tone map and final anti-aliasing.  -> (h, w, 4)."""
        mapped = tone_mapped(modulated(inputs, lights[0] + lights[1], exposure))
        before = self.state.get("antialiased", np.zeros_like(mapped))
        had = has_history and self.taa
        color, used = antialiased(mapped, before, inputs, self.taa_alpha, had, self.taa_filtering)
        self.state["antialiased"] = color
        share = np.where(used, share * self.taa_alpha, share)
        return np.concatenate([tone_unmapped(color), 1.0 - share[..., None]], axis=-1)
