"""What a reuse method is: the inputs it reads, the history it keeps, its settings and its passes.  Plain data, no GL.

A method is a folder with ``method.toml`` and GLSL files (``toml_method``) or a Python class (``python_method``); both
become a ``Method``.  docs/reuse.md teaches the contract.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from taubench_gl.errors import MethodError
from taubench_gl.reuse.frame import INPUTS

Value = float | int | bool | str


@dataclass(frozen=True, slots=True)
class Format:
    """A texture format a method may keep.  ``dtype`` as moderngl names it, ``glsl`` the type of one value."""

    name: str
    components: int
    dtype: str
    glsl: str

    @property
    def bytes(self) -> int:
        """Per pixel."""
        return self.components * int(self.dtype[1])


FORMATS: dict[str, Format] = {
    f.name: f
    for f in (
        Format("rgba32f", 4, "f4", "vec4"),
        Format("rgba16f", 4, "f2", "vec4"),
        Format("rg32f", 2, "f4", "vec2"),
        Format("rg16f", 2, "f2", "vec2"),
        Format("r32f", 1, "f4", "float"),
        Format("r16f", 1, "f2", "float"),
        Format("rgba32ui", 4, "u4", "uvec4"),
        Format("rg32ui", 2, "u4", "uvec2"),
        Format("r32ui", 1, "u4", "uint"),
    )
}

RESULT = "result"
RESULT_FORMAT = FORMATS["rgba32f"]
"""rgb: linear radiance, exposure applied.  a: weight of history in the pixel, 0 .. 1, or -1 where the method does not
say (``write_result(p, vec3)``)."""

MAX_WRITES, MAX_READS = 8, 16
"""Images and textures that every GL 4.5 driver gives a compute shader."""

MAX_REPEAT = 64

_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
_WORDS = (
    "attribute const uniform buffer shared coherent volatile restrict readonly writeonly layout centroid flat smooth "
    "noperspective patch sample invariant precise break continue do for while switch case default if else subroutine "
    "in out inout int void bool true false float double discard return vec2 vec3 vec4 ivec2 ivec3 ivec4 uint uvec2 "
    "uvec3 uvec4 bvec2 bvec3 bvec4 mat2 mat3 mat4 lowp mediump highp precision struct common partition active filter "
    "asm class union enum typedef template this resource goto inline noinline public static extern external interface "
    "long short half fixed unsigned superp input output cast namespace using sizeof main "
    "abs sign floor ceil fract mod min max clamp mix step smoothstep sqrt pow exp log exp2 log2 sin cos tan length "
    "distance dot cross normalize reflect refract any all not texture round trunc"
)
_GLSL_WORDS = frozenset(_WORDS.split())
_OUR_WORDS = (
    "frame iteration result reuse tap luminance inside in_picture previous_px reusable reusable_in_truth "
    "nearest_surface bilinear_tap catmull_rom_weights clip_to_box ycocg_from_rgb rgb_from_ycocg non_finite"
)
_OURS = frozenset(_OUR_WORDS.split())


@dataclass(frozen=True, slots=True)
class Setting:
    """One number or choice a user may change; in GLSL a uniform of this name.

    ``kind``: float, int, bool, or choice (GLSL: int, the index into ``choices``).  ``scale``: how a search should step
    through [minimum, maximum], linear or log.
    """

    name: str
    kind: str
    default: Value
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    scale: str = "linear"
    doc: str = ""

    @property
    def allowed(self) -> str:
        """What may be given, in words."""
        if self.kind == "choice":
            return "one of " + ", ".join(self.choices)
        if self.kind == "bool":
            return "true or false"
        what = "a whole number" if self.kind == "int" else "a number"
        low, high = self.minimum, self.maximum
        if low is not None and high is not None:
            return f"{what} from {low:g} to {high:g}"
        if low is not None:
            return f"{what} of at least {low:g}"
        return what if high is None else f"{what} of at most {high:g}"

    def fault(self, value: object) -> str | None:
        """Why ``value`` cannot be meant, or None."""
        if self.kind in ("bool", "choice"):
            good = isinstance(value, bool) if self.kind == "bool" else value in self.choices
        else:
            good = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
            good = good and (self.kind == "float" or float(value).is_integer())
            good = good and (self.minimum is None or value >= self.minimum)
            good = good and (self.maximum is None or value <= self.maximum)
        return None if good else f"{value!r} is not {self.allowed}"

    def parse(self, text: str) -> Value:
        """The value of text from a command line.  Raises MethodError."""
        value: Value | str = text.strip()
        if self.kind == "bool":
            value = {"true": True, "false": False, "1": True, "0": False}.get(text.strip().lower(), text)
        elif self.kind != "choice":
            try:
                value = float(text)
                value = int(value) if self.kind == "int" and value.is_integer() else value
            except ValueError:
                pass
        fault = self.fault(value)
        if fault:
            raise MethodError(f"setting {self.name}: {fault}")
        return value

    def number(self, value: Value) -> float | int | bool:
        """``value`` as the uniform has it."""
        return self.choices.index(value) if self.kind == "choice" else value


@dataclass(frozen=True, slots=True)
class PassInfo:
    """One dispatch over all pixels, ``repeat`` times.

    ``reads``: inputs, ``prev_<history>``, and histories or buffers written before.  What a pass both reads and writes
    it reads as it was before this turn.  ``repeat`` may name an int setting.
    """

    shader: str
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    repeat: int | str = 1


@dataclass(frozen=True, slots=True)
class Method:
    """A valid reuse method, ready for ``MethodRunner``.

    ``reads``: names of INPUTS.  ``history``, ``buffers``: name -> Format.  ``keyframe``: every how many frames the
    frame in hand becomes the key frame (``frame.key_*`` in GLSL), or the int setting that says so; None: no key frames.
    ``factory`` is the class of a Python method, ``folder`` where a GLSL method's shaders lie.
    """

    name: str
    title: str
    cite: tuple[str, ...]
    reads: tuple[str, ...]
    settings: Mapping[str, Setting]
    history: Mapping[str, Format]
    buffers: Mapping[str, Format]
    passes: tuple[PassInfo, ...]
    folder: Path | None
    keyframe: int | str | None = None
    factory: type | None = None
    where: str = ""

    def values(self, given: Mapping[str, Value] | None = None) -> dict[str, Value]:
        """Every setting's value, ``given`` over the defaults.  Raises MethodError naming all faults at once."""
        faults = []
        for name, value in (given or {}).items():
            if name not in self.settings:
                faults.append(f"no setting is named {name!r}{suggestion(name, self.settings, 'it has no settings')}")
            elif fault := self.settings[name].fault(value):
                faults.append(f"setting {name}: {fault}")
        if faults:
            raise MethodError("; ".join(faults), where=self.label)
        return {name: _typed(setting, (given or {}).get(name, setting.default))
                for name, setting in self.settings.items()}  # fmt: skip

    def number(self, value: int | str | None, values: Mapping[str, Value]) -> int | None:
        """``value`` itself, or what the setting it names has."""
        return int(values[value]) if isinstance(value, str) else value

    @property
    def label(self) -> str:
        return f"method {self.name!r}"

    @property
    def spares(self) -> frozenset[str]:
        """Histories and buffers that a pass reads and writes in one turn: they need one texture more."""
        return frozenset(name for p in self.passes for name in p.writes if name in p.reads)

    def bytes(self, size: tuple[int, int]) -> int:
        """Textures this method needs at ``size``, its result and history included; those of its inputs are not."""
        kept = {**self.history, **self.buffers, RESULT: RESULT_FORMAT}
        per_pixel = sum(f.bytes * (1 + (n in self.history) + (n in self.spares)) for n, f in kept.items())
        return size[0] * size[1] * per_pixel


def _typed(setting: Setting, value: Value) -> Value:
    return {"float": float, "int": int}.get(setting.kind, lambda v: v)(value)


def suggestion(name: str, known: Iterable[str], none: str = "") -> str:
    """`` (did you mean X? there are A, B)`` for an unknown ``name``."""
    known = sorted(known)
    if not known:
        return f" ({none})" if none else ""
    close = difflib.get_close_matches(name, known, n=1)
    listed = ", ".join(known)
    return f" (did you mean {close[0]!r}? there are {listed})" if close else f" (there are {listed})"


def name_fault(name: object, what: str, taken: Iterable[str] = ()) -> str | None:
    """Why ``name`` cannot name a history, buffer or setting, or None: it becomes part of the shader."""
    if not isinstance(name, str) or not _NAME.fullmatch(name) or "__" in name:
        return f"{name!r} cannot name a {what}: small letters, digits and single _ only, a letter first, 40 at most"
    if name in _GLSL_WORDS or name in _OURS or name.startswith("gl_"):
        return f"{name!r} cannot name a {what}: the word is taken in GLSL or by what every shader is given"
    if name.startswith("prev_"):
        return f"{name!r} cannot name a {what}: prev_ is the last frame's value of a history"
    if name in INPUTS or f"prev_{name}" in INPUTS:
        return f"{name!r} cannot name a {what}: an input has that name"
    if name in taken:
        return f"{name!r} is given twice"
    return None


def input_fault(name: object) -> str | None:
    """Why ``name`` is no input, or None."""
    if isinstance(name, str) and name in INPUTS:
        return None
    return f"no input is named {name!r}{suggestion(str(name), INPUTS)}"


def parse_setting(name: str, raw: object) -> tuple[Setting | None, list[str]]:
    """A setting from ``0.1`` or ``{default, min, max, choices, scale, doc}``: it, or None and every fault."""
    table = raw if isinstance(raw, Mapping) else {"default": raw}
    faults = [f"{key}: unknown key (allowed: default, min, max, choices, scale, doc)"
              for key in table if key not in ("default", "min", "max", "choices", "scale", "doc")]  # fmt: skip
    if "default" not in table:
        return None, [*faults, "default: is missing (a number, true, false, or one of choices)"]
    default, choices = table["default"], table.get("choices", ())
    if not isinstance(choices, (list, tuple)) or not all(isinstance(c, str) and _NAME.fullmatch(c) for c in choices):
        return None, [*faults, "choices: not a list of words in small letters"]
    kind = _kind(default, bool(choices))
    if kind is None:
        return None, [*faults, f"default: {default!r} is not a number, true or false, nor are there choices"]
    for key in ("min", "max"):
        bound = table.get(key)
        if bound is None:
            continue
        if kind not in ("float", "int") or isinstance(bound, bool) or not isinstance(bound, (int, float)):
            return None, [*faults, f"{key}: {bound!r} is not a number for a setting that is a number"]
    scale = table.get("scale", "linear")
    if scale not in ("linear", "log"):
        faults.append(f"scale: {scale!r} is not linear or log")
    if not isinstance(table.get("doc", ""), str):
        faults.append(f"doc: {table['doc']!r} is not text")
    setting = Setting(name, kind, default, table.get("min"), table.get("max"), tuple(choices), scale,
                      str(table.get("doc", "")))  # fmt: skip
    if scale == "log" and not (setting.minimum or 0) > 0:
        faults.append("scale: log needs a min above 0")
    if fault := setting.fault(default):
        faults.append(f"default: {fault}")
    return (None, faults) if faults else (setting, [])


def _kind(default: object, choices: bool) -> str | None:
    if choices:
        return "choice"
    if isinstance(default, bool):
        return "bool"
    return {int: "int", float: "float"}.get(type(default))
