"""Parameters that trade accuracy for time: their values, the columns they may change, and when they are inapplicable.

A parameter of kind ``accuracy`` approximates the same masks better or worse.  One of kind ``grid`` changes the pixels
or the pairs, so that masks cannot be compared pixel by pixel: its columns are compared, in a table of their own.  It is
on no Pareto front and in no preset.  What changes the metric itself, such as the frame rate, is no parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.effects.decide import Effect
from taubench_gl.effects.lighting import environment_of
from taubench_gl.effects.path_tracing import traced_sources
from taubench_gl.features import LIGHT_FEATURES
from taubench_gl.frame.shadow_faces import faces_of, map_sizes, pack, wanted_sizes
from taubench_gl.metrics.pair_sample import sample_pairs
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings, scheme_of

TRACED = "path-traced"
"""Value of ``light`` with its samples per pixel: path-traced@16."""

CPU_FLOAT64 = "double"
"""Value of ``storage``: float32 channels of the GPU, masks by the float64 reference on the CPU."""

MIN_SAMPLED_PAIRS = 3
"""Fewer sampled pairs give no usable confidence interval."""


@dataclass(frozen=True, slots=True)
class StudyContext:
    """What decides whether a parameter is applicable."""

    scene: Scene
    effects: Mapping[str, Effect]
    baseline: Settings
    pairs: int
    ranked_lights: tuple[int, ...] = ()  # rows of the light table, the most significant first
    max_texture: int = 16384  # texels along a side, a limit of the device

    def disabled(self, effect: str) -> str | None:
        """Why ``effect`` is disabled; None where it is enabled."""
        return None if self.effects[effect].enabled else self.effects[effect].reason


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter.  ``values`` run from the coarsest to the most exact; ``best`` is the highest-quality value.

    ``best`` None: the highest quality has the baseline's value.
    """

    name: str
    doc: str
    values: tuple[Any, ...]
    best: Any
    phrase: Callable[[Any], str]  # a value in words
    kind: str = "accuracy"  # accuracy | grid
    inapplicable: Callable[[StudyContext], str | None] = lambda c: None  # why no value changes anything
    inapplicable_value: Callable[[StudyContext, Any], str | None] = lambda c, v: None  # why one value does not

    def value_in(self, settings: Settings) -> Any:
        """The value that ``settings`` have.  ``scale`` is relative to them: 1."""
        if self.name == "light":
            method = settings.lighting.light
            return f"{TRACED}@{settings.lighting.path_samples}" if method == TRACED else method
        if self.name == "indirect" and settings.lighting.indirect == "auto":
            return "probes"
        return 1.0 if self.name == "scale" else settings.get(self.name)

    def apply(self, settings: Settings, value: Any) -> Settings:
        """``settings`` with this parameter at ``value``."""
        if self.name == "scale":
            sequence = settings.sequence
            width, height = (max(1, round(side * value)) for side in (sequence.width, sequence.height))
            return settings.replace(width=width, height=height)
        if self.name == "light":
            return with_light(settings, value)
        if self.name == "storage" and value == CPU_FLOAT64:
            return settings
        return settings.replace(**{self.name: value})


def with_light(settings: Settings, value: str) -> Settings:
    """``settings`` with the light method ``raster``, or ``path-traced@N``: N samples per pixel, pattern fixed; paths as
    those of the reference, or of ``settings`` if they are path-traced already."""
    method, _, samples = value.partition("@")
    if method != TRACED:
        return settings.replace(light=method)
    bidirectional = settings.lighting.bidirectional or settings.lighting.light != TRACED
    return settings.replace(
        light=method, spp=int(samples), pattern="fixed", indirect="auto", bidirectional=bidirectional
    )


def _bad_pair_sample(context: StudyContext, value: str) -> str | None:
    if value == "all":
        return None
    count = len(sample_pairs(context.pairs, *scheme_of(value)).positions)
    if count < MIN_SAMPLED_PAIRS:
        return f"{context.pairs} pairs are too few for {value}"
    return f"{value} evaluates all pairs" if count == context.pairs else None


def _more_than_all_lights(context: StudyContext, value: int) -> str | None:
    lights = len(context.scene.light_nodes) + (environment_of(context.baseline).sun is not None)
    below = [v for v in PARAMETERS["shadow_lights"].values if v < value]
    return f"the scene has {lights} lights" if below and below[-1] >= lights else None


def _too_large_an_atlas(context: StudyContext, size: int) -> str | None:
    """All shadow maps share one texture, whose size the device limits."""
    ranked = context.ranked_lights[: context.baseline.lighting.shadow_lights]
    sun = environment_of(context.baseline).sun
    wanted = wanted_sizes(ranked, size)
    if map_sizes(context.scene, ranked, size, context.max_texture, sun) == wanted:
        return None
    faces = faces_of(context.scene, None, sorted(ranked), (np.zeros(3), 1.0), wanted, sun)
    width, height = pack(faces, context.max_texture)[1]
    return f"{len(faces)} shadow maps of that size need {width}x{height} texels; the limit is {context.max_texture}"


def _without(effect: str) -> Callable[[StudyContext], str | None]:
    return lambda context: context.disabled(effect)


def _without_raster_indirect(context: StudyContext) -> str | None:
    return "light is path-traced" if context.effects["path_traced"].enabled else context.disabled("indirect")


def _without_light(context: StudyContext) -> str | None:
    lit = traced_sources(context.scene, with_light(context.baseline, f"{TRACED}@1"))
    return None if lit and set(LIGHT_FEATURES) & set(context.baseline.metrics.columns) else "nothing is lit"


def _same_light(context: StudyContext, value: str) -> str | None:
    if value == "raster" and not traced_sources(context.scene, context.baseline):
        return "the baseline's light is of the raster method"
    return None


def _without_probes(context: StudyContext) -> str | None:
    if reason := _without_raster_indirect(context):
        return reason
    method = {"auto": "probes"}.get(context.baseline.lighting.indirect, context.baseline.lighting.indirect)
    return None if method == "probes" else f"the indirect-light method is {method}"


def _phrase_light(value: str) -> str:
    method, _, samples = value.partition("@")
    return f"{method}, {samples} spp" if samples else f"{method} light"


def _phrase_pairs(value: str) -> str:
    scheme, _, number = value.partition(":")
    return {
        "all": "all pairs",
        "every": {"2": "every other pair", "3": "every third pair"}.get(number, f"every {number}th pair"),
        "strata": f"two pairs from each of {number} strata",
    }[scheme]


PARAMETERS: dict[str, Parameter] = {
    parameter.name: parameter
    for parameter in (
        Parameter(
            "scale", "image size relative to --size; larger pixels also discard a wider strip at the image edge",
            (0.25, 0.5, 0.75, 1.0), None, lambda v: f"{100 * v:g} % resolution", kind="grid",
        ),
        Parameter(
            "pairs", "pairs to evaluate: every k-th, or two from each of H strata",
            ("every:8", "strata:2", "every:4", "strata:4", "strata:8", "every:2", "all"), None, _phrase_pairs,
            kind="grid", inapplicable_value=_bad_pair_sample,
        ),
        Parameter(
            "samples_per_pixel", "sub-pixel positions at which both frames of a pair are rendered and classified",
            (1, 4, 16), None, lambda v: f"{v} samples per pixel" if v > 1 else "1 sample per pixel",
            kind="grid",
        ),
        Parameter(
            "storage", "component type of channels between passes; double: float channels, masks by the float64 "
            "reference on the CPU (not timed)", ("half", "float", CPU_FLOAT64), "float",
            lambda v: {"half": "half floats", "float": "32-bit floats", CPU_FLOAT64: "masks in float64 on the CPU"}[v],
        ),
        Parameter(
            "shadow_size", "texels along a shadow-map face", (256, 512, 1024, 2048), 2048,
            lambda v: f"shadow maps {v}", inapplicable=_without("shadows"), inapplicable_value=_too_large_an_atlas,
        ),
        Parameter(
            "shadow_filter", "filter of the shadow-map lookup: one texel, or four weighted", ("hard", "bilinear"),
            "bilinear", lambda v: f"{v} shadow filter", inapplicable=_without("shadows"),
        ),
        Parameter(
            "shadow_lights", "lights with shadows, the most significant first", (4, 24), 24,
            lambda v: f"{v} light{'s' * (v != 1)} with shadows", inapplicable=_without("shadows"),
            inapplicable_value=_more_than_all_lights,
        ),
        Parameter(
            "light_error", "radiance that light culling may leave out of a tile", (0.1, 0.001, 0.0), 0.0,
            lambda v: f"light error {v:g}" if v else "no light culled", inapplicable=_without("light_culling"),
        ),
        Parameter(
            "indirect", "method of indirect light", ("none", "rsm", "probes"), "probes",
            lambda v: "no indirect light" if v == "none" else f"indirect light by {v}",
            inapplicable=_without_raster_indirect,
        ),
        Parameter(
            "indirect_samples", "virtual point lights", (256, 1024, 4096), 4096, lambda v: f"{v} VPLs",
            inapplicable=_without_raster_indirect,
        ),
        Parameter(
            "light", "method of light, path-traced (bidirectional) with its samples per pixel",
            ("raster", *(f"{TRACED}@{n}" for n in (1, 4, 16, 64))), None, _phrase_light,
            inapplicable=_without_light, inapplicable_value=_same_light,
        ),
        Parameter(
            "probes", "irradiance probes", (96, 768, 3072), 3072, lambda v: f"{v} probes",
            inapplicable=_without_probes,
        ),
    )
}  # fmt: skip
"""By name, in the order in which a study measures them."""
