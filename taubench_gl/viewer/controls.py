"""Kinds of controls.  A control is declared once, as a field of ``ViewerState`` or ``Live``.

Its name in scripts, session files and preferences, its widget, its keys with their help, and what a change restarts all
follow from that declaration.  No window and no OpenGL.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from taubench_gl.errors import SettingsError

Change = Callable[[Any], None]
"""A function that changes a ``ViewerState``."""
NOTHING, IMAGE, MASKS, SOURCE = "", "image", "masks", "source"
"""What a change restarts: nothing; the image is drawn again; the pair is compared again; passes are planned again."""


@dataclass(frozen=True, slots=True)
class Action:
    """What keys, buttons and scripts run by name.

    ``keys``: chords separated by spaces; ``doc``: line of the help and tooltip; ``run``: the change of the state, None
    for a request that the model serves.
    """

    name: str
    keys: str
    doc: str
    run: Change | None = None


@dataclass(frozen=True, kw_only=True)
class Control:
    """One value of the state that the user sets.  Subclasses read it from text and describe its widget.

    ``section``: panel section that draws a widget, empty for none; ``label``: text of the widget, by default the name;
    ``visible``: whether the widget is drawn now; ``group``: heading of ``actions`` in the help; ``restarts``: NOTHING,
    IMAGE, MASKS or SOURCE; ``preference``: kept from one start of the viewer to the next; ``in_session``: stored in
    session files; ``live``: a field of ``Live``.
    """

    section: str = ""
    label: str = ""
    visible: Callable[[Any], bool] = lambda state: True
    group: str = ""
    actions: tuple[Action, ...] = ()
    restarts: str = IMAGE
    preference: bool = False
    in_session: bool = True
    name: str = ""
    live: bool = False

    def get(self, state: Any) -> Any:
        """The value of this control in ``state``."""
        return getattr(state.live if self.live else state, self.name)

    def set(self, state: Any, value: Any) -> None:
        """Store ``value`` in ``state``; it must be valid."""
        if self.live:
            state.live = dataclasses.replace(state.live, **{self.name: value})
        else:
            setattr(state, self.name, value)

    def read(self, state: Any) -> dict[str, Any]:
        """Names of scripts -> values, which are numbers or text."""
        return {self.name: self.get(state)}

    def write(self, state: Any, name: str, text: str) -> None:
        """Set ``name``, one of ``read``, to the value that ``text`` spells.  Raises SettingsError."""
        self.set(state, self.parse(state, name, text))

    def parse(self, state: Any, name: str, text: str) -> Any:
        """The value that ``text`` spells, within the limits of the control.  Raises SettingsError."""
        raise NotImplementedError

    def all_actions(self) -> tuple[Action, ...]:
        """Every action on this control, that of a flag first."""
        return self.actions


@dataclass(frozen=True)
class Flag(Control):
    """On or off, with a checkbox.

    ``keys``, ``doc`` and ``action``: keys, description and name of the action that switches the flag.
    """

    keys: str = ""
    doc: str = ""
    action: str = ""

    def read(self, state: Any) -> dict[str, Any]:
        return {self.name: int(self.get(state))}

    def parse(self, state: Any, name: str, text: str) -> bool:
        return flag(name, text)

    @property
    def switch(self) -> str:
        """Name of the action that switches the flag."""
        return self.action or self.name.replace("_", " ")

    def all_actions(self) -> tuple[Action, ...]:
        def flip(state: Any) -> None:
            self.set(state, not self.get(state))

        switch = (Action(self.switch, self.keys, self.doc, flip),) if self.keys else ()
        return (*switch, *self.actions)


@dataclass(frozen=True)
class Number(Control):
    """A number from ``low`` to ``high``, with a slider.

    ``whole``: an integer; ``slider``: its ends, by default ``low`` and ``high``; ``text``: printf format of
    the value; ``logarithmic``: scale of the slider.
    """

    low: float
    high: float
    whole: bool = False
    slider: tuple[float, float] | None = None
    text: str = "%.2f"
    logarithmic: bool = False

    def parse(self, state: Any, name: str, text: str) -> float:
        value = min(max(number(name, text), self.low), self.high)
        return round(value) if self.whole else value


@dataclass(frozen=True)
class Choice(Control):
    """One of ``values``, with a list; they may depend on the state.  ``numeric``: the values spell numbers."""

    values: Sequence[str] | Callable[[Any], Sequence[str]]
    numeric: bool = False

    def choices(self, state: Any) -> Sequence[str]:
        """The values that can be chosen in ``state``."""
        return self.values(state) if callable(self.values) else self.values

    def spelled(self, state: Any) -> str:
        """The value as one of ``choices``."""
        return f"{self.get(state):g}" if self.numeric else self.get(state)

    def parse(self, state: Any, name: str, text: str) -> str | float:
        text = f"{number(name, text):g}" if self.numeric else text
        chosen(name, text, self.choices(state))
        return float(text) if self.numeric else text


@dataclass(frozen=True)
class Members(Control):
    """A dictionary of values of one ``kind``; scripts name them ``prefix.KEY``."""

    prefix: str
    kind: Control

    def read(self, state: Any) -> dict[str, Any]:
        return {f"{self.prefix}.{k}": int(v) if isinstance(v, bool) else v for k, v in self.get(state).items()}

    def write(self, state: Any, name: str, text: str) -> None:
        self.get(state)[name.partition(".")[2]] = self.kind.parse(state, name, text)


@dataclass(frozen=True)
class Special(Control):
    """A value with rules of its own: the functions ``reader`` and ``writer`` do what ``read`` and ``write`` promise."""

    reader: Callable[[Any], dict[str, Any]]
    writer: Callable[[Any, str, str], None]

    def read(self, state: Any) -> dict[str, Any]:
        return self.reader(state)

    def write(self, state: Any, name: str, text: str) -> None:
        self.writer(state, name, text)


def control(default: Any, kind: Control, *actions: Action) -> Any:
    """A field of a data class that declares a control and what keys do with it."""
    return field(default=default, metadata=declared(kind, *actions))


def declared(kind: Control, *actions: Action) -> dict[str, Control]:
    """Metadata of a field that declares a control."""
    return {"control": dataclasses.replace(kind, actions=actions)}


def controls_of(kind: type, live: bool = False) -> list[Control]:
    """The controls that the fields of a data class declare, in their order, with their names."""
    return [
        dataclasses.replace(f.metadata["control"], name=f.name, live=live)
        for f in dataclasses.fields(kind)
        if "control" in f.metadata
    ]


def chosen(name: str, text: str, allowed: Sequence[str]) -> str:
    """``text``, if it is one of ``allowed``.  Raises SettingsError."""
    if text not in allowed:
        raise SettingsError(f"{name} cannot be {text!r}", hint=f"choose from {', '.join(allowed) or 'nothing'}")
    return text


def number(name: str, text: str) -> float:
    """The finite number that ``text`` spells.  Raises SettingsError."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) < 1e30:
        raise SettingsError(f"{name} cannot be {text!r}", hint="give a number")
    return value


def flag(name: str, text: str) -> bool:
    """Whether ``text`` spells on or off.  Raises SettingsError."""
    flags = {"1": True, "on": True, "true": True, "yes": True, "0": False, "off": False, "false": False, "no": False}
    if text.lower() not in flags:
        raise SettingsError(f"{name} cannot be {text!r}", hint="give on or off")
    return flags[text.lower()]


def pixel(name: str, text: str, size: tuple[int, int]) -> tuple[int, int] | None:
    """``X,Y`` within an image of ``size``, row from the top; None for ``none``.  Raises SettingsError."""
    if text == "none":
        return None
    match = re.fullmatch(r"(\d{1,6}),(\d{1,6})", text)
    if match is None or int(match[1]) >= size[0] or int(match[2]) >= size[1]:
        raise SettingsError(f"{name} cannot be {text!r}", hint=f"give X,Y below {size[0]},{size[1]}, or none")
    return int(match[1]), int(match[2])
