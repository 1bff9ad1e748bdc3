"""Names for everything that can be set or read: ``set threshold.normal 0.05``, ``expect overlay.position > 1``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from taubench_gl.errors import SettingsError
from taubench_gl.viewer.state import CAMERAS, COMPARISONS, ViewerState

_FLAGS = (
    "playing", "freeze_current", "freeze_previous", "frusta", "auto_range", "overlays", "arrows", "panels", "help",
    "probe_pinned",
)  # fmt: skip
_NUMBERS = {"speed": (0.01, 16.0), "opacity": (0.0, 1.0), "split": (0.0, 1.0), "gain": (0.01, 1e4)}
_CHOICES: dict[str, Callable[[ViewerState], tuple[str, ...]]] = {
    "camera": lambda s: CAMERAS,
    "channel": lambda s: s.channels,
    "comparison": lambda s: COMPARISONS,
    "feature": lambda s: tuple(s.thresholds),
    "effect": lambda s: s.effects,
}


def names(state: ViewerState) -> list[str]:
    """Every name that ``assign`` takes."""
    groups = [("show", state.shown), ("threshold", state.thresholds), ("section", state.sections)]
    dotted = [f"{group}.{name}" for group, members in groups for name in members]
    dotted += [f"effect.{name}" for name in state.effects]
    return ["frame", "loop.first", "loop.last", "range.low", "range.high", *_FLAGS, *_NUMBERS, *_CHOICES, *dotted]


def assign(state: ViewerState, name: str, text: str) -> None:
    """Set ``name`` to the value that ``text`` spells.  Raises SettingsError naming what there is."""
    group, _, member = name.partition(".")
    if name == "frame":
        state.go_to(round(_number(name, text)))
    elif group == "loop" and member in ("first", "last"):
        state.set_loop(**{"low" if member == "first" else "high": round(_number(name, text))})
    elif group == "range" and member in ("low", "high"):
        value = _number(name, text)
        state.set_range(*((value, max(value, state.high)) if member == "low" else (min(value, state.low), value)))
    elif name in _FLAGS:
        setattr(state, name, _flag(name, text))
    elif name in _NUMBERS:
        low, high = _NUMBERS[name]
        setattr(state, name, min(max(_number(name, text), low), high))
    elif name in _CHOICES:
        allowed = _CHOICES[name](state)
        if text not in allowed:
            raise SettingsError(f"{name} cannot be {text!r}", hint=f"choose from {', '.join(allowed) or 'nothing'}")
        setattr(state, name, text)
    elif group == "show" and member in state.shown:
        state.shown[member] = _flag(name, text)
    elif group == "section" and member in state.sections:
        state.sections[member] = _flag(name, text)
    elif group == "threshold" and member in state.thresholds:
        state.set_threshold(member, _number(name, text))
    elif group == "effect" and member in state.effects:
        state.switched_off = (state.switched_off - {member}) | (frozenset() if _flag(name, text) else {member})
    else:
        raise SettingsError(f"there is no {name!r}", hint=f"choose from {', '.join(names(state))}")


def values(state: ViewerState) -> dict[str, Any]:
    """Every name of ``assign`` with its value: numbers, or text for choices."""
    low, high = state.range
    out: dict[str, Any] = {
        "frame": state.frame, "first": state.first, "last": state.last, "loop.first": low, "loop.last": high,
        "range.low": state.low, "range.high": state.high,
    }  # fmt: skip
    out |= {name: int(getattr(state, name)) for name in _FLAGS}
    out |= {name: getattr(state, name) for name in (*_NUMBERS, *_CHOICES)}
    out |= {f"show.{n}": int(on) for n, on in state.shown.items()}
    out |= {f"section.{n}": int(on) for n, on in state.sections.items()}
    out |= {f"threshold.{n}": v for n, v in state.thresholds.items()}
    out |= {f"effect.{n}": int(n not in state.switched_off) for n in state.effects}
    out["probe.x"], out["probe.y"] = state.probe or (-1, -1)
    return out | {"message": state.message}


def _number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) < 1e30:
        raise SettingsError(f"{name} cannot be {text!r}", hint="give a number")
    return value


def _flag(name: str, text: str) -> bool:
    flags = {"1": True, "on": True, "true": True, "yes": True, "0": False, "off": False, "false": False, "no": False}
    if text.lower() not in flags:
        raise SettingsError(f"{name} cannot be {text!r}", hint="give on or off")
    return flags[text.lower()]
