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
"""``light_within`` of decided samples, percentage points."""

SAMPLES = (1, 4, 16, 64)
"""``spp`` of fixed samples."""

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
"""Settings that a preview changes.  Without indirect light a table lacks that column: it is shown, never chosen."""

SHADOWS = ("shadow_size", "shadow_filter", "shadow_lights")

OWN = ("light", "spp", "light_within", "light_time", "pattern")
"""Settings that belong to the configurations: those of the user do not count."""


@dataclass(frozen=True, slots=True)
class Configuration:
    """``changes``: settings by name.  ``effort``: what its seconds grow with, by which the next one is estimated."""

    series: str
    changes: Mapping[str, Any]
    effort: float = 0.0

    @property
    def programs(self) -> str:
        """Names the shaders that it needs: decided samples have the same, whatever their number."""
        return self.series if self.series == DECIDED else self.name

    @property
    def name(self) -> str:
        """Its options, as on the command line: ``--light preview --probes 96``."""
        return " ".join(option for name, value in self.changes.items() for option in _option(name, value)) or "default"

    def settings(self, baseline: Settings) -> Settings:
        return own_settings(baseline).replace(**self.changes)


def own_settings(baseline: Settings) -> Settings:
    """``baseline`` with the defaults of OWN."""
    return baseline.replace(**{name: FIELDS[name].default for name in OWN})


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
    """The configurations of a study by series, each in the order of the work.  ``off``: of ``without_effect``."""

    baseline: Settings
    off: Mapping[str, str]

    @cached_property
    def series(self) -> dict[str, tuple[Configuration, ...]]:
        default, least = Settings().lighting.light_within, min(WITHIN)
        decided = [
            Configuration(DECIDED, {} if w == default else {"light_within": w}, (least / w) ** 2) for w in WITHIN
        ]
        traced = {"light": "path-traced"}
        if self.baseline.lighting.indirect != "auto":
            traced["indirect"] = "auto"  # of the raster method
        return {
            PREVIEW: tuple(
                Configuration(PREVIEW, {"light": "preview", **changes})
                for changes in PREVIEWS
                if self.off.keys().isdisjoint(changes)
            ),
            FIXED: tuple(Configuration(FIXED, {**traced, "spp": n}, float(n)) for n in SAMPLES),
            DECIDED: (*decided, Configuration(DECIDED, traced)),
        }

    @property
    def every(self) -> tuple[Configuration, ...]:
        return tuple(c for configurations in self.series.values() for c in configurations)


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
    """The words of one setting on the command line."""
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
