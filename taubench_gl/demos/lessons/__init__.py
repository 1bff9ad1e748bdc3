"""The lessons, numbered in the order of ``lessons.toml``.

The module that has the name of a lesson holds what is specific to it: ``scene()`` and ``run(stage, lesson)``.
"""

from __future__ import annotations

import importlib

from taubench_gl.demos.demo import Demo
from taubench_gl.demos.texts import TEXTS, LessonText
from taubench_gl.errors import SettingsError, choice_hint


def _demo(number: int, text: LessonText) -> Demo:
    """The demo that a text and the module of its name make."""
    own, shown = (importlib.import_module(f"{__name__}.{name}") for name in (text.name, text.scene or text.name))
    return Demo(number, text, own.run, shown.scene)


DEMOS = {text.name: _demo(number, text) for number, text in enumerate(TEXTS.lesson, start=1)}
"""The demos by name, ordered by number."""


def find_demo(text: str) -> Demo:
    """The demo with a name, a number or a unique prefix of a name.  Raises SettingsError."""
    every, word = list(DEMOS.values()), text.strip().lower()
    if word.isdigit():
        matches = [d for d in every if d.number == int(word)]
    else:
        matches = [d for d in every if d.name == word] or [d for d in every if word and d.name.startswith(word)]
    if len(matches) == 1:
        return matches[0]
    message = f"several demos begin with {text!r}" if matches else f"no demo is {text!r}"
    numbered = [f"{d.number} {d.name}" for d in matches or every]
    raise SettingsError(message, hint=choice_hint(word, [d.name for d in matches or every], shown=numbered))
