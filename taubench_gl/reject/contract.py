"""A rejection test: a folder with ``test.toml`` and ``test.glsl``.  No OpenGL.

``test.glsl`` has ``float difference(Point now, Point history, Pixel pixel)`` (``shaders/reject/contract.glsl``);
history is rejected where it is above the threshold.  A test of kind ``color`` also reads radiance.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from taubench_gl.data_files import read_text, read_toml
from taubench_gl.errors import MethodError, choice_hint
from taubench_gl.paths import PACKAGE
from taubench_gl.setting_values import FLOAT32_MAX

FILE, SHADER = "test.toml", "test.glsl"
BUILTIN = PACKAGE / "reject" / "tests"
_MAX_BYTES = 1 << 20
_NAME = re.compile(r"[a-z][a-z0-9_]{0,40}")
COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
"""Pattern of a comment in GLSL."""
_ENTRY = re.compile(r"\bfloat\s+difference\s*\(\s*(?:in\s+)?Point\b")
_RESERVED = {"now", "history", "pixel", "difference", "at"}


class _Setting(msgspec.Struct, forbid_unknown_fields=True):
    default: float
    doc: str
    min: float = -math.inf
    max: float = math.inf


class _File(msgspec.Struct, forbid_unknown_fields=True):
    title: str
    kind: Literal["geometry", "color"]
    unit: str
    threshold: Annotated[float, msgspec.Meta(ge=0)]
    cite: str = ""
    settings: dict[str, _Setting] = {}


@dataclass(frozen=True, slots=True)
class RejectionTest:
    """One test, or several of which any rejects.

    ``parts``: of a combination, whose difference is the largest of those of its parts, each divided by its threshold.
    """

    name: str
    title: str
    kind: str  # geometry | color
    unit: str
    threshold: float
    cite: str = ""
    shader: str = ""  # text of test.glsl
    settings: Mapping[str, float] = field(default_factory=dict)
    where: str = ""
    parts: tuple[RejectionTest, ...] = ()

    @property
    def single(self) -> tuple[RejectionTest, ...]:
        """The tests that are computed."""
        return self.parts or (self,)


def builtin_tests() -> tuple[str, ...]:
    """Names of the built-in tests, in alphabetical order."""
    return tuple(sorted(path.parent.name for path in BUILTIN.glob(f"*/{FILE}")))


def load_test(source: str) -> RejectionTest:
    """The test ``NAME`` or a folder, or any of several joined by ``+``; each may end with ``=THRESHOLD``.

    Raises MethodError.
    """
    names = source.split("+")
    if len(names) == 1:
        return _load_single(source)
    parts = tuple(_load_single(name) for name in names)
    kind = "color" if any(part.kind == "color" for part in parts) else "geometry"
    title = "any of " + ", ".join(part.name for part in parts)
    return RejectionTest("+".join(p.name for p in parts), title, kind, "thresholds of its parts", 1.0, parts=parts)


def load_tests(sources: Sequence[str]) -> tuple[RejectionTest, ...]:
    """The tests of ``sources`` by ``load_test``.  Raises MethodError, also for none and for two of one name."""
    tests = tuple(load_test(source) for source in sources)
    names = [test.name for test in tests]
    for name in names:
        if names.count(name) > 1:
            raise MethodError(f"two tests are named {name!r}", hint="give each once")
    if not tests:
        raise MethodError("no test was given", hint=f"choose from {', '.join(builtin_tests())}")
    return tests


def _load_single(source: str) -> RejectionTest:
    name, equals, text = source.strip().partition("=")
    path = BUILTIN / name if name in builtin_tests() else Path(name)
    if not name or not (path / FILE).is_file():
        hint = choice_hint(name, builtin_tests(), ", or give a folder")
        raise MethodError(f"there is no rejection test {name!r}", hint=hint)
    test = load_folder(path)
    if not equals:
        return test
    try:
        threshold = float(text)
    except ValueError:
        threshold = -1.0
    if not (threshold >= 0.0 and math.isfinite(threshold)):
        raise MethodError(f"the threshold {text!r} is not a number of at least 0", where=test.name)
    return replace(test, threshold=threshold)


def load_folder(folder: Path) -> RejectionTest:
    """The test in ``folder``.  Raises MethodError."""
    path = folder / FILE
    file = read_toml(path, _File, MethodError, max_bytes=_MAX_BYTES)
    name = folder.resolve().name
    if not _NAME.fullmatch(name):
        raise MethodError("its folder's name is not lower-case letters, digits and _", where=str(folder))
    for key, setting in file.settings.items():
        if not _NAME.fullmatch(key) or key in _RESERVED:
            raise MethodError(f"settings.{key}: not a name for a constant", where=str(path))
        if not (setting.min <= setting.default <= setting.max and abs(setting.default) <= FLOAT32_MAX):
            raise MethodError(f"settings.{key}.default: not between min and max, or no float32", where=str(path))
    shader = read_text(folder / SHADER, fault=MethodError, max_bytes=_MAX_BYTES)
    bare = COMMENT.sub(" ", shader)
    if "#" in bare:
        raise MethodError("preprocessor lines are not allowed: a test is one file", where=str(folder / SHADER))
    if not _ENTRY.search(bare):
        message = "has no float difference(Point now, Point history, Pixel pixel)"
        raise MethodError(message, where=str(folder / SHADER))
    settings = {key: setting.default for key, setting in file.settings.items()}
    return RejectionTest(
        name, file.title, file.kind, file.unit, file.threshold, file.cite, shader, settings, str(folder / SHADER)
    )


def constants(test: RejectionTest) -> str:
    """The settings of ``test`` as GLSL constants."""
    return "\n".join(f"const float {name} = {float(value)!r};" for name, value in test.settings.items())
