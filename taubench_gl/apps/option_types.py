"""What options hold: sizes, ranges of frames, thresholds, colors, lists of words."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.aliases import current_value


class Size(click.ParamType):
    """``1920x1080`` -> (1920, 1080)."""

    name = "WxH"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        width, by, height = value.lower().partition("x")
        if not (by and width.isdecimal() and height.isdecimal()):
            self.fail(f"{value!r} is not a size such as 1920x1080", param, ctx)
        return int(width), int(height)


class Frames(click.ParamType):
    """``A:B`` -> (A, B), either end may be missing: a Python slice of frame numbers."""

    name = "A:B"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        first, colon, stop = value.partition(":")
        try:
            if not colon:
                raise ValueError
            return tuple(int(end) if end.strip() else None for end in (first, stop))
        except ValueError:
            self.fail(f"{value!r} is not a range of frames such as 0:24, 100: or :-1", param, ctx)


class Threshold(click.ParamType):
    """``normal=0.1`` -> ("normal", 0.1); the names are checked by Settings."""

    name = "NAME=V"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        name, equals, number = value.partition("=")
        try:
            if not equals:
                raise ValueError
            return name.strip(), float(number)
        except ValueError:
            self.fail(f"{value!r} is not a threshold such as normal=0.1", param, ctx)


class Color(click.ParamType):
    """``R,G,B``, or one number for a gray -> (r, g, b) floats; the range is checked by Settings."""

    name = "R,G,B"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(float(part) for part in value.split(","))
        except ValueError:
            numbers = ()
        if len(numbers) not in (1, 3):
            self.fail(f"{value!r} is not a radiance such as 0.2,0.4,0.9", param, ctx)
        return numbers * 3 if len(numbers) == 1 else numbers


class OutPath(click.Path):
    """Where results go -> Path.  An empty name, as of a shell variable that is not set, is no place."""

    def __init__(self, *, dir_okay: bool = True) -> None:
        super().__init__(path_type=Path, dir_okay=dir_okay)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "":
            self.fail("the name is empty; '.' is the current folder", param, ctx)
        return super().convert(value, param, ctx)


class Words(click.ParamType):
    """A comma-separated choice of ``words`` -> tuple, in the order given, each once.

    ``none`` allows an empty list.  ``former`` maps former words to current ones.
    """

    name = "LIST"

    def __init__(self, *words: str, verb: str = "save", none: bool = True, former: Mapping[str, str] | None = None):
        self.words, self.verb, self.none = words, verb, none
        self.former = dict(former or {})

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        given = (word.strip() for word in value.split(",") if word.strip())
        chosen = tuple(dict.fromkeys(current_value(word, self.former, param) for word in given))
        unknown = [word for word in chosen if word not in self.words]
        if unknown:
            self.fail(f"cannot {self.verb} {', '.join(unknown)}; choose from {', '.join(self.words)}", param, ctx)
        if not (chosen or self.none):
            self.fail(f"nothing to {self.verb}; choose from {', '.join(self.words)}", param, ctx)
        return chosen
