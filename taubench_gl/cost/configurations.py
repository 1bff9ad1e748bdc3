"""What a cost study evaluates: ways to get the light columns of one table, and the options that ask for them."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from taubench_gl.effects.decide import decide
from taubench_gl.effects.path_tracing import traced_sources
from taubench_gl.report.labels import range_text
from taubench_gl.scene.model import Scene
from taubench_gl.settings import FIELDS, INDIRECT, SIZE, Settings

PREVIEW, DECIDED, FIXED, TRUTH = "preview", "decided", "fixed", "truth"

WITHIN = (4.0, 2.0, 1.0, 0.5)
"""Values of ``light_within`` of decided samples, percentage points."""

SAMPLES = (1, 4, 16, 64)
"""Numbers of fixed samples per pixel."""

PREVIEWS: tuple[Mapping[str, Any], ...] = (
    {},
    {"light": "raster"},
    {"spp": 16},
    {"shadow_size": 256},
    {"shadow_size": 2048},
    {"shadow_filter": "hard"},
    {"shadow_lights": 4},
    *({"indirect": method} for method in INDIRECT if method not in ("auto", "probes")),
    {"probes": 96},
    {"probes": 3072},
    {"storage": "half"},
)
"""Settings that each preview changes.  Without indirect light a table lacks that column: it is shown, never chosen."""

SHADOWS = ("shadow_size", "shadow_filter", "shadow_lights")
"""Settings of previews that change shadows alone."""

COMPARED = ("light", "spp", "light_within", "light_time", "pattern")
"""Settings whose values the configurations compare: the user cannot give them."""

RUNS = 16
"""Most evaluations that make the truth."""


@dataclass(frozen=True, slots=True)
class Configuration:
    """One way to get the table.  ``changes``: its settings by name.

    ``effort``: a number with which its seconds grow, by which those of the next one are estimated.
    """

    series: str
    changes: Mapping[str, Any]
    effort: float = 0.0

    @property
    def programs(self) -> str:
        """Names the shaders that it compiles, the same for decided samples of any number; empty for the truth."""
        return {DECIDED: DECIDED, TRUTH: ""}.get(self.series, self.name)

    @property
    def name(self) -> str:
        """The options of the configuration, as on the command line: ``--light preview --probes 96``."""
        return " ".join(option for name, value in self.changes.items() for option in _option(name, value)) or "default"

    def settings(self, baseline: Settings) -> Settings:
        """The baseline with the changes of the configuration, and the defaults of all other COMPARED settings."""
        return baseline.replace(**{name: FIELDS[name].default for name in COMPARED} | dict(self.changes))


def without_effect(scene: Scene, settings: Settings) -> dict[str, str]:
    """Settings of previews that change nothing on ``scene``, and why.  ``settings``: with resolved lighting."""
    preview = settings.replace(light="preview")
    effects, out = decide(scene, preview), dict[str, str]()
    if not traced_sources(scene, preview):
        out |= dict.fromkeys(("light", "spp"), "the preview traces no paths")
    for effect, names in {"shadows": SHADOWS, "indirect": ("indirect", "probes")}.items():
        if not effects[effect].enabled:
            out |= dict.fromkeys(names, effects[effect].reason)
    return out


@dataclass(frozen=True)
class Plan:
    """The configurations of a study.  ``off``: settings of previews without effect, and why (``without_effect``).

    ``truth_within``: wanted half width of the truth, percentage points.
    """

    baseline: Settings
    off: Mapping[str, str]
    truth_within: float = 0.25

    @cached_property
    def series(self) -> dict[str, tuple[Configuration, ...]]:
        """Configurations by series, in the order of the work.  The truth has the seeds after the baseline's."""
        default, least = Settings().lighting.light_within, min(WITHIN)
        decided = [
            Configuration(DECIDED, {} if w == default else {"light_within": w}, (least / w) ** 2) for w in WITHIN
        ]
        traced = {"light": "path-traced"}
        if self.baseline.lighting.indirect != "auto":
            traced["indirect"] = "auto"  # another method than path tracing
        previews = (changes for changes in PREVIEWS if self.off.keys().isdisjoint(changes))
        seeds = [(self.baseline.lighting.seed + 1 + number) % 2**31 for number in range(RUNS)]
        return {
            TRUTH: tuple(Configuration(TRUTH, {"light_within": self.truth_within, "seed": seed}) for seed in seeds),
            DECIDED: (*decided, Configuration(DECIDED, traced)),
            FIXED: tuple(Configuration(FIXED, {**traced, "spp": n}, float(n)) for n in SAMPLES),
            PREVIEW: tuple(Configuration(PREVIEW, {"light": "preview", **changes}) for changes in previews),
        }

    @property
    def compared(self) -> tuple[Configuration, ...]:
        """Every configuration but those of the truth."""
        return tuple(c for name in (PREVIEW, FIXED, DECIDED) for c in self.series[name])


def command_line(scene: str, settings: Settings) -> str:
    """The call of ``evaluate`` with these settings, those that are no default as options."""
    default = {name: field.default for name, field in FIELDS.items()} | {"thresholds": Settings().metrics.thresholds}
    words = ["taubench-gl", "evaluate", scene]
    sequence = settings.sequence
    if (sequence.width, sequence.height) != SIZE.default:
        words += [SIZE.option, f"{sequence.width}x{sequence.height}"]
    for name in FIELDS:
        value = settings.get(name)
        if name not in ("width", "height") and value != default[name]:
            words += _option(name, value)
    return shlex.join(words)


def _option(name: str, value: Any) -> list[str]:
    """One setting as words of the command line, such as ``--spp 4``."""
    field = FIELDS[name]
    if isinstance(value, bool):
        return [field.option] if value else []
    if isinstance(value, Mapping):
        return [word for key, number in value.items() for word in (field.option, f"{key}={number:.17g}")]
    if field.repeats:
        return [word for element in value for word in (field.option, str(element))]
    if name == "frames":
        return [field.option, range_text(value)]
    texts = [f"{v:.17g}" if isinstance(v, float) else str(v) for v in (value if isinstance(value, tuple) else (value,))]
    return [field.option, ",".join(texts)]
