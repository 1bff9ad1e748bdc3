"""The description of a reuse method: inputs, history, settings and passes.  Plain data, no GL.

A method is a folder with ``method.toml`` and GLSL files, or a Python class.  Both become a ``Method``, see
``declaration``.  docs/reuse.md documents the contract.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from taubench_gl.errors import MethodError
from taubench_gl.gpu.layout import Struct
from taubench_gl.setting_values import FLOAT32_MAX

Value = float | int | bool | str


@dataclass(frozen=True, slots=True)
class Format:
    """A format for histories and buffers.  ``dtype`` of moderngl; ``glsl``: type of one value.

    ``struct``: the method's own, a storage buffer of one record a pixel instead of a texture; None: a texture.
    """

    name: str
    components: int
    dtype: str
    glsl: str
    struct: Struct | None = None

    @property
    def bytes(self) -> int:
        """Bytes of one pixel."""
        return self.components * int(self.dtype[1]) if self.struct is None else self.struct.dtype.itemsize


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
"""Format of a result. rgb: linear radiance, exposure applied. a: weight of history in the pixel, 0 .. 1, or -1 where
the method does not report it (``write_result(p, vec3)``)."""

REPORTS: dict[str, str] = {
    "reprojected_history": "rgb: the color history as it was fetched along the motion, before any rectification; "
    "a: 1 with history, 0 without",
    "eye_history": "with history both: rgb: the color of the other eye as it was fetched; a: 1 with one, 0 without",
    "rectified_history": "rgb: the history that was used, after rectification (clamp, clip); default: derived from "
    "the result and its weight",
    "blend_input": "rgb: the color that history was blended with; default: radiance",
    "history_sample": 'of light = "own": x: number of the light in the history reservoir of the pixel, also where it '
    "is then rejected, -1: none; yz: its uv; w: 1 kept, 0 rejected",
    "kept_sample": 'of light = "own": x: number of the light in the reservoir of the pixel after the frame, -1: none; '
    "yz: its uv; w: M, the samples that it stands for",
}
"""Outputs that a pass may write for the evaluation: what the method blended, linear radiance, exposure applied, in the
space of the result; and which light samples its reservoirs hold.  They are stored only where ``MethodRunner.reported``
asks for them."""

SAMPLE_REPORTS = ("history_sample", "kept_sample")
"""Reports that only a method with ``light = "own"`` has: samples of its reservoirs."""

REPORT_FORMAT = FORMATS["rgba32f"]

MAX_WRITES, MAX_READS = 8, 16
"""Images and textures that every GL 4.5 driver provides to a compute shader."""

MAX_REPEAT = 64

REFERENCE_INPUT = "reference"
LIGHTS, EMITTED = "lights", "emitted"
"""Inputs that every method with ``light = "own"`` reads.  LIGHTS is no texture, but ``FrameInputs.light``."""

NOT_OF_A_RENDERER = (REFERENCE_INPUT, "exact_mask")
"""Inputs that no renderer has: methods that read them are measured, and never ranked."""

BLOCK_THREADS = 256
"""Invocations of a work group of a block pass: they share memory and synchronize with ``barrier()``."""

MIN_BLOCK, MAX_BLOCK = 8, 64
"""Width and height of a block, pixels."""


@dataclass(frozen=True, slots=True)
class Parameter:
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
        noun = "a 32-bit integer" if self.kind == "int" else "a number that float32 holds"
        low, high = self.minimum, self.maximum
        if low is not None and high is not None:
            return f"{noun} from {low:g} to {high:g}"
        if low is not None:
            return f"{noun} of at least {low:g}"
        return noun if high is None else f"{noun} of at most {high:g}"

    def error(self, value: object) -> str | None:
        """Why ``value`` is invalid, or None."""
        if self.kind in ("bool", "choice"):
            good = isinstance(value, bool) if self.kind == "bool" else value in self.choices
        else:
            least, most = (-(2**31), 2**31 - 1) if self.kind == "int" else (-FLOAT32_MAX, FLOAT32_MAX)  # a uniform's
            good = isinstance(value, (int, float)) and not isinstance(value, bool) and least <= value <= most
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
        """``value`` as its uniform holds it: a choice is its index."""
        return self.choices.index(value) if self.kind == "choice" else value


@dataclass(frozen=True, slots=True)
class PassInfo:
    """One dispatch over all pixels, ``repeat`` times.

    ``block``: width and height in pixels of a block pass, which is called once per block with BLOCK_THREADS invocations
    that share memory; None: once per pixel.  ``reads``: inputs, ``prev_<history>``, and histories or buffers written by
    earlier passes.  A name in both ``reads`` and ``writes`` is read as it was before this dispatch.  ``repeat`` can be
    the name of an int setting.  ``size``: it runs over the pixels of the ``output`` or of the ``input``.
    """

    shader: str
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    repeat: int | str = 1
    block: tuple[int, int] | None = None
    size: str = "output"


@dataclass(frozen=True, slots=True)
class Stage:
    """One stage of a paper's pipeline.  A method with a missing stage carries that in its name: ``svgf_without_taa``,
    or ``-class`` at its end: of this class of methods, but not complete.

    ``doc``: what it computes; ``paper``: section or equation; ``shader``: the file that computes it, None for a method
    in Python; ``missing``: why the method does not have it, None if it does.
    """

    name: str
    doc: str
    paper: str
    shader: str | None = None
    missing: str | None = None

    @property
    def done(self) -> bool:
        return self.missing is None


@dataclass(frozen=True, slots=True)
class Method:
    """A valid reuse method, input of ``MethodRunner``.

    ``reads``: names of INPUTS.  ``history``, ``buffers``: name -> Format.  ``keyframe``: interval in frames at which
    the current frame becomes the key frame (``frame.key_*`` in GLSL), or the name of an int setting; None: no key
    frames.  ``factory``: the class of a Python method; ``folder``: the shaders of a GLSL method; ``stages``: the stages
    of its paper; ``reports``: names of REPORTS that the method writes; ``base``: folder of the shaders that ``folder``
    does not have.  ``upscales``: inputs can be smaller than the result; ``input_sized``: its histories and buffers that
    have the size of the inputs.  ``structs``: the formats that are its own; ``chain``: two
    methods, the second of which has the image of the first as its input; ``generates``: ``extrapolate`` or
    ``interpolate``: it makes frames after or between rendered ones; None: it reuses history in rendered frames.
    """

    name: str
    title: str
    cite: tuple[str, ...]
    reads: tuple[str, ...]
    settings: Mapping[str, Parameter]
    history: Mapping[str, Format] = field(default_factory=dict)
    buffers: Mapping[str, Format] = field(default_factory=dict)
    passes: tuple[PassInfo, ...] = ()
    folder: Path | None = None
    keyframe: int | str | None = None
    factory: type | None = None
    where: str = ""
    stages: tuple[Stage, ...] = ()
    reports: tuple[str, ...] = ()
    base: Path | None = None
    upscales: bool = False
    input_sized: frozenset[str] = frozenset()
    structs: tuple[Struct, ...] = ()
    chain: tuple[Method, ...] = ()
    generates: str | None = None

    def values(self, changes: Mapping[str, Value] | None = None) -> dict[str, Value]:
        """The value of every setting: ``changes``, else the default.  Raises MethodError, which lists all errors."""
        errors = []
        for name, value in (changes or {}).items():
            if name not in self.settings:
                errors.append(f"there is no setting {name!r}{suggestion(name, self.settings, 'it has no settings')}")
            elif error := self.settings[name].error(value):
                errors.append(f"setting {name}: {error}")
        if errors:
            raise MethodError("; ".join(errors), where=self.label)
        return {name: _typed(setting, (changes or {}).get(name, setting.default))
                for name, setting in self.settings.items()}  # fmt: skip

    def number(self, value: int | str | None, values: Mapping[str, Value]) -> int | None:
        """A number of method.toml: itself, or of the int setting with this name its value in ``values``."""
        return int(values[value]) if isinstance(value, str) else value

    @property
    def label(self) -> str:
        return f"method {self.name!r}"

    @property
    def yardstick(self) -> str | None:
        """Why it is not ranked: it reads what a renderer does not know.  None for other methods."""
        lost = [name for name in NOT_OF_A_RENDERER if name in self.reads]
        return f"reads {' and '.join(lost)}, which no renderer has" if lost else None

    @property
    def own_light(self) -> bool:
        """Whether it computes direct light itself, from lights and shadow rays."""
        return LIGHTS in self.reads

    @property
    def shader_folders(self) -> tuple[Path, ...]:
        """Folders of the shaders of a method in GLSL, in the order of the search."""
        return tuple(folder for folder in (self.folder, self.base) if folder is not None)

    @property
    def spares(self) -> frozenset[str]:
        """Histories and buffers that one pass reads and writes: they need an additional texture."""
        return frozenset(name for p in self.passes for name in p.writes if name in p.reads)

    def bytes(self, size: tuple[int, int], input_size: tuple[int, int] | None = None) -> int:
        """Bytes of the textures of this method: history, buffers and result, without inputs.

        ``size``: of the result; ``input_size``: of the inputs, None: the same.
        """
        if self.chain:
            return sum(method.bytes(size, input_size) for method in self.chain)
        total, small = 0, input_size or size
        for name, form in {**self.history, **self.buffers, RESULT: RESULT_FORMAT}.items():
            width, height = small if name in self.input_sized else size
            total += width * height * form.bytes * (1 + (name in self.history) + (name in self.spares))
        return total


def _typed(setting: Parameter, value: Value) -> Value:
    return {"float": float, "int": int}.get(setting.kind, lambda v: v)(value)


def suggestion(name: str, names: Iterable[str], none: str = "") -> str:
    """`` (did you mean X? available: A, B)`` for an unknown ``name``."""
    names = sorted(names)
    if not names:
        return f" ({none})" if none else ""
    close = difflib.get_close_matches(name, names, n=1)
    listed = ", ".join(names)
    return f" (did you mean {close[0]!r}? available: {listed})" if close else f" (available: {listed})"
