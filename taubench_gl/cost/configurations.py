"""The configurations that a study measures: baseline, single changes, combinations, effects left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from taubench_gl.cost.parameters import CPU_FLOAT64, PARAMETERS, TRACED, StudyContext
from taubench_gl.errors import SettingsError
from taubench_gl.settings import Settings

BASELINE, HIGHEST = "baseline", "highest_quality"
LABELS = {BASELINE: "baseline", HIGHEST: "highest quality"}
COMBINATION_SET, EFFECT_SET = "combinations", "effects"
"""Names beside those of parameters: COMBINATIONS; what each effect costs."""

EVERYTHING = "every effect on"
"""Configuration with the effects that the scene does not call for: masks must be the same, at a higher price."""

EFFECTS = ("normal_maps", "glossy", "shadows", "indirect", "emission", "emitter_light", "environment_light")
"""Effects that can be left out while all columns stay."""

_COARSE = {"shadow_size": 256, "shadow_filter": "hard"}
COMBINATIONS: tuple[Mapping[str, Any], ...] = (
    _COARSE | {"shadow_lights": 4, "indirect": "none"},
    _COARSE | {"indirect": "none"},
    _COARSE | {"indirect": "rsm", "indirect_samples": 256},
    _COARSE | {"indirect": "rsm"},
    _COARSE | {"indirect_samples": 256, "probes": 96},
    _COARSE,
    {"indirect": "rsm", "indirect_samples": 256},
    {"indirect_samples": 256, "probes": 96},
    {"shadow_size": 2048, "indirect_samples": 4096},
)
"""Parameters that are usually changed together, from the fastest to the most exact."""


@dataclass(frozen=True, slots=True)
class Configuration:
    """Settings to measure.  ``role``: as of ``analysis.Point``."""

    name: str
    role: str
    values: Mapping[str, Any]  # parameter or setting -> value, where it differs from the baseline
    settings: Settings
    on_cpu: bool = False  # masks by the float64 reference on the CPU; not timed, no preset
    without: tuple[str, ...] = ()  # effects left out; no preset
    title: str = ""

    @property
    def label(self) -> str:
        """In words: what differs from the baseline."""
        named = self.title or LABELS.get(self.name)
        return named or ", ".join(PARAMETERS[n].phrase(v) for n, v in self.values.items())

    @property
    def comparable(self) -> bool:
        """Whether its masks are of the same pixels as the baseline's."""
        return self.role != "grid"

    @property
    def traced(self) -> bool:
        """All its light is path-traced."""
        return self.settings.lighting.light == TRACED

    @property
    def slow(self) -> bool:
        """Takes long, and the answer does not need it."""
        return self.traced and self.role != BASELINE


@dataclass(frozen=True, slots=True)
class Plan:
    """``inapplicable``: ``parameter`` or ``parameter=value`` -> why it is not measured."""

    configurations: tuple[Configuration, ...]
    highest: Settings  # of the raster method at its best
    parameters: tuple[str, ...]
    inapplicable: Mapping[str, str]

    def named(self, name: str) -> Configuration:
        return next(c for c in self.configurations if c.name == name)


def make_plan(context: StudyContext, parameters: Sequence[str] | None = None) -> Plan:
    """All configurations for one scene, in the order in which they are measured.

    ``parameters``: names in ``PARAMETERS``, ``combinations``, ``effects``; None: all.  Parameters
    without an effect on this scene are left out, with the reason.
    Raises SettingsError for an unknown name, and if nothing is left to vary.
    """
    every = (COMBINATION_SET, *PARAMETERS, EFFECT_SET)
    requested = tuple(every if parameters is None else dict.fromkeys(parameters))
    for name in requested:
        if name not in every:
            raise SettingsError(f"no parameter is named {name!r}", hint=f"choose from {', '.join(every)}")
    named = [name for name in requested if name in PARAMETERS]
    inapplicable = {name: reason for name in named if (reason := PARAMETERS[name].inapplicable(context))}
    active = tuple(name for name in named if name not in inapplicable)
    highest = _highest_quality(active, context)
    planned = [Configuration(BASELINE, BASELINE, {}, context.baseline), highest]
    planned += _combinations(context) if COMBINATION_SET in requested else ()
    for name in active:
        planned += _single_changes(name, context, inapplicable)
    planned = _without_repetition([*planned, *(_effects(context) if EFFECT_SET in requested else ())])
    if len(planned) == 1:
        why = "; ".join(f"{name}: {reason}" for name, reason in inapplicable.items())
        raise SettingsError("no parameter changes anything in this scene", hint=why or "choose other parameters")
    planned.sort(key=lambda c: (not c.comparable, c.slow))
    return Plan(tuple(planned), highest.settings, active, inapplicable)


def _without_repetition(planned: Sequence[Configuration]) -> list[Configuration]:
    """The first of those that have the same settings: a combination may be a single change."""
    out: list[Configuration] = []
    for c in planned:
        if all((c.settings, c.without, c.on_cpu) != (o.settings, o.without, o.on_cpu) for o in out):
            out.append(c)
    return out


def _highest_quality(active: Sequence[str], context: StudyContext) -> Configuration:
    """Every accuracy parameter at its best; shadow maps, last, as large as the device allows for their number."""
    names = [n for n in active if PARAMETERS[n].kind == "accuracy" and PARAMETERS[n].best is not None]
    settings, values = context.baseline, {}
    for name in sorted(names, key=lambda n: n == "shadow_size"):
        parameter, here = PARAMETERS[name], replace(context, baseline=settings)
        value = parameter.best
        if name == "shadow_size" and parameter.inapplicable_value(here, value):
            possible = [v for v in parameter.values if not parameter.inapplicable_value(here, v)]
            value = max(possible, default=settings.lighting.shadow_size)
        values[name] = value
        settings = parameter.apply(settings, value)
    return Configuration(HIGHEST, HIGHEST, {n: values[n] for n in names}, settings)


def _single_changes(name: str, context: StudyContext, inapplicable: dict[str, str]) -> list[Configuration]:
    """Reasons why values have no effect are added to ``inapplicable``."""
    parameter, out = PARAMETERS[name], []
    for value in parameter.values:
        if value == parameter.value_in(context.baseline):
            continue
        if reason := parameter.inapplicable_value(context, value):
            inapplicable[f"{name}={value}"] = reason
            continue
        role = "single" if parameter.kind == "accuracy" else parameter.kind
        role = "path_traced" if str(value).startswith(TRACED) else role
        out.append(configuration(role, {name: value}, context.baseline))
    return out


def _combinations(context: StudyContext) -> list[Configuration]:
    """Without the values that have no effect on this scene."""
    out = []
    for combination in COMBINATIONS:
        values = {
            n: v
            for n, v in combination.items()
            if v != PARAMETERS[n].value_in(context.baseline) and not PARAMETERS[n].inapplicable(context)
        }
        whole = configuration("combined", values, context.baseline)
        # Whether a value has an effect is asked beside the others, its own included: it may depend on them.
        together = replace(context, baseline=whole.settings)
        if values and not any(PARAMETERS[n].inapplicable_value(together, v) for n, v in values.items()):
            out.append(whole)
    return out


def _effects(context: StudyContext) -> list[Configuration]:
    """Each effect of the scene left out, and every effect on."""
    on = [name for name in EFFECTS if name in context.effects and context.effects[name].enabled]
    out = [
        Configuration(f"without {e}", "effect", {}, context.baseline, without=(e,), title=f"without {e}") for e in on
    ]
    whole = context.baseline.replace(effects="all")
    return [*out, Configuration(EVERYTHING, "effect", {}, whole, title=EVERYTHING)]


def configuration(role: str, values: Mapping[str, Any], baseline: Settings) -> Configuration:
    """``baseline`` with the parameter ``values``, named by them."""
    settings = baseline
    for name, value in values.items():
        settings = PARAMETERS[name].apply(settings, value)
    name = ", ".join(f"{n}={v}" for n, v in values.items())
    return Configuration(name, role, values, settings, on_cpu=values.get("storage") == CPU_FLOAT64)
