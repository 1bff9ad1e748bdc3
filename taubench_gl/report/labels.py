"""Names of runs that are compared: the scene, and the settings in which runs of one scene differ."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from taubench_gl.glossary import OPTIONS

Summary = Mapping[str, Any]

NOT_GIVEN = "default"
GIVEN = "as given"
"""Reason of a lighting setting that the caller chose."""
_OTHER_KEYS = ("width", "height", "first_frame", "last_frame", "thresholds")
"""Settings that ``flat_settings`` combines or splits into other keys."""
_CAMERA_REMARK = re.compile(r" \(|: ")
"""Start of the remark that follows the name in the ``source`` of a camera."""


def run_labels(summaries: Sequence[Summary]) -> list[str]:
    """One label per run: the scene, with the differing settings if several runs have it, numbered if none differs."""
    names = [str((summary.get("scene") or {}).get("name") or "scene") for summary in summaries]
    labels = list(names)
    for name in dict.fromkeys(names):
        indices = [i for i, other in enumerate(names) if other == name]
        for i, settings in zip(indices, differing([_settings_of(summaries[i]) for i in indices]), strict=True):
            labels[i] = labelled(name, (phrase(*item) for item in settings.items()))
    count = labels.count
    return [f"{label} #{labels[: i + 1].count(label)}" if count(label) > 1 else label for i, label in enumerate(labels)]


def labelled(name: str, phrases: Iterable[str]) -> str:
    """``name (size 1920x1080, camera Top)``; the name alone without phrases."""
    text = ", ".join(phrases)
    return f"{name} ({text})" if text else name


def flat_settings(settings: Mapping[str, Any]) -> dict[str, str]:
    """Key -> text of every setting, from the fields of Settings or the ``settings`` block of a summary.

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
        elif key not in _OTHER_KEYS:
            flat[key] = _text(value)
    return flat


def differing(runs: Sequence[Mapping[str, str]]) -> list[dict[str, str]]:
    """For each run, the flat settings that not all runs share; a missing setting counts as its default."""
    keys = dict.fromkeys(key for run in runs for key in run)
    different = [key for key in keys if len({run.get(key, NOT_GIVEN) for run in runs}) > 1]
    return [{key: run.get(key, NOT_GIVEN) for key in different} for run in runs]


def phrase(key: str, text: str) -> str:
    """One flat setting in words: ``fps 24``, ``normal threshold 0.05``."""
    _, prefix, name = key.partition("thresholds.")
    return f"{name} threshold {text}" if prefix else f"{key.replace('_', ' ')} {text}"


def lighting_text(summary: Summary) -> str | None:
    """Light unit, exposure and environment of a run with their reasons; None for runs that do not record them.

    ``light unit candela (written by X), exposure 0.3581 (metered in frames 0, 2 and 3), environment none``
    """
    settings, reasons = summary.get("settings") or {}, summary.get("lighting") or {}
    if "light_unit" not in settings:
        return None
    parts = []
    for name in ("light_unit", "exposure", "environment"):
        value, reason = settings.get(name), reasons.get(name, GIVEN)
        text = f"{name.replace('_', ' ')} {_light_value(value)}"
        parts.append(text if reason == GIVEN or value is None else f"{text} ({reason})")
    return ", ".join([*parts, *_light_method(settings, summary.get("effects") or {})])


def comparison_text(summary: Summary) -> str:
    """``camera reprojection, nearest sampling``, and where the history is not the frame before, which one it is."""
    settings = summary.get("settings") or {}
    text = f"{settings.get('reprojection', '?')} reprojection, {settings.get('sampling', '?')} sampling"
    stored = (summary.get("path_traced") or {}).get("vectors")
    vectors = [f"motion vectors of the files (pass {stored})"] if stored else []
    return ", ".join([text, *vectors, *history_text(settings)])


def history_text(settings: Summary) -> list[str]:
    """``history of the other eye (the right eye, 0.064 m from the camera)``; nothing for that of the frame before."""
    history = settings.get("history", "frame")
    if history == "frame":
        return []
    if settings.get("other_eye") is not None:
        return [f"{OPTIONS[history].label} (camera {settings['other_eye']!r})"]
    converges = settings.get("convergence")
    at = "" if converges is None else f", convergence at {converges:g} m"
    side = "right" if settings.get("eye") == "left" else "left"
    return [f"{OPTIONS[history].label} (the {side} eye, {settings.get('eyes'):g} m from the camera{at})"]


def _light_method(settings: Summary, effects: Summary) -> list[str]:
    """``light path-traced (64 fixed samples per pixel)`` where light is path-traced, all or part of it."""
    traced = {name for name in ("path_traced", "emitter_light", "environment_light") if effects.get(name, {}).get("on")}
    if not traced and ("path_traced" in effects or settings.get("light") != "path-traced"):
        return []  # no requested column depends on light, or nothing lights the scene
    parts = {"emitter_light": "emitters", "environment_light": "environment"}
    of = "".join(f" {'and ' * bool(k)}{parts[name]}" for k, name in enumerate(sorted(traced & parts.keys())))
    samples = f"{settings['spp']} " if settings.get("spp") else ""
    plural = "" if settings.get("spp") == 1 else "s"
    pattern = f"{samples}{settings.get('pattern', 'fixed')} sample{plural} per pixel"
    if settings.get("bidirectional") and not of:
        pattern += ", bidirectional"
    return [f"light of{of} path-traced ({pattern})" if of else f"light path-traced ({pattern})"]


def _light_value(value: Any) -> str:
    if isinstance(value, float | int):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        return ",".join(f"{number:.4g}" for number in value)
    return "as rendered" if value is None else str(value)


def range_text(ends: Iterable[int | None]) -> str:
    """A range of frames in the notation of the command line: ``0:24``, ``100:``."""
    return ":".join("" if end is None else str(end) for end in ends)


def _settings_of(summary: Summary) -> dict[str, str]:
    """Flat settings of a run, and the name of its camera."""
    source = str((summary.get("camera") or {}).get("source") or "")
    camera = {"camera": _CAMERA_REMARK.split(source)[0].removeprefix("camera ")} if source else {}
    return flat_settings(summary.get("settings") or {}) | camera


def _text(value: Any) -> str:
    if value is None:
        return NOT_GIVEN
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, float):
        return f"{value:.6g}"
    return ",".join(_text(item) for item in value) if isinstance(value, (list, tuple)) else str(value)
