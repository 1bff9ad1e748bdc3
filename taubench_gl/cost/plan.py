"""Which settings a study measures: the base, every knob's other values one at a time, and declared combinations."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from taubench_gl.cost.parameters import DOUBLE, KNOBS, Situation
from taubench_gl.errors import SettingsError
from taubench_gl.settings import Settings

BASE, BEST = "base", "best"

COMBINATIONS: tuple[Mapping[str, Any], ...] = (
    {"scale": 0.5, "samples_per_pixel": 4},
    {"scale": 0.5, "storage": "half"},
    {"scale": 0.5, "pairs": "strata:4"},
    {"storage": "half", "pairs": "strata:8"},
    {"shadow_size": 512, "shadow_filter": "hard"},
    {"shadow_size": 512, "shadow_lights": 4},
    {"shadow_size": 2048, "shadow_lights": 16},
    {"shadow_size": 2048, "samples_per_pixel": 4},
    {"indirect_samples": 256, "probes": 96},
    {"indirect": "rsm", "indirect_samples": 256},
    {"scale": 0.5, "shadow_size": 512, "indirect_samples": 256},
)
"""Combinations measured where all their knobs are dials of the study: what is usually turned together."""


@dataclass(frozen=True, slots=True)
class Setting:
    """One row of the study.  ``role``: base | one | combined | best | question."""

    name: str
    role: str
    choice: Mapping[str, Any]  # knob -> value, for the knobs that differ from the base
    settings: Settings
    twin: bool = False  # masks by the float64 twin on the CPU

    @property
    def label(self) -> str:
        """In words: the phrases of what differs from the base."""
        words = ", ".join(KNOBS[name].phrase(value) for name, value in self.choice.items())
        return {BASE: "as asked", BEST: "everything at its best"}.get(self.name, words)


@dataclass(frozen=True, slots=True)
class Plan:
    """``skipped``: knob, or ``knob=value``, -> why it is not measured here."""

    settings: tuple[Setting, ...]
    knobs: tuple[str, ...]
    skipped: Mapping[str, str]

    def named(self, name: str) -> Setting:
        return next(s for s in self.settings if s.name == name)


def make_plan(situation: Situation, knobs: Sequence[str] | None = None, *, bare: bool = False) -> Plan:
    """The declared set for one scene.  ``knobs``: names of ``KNOBS``, None: all.  ``bare``: it may be the base alone.

    What cannot change anything here (no lights: no shadow knobs) is skipped, with the reason.  Raises SettingsError for
    an unknown name, or if nothing is left to vary.
    """
    chosen = tuple(KNOBS) if knobs is None else tuple(dict.fromkeys(knobs))
    for name in chosen:
        if name not in KNOBS:
            raise SettingsError(f"no knob is named {name!r}", hint=f"choose from {', '.join(KNOBS)}, method:NAME")
    skipped = {name: reason for name in chosen if (reason := KNOBS[name].idle(situation))}
    active = tuple(name for name in chosen if name not in skipped)
    base = situation.base
    found = [Setting(BASE, BASE, {}, base)]
    found.append(_best(active, situation))
    for name in active:
        found += _one_at_a_time(name, situation, skipped)
    found += _combinations(active, situation)
    if len(found) == 2 and not bare:
        why = "; ".join(f"{name}: {reason}" for name, reason in skipped.items())
        raise SettingsError("no knob changes anything here", hint=why or "choose other knobs")
    return Plan(tuple(found), active, skipped)


def _best(active: Sequence[str], situation: Situation) -> Setting:
    """Every accuracy knob at its best; shadow maps, last, as large as the device allows for their number."""
    names = [n for n in active if KNOBS[n].kind == "accuracy"]
    settings, choice = situation.base, {}
    for name in sorted(names, key=lambda n: n == "shadow_size"):
        knob, here = KNOBS[name], replace(situation, base=settings)
        value = knob.best
        if name == "shadow_size" and knob.useless(here, value):
            value = max((v for v in knob.values if not knob.useless(here, v)), default=settings.lighting.shadow_size)
        choice[name] = value
        settings = knob.apply(settings, value)
    return Setting(BEST, BEST, {n: choice[n] for n in names}, settings)


def _one_at_a_time(name: str, situation: Situation, skipped: dict[str, str]) -> list[Setting]:
    knob, out = KNOBS[name], []
    for value in knob.values:
        if value == knob.current(situation.base):
            continue
        reason = knob.useless(situation, value)
        if reason:
            skipped[f"{name}={value}"] = reason
            continue
        role = "question" if knob.kind == "question" else "one"
        out.append(setting_of(role, {name: value}, situation.base))
    return out


def _combinations(active: Sequence[str], situation: Situation) -> list[Setting]:
    out = []
    for choice in COMBINATIONS:
        if not set(choice) <= set(active) or any(useless_beside(choice, n, situation) for n in choice):
            continue
        choice = {n: v for n, v in choice.items() if v != KNOBS[n].current(situation.base)}
        if len(choice) > 1:
            out.append(setting_of("combined", choice, situation.base))
    return out


def useless_beside(choice: Mapping[str, Any], name: str, situation: Situation) -> str | None:
    """Why ``name`` of ``choice`` cannot be had beside the others."""
    base = situation.base
    for other, value in choice.items():
        base = base if other == name else KNOBS[other].apply(base, value)
    return KNOBS[name].useless(replace(situation, base=base), choice[name])


def setting_of(role: str, choice: Mapping[str, Any], base: Settings) -> Setting:
    """``base`` with the dials of ``choice``, named by them in their order."""
    settings = base
    for name, value in choice.items():
        settings = KNOBS[name].apply(settings, value)
    name = ", ".join(f"{n}={v}" for n, v in choice.items())
    return Setting(name, role, choice, settings, twin=choice.get("storage") == DOUBLE)


def identity(plan: Plan, scene_hash: str | None, frames: range, reference: str, camera: str) -> dict[str, str]:
    """What the records of a study rest on, by part, as short hashes: studies whose parts differ must not be mixed."""
    base = plan.named(BASE).settings.replace(backend="auto", device=None).as_summary(frames)
    parts = {
        "scene": [scene_hash, camera],
        "settings": [base, [frames.start, frames.stop]],
        "knobs": [[s.name, s.settings.as_summary(frames)] for s in plan.settings],
        "reference": reference,
    }
    return {name: fingerprint(part) for name, part in parts.items()}


def fingerprint(part: Any) -> str:
    """A short hash of what JSON can hold."""
    return hashlib.sha256(json.dumps(part, sort_keys=True, default=str).encode()).hexdigest()[:16]
