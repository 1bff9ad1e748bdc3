"""The configurations that a study measures: baseline, highest quality, single parameter changes, combinations."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from taubench_gl.cost.parameters import CPU_FLOAT64, PARAMETERS, StudyContext
from taubench_gl.errors import SettingsError
from taubench_gl.settings import Settings

BASELINE, HIGHEST = "baseline", "highest_quality"
LABELS = {BASELINE: "baseline", HIGHEST: "highest quality"}

COMBINATIONS: tuple[Mapping[str, Any], ...] = (
    {"scale": 0.5, "samples_per_pixel": 4},
    {"scale": 0.5, "storage": "half"},
    {"scale": 0.5, "pairs": "strata:4"},
    {"storage": "half", "pairs": "strata:8"},
    {"shadow_size": 512, "shadow_filter": "hard"},
    {"shadow_size": 512, "shadow_lights": 4},
    {"shadow_size": 2048, "shadow_lights": 24},
    {"shadow_size": 2048, "samples_per_pixel": 4},
    {"indirect_samples": 256, "probes": 96},
    {"indirect": "rsm", "indirect_samples": 256},
    {"scale": 0.5, "shadow_size": 512, "indirect_samples": 256},
)
"""Parameters that are usually changed together.  A combination is measured if all its parameters are in the study."""


@dataclass(frozen=True, slots=True)
class Configuration:
    """Settings to measure.  ``role``: baseline | highest_quality | single | combined | definition."""

    name: str
    role: str
    values: Mapping[str, Any]  # parameter -> value, where it differs from the baseline
    settings: Settings
    on_cpu: bool = False  # masks by the float64 reference on the CPU; not timed, no preset

    @property
    def label(self) -> str:
        """In words: what differs from the baseline."""
        return LABELS.get(self.name) or ", ".join(PARAMETERS[n].phrase(v) for n, v in self.values.items())


@dataclass(frozen=True, slots=True)
class Plan:
    """``inapplicable``: ``parameter`` or ``parameter=value`` -> why it is not measured."""

    configurations: tuple[Configuration, ...]
    parameters: tuple[str, ...]
    inapplicable: Mapping[str, str]

    def named(self, name: str) -> Configuration:
        return next(c for c in self.configurations if c.name == name)


def make_plan(context: StudyContext, parameters: Sequence[str] | None = None, *, bare: bool = False) -> Plan:
    """All configurations for one scene.

    ``parameters``: names in ``PARAMETERS``; None: all.  ``bare``: baseline and highest quality alone are enough.
    Parameters without an effect on this scene are left out, with the reason.  Raises SettingsError for an unknown name,
    and if nothing is left to vary.
    """
    chosen = tuple(PARAMETERS) if parameters is None else tuple(dict.fromkeys(parameters))
    for name in chosen:
        if name not in PARAMETERS:
            hint = f"choose from {', '.join(PARAMETERS)}, method:NAME"
            raise SettingsError(f"no parameter is named {name!r}", hint=hint)
    inapplicable = {name: reason for name in chosen if (reason := PARAMETERS[name].inapplicable(context))}
    active = tuple(name for name in chosen if name not in inapplicable)
    found = [Configuration(BASELINE, BASELINE, {}, context.baseline), _highest_quality(active, context)]
    for name in active:
        found += _single_changes(name, context, inapplicable)
    found += _combinations(active, context)
    if len(found) == 2 and not bare:
        why = "; ".join(f"{name}: {reason}" for name, reason in inapplicable.items())
        raise SettingsError("no parameter changes anything in this scene", hint=why or "choose other parameters")
    return Plan(tuple(found), active, inapplicable)


def _highest_quality(active: Sequence[str], context: StudyContext) -> Configuration:
    """Every accuracy parameter at its best; shadow maps, last, as large as the device allows for their number."""
    names = [n for n in active if PARAMETERS[n].kind == "accuracy"]
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
    parameter, out = PARAMETERS[name], []
    for value in parameter.values:
        if value == parameter.value_in(context.baseline):
            continue
        reason = parameter.inapplicable_value(context, value)
        if reason:
            inapplicable[f"{name}={value}"] = reason
            continue
        role = "definition" if parameter.kind == "definition" else "single"
        out.append(configuration(role, {name: value}, context.baseline))
    return out


def _combinations(active: Sequence[str], context: StudyContext) -> list[Configuration]:
    out = []
    for values in COMBINATIONS:
        if not set(values) <= set(active) or any(_inapplicable_beside(values, n, context) for n in values):
            continue
        values = {n: v for n, v in values.items() if v != PARAMETERS[n].value_in(context.baseline)}
        if len(values) > 1:
            out.append(configuration("combined", values, context.baseline))
    return out


def _inapplicable_beside(values: Mapping[str, Any], name: str, context: StudyContext) -> str | None:
    """Why the value of ``name`` is inapplicable together with the others."""
    settings = context.baseline
    for other, value in values.items():
        settings = settings if other == name else PARAMETERS[other].apply(settings, value)
    return PARAMETERS[name].inapplicable_value(replace(context, baseline=settings), values[name])


def configuration(role: str, values: Mapping[str, Any], baseline: Settings) -> Configuration:
    """``baseline`` with the parameter ``values``, named by them."""
    settings = baseline
    for name, value in values.items():
        settings = PARAMETERS[name].apply(settings, value)
    name = ", ".join(f"{n}={v}" for n, v in values.items())
    return Configuration(name, role, values, settings, on_cpu=values.get("storage") == CPU_FLOAT64)


def identity(plan: Plan, scene_hash: str | None, frames: range, reference: str, camera: str) -> dict[str, str]:
    """Short hashes of everything that the records of a study depend on, by part."""
    baseline = plan.named(BASELINE).settings.as_summary(frames)
    parts = {
        "scene": [scene_hash, camera],
        "settings": [baseline, [frames.start, frames.stop]],
        "parameters": [[c.name, c.settings.as_summary(frames)] for c in plan.configurations],
        "reference": reference,
    }
    return {name: fingerprint(part) for name, part in parts.items()}


def fingerprint(part: Any) -> str:
    """A short hash of JSON values."""
    return hashlib.sha256(json.dumps(part, sort_keys=True, default=str).encode()).hexdigest()[:16]
