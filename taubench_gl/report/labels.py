"""Names of runs that stand side by side: what tells those of one scene apart is the settings that differ."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

NOT_GIVEN = "default"
_ELSEWHERE = ("width", "height", "first_frame", "last_frame", "thresholds")
"""Settings that ``flat_settings`` puts under other keys, or in other words."""


def labelled(name: str, told: Iterable[str]) -> str:
    """``name (size 1920x1080, camera Top)``; the name alone where there is nothing to tell."""
    words = ", ".join(told)
    return f"{name} ({words})" if words else name


def flat_settings(settings: Mapping[str, Any]) -> dict[str, str]:
    """Key -> text of every setting, of Settings' fields as plain values or of a summary's ``settings`` block.

    Width and height are one key, ``size``; first and last frame are ``frames``; each threshold is ``thresholds.NAME``.
    """
    flat = {}
    if "width" in settings and "height" in settings:
        flat["size"] = f"{settings['width']}x{settings['height']}"
    first, last = settings.get("first_frame"), settings.get("last_frame")
    if first is not None and last is not None:
        flat["frames"] = range_text((first, last + 1))
    for name, value in (settings.get("thresholds") or {}).items():
        flat[f"thresholds.{name}"] = _text(value)
    for key, value in settings.items():
        if key == "frames":
            flat[key] = range_text(value) if any(end is not None for end in value) else NOT_GIVEN
        elif key not in _ELSEWHERE:
            flat[key] = _text(value)
    return flat


def range_text(ends: Iterable[int | None]) -> str:
    """A range of frames as the command line has it: ``0:24``, ``100:``."""
    return ":".join("" if end is None else str(end) for end in ends)


def _text(value: Any) -> str:
    if value is None:
        return NOT_GIVEN
    if isinstance(value, float):
        return f"{value:.6g}"
    return ",".join(_text(one) for one in value) if isinstance(value, (list, tuple)) else str(value)


def differing(runs: Sequence[Mapping[str, str]]) -> list[dict[str, str]]:
    """Of each run's flat settings those on which not all runs agree; a setting that a run lacks is its default."""
    keys = dict.fromkeys(key for run in runs for key in run)
    apart = [key for key in keys if len({run.get(key, NOT_GIVEN) for run in runs}) > 1]
    return [{key: run.get(key, NOT_GIVEN) for key in apart} for run in runs]


def phrase(key: str, text: str) -> str:
    """One setting in words: ``fps 24``, ``normal threshold 0.05``."""
    _, of, name = key.partition("thresholds.")
    return f"{name} threshold {text}" if of else f"{key.replace('_', ' ')} {text}"
