"""Fields of settings.  Each is declared once, with its type, default, meaning, unit, range and place in the help.

``Settings`` and the dataclasses beside it declare fields with ``setting(...)``, and so do the functions of commands,
for their own keyword parameters.  Options of the command line, keys of files, keywords of Python functions, their
checks, the help and the pages of the documentation are derived from these declarations.
"""

from __future__ import annotations

import contextlib
import dataclasses
import difflib
import functools
import inspect
import math
import os
import re
import types
import typing
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from taubench_gl.errors import SettingsError, choice_hint

REQUIRED = dataclasses.MISSING
"""Default of a field that must be given."""

NO_OPTION = "-"
"""``flag`` of a field that is no option of the command line."""

T = TypeVar("T")


# Checks


@dataclass(frozen=True, slots=True)
class Check:
    """Allowed values of a field."""

    text: str  # completes "give ..."
    fault: Callable[[str, Any], str | None]  # (name, value) -> what is wrong, None if nothing is
    words: tuple[str, ...] = ()  # that the value, or each name in it, is one of

    def hint(self, value: Any) -> str:
        """How to correct ``value``: the word that is nearest to the first unknown one, else what is allowed."""
        names = [value] if isinstance(value, str) else value if isinstance(value, Collection) else ()
        unknown = next((name for name in names if isinstance(name, str) and name not in self.words), "")
        near = difflib.get_close_matches(unknown, self.words, 1)
        return f"did you mean {near[0]}?" if near else f"give {self.text}"


def value_text(name: str, value: Any) -> str:
    """The usual text of a fault: ``NAME is VALUE``."""
    return f"{name} is {value!r:.60}"


def at_least(least: float, text: str = "", most: float = math.inf) -> Check:
    """A check that a value is a finite number in [least, most]."""
    text = text or (f"{least:g} or more" if most == math.inf else f"{least:g} to {most:.17g}")
    return Check(text, lambda name, x: None if math.isfinite(x) and least <= x <= most else value_text(name, x))


def above_zero(text: str = "a number above 0") -> Check:
    """A check that a value is a finite number above 0."""
    return Check(text, lambda name, x: None if math.isfinite(x) and x > 0 else value_text(name, x))


def one_of(allowed: Collection[str]) -> Check:
    """A check that a value is one word of ``allowed``."""
    words = tuple(allowed)
    return Check(f"one of {', '.join(words)}", lambda name, x: None if x in words else value_text(name, x), words)


def some_of(allowed: Collection[str], *, least: int = 0) -> Check:
    """A check that a value is a sequence of words of ``allowed``, at least ``least`` of them."""
    words = tuple(allowed)

    def fault(name: str, value: Any) -> str | None:
        unknown = [word for word in value if word not in words]
        if unknown:
            return f"{name} has no {unknown[0]!r:.60}"
        return None if len(value) >= least else f"{name} is empty"

    return Check(f"names from {', '.join(words)}", fault, words)


# Declarations


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """The declaration of one field.  ``name`` and ``kind``, its type, are filled in by ``declared``."""

    default: Any
    meaning: str  # sentences without the final period
    check: Check | None = None
    name: str = ""
    kind: Any = str
    unit: str = ""
    selects: bool = False  # names the scene, frames or machine of a run: no part of presets and summaries
    read: Callable[[Any], Any] | None = None  # other spellings -> the value; raises SettingsError
    group: str = ""  # heading in the complete help
    short: bool | None = None  # whether the short help shows it; None: only of a command's own parameters
    flag: str = ""  # option, where it is not --NAME: --A, --A/--B or, with another spelling, --A|--B; or NO_OPTION
    metavar: str = ""  # of the option's value
    shown: str = ""  # the default in words, where its value says too little
    repeats: bool = False  # whether the option may be repeated, once for each element
    variable: str = ""  # environment variable that gives the default

    @property
    def option(self) -> str:
        """The option's name on the command line."""
        return re.split("[/|]", self.flag)[0] or f"--{self.name.replace('_', '-')}"

    @property
    def kinds(self) -> tuple[Any, ...]:
        """The alternatives of a union, else the type alone.  Types of a sequence's elements are not among them."""
        return typing.get_args(self.kind) if isinstance(self.kind, types.UnionType) else (self.kind,)

    @property
    def optional(self) -> bool:
        """Whether the value may be None."""
        return type(None) in self.kinds

    @property
    def default_text(self) -> str:
        """The default in words; empty for none, and for switches that are off."""
        if self.shown:
            return self.shown
        if self.default is REQUIRED or self.default is None or self.default is False or self.default in ((), {}, ""):
            return ""
        return ",".join(map(str, self.default)) if isinstance(self.default, tuple) else str(self.default)

    @property
    def help(self) -> str:
        """The help text of an option: meaning and default."""
        return f"{self.meaning}." + (f"  [default: {self.default_text}]" if self.default_text else "")

    def value_of(self, value: Any, name: str = "") -> Any:
        """``value``, as people or programs write it, in the field's type; the range is not checked.

        ``name``: of the field in messages.  Raises SettingsError.
        """
        value, kinds = _python(value), self.kinds
        if isinstance(value, str) and str not in kinds and (int in kinds or float in kinds):
            with contextlib.suppress(ValueError):
                value = float(value) if float in kinds else int(value)
        if Path in kinds and isinstance(value, str | None):
            return value if value is None or str in kinds else self._path(value, name)
        if tuple[Path, ...] in kinds:
            return tuple(self._path(element, name) for element in ([value] if isinstance(value, str) else value))
        if self.read is not None:
            value = self.read(value)
        elif isinstance(value, str) and tuple[str, ...] in kinds:
            value = tuple(dict.fromkeys(part.strip() for part in value.split(",") if part.strip()))
            if not value:
                raise SettingsError(f"{name or self.name} is empty", hint="leave it out", setting=self.name)
        elif tuple[int, ...] in kinds or tuple[float, ...] in kinds:
            value = self._numbers(value, int if tuple[int, ...] in kinds else float, name or self.name)
        return self._converted(value, name or self.name)

    def fault(self, value: Any, name: str = "") -> str | None:
        """What is wrong with ``value``, None if nothing is.  ``name``: of the field in the text."""
        if self.check is None or (value is None and self.optional):
            return None
        name = name or self.name.replace("_", " ")
        try:
            return self.check.fault(name, value)
        except (TypeError, AttributeError, OverflowError):
            return value_text(name, value)

    def checked(self, value: Any, name: str = "") -> Any:
        """``value`` in the type of the field, as ``value_of`` reads it.  Raises SettingsError, also out of range."""
        value = self.value_of(value, name)
        fault = self.fault(value, name)
        if fault is not None:
            raise SettingsError(fault, hint=self.check.hint(value) if self.check else None, setting=self.name)
        return value

    def _numbers(self, value: Any, number: type[int] | type[float], name: str) -> Any:
        """Numbers of comma-separated text, or of a sequence whose elements may be text.  Raises SettingsError."""
        parts = value.split(",") if isinstance(value, str) else value
        if not isinstance(parts, list | tuple):
            return value
        try:
            return tuple(number(part) if isinstance(part, str) else part for part in parts)
        except ValueError:
            hint = f"give {self.check.text if self.check else 'integers' if number is int else 'numbers'}"
            raise SettingsError(value_text(name, value), hint=hint, setting=self.name) from None

    def _path(self, value: str, name: str) -> Path:
        if not value:
            raise SettingsError(f"{name or self.name}: the name is empty", hint="'.' is the current folder")
        return Path(value)

    def _converted(self, value: Any, name: str) -> Any:
        """``value`` in the type of the field.  Raises SettingsError."""
        try:
            return msgspec.convert(value, self.kind)
        except (msgspec.ValidationError, UnicodeError, AttributeError) as error:
            reason = str(error).replace("`", "") if isinstance(error, msgspec.ValidationError) else "of another type"
            message = f"{value_text(name, value)}: {reason}"
            hint = self.check.hint(value) if self.check else None
            raise SettingsError(message, hint=hint, setting=self.name) from None


def setting(default: Any, meaning: str, check: Check | None = None, **fields: Any) -> Any:
    """A field of a dataclass, or the default of a keyword parameter of a command.  ``fields``: of ``Setting``."""
    metadata = {"setting": Setting(default=default, meaning=meaning, check=check, **fields)}
    if isinstance(default, dict):
        return dataclasses.field(default_factory=default.copy, metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


@functools.cache
def declared(owner: Any) -> dict[str, Setting]:
    """The fields that a dataclass, or the keyword parameters that a function, declares with ``setting``, by name.

    Fields without a group get the attribute ``group`` of the class.  The short help shows parameters of functions.
    """
    hints = typing.get_type_hints(owner)
    if dataclasses.is_dataclass(owner):
        fields = {field.name: field for field in dataclasses.fields(owner)}
    else:
        fields = {name: parameter.default for name, parameter in inspect.signature(owner).parameters.items()}
    settings = {
        name: field.metadata["setting"]
        for name, field in fields.items()
        if isinstance(field, dataclasses.Field) and "setting" in field.metadata
    }
    group, is_function = getattr(owner, "group", ""), not dataclasses.is_dataclass(owner)
    return {
        name: dataclasses.replace(
            field,
            name=name,
            kind=hints[name],
            group=field.group or group,
            short=is_function if field.short is None else field.short,
        )
        for name, field in settings.items()
    }


def unknown_field(name: str, allowed: Collection[str]) -> SettingsError:
    """The error for a name that is none of ``allowed``."""
    return SettingsError(f"no setting is named {name!r}", hint=choice_hint(name, allowed), setting=name)


def from_values(kind: type[T], values: Mapping[str, Any]) -> T:
    """An object of ``kind``, a dataclass of fields, from values by name as people or programs write them.

    Raises SettingsError for a name that is no field, a field that is missing, and a wrong value.
    """
    declarations, fields = declared(kind), {field.name: field for field in dataclasses.fields(kind)}
    for name in values:
        if name not in fields:
            raise unknown_field(name, tuple(fields))
    for name, field in declarations.items():
        if field.default is REQUIRED and name not in values:
            raise SettingsError(f"{name} is missing", hint=field.meaning, setting=name)
    return kind(**{n: declarations[n].value_of(v) if n in declarations else v for n, v in values.items()})


class Checked:
    """Base of dataclasses of settings: checks every field when an object is made.  Raises SettingsError."""

    __slots__ = ()

    def __post_init__(self) -> None:
        for name, field in declared(type(self)).items():
            value = getattr(self, name)
            fault = field.fault(value)
            if fault is not None:
                raise SettingsError(fault, hint=field.check.hint(value) if field.check else None, setting=name)


def _python(value: Any) -> Any:
    """NumPy numbers and arrays as Python numbers and lists, a path as text; inside mappings too."""
    if isinstance(value, Mapping):
        return {key: _python(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(_python(inner) for inner in value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value.tolist() if hasattr(value, "tolist") else value
