"""The description of a reuse method: inputs, history, settings and passes.  Plain data, no GL.

A method is a folder with ``method.toml`` and GLSL files (``toml_method``) or a Python class (``python_method``).  Both
become a ``Method``.  docs/reuse.md documents the contract.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from taubench_gl.errors import MethodError
from taubench_gl.reuse.frame import INPUTS, RESERVED_INPUTS
from taubench_gl.reuse.stages import Stage

Value = float | int | bool | str


@dataclass(frozen=True, slots=True)
class Format:
    """A texture format for histories and buffers.  ``dtype`` of moderngl; ``glsl``: type of one value."""

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
report it (``write_result(p, vec3)``)."""

REPORTS: dict[str, str] = {
    "reprojected_history": "rgb: the color history as it was fetched along the motion, before any rectification; "
    "a: 1 with history, 0 without",
    "rectified_history": "rgb: the history that was used, after rectification (clamp, clip); default: derived from "
    "the result and its weight",
    "blend_input": "rgb: the color that history was blended with; default: radiance",
}
"""Outputs that a pass may write for the evaluation, linear radiance, exposure applied, in the space of the result: what
the method blended.  They are stored only where ``MethodRunner.reported`` asks for them."""

REPORT_FORMAT = FORMATS["rgba32f"]

MAX_WRITES, MAX_READS = 8, 16
"""Images and textures that every GL 4.5 driver provides to a compute shader."""

MAX_REPEAT = 64

BLOCK_THREADS = 256
"""Invocations of a work group of a block pass: they share memory and synchronize with ``barrier()``."""

MIN_BLOCK, MAX_BLOCK = 8, 64
"""Width and height of a block, pixels."""

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
    "frame iteration result reuse tap luminance inside in_image previous_px reusable reusable_exact "
    "nearest_surface bilinear_tap catmull_rom_weights clip_to_box clip_towards ycocg_from_rgb rgb_from_ycocg "
    "non_finite reuse_block block_size block_threads"
)
_OURS = frozenset((*_OUR_WORDS.split(), *REPORTS))
_UPSCALING_WORDS = (
    "input_size output_size pass_size input_from_output output_from_input input_pixel output_scale pass_from_input"
)
_READ_WORDS = {"material": ("roughness", "metallic"), "emitted": ("remodulate",)}
"""Functions that are generated where an input is read."""

SIZES = ("output", "input")
"""Grids of a method that upscales: of the result, and of the inputs."""


@dataclass(frozen=True, slots=True)
class Setting:
    """One parameter of a method; in GLSL a uniform of this name.

    ``kind``: float, int, bool, or choice (GLSL: int, the index into ``choices``).  ``scale``: linear or log, the
    spacing of a search in [minimum, maximum].
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
        """The allowed values, in words."""
        if self.kind == "choice":
            return "one of " + ", ".join(self.choices)
        if self.kind == "bool":
            return "true or false"
        what = "an integer" if self.kind == "int" else "a number"
        low, high = self.minimum, self.maximum
        if low is not None and high is not None:
            return f"{what} from {low:g} to {high:g}"
        if low is not None:
            return f"{what} of at least {low:g}"
        return what if high is None else f"{what} of at most {high:g}"

    def error(self, value: object) -> str | None:
        """Why ``value`` is invalid, or None."""
        if self.kind in ("bool", "choice"):
            good = isinstance(value, bool) if self.kind == "bool" else value in self.choices
        else:
            good = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
            good = good and (self.kind == "float" or float(value).is_integer())
            good = good and (self.minimum is None or value >= self.minimum)
            good = good and (self.maximum is None or value <= self.maximum)
        return None if good else f"{value!r} is not {self.allowed}"

    def parse(self, text: str) -> Value:
        """The value of a text from the command line.  Raises MethodError."""
        value: Value | str = text.strip()
        if self.kind == "bool":
            value = {"true": True, "false": False, "1": True, "0": False}.get(text.strip().lower(), text)
        elif self.kind != "choice":
            try:
                value = float(text)
                value = int(value) if self.kind == "int" and value.is_integer() else value
            except ValueError:
                pass
        error = self.error(value)
        if error:
            raise MethodError(f"setting {self.name}: {error}")
        return value

    def number(self, value: Value) -> float | int | bool:
        """``value`` as the value of the uniform."""
        return self.choices.index(value) if self.kind == "choice" else value


@dataclass(frozen=True, slots=True)
class PassInfo:
    """One dispatch over all pixels, ``repeat`` times.

    ``block``: width and height in pixels of a block pass, which is called once per block with BLOCK_THREADS invocations
    that share memory; None: once per pixel.  ``reads``: inputs, ``prev_<history>``, and histories or buffers written by
    earlier passes.  A name in both ``reads`` and ``writes`` is read as it was before this dispatch.  ``repeat`` can be
    the name of an int setting.  ``size``: of SIZES, the pixels that it runs over.
    """

    shader: str
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    repeat: int | str = 1
    block: tuple[int, int] | None = None
    size: str = "output"


@dataclass(frozen=True, slots=True)
class Method:
    """A valid reuse method, input of ``MethodRunner``.

    ``reads``: names of INPUTS.  ``history``, ``buffers``: name -> Format.  ``keyframe``: interval in frames at which
    the current frame becomes the key frame (``frame.key_*`` in GLSL), or the name of an int setting; None: no key
    frames.  ``factory``: the class of a Python method; ``folder``: the shaders of a GLSL method; ``stages``: those of
    its paper; ``reports``: names of REPORTS that the method writes; ``base``: folder of the shaders that ``folder``
    does not have.  ``upscales``: inputs can be smaller than the result; ``input_sized``: its histories and buffers that
    have the size of the inputs.
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
    stages: tuple[Stage, ...] = ()
    reports: tuple[str, ...] = ()
    base: Path | None = None
    upscales: bool = False
    input_sized: frozenset[str] = frozenset()

    def values(self, given: Mapping[str, Value] | None = None) -> dict[str, Value]:
        """The value of every setting: ``given``, else the default.  Raises MethodError, which lists all errors."""
        errors = []
        for name, value in (given or {}).items():
            if name not in self.settings:
                errors.append(f"there is no setting {name!r}{suggestion(name, self.settings, 'it has no settings')}")
            elif error := self.settings[name].error(value):
                errors.append(f"setting {name}: {error}")
        if errors:
            raise MethodError("; ".join(errors), where=self.label)
        return {name: _typed(setting, (given or {}).get(name, setting.default))
                for name, setting in self.settings.items()}  # fmt: skip

    def number(self, value: int | str | None, values: Mapping[str, Value]) -> int | None:
        """``value``, or the value of the setting with this name."""
        return int(values[value]) if isinstance(value, str) else value

    @property
    def label(self) -> str:
        return f"method {self.name!r}"

    @property
    def shader_folders(self) -> tuple[Path, ...]:
        """Where its shaders are, in the order of the search."""
        return tuple(folder for folder in (self.folder, self.base) if folder is not None)

    @property
    def spares(self) -> frozenset[str]:
        """Histories and buffers that one pass reads and writes: they need an additional texture."""
        return frozenset(name for p in self.passes for name in p.writes if name in p.reads)

    def bytes(self, size: tuple[int, int], input_size: tuple[int, int] | None = None) -> int:
        """Bytes of the textures of this method: history, buffers and result, without inputs.

        ``size``: of the result; ``input_size``: of the inputs, None: the same.
        """
        total, small = 0, input_size or size
        for name, form in {**self.history, **self.buffers, RESULT: RESULT_FORMAT}.items():
            width, height = small if name in self.input_sized else size
            total += width * height * form.bytes * (1 + (name in self.history) + (name in self.spares))
        return total


def _typed(setting: Setting, value: Value) -> Value:
    return {"float": float, "int": int}.get(setting.kind, lambda v: v)(value)


def suggestion(name: str, known: Iterable[str], none: str = "") -> str:
    """`` (did you mean X? available: A, B)`` for an unknown ``name``."""
    known = sorted(known)
    if not known:
        return f" ({none})" if none else ""
    close = difflib.get_close_matches(name, known, n=1)
    listed = ", ".join(known)
    return f" (did you mean {close[0]!r}? available: {listed})" if close else f" (available: {listed})"


def name_error(
    name: object, what: str, taken: Iterable[str] = (), reads: Collection[str] = (), upscales: bool = False
) -> str | None:
    """Why ``name`` is not a valid name for a history, buffer or setting, or None.  It becomes part of the shader.

    ``reads``: the inputs of the method.  A later input is no reserved name where the method does not read it.
    """
    if not isinstance(name, str) or not _NAME.fullmatch(name) or "__" in name:
        return f"{name!r} is not a name for a {what}: lower-case letters, digits, single _; 40 characters"
    generated = {word for read in reads for word in _READ_WORDS.get(read, ())}
    generated |= set(_UPSCALING_WORDS.split()) if upscales else set()
    if name in _GLSL_WORDS or name in _OURS or name in generated or name.startswith("gl_"):
        return f"{name!r} is not a name for a {what}: it is reserved in GLSL or in the generated shader"
    if name.startswith("prev_"):
        return f"{name!r} is not a name for a {what}: prev_ denotes the history of the previous frame"
    inputs = RESERVED_INPUTS | set(reads)
    if name in inputs or f"prev_{name}" in inputs:
        return f"{name!r} is not a name for a {what}: it is the name of an input"
    if name in taken:
        return f"{name!r} is declared twice"
    return None


def parse_reads(names: Iterable[object]) -> tuple[tuple[str, ...], list[str]]:
    """Names of INPUTS without duplicates, and an error for every unknown name."""
    found: dict[str, None] = {}
    errors = []
    for name in names:
        if isinstance(name, str) and name in INPUTS:
            found[name] = None
        else:
            errors.append(f"reads: there is no input {name!r}{suggestion(str(name), INPUTS)}")
    return tuple(found), errors


def parse_setting(name: str, raw: object) -> tuple[Setting | None, list[str]]:
    """A setting from ``0.1`` or ``{default, min, max, choices, scale, doc}``.  -> the setting or None, all errors."""
    table = raw if isinstance(raw, Mapping) else {"default": raw}
    errors = [f"{key}: unknown key (allowed: default, min, max, choices, scale, doc)"
              for key in table if key not in ("default", "min", "max", "choices", "scale", "doc")]  # fmt: skip
    if "default" not in table:
        return None, [*errors, "default: is missing (a number, true, false, or one of choices)"]
    default, choices = table["default"], table.get("choices", ())
    if not isinstance(choices, (list, tuple)) or not all(isinstance(c, str) and _NAME.fullmatch(c) for c in choices):
        return None, [*errors, "choices: not a list of lower-case words"]
    kind = _kind(default, bool(choices))
    if kind is None:
        return None, [*errors, f"default: {default!r} is not a number, true or false, and there are no choices"]
    for key in ("min", "max"):
        bound = table.get(key)
        if bound is None:
            continue
        if kind not in ("float", "int") or isinstance(bound, bool) or not isinstance(bound, (int, float)):
            return None, [*errors, f"{key}: {bound!r} is not a number, or the setting is not a number"]
    scale = table.get("scale", "linear")
    if scale not in ("linear", "log"):
        errors.append(f"scale: {scale!r} is not linear or log")
    if not isinstance(table.get("doc", ""), str):
        errors.append(f"doc: {table['doc']!r} is not text")
    setting = Setting(name, kind, default, table.get("min"), table.get("max"), tuple(choices), scale,
                      str(table.get("doc", "")))  # fmt: skip
    if scale == "log" and not (setting.minimum or 0) > 0:
        errors.append("scale: log needs a min above 0")
    if error := setting.error(default):
        errors.append(f"default: {error}")
    return (None, errors) if errors else (setting, [])


def _kind(default: object, choices: bool) -> str | None:
    if choices:
        return "choice"
    if isinstance(default, bool):
        return "bool"
    return {int: "int", float: "float"}.get(type(default))
