"""The demos.  Importing this package registers them."""

from __future__ import annotations

from taubench_gl.demos.demo import REGISTRY, Demo
from taubench_gl.demos.lessons import (
    behind,
    cost,
    counting,
    exposure,
    features,
    ghosting,
    ground,
    half,
    jitter,
    lock,
    noise,
    occlusion,
    relative,
    rotations,
    samples,
    sampling,
    thresholds,
)
from taubench_gl.errors import SettingsError

__all__ = [
    "behind", "cost", "counting", "demos", "exposure", "features", "find_demo", "ghosting", "ground", "half", "jitter",
    "lock", "noise", "occlusion", "relative", "rotations", "samples", "sampling", "thresholds",
]  # fmt: skip


def demos() -> list[Demo]:
    """All demos, ordered by number."""
    return sorted(REGISTRY.values(), key=lambda d: d.number)


def find_demo(text: str) -> Demo:
    """The demo with a name, a number or a unique prefix of a name.  Raises SettingsError."""
    every = demos()
    word = text.strip().lower()
    if word.isdigit():
        found = [d for d in every if d.number == int(word)]
    else:
        found = [d for d in every if d.name == word] or [d for d in every if word and d.name.startswith(word)]
    if len(found) == 1:
        return found[0]
    what = "several demos begin with" if found else "no demo is"
    names = ", ".join(f"{d.number} {d.name}" for d in (found or every))
    raise SettingsError(f"{what} {text!r}", hint=f"choose from {names}")
