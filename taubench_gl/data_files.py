"""The one opener of files that other programs and people may have written, and the reader of JSON, TOML and CSV.

Only regular files are opened, up to a size limit; names may have any bytes.  Numbers fit their types, nesting and keys
are bounded.  Every fault is one error of the class that the caller names.  JSON has no NaN and no infinity; ``checked``
compares values with a type.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import os
import re
import stat
import tomllib
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import reduce
from pathlib import Path
from typing import Any, BinaryIO, Literal, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from taubench_gl.errors import OutputError, TaubenchError
from taubench_gl.memory_budget import require, shown_bytes
from taubench_gl.paths import PACKAGE, SHADERS

MAX_BYTES = 256 << 20
"""Size limit of a file, unless its reader gives another."""
_BLOCK = 1 << 16
MAX_TOML_BYTES = 4 << 20
MAX_VALUES = 4_000_000
"""Limit on the values of a JSON file; each takes about a hundred bytes."""
MAX_DEPTH = 64
"""Limit on the nesting of objects and lists; deeper values exhaust the stack of the functions that handle them."""
_INTEGER = re.compile(r"[+-]?[0-9]+")
_KEY_PART = r"(?:[\w-]++|\"[^\"\n]*+\"|'[^'\n]*+')"
_LONG_KEY = re.compile(rf"(?:^|[\[{{,])[ \t]*+{_KEY_PART}(?:[ \t]*+\.[ \t]*+{_KEY_PART}){{{MAX_DEPTH}}}", re.MULTILINE)
_EXPECTED = re.compile(r"Expected (.*), got (.*)")
_FIELD = re.compile(r"Object (missing required|contains unknown) field (.*)")
_STEP = re.compile(r"\.([^.\[\]`]+)|\[(\d+)\]")
_WORDS = {"object": "an object", "array": "a list", "str": "text", "float": "a number", "int": "an integer",
          "bool": "true or false"}  # fmt: skip
_MAX_DIGITS = 20  # of an integer: 64 bits with a sign
ARRAY_FAULTS = (
    OSError, ValueError, KeyError, EOFError, MemoryError, AttributeError, TypeError, zipfile.BadZipFile, zlib.error,
    NotImplementedError,
)  # fmt: skip
_READ_FAULTS = (ValueError, RecursionError, OverflowError, csv.Error)

Fault = type[TaubenchError]
T = TypeVar("T")


def opened(
    path: str | Path,
    fault: Fault = OutputError,
    *,
    max_bytes: int | None = None,
    links: bool = True,
    where: str | None = None,
) -> BinaryIO:
    """A regular file of at most ``max_bytes``, open for reading.  Raises ``fault``, also when the file is read.

    Pipes and devices are not opened.  ``links``: follow a link in the place of the file; False in output folders, where
    others may have put it.  Libraries that open files by name get ``by_descriptor``.  ``where``: what refers to the
    file, by default the file itself.
    """
    where = where or str(path)
    follow = 0 if links else os.O_NOFOLLOW
    try:
        # Without O_NONBLOCK, opening a pipe waits for its writer.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | follow)
    except FileNotFoundError:
        raise fault("no such file", where=where, hint="check the path") from None
    except (OSError, ValueError) as error:
        raise fault(f"cannot be read: {getattr(error, 'strerror', None) or error}", where=where) from None
    about = os.fstat(descriptor)
    problem = None
    if not stat.S_ISREG(about.st_mode):
        problem = "is a folder, not a file" if stat.S_ISDIR(about.st_mode) else "is not a regular file"
    elif max_bytes is not None and about.st_size > max_bytes:
        problem = f"{'' if where == str(path) else f'{Path(path).name} '}is larger than {shown_bytes(max_bytes)}"
    if problem is not None:
        os.close(descriptor)
        raise fault(problem, where=where)
    return io.BufferedReader(_Readable(descriptor, fault, where))


class _Readable(io.FileIO):
    """An open file whose system errors, as of a failing disk, are ``fault``."""

    def __init__(self, descriptor: int, fault: Fault, where: str):
        super().__init__(descriptor)
        self._fault, self._where = fault, where

    def readinto(self, buffer: Any) -> int:
        return self._read(super().readinto, buffer)

    def readall(self) -> bytes:
        return self._read(super().readall)

    def _read(self, read: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return read(*arguments)
        except OSError as error:
            raise self._fault(f"cannot be read: {error.strerror}", where=self._where) from None


def by_descriptor(file: BinaryIO) -> str:
    """A name of an open file for libraries that open by name: the same file, whatever its name and its bytes are."""
    return f"/dev/fd/{file.fileno()}"


def read_bytes(
    path: str | Path,
    fault: Fault = OutputError,
    *,
    max_bytes: int = MAX_BYTES,
    links: bool = True,
    where: str | None = None,
) -> bytes:
    """The content of a file that ``opened`` opens.  Raises ``fault``, also for one that grows beyond ``max_bytes``."""
    with opened(path, fault, max_bytes=max_bytes, links=links, where=where) as file:
        data = file.read(os.fstat(file.fileno()).st_size)
        # It has grown, or is a file of the system: those say 0 bytes, and fail for a large buffer.
        while len(data) <= max_bytes and (block := file.read(_BLOCK)):
            data += block
    if len(data) > max_bytes:
        raise fault(f"is larger than {shown_bytes(max_bytes)}", where=where or str(path))
    return data


@contextmanager
def stored_arrays(path: str | Path, fault: Fault = OutputError, hint: str | None = None) -> Iterator[Any]:
    """The arrays of a NumPy archive (.npz) by name, read on demand.  Raises ``fault``, also inside the block."""
    import numpy as np

    with opened(path, fault) as file:
        try:
            with np.load(file, allow_pickle=False) as arrays:
                require(sum(entry.file_size for entry in arrays.zip.infolist()), "the arrays", fault, str(path))
                yield arrays
        except ARRAY_FAULTS as error:
            raise fault(f"is damaged: {error!s:.200}", where=str(path), hint=hint) from None


def hashed(path: str | Path, fault: Fault = OutputError, digest: Any = None) -> Any:
    """Add the bytes of a file to ``digest``, by default a new SHA-256, which is returned.  Raises ``fault``."""
    digest = hashlib.sha256() if digest is None else digest
    with opened(path, fault) as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest


def code_hash(modules: Iterable[str], shaders: Iterable[str] = ("",)) -> str:
    """Hash of files of the package, 16 hexadecimal digits: part of the key of what they compute and a cache keeps.

    ``modules``: files and folders of the package; ``shaders``: folders of ``SHADERS``, by default all.
    """
    roots = [PACKAGE / name for name in modules] + [SHADERS / name for name in shaders]
    files = {path for root in roots for path in ([root] if root.is_file() else root.rglob("*.*"))}
    digest = hashlib.sha256()
    for path in sorted(f for f in files if f.suffix in (".py", ".glsl")):
        digest.update(path.name.encode() + b"\0")
        hashed(path, digest=digest)
    return digest.hexdigest()[:16]


def read_text(path: str | Path, fault: Fault = OutputError, *, max_bytes: int = MAX_BYTES, links: bool = True) -> str:
    """The content of a file as UTF-8 text, without a byte order mark.  Raises ``fault``, as ``read_bytes``."""
    data = read_bytes(path, fault, max_bytes=max_bytes, links=links)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise fault("is not UTF-8 text", where=str(path)) from None


def read_json(
    path: str | Path,
    kind: Any = Any,
    fault: Fault = OutputError,
    *,
    hint: str | None = None,
    max_bytes: int = MAX_BYTES,
) -> Any:
    """The value of a JSON file, which matches the type ``kind`` (``checked``).  Raises ``fault``."""
    text = read_text(path, fault, max_bytes=max_bytes)
    with one_line(path, fault, "is not valid JSON", hint):
        return checked(parse_json(text), kind)


def read_toml(
    path: str | Path,
    kind: type[T] = dict[str, Any],
    fault: Fault = OutputError,
    *,
    hint: str | None = None,
    max_bytes: int = MAX_TOML_BYTES,
) -> T:
    """The content of a TOML file as ``kind``, a msgspec.Struct or a dict of its tables.  Raises ``fault``."""
    text = read_text(path, fault, max_bytes=max_bytes)
    with one_line(path, fault, "is not TOML", hint):
        return convert(parse_toml(text), kind)


@contextmanager
def one_line(
    path: str | Path, fault: Fault = OutputError, problem: str = "is damaged", hint: str | None = None
) -> Iterator[None]:
    """Turns an exception of a parser or of msgspec inside the block into a ``fault`` of the file ``path``.

    ``problem`` begins the message about text that cannot be parsed; a value of another type is named by its key.
    """
    try:
        yield
    except msgspec.ValidationError as error:
        raise fault(schema_fault(error), where=str(path), hint=hint) from None
    except _READ_FAULTS as error:
        raise fault(f"{problem}: {_short(error)}", where=str(path), hint=hint) from None


def read_csv(
    path: str | Path, fault: Fault = OutputError, *, whole_lines: bool = False, links: bool = True
) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of each row of a CSV file.  ``links``: as for ``opened``.  Raises ``fault``.

    ``whole_lines``: leave out a last line without its line break, which an interrupted writer has left.
    """
    text = read_text(path, fault, max_bytes=8 * MAX_BYTES, links=links)
    if whole_lines:
        text = text[: text.rfind("\n") + 1]
    reader = csv.reader(text.splitlines())
    try:
        for cells in reader:
            yield reader.line_num, cells
    except _READ_FAULTS as error:
        raise fault(f"is not CSV: {_short(error)}", where=f"{path}:{reader.line_num}") from None


def parse_json(text: str | bytes) -> Any:
    """The value of a JSON text.  Raises ValueError or RecursionError, also for NaN, infinity and oversized numbers."""
    comma, opening = (",", "{[") if isinstance(text, str) else (b",", (b"{", b"["))
    if text.count(comma) + sum(text.count(bracket) for bracket in opening) > MAX_VALUES:
        raise ValueError(f"more than {MAX_VALUES:,} values")
    value = json.loads(text, parse_int=integer, parse_float=real, parse_constant=_no_constant)
    return _bounded(value)


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text.  Raises ValueError or RecursionError, also for numbers that do not fit."""
    if _LONG_KEY.search(text):  # the parser's memory grows with the square of the parts
        raise ValueError(f"more than {MAX_DEPTH} levels of nesting")
    return _bounded(tomllib.loads(text, parse_float=_toml_real))


def checked(value: Any, kind: Any) -> Any:
    """The value itself, if it matches the type ``kind`` as msgspec reads types.  Raises msgspec.ValidationError."""
    if kind is not Any:
        convert(value, kind)
    return value


def convert(value: Any, kind: type[T]) -> T:
    """``msgspec.convert``, whose errors name the keys of tables, which msgspec writes as ``[...]``, and allowed values.

    Raises msgspec.ValidationError.
    """
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        first = str(error)
    message, at, place = first.partition(" - at ")
    named, *rest = place.split("[...]")
    steps = _steps(named)
    for part in rest:
        # The one entry of the table that alone gives the same error.
        table = reduce(lambda inner, step: inner[step], steps, value)
        alone = ((key, _replaced(value, steps, {key: table[key]})) for key in table if isinstance(table, Mapping))
        key, value = next(((key, one) for key, one in alone if _error(one, kind) == first), ("[...]", value))
        if key == "[...]":
            break
        steps += [key, *_steps(part)]
        named += f".{key}{part}"
    else:
        place = named
    if message.startswith("Invalid enum value") and (values := _choices(kind, _steps(place))):
        message += f", expected one of {', '.join(values)}"
    raise msgspec.ValidationError(message + at + place) from None


def _choices(kind: Any, steps: Sequence[str | int]) -> list[str]:
    """Values of the literals of the type ``kind``, followed through structs, tables and lists along ``steps``."""
    arguments = [a for a in get_args(kind) if a is not type(None)]
    if get_origin(kind) is Literal:
        return [str(value) for value in arguments]
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct) and steps:
        field = next((f.name for f in msgspec.structs.fields(kind) if f.encode_name == steps[0]), None)
        return _choices(get_type_hints(kind)[field], steps[1:]) if field else []
    if get_origin(kind) in (list, dict, tuple) and steps:
        return _choices(arguments[-1] if get_origin(kind) is dict else arguments[0], steps[1:])
    return [value for alternative in arguments for value in _choices(alternative, steps)]


def _steps(place: str) -> list[str | int]:
    """Keys and indices of a place in msgspec's messages."""
    return [int(index) if index else key for key, index in _STEP.findall(place)]


def _replaced(value: Any, steps: Sequence[str | int], inner: Any) -> Any:
    """A copy of nested tables and lists with ``inner`` at ``steps``."""
    if not steps:
        return inner
    copy = dict(value) if isinstance(value, Mapping) else list(value)
    copy[steps[0]] = _replaced(value[steps[0]], steps[1:], inner)
    return copy


def _error(value: Any, kind: Any) -> str | None:
    """The message of msgspec about ``value``, None if it matches ``kind``."""
    try:
        msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        return str(error)
    return None


def schema_fault(error: msgspec.ValidationError) -> str:
    """msgspec's message with the key first: ``settings.width is text, expected a number``."""
    message, _, place = str(error).replace("`", "").partition(" - at ")
    key = place.removeprefix("$").removeprefix(".")
    if field := _FIELD.fullmatch(message):
        fault = "is missing" if field[1] == "missing required" else "is unknown"
        return f"{f'{key}.{field[2]}'.removeprefix('.')} {fault}"
    key = key or "the file"
    if types := _EXPECTED.fullmatch(message):
        return f"{key} is {_in_words(types[2])}, expected {_in_words(types[1])}"
    return f"{key}: {message[:1].lower()}{message[1:]}"


def _in_words(kinds: str) -> str:
    """Names of types in msgspec's messages, as people who write TOML and JSON know them."""
    return " or ".join(_WORDS.get(kind, kind) for kind in kinds.split(" | "))


def integer(text: str) -> int:
    """An integer of at most 64 bits.  Raises ValueError."""
    if len(text) > _MAX_DIGITS:
        raise ValueError(f"an integer of {len(text)} digits")
    if not _INTEGER.fullmatch(text):  # int() takes digits of any script, and underscores
        raise ValueError(f"{text!r} is not an integer")
    return int(text)


def real(text: str) -> float:
    """A finite number.  Raises ValueError."""
    if not text.isascii() or "_" in text:
        raise ValueError(f"{text[:_MAX_DIGITS]!r} is not a number")
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:_MAX_DIGITS]} is not a finite number")
    return value


def _toml_real(text: str) -> float:
    # TOML has literals of infinity and NaN; whether a setting may have them is its own rule.
    return float(text) if text.lstrip("+-") in ("inf", "nan") else real(text.replace("_", ""))


def _no_constant(text: str) -> float:
    raise ValueError(f"{text} is not a number in JSON")


def _bounded(value: Any) -> Any:
    """The value itself, if it is not nested too deep and its integers fit 64 bits.  Raises ValueError."""
    level = [value]
    for _ in range(MAX_DEPTH):
        below: list[Any] = []
        for item in level:
            if isinstance(item, dict):
                below += item.values()
            elif isinstance(item, list):
                below += item
            elif isinstance(item, int) and item.bit_length() > 64:
                raise ValueError("an integer of more than 64 bits")
        if not below:
            return value
        level = below
    raise ValueError(f"more than {MAX_DEPTH} levels of nesting")


def _short(error: Exception) -> str:
    """The message of a parser, at most 200 characters of it."""
    if isinstance(error, RecursionError):
        return f"more than {MAX_DEPTH} levels of nesting"
    return f"{error!s:.200}"
