"""The demos.  Importing this package registers them."""

from __future__ import annotations

import importlib
import pkgutil

from taubench_gl.demos.demo import REGISTRY, Demo
from taubench_gl.errors import SettingsError, choice_hint

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")


def demos() -> list[Demo]:
    """All demos, ordered by number."""
    return sorted(REGISTRY.values(), key=lambda d: d.number)


def find_demo(text: str) -> Demo:
    """The demo with a name, a number or a unique prefix of a name.  Raises SettingsError."""
    every, word = demos(), text.strip().lower()
    if word.isdigit():
        matches = [d for d in every if d.number == int(word)]
    else:
        matches = [d for d in every if d.name == word] or [d for d in every if word and d.name.startswith(word)]
    if len(matches) == 1:
        return matches[0]
    message = f"several demos begin with {text!r}" if matches else f"no demo is {text!r}"
    numbered = [f"{d.number} {d.name}" for d in matches or every]
    raise SettingsError(message, hint=choice_hint(word, [d.name for d in matches or every], shown=numbered))
