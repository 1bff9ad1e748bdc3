"""The knobs: every setting that trades accuracy for time, what it may change, and when it changes nothing.

A knob either approximates the same quantity better or worse (``accuracy``), or asks another question (``question``):
twice the frame rate does not measure the same discards more exactly, it measures other discards.  Questions are timed
and printed apart; they never stand on a front and never get into a preset.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.conventions import COLUMNS
from taubench_gl.effects.decide import Effect
from taubench_gl.frame.shadow_faces import faces_of, pack
from taubench_gl.metrics.pair_sample import sample_pairs
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings, scheme_of

GEOMETRY = ("position", "normal", "motion")
LIGHT = ("direct", "indirect", "color")
DOUBLE = "double"


@dataclass(frozen=True, slots=True)
class Situation:
    """What decides whether a knob does anything: the scene, its effects, the base settings and their pairs."""

    scene: Scene
    effects: Mapping[str, Effect]
    base: Settings
    pairs: int
    ranked: tuple[int, ...] = ()  # rows of the light table, the most significant first
    max_texture: int = 16384  # texels, of the device

    def off(self, name: str) -> str | None:
        """Why effect ``name`` is off; None where it is on."""
        return None if self.effects[name].enabled else self.effects[name].reason


@dataclass(frozen=True, slots=True)
class Knob:
    """One dial.  ``values`` run from cheap and coarse to dear and exact; ``best`` is the reference's."""

    name: str
    doc: str
    values: tuple[Any, ...]
    best: Any
    columns: tuple[str, ...]  # columns of Table 4 that it may change
    features: tuple[str, ...]  # per-pixel quantities that it may change
    phrase: Callable[[Any], str]
    kind: str = "accuracy"  # accuracy | question
    field: str | None = None  # of Settings; None: as ``name``
    idle: Callable[[Situation], str | None] = lambda s: None  # why it changes nothing here
    useless: Callable[[Situation, Any], str | None] = lambda s, v: None  # why one value does not

    def current(self, settings: Settings) -> Any:
        """The value that ``settings`` has.  ``scale`` is relative: 1."""
        return 1.0 if self.name == "scale" else settings.get(self.field or self.name)

    def apply(self, settings: Settings, value: Any) -> Settings:
        """``settings`` with this knob at ``value``."""
        if self.name == "scale":
            size = (max(1, round(side * value)) for side in (settings.sequence.width, settings.sequence.height))
            return settings.replace(**dict(zip(("width", "height"), size)))
        if self.name == "fps":
            return _at_rate(settings, value)
        if self.name == "storage" and value == DOUBLE:
            return settings  # the CPU twin judges what the GPU drew
        return settings.replace(**{self.field or self.name: value})


def _at_rate(settings: Settings, fps: float) -> Settings:
    """Another rate over the same stretch of time."""
    first, stop = settings.sequence.frames
    start = None if first is None else round(first / settings.sequence.fps * fps)
    end = None if stop is None else round((stop - 1) / settings.sequence.fps * fps) + 1
    return settings.replace(fps=fps, frames=(start, end))


def _too_few(situation: Situation, value: str) -> str | None:
    count = len(sample_pairs(situation.pairs, *scheme_of(value)).positions)
    if value == "all":
        return None
    if count < 3:
        return f"{situation.pairs} pairs are too few for {value}"
    return f"{value} draws all pairs" if count == situation.pairs else None


def _more_than_there_are(situation: Situation, value: int) -> str | None:
    lights = len(situation.scene.light_nodes)
    below = [v for v in KNOBS["shadow_lights"].values if v < value]
    return f"the scene has {lights} lights" if below and below[-1] >= lights else None


def _too_large_an_atlas(situation: Situation, size: int) -> str | None:
    """Shadow maps share one texture, which a device allows so large and no larger."""
    rows = sorted(situation.ranked[: situation.base.lighting.shadow_lights])
    faces = faces_of(situation.scene, None, rows, (np.zeros(3), 1.0), size)
    width, height = pack(faces)[1]
    if max(width, height) <= situation.max_texture:
        return None
    return f"{len(faces)} maps of that size need {width}x{height} texels, the device has {situation.max_texture}"


def _only(rung: str) -> Callable[[Situation], str | None]:
    def idle(situation: Situation) -> str | None:
        used = {"auto": "probes"}.get(situation.base.lighting.indirect, situation.base.lighting.indirect)
        reason = situation.off("indirect")
        return reason or (None if rung in ("any", used) else f"the indirect rung is {used}")

    return idle


def _ordinal(number: str) -> str:
    teens = number[-2:-1] == "1"
    return number + ("th" if teens else {"1": "st", "2": "nd", "3": "rd"}.get(number[-1:], "th"))


def _phrase_pairs(value: str) -> str:
    scheme, _, number = value.partition(":")
    return {
        "all": "all pairs",
        "every": {"2": "every other pair", "3": "every third pair"}.get(number, f"every {_ordinal(number)} pair"),
        "strata": f"two pairs from each of {number} stretches",
    }[scheme]


_DRAWN = (*GEOMETRY, "direct", "indirect", "color")

KNOBS: dict[str, Knob] = {
    knob.name: knob
    for knob in (
        Knob(
            "scale", "resolution of the picture, as a share of the size asked for; a larger pixel is also another "
            "question: whatever crosses the border takes a whole row of pixels with it", (0.25, 0.5, 0.75, 1.0), 1.0,
            COLUMNS, _DRAWN,
            lambda v: f"{100 * v:g} % resolution", ),
        Knob(
            "pairs", "pairs looked at: every k-th, or two drawn from each of H stretches; the error is at least the "
            "half width of the confidence interval", ("every:8", "strata:2", "every:4", "strata:4", "strata:8",
            "every:2", "all"), "all", COLUMNS, (), _phrase_pairs, useless=_too_few, ),
        Knob(
            "samples_per_pixel", "places within a pixel at which both frames are drawn and judged",
            (1, 4), 16, COLUMNS, (), lambda v: f"{v} samples per pixel" if v > 1 else "1 sample per pixel",
            ),
        Knob(
            "storage", "of channels between passes: half, float, or float judged in double by the CPU twin",
            ("half", "float", DOUBLE), "float", COLUMNS, _DRAWN,
            lambda v: {"half": "half floats", "float": "32-bit floats", DOUBLE: "masks in double on the CPU"}[v],
        ),
        Knob(
            "shadow_size", "texels along a shadow map", (256, 512, 1024, 2048), 2048, LIGHT, LIGHT,
            lambda v: f"shadow maps {v}", idle=lambda s: s.off("shadows"), useless=_too_large_an_atlas,
            ),
        Knob(
            "shadow_filter", "one texel decides, or four, weighted", ("hard", "bilinear"), "bilinear", LIGHT, LIGHT,
            lambda v: f"{v} shadow filter", idle=lambda s: s.off("shadows"),
        ),
        Knob(
            "shadow_lights", "lights that cast shadows, the most significant first", (1, 4, 8, 16), 16, LIGHT, LIGHT,
            lambda v: f"{v} shadowed light{'s' * (v != 1)}", idle=lambda s: s.off("shadows"),
            useless=_more_than_there_are, ),
        Knob(
            "light_error", "radiance that light culling may leave out of a tile", (0.1, 0.01, 0.001, 0.0), 0.0, LIGHT,
            LIGHT, lambda v: f"light error {v:g}" if v else "no light left out", idle=lambda s: s.off("light_culling"),
            ),
        Knob(
            "indirect", "rung of indirect light", ("none", "rsm", "probes"), "probes", ("indirect", "color"),
            ("indirect", "color"), lambda v: {"none": "no indirect light"}.get(v, f"indirect light by {v}"),
            idle=_only("any"),
        ),
        Knob(
            "indirect_samples", "virtual lights", (256, 1024, 4096), 4096, ("indirect", "color"), ("indirect", "color"),
            lambda v: f"{v} virtual lights", idle=_only("any"), ),
        Knob(
            "probes", "irradiance probes", (96, 768, 3072), 3072, ("indirect", "color"), ("indirect", "color"),
            lambda v: f"{v} probes", idle=_only("probes"), ),
        Knob(
            "fps", "frames per second: other steps between frames, so other discards", (12.0, 24.0, 48.0), None,
            COLUMNS, (), lambda v: f"{v:g} fps", kind="question",
        ),
        Knob(
            "sampling", "how history is read: the convention decides what a sub-pixel step finds", ("nearest",
            "bilinear"), None, COLUMNS, (), lambda v: f"{v} history", kind="question",
        ),
        Knob(
            "reprojection", "whether surfaces are followed: the convention decides what moving surfaces count as",
            ("camera", "motion"), None, COLUMNS, (), lambda v: f"{v} reprojection", kind="question",
        ),
    )
}  # fmt: skip
"""By name, in the order in which a study goes through them."""
