"""Declarations of methods -> Method: a folder with ``method.toml`` and GLSL files, or a Python class.

msgspec checks types and keys of a declaration (``MethodFile``, ``MethodClass``) and names the first that is wrong.
``_Declaration`` checks what the values mean, and reports all of its errors together.  There is no GL call.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from taubench_gl.data_files import convert, one_line, read_toml
from taubench_gl.errors import GraphicsError, MethodError
from taubench_gl.gpu.layout import TYPES, Field, Struct
from taubench_gl.gpu.shader import MAX_INCLUDES, read_source
from taubench_gl.paths import PACKAGE
from taubench_gl.reuse.contract import (
    EMITTED,
    FORMATS,
    LIGHTS,
    MAX_BLOCK,
    MAX_READS,
    MAX_REPEAT,
    MAX_WRITES,
    MIN_BLOCK,
    REFERENCE_INPUT,
    REPORTS,
    RESULT,
    RESULT_FORMAT,
    SAMPLE_REPORTS,
    Format,
    Method,
    Parameter,
    PassInfo,
    Stage,
    Value,
    suggestion,
)
from taubench_gl.reuse.frame import INPUTS, RESERVED_INPUTS

FILE = "method.toml"
BUILTIN = PACKAGE / "reuse" / "methods"
INCOMPLETE = "-class"
"""End of the name of a method that is of a class of methods, and lacks stages that others of it have."""

MAX_METHOD_BYTES = 1 << 20
"""Size limit of a method.toml and of a method in Python."""

MAX_KEYFRAME = 1 << 20
"""Largest interval between key frames, in frames."""

Text = Annotated[str, msgspec.Meta(pattern=r"\S")]
Size = Literal["output", "input"]
Side = Annotated[int, msgspec.Meta(ge=MIN_BLOCK, le=MAX_BLOCK)]


class SettingEntry(msgspec.Struct, forbid_unknown_fields=True):
    """The table of one setting, ``[settings.NAME]``."""

    default: Value
    min: int | float | None = None
    max: int | float | None = None
    choices: tuple[str, ...] = ()
    scale: Literal["linear", "log"] = "linear"
    doc: str = ""


class StageEntry(msgspec.Struct, forbid_unknown_fields=True):
    """The table of one stage of a paper, ``[stages.NAME]``: the fields of ``contract.Stage``."""

    doc: Text
    paper: Text
    shader: Text | None = None
    missing: Text | None = None


class StoredEntry(msgspec.Struct, forbid_unknown_fields=True):
    """The table of a history or buffer whose size is not that of the result."""

    format: str
    size: Size = "output"


class PassEntry(msgspec.Struct, forbid_unknown_fields=True):
    """The table of one pass, ``[[pass]]``; defaults as in ``contract.PassInfo``."""

    shader: Text
    writes: tuple[str, ...]
    reads: tuple[str, ...] | None = None
    repeat: int | str = 1
    block: tuple[Side, Side] | None = None
    size: Size = "output"


class Declared(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Keys of method.toml that are also attributes of a class."""

    name: Text | None = None
    title: Text | None = None
    cite: str | tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    settings: dict[str, SettingEntry | Value] = {}
    stages: dict[str, StageEntry] = {}
    upscales: bool = False
    generates: Literal["extrapolate", "interpolate"] | None = None


class MethodClass(Declared):
    """The attributes of a method in Python."""

    reports: tuple[str, ...] = ()
    arrays: Literal["numpy", "torch"] = "numpy"


class MethodFile(Declared):
    """The keys of a method.toml."""

    base: str | None = None
    light: Literal["own"] | None = None
    structs: dict[str, dict[str, str]] = {}
    history: dict[str, str | StoredEntry] = {}
    buffers: dict[str, str | StoredEntry] = {}
    keyframe: int | str | None = None
    passes: tuple[PassEntry, ...] = msgspec.field(name="pass", default=())


_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
_STAGE_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_ENTRY = re.compile(r"\bvoid\s+reuse\s*\(\s*(?:in\s+)?ivec2\b")
_BLOCK_ENTRY = re.compile(r"\bvoid\s+reuse_block\s*\(\s*(?:in\s+)?ivec2\b[^,)]*,\s*(?:in\s+)?int\b")
_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"', re.MULTILINE)
_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
_USE = re.compile(r"\b(fetch|nearest|sample|cubic|write)_([a-z][a-z0-9_]*)\s*\(")
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
_LIGHT_WORDS = (
    "surface_at prev_surface_at sample_light light_at prev_light_at incident reflected visible prev_visible brdf "
    "random light_tally light_in visible_in surface_of surface_row luminance evaluate_brdf offset_origin trace occluded"
)
"""Functions of a method that computes its direct light itself (shaders/reuse/light.glsl)."""

_STRUCT_NAME = re.compile(r"[A-Z][A-Za-z0-9]{0,39}")
_READ_WORDS = {
    "eye_motion": ("eye_px",),
    "eye_mask": ("reusable_eye",),
    "material": ("roughness", "metallic"),
    "emitted": ("remodulate",),
}
"""Functions that are generated where an input is read."""


def load_folder(folder: Path) -> Method:
    """The method in ``folder``.  Raises MethodError with the TOML key, or the file and line, of what is wrong."""
    path = folder / FILE
    file = read_toml(path, MethodFile, MethodError, max_bytes=MAX_METHOD_BYTES)
    return _FolderDeclaration(folder, file).folder_method(str(path))


def method_from_class(cls: type, where: str = "") -> Method:
    """A Method from a class with ``reads`` and ``step``.  Raises MethodError at ``where``, by default the class."""
    where = where or f"{cls.__module__}:{cls.__qualname__}"
    values = {name: getattr(cls, name) for name in MethodClass.__struct_fields__ if hasattr(cls, name)}
    with one_line(where, MethodError):
        attributes = convert(values, MethodClass)
    declared = _Declaration(attributes, cls.__name__, own_light=False)
    declared.declare_settings(())
    if not callable(getattr(cls, "step", None)):
        declared.fault("step", "must be a function step(self, frame)")
    known = [name for name in REPORTS if name not in SAMPLE_REPORTS]
    reports = declared.names("reports", attributes.reports, known)
    return declared.method(where, factory=cls, where=where, reports=reports)


class _Declaration:
    """Checks a declaration beyond its types, and collects all errors."""

    def __init__(self, declared: Declared, default_name: str, own_light: bool):
        self.errors: list[str] = []
        self._declared, self.own_light, self.upscales = declared, own_light, declared.upscales
        self.name = (declared.name or default_name).strip()
        self.reads = self.names("reads", declared.reads, list(INPUTS))
        if not declared.reads and not own_light:
            self.fault("reads", f"must be a list of names (available: {', '.join(INPUTS)})")
        if declared.generates and REFERENCE_INPUT in self.reads:
            self.fault("reads", "a method that generates frames gets no 'reference', by which it is scored")
        self.settings: dict[str, Parameter] = {}

    def method(self, origin: str, shaders: Collection[str] | None = None, **kind_fields: Any) -> Method:
        """The method.  Raises MethodError at ``origin``.

        ``shaders``: files of its passes, None for a method in Python; ``kind_fields``: of one kind of methods.
        """
        stages = tuple(self.stage(name, entry, shaders) for name, entry in self._declared.stages.items())
        if self.errors:
            raise MethodError("; ".join(self.errors), where=origin)
        cite = self._declared.cite
        light = tuple(name for name in (EMITTED, LIGHTS) if self.own_light and name not in self.reads)
        return Method(
            name=self.name,
            title=(self._declared.title or self.name).strip(),
            cite=(cite,) if isinstance(cite, str) else cite,
            reads=(*self.reads, *light),
            settings=self.settings,
            stages=stages,
            upscales=self.upscales,
            generates=self._declared.generates,
            **kind_fields,
        )

    def fault(self, key: str, message: str) -> None:
        """Add an error of the TOML key or attribute ``key``."""
        self.errors.append(f"{key}: {message}")

    def names(self, key: str, names: Sequence[str], allowed: list[str], later: Collection[str] = ()) -> tuple[str, ...]:
        """The ``names`` that are ``allowed``, without duplicates; a fault for each other name.

        ``later``: names that a later pass writes.
        """
        for name in names:
            if name in allowed:
                continue
            if name in later:
                self.fault(key, f"{name!r} is read before a pass writes it")
            else:
                input_name = name in INPUTS and key.endswith("reads")
                hint = ": add it to the method's reads" if input_name else suggestion(name, allowed)
                self.fault(key, f"unknown name {name!r}{hint}")
        return tuple(dict.fromkeys(name for name in names if name in allowed))

    # ------------------------------------------------------------------------------------------- settings and stages
    def name_error(self, name: str, kind: str, used_names: Collection[str] = ()) -> str | None:
        """Why ``name`` is not a valid name for a history, buffer or setting, or None.  It becomes part of the shader.

        A later input is no reserved name where the method does not read it.
        """
        no_name = f"{name!r} is not a name for a {kind}"
        if not _NAME.fullmatch(name) or "__" in name:
            return f"{no_name}: lower-case letters, digits, single _; 40 characters"
        generated = {word for read in self.reads for word in _READ_WORDS.get(read, ())}
        generated |= set(_UPSCALING_WORDS.split()) if self.upscales else set()
        generated |= set(_LIGHT_WORDS.split()) if self.own_light else set()
        if name in _GLSL_WORDS or name in _OURS or name in generated or name.startswith("gl_"):
            return f"{no_name}: it is reserved in GLSL or in the generated shader"
        if name.startswith("prev_"):
            return f"{no_name}: prev_ denotes the history of the previous frame"
        inputs = RESERVED_INPUTS | set(self.reads)
        if name in inputs or f"prev_{name}" in inputs:
            return f"{no_name}: it is the name of an input"
        return f"{name!r} is declared twice" if name in used_names else None

    def declare_settings(self, used_names: Collection[str]) -> None:
        """Fill ``settings``.  ``used_names``: names that they cannot have."""
        for name, entry in self._declared.settings.items():
            if error := self.name_error(name, "setting", used_names):
                self.fault("settings", error)
            elif setting := self.setting(name, entry if isinstance(entry, SettingEntry) else SettingEntry(entry)):
                self.settings[name] = setting

    def setting(self, name: str, entry: SettingEntry) -> Parameter | None:
        """The setting that ``entry`` declares; None with errors."""
        at, errors = f"settings.{name}", len(self.errors)
        kind = "choice" if entry.choices else {bool: "bool", int: "int", float: "float"}.get(type(entry.default))
        if not all(_NAME.fullmatch(word) for word in entry.choices):
            return self.fault(f"{at}.choices", "not a list of lower-case words")
        if kind is None:
            return self.fault(f"{at}.default", f"{entry.default!r} is not a number, true, false, or one of choices")
        for key in ("min", "max"):
            if getattr(entry, key) is not None and kind not in ("float", "int"):
                self.fault(f"{at}.{key}", "the setting is not a number")
        if entry.scale == "log" and not (entry.min or 0) > 0:
            self.fault(f"{at}.scale", "log needs a min above 0")
        setting = Parameter(name, kind, entry.default, entry.min, entry.max, entry.choices, entry.scale, entry.doc)
        if error := setting.error(entry.default):
            self.fault(f"{at}.default", error)
        return setting if len(self.errors) == errors else None

    def stage(self, name: str, entry: StageEntry, shaders: Collection[str] | None) -> Stage:
        """A stage of the method's paper.  ``shaders``: files of its passes, None for a method in Python."""
        at = f"stages.{name}"
        if not _STAGE_NAME.fullmatch(name):
            self.fault(at, "is not a name: lower-case letters, digits, single _")
        if shaders is None and entry.shader is not None:
            self.fault(f"{at}.shader", "a method in Python has none")
        if shaders is not None and entry.missing is None and entry.shader not in shaders:
            available = ", ".join(sorted(shaders))
            self.fault(f"{at}.shader", f"{entry.shader!r} is not a file of its passes (available: {available})")
        if entry.missing is not None and entry.shader is not None:
            self.fault(at, "has both shader and missing")
        in_name = self.name.endswith(INCOMPLETE) or ("without" in self.name and name in self.name)
        if entry.missing is not None and not in_name:
            names = f"{self.name}_without_{name}, or {self.name}{INCOMPLETE}"
            self.fault(at, f"a missing stage is in the method's name: {names}")
        return Stage(name, **msgspec.structs.asdict(entry))


class _FolderDeclaration(_Declaration):
    """The declaration of a method in GLSL."""

    def __init__(self, folder: Path, file: MethodFile):
        super().__init__(file, folder.resolve().name, own_light=file.light is not None)
        self._folder, self._base = folder, self.base_folder(file.base)
        self._shader_files: set[str] = set()  # shaders of the passes, and their includes
        self._input_sized: set[str] = set()
        if self.own_light and self.upscales:
            self.fault("light", "a method that upscales does not compute its light itself")
        self._structs = tuple(self.struct(name, fields) for name, fields in file.structs.items())
        self._formats = {**FORMATS, **{s.name: Format(s.name, 0, "f4", s.name, s) for s in self._structs}}
        self._history = self.formats("history", "history", file.history, ())
        self._buffers = self.formats("buffers", "buffer", file.buffers, self._history)
        self._image_formats = {**self._history, **self._buffers, RESULT: RESULT_FORMAT}
        self.declare_settings({**self._history, **self._buffers})
        self._keyframe = None if file.keyframe is None else self.count("keyframe", file.keyframe, MAX_KEYFRAME)
        self._passes = self.declare_passes(file.passes)

    def folder_method(self, origin: str) -> Method:
        """The method.  Raises MethodError at ``origin``."""
        written = {name for info in self._passes for name in info.writes}
        return self.method(
            origin,
            self._shader_files,
            where=str(self._folder),
            history=self._history,
            buffers=self._buffers,
            passes=self._passes,
            keyframe=self._keyframe,
            folder=self._folder,
            base=self._base,
            structs=self._structs,
            input_sized=frozenset(self._input_sized),
            reports=tuple(name for name in REPORTS if name in written),
        )

    def base_folder(self, name: str | None) -> Path | None:
        """Folder of the built-in method ``name``, whose shaders this method uses where it has none of its own."""
        methods = sorted(path.parent.name for path in BUILTIN.glob(f"*/{FILE}"))
        if name is None or name in methods:
            return None if name is None else BUILTIN / name
        return self.fault("base", f"there is no built-in method in GLSL {name!r}{suggestion(name, methods)}")

    def struct(self, name: str, fields: Mapping[str, str]) -> Struct:
        """A format of the method's own, from the types of its fields."""
        if not _STRUCT_NAME.fullmatch(name):
            self.fault(f"structs.{name}", "is not a name: a capital letter, then letters and digits")
        if not fields:
            self.fault(f"structs.{name}", 'must be a table such as { light = "int", weight = "float" }')
        good = {f: t for f, t in fields.items() if t in TYPES and _NAME.fullmatch(f) and f not in _GLSL_WORDS}
        for field in fields.keys() - good.keys():
            self.fault(f"structs.{name}.{field}", f"is not a name with one of the types {', '.join(TYPES)}")
        return Struct(name, *(Field(field, kind, "") for field, kind in good.items()))

    def formats(
        self, key: str, kind: str, entries: Mapping[str, str | StoredEntry], used_names: Collection[str]
    ) -> dict[str, Format]:
        """Histories or buffers by name.  One error for a wrong format, not one for each use of the name."""
        formats = {}
        for name, entry in entries.items():
            stored = StoredEntry(entry) if isinstance(entry, str) else entry
            if self.image_size(f"{key}.{name}", stored.size) == "input":
                self._input_sized.add(name)
            if error := self.name_error(name, kind, used_names):
                self.fault(key, error)
                continue
            if stored.format not in self._formats:
                available = ", ".join(self._formats)
                self.fault(f"{key}.{name}", f"{stored.format!r} is not a format (available: {available})")
            formats[name] = self._formats.get(stored.format, RESULT_FORMAT)
        return formats

    def image_size(self, at: str, size: Size) -> Size:
        """The key ``size`` of a history, buffer or pass."""
        if size == "input" and not self.upscales:
            self.fault(f"{at}.size", "both sizes are equal without 'upscales = true'")
        return size

    def count(self, key: str, value: int | str, most: int) -> int | str | None:
        """An integer from 1 to ``most``, or the name of an int setting within these bounds; None with an error."""
        if isinstance(value, int) and 1 <= value <= most:
            return value
        if value in self.settings:
            s = self.settings[value]
            if s.kind == "int" and (s.minimum or 0) >= 1 and s.maximum is not None and s.maximum <= most:
                return value
            return self.fault(key, f"setting {value!r} must be an integer with min >= 1 and max <= {most}")
        names = ", ".join(n for n, s in self.settings.items() if s.kind == "int") or "none"
        message = f"{value!r} is not an integer from 1 to {most} and not an int setting (available: {names})"
        return self.fault(key, message)

    # -------------------------------------------------------------------------------------------------------- passes
    def declare_passes(self, entries: Sequence[PassEntry]) -> tuple[PassInfo, ...]:
        """The passes in their order; each reads what those before it wrote."""
        if not entries:
            self.fault("pass", "at least one [[pass]] with shader and writes is required")
            return ()
        written_images: list[str] = []
        passes = []
        for number, entry in enumerate(entries):
            info = self.pass_info(f"pass[{number}]", entry, written_images)
            written_images += [name for name in info.writes if name not in (*written_images, *REPORTS)]
            passes.append(info)
        for name in self._image_formats:
            if name not in written_images:
                kind = "history" if name in self._history else "buffer" if name in self._buffers else "the image"
                self.fault("pass", f"no pass writes {name!r} ({kind})")
        return tuple(passes)

    def pass_info(self, at: str, entry: PassEntry, written_images: Sequence[str]) -> PassInfo:
        """The pass of the table ``at``.  ``written_images``: histories, buffers and result of the passes before it."""
        writes = self.names(f"{at}.writes", entry.writes, [*self._image_formats, *REPORTS])
        readable = [*self.reads, *(f"prev_{name}" for name in self._history), *written_images]
        reads = tuple(name for name in readable if name not in writes)
        if entry.reads is not None:
            reads = self.names(f"{at}.reads", entry.reads, readable, self._image_formats)
            if len(reads) > MAX_READS:
                self.fault(f"{at}.reads", f"{len(reads)} textures; the limit per pass is {MAX_READS}")
        if not self.own_light and (foreign := [name for name in writes if name in SAMPLE_REPORTS]):
            self.fault(f"{at}.writes", f'{foreign[0]} is of methods with light = "own"')
        if len(writes) > MAX_WRITES:
            self.fault(f"{at}.writes", f"{len(writes)} textures; the limit per pass is {MAX_WRITES}")
        repeat = self.count(f"{at}.repeat", entry.repeat, MAX_REPEAT)
        if entry.block and self.own_light:
            self.fault(f"{at}.block", 'a pass of a method with light = "own" runs once per pixel')
        info = PassInfo(entry.shader, reads, writes, repeat or 1, entry.block, self.image_size(at, entry.size))
        self.check_shader(at, info)
        for name in writes:
            size = "input" if name in self._input_sized else "output"
            if size != info.size:
                self.fault(f"{at}.writes", f"{name!r} has the {size} size, the pass the {info.size} size")
        return info

    def check_shader(self, at: str, info: PassInfo) -> None:
        """Check that the shader exists, defines its entry function, and uses only what its pass declares."""
        try:
            texts = list(_shader_texts(tuple(f for f in (self._folder, self._base) if f), info.shader))
        except GraphicsError as error:
            return self.fault(f"{at}.shader", f"{info.shader[:80]}: {error.what}")
        self._shader_files |= {file for file, _ in texts}
        entry, signature = (_ENTRY, "reuse(ivec2 p)")
        if info.block:
            entry, signature = (_BLOCK_ENTRY, "reuse_block(ivec2 block, int thread)")
        if not any(entry.search(text) for _, text in texts):
            self.fault(f"{at}.shader", f"{info.shader} has no function 'void {signature}'")
        readable = (*self.reads, *self._image_formats, *REPORTS, *(f"prev_{name}" for name in self._history))
        for file, text in texts:
            for match in _USE.finditer(text):
                verb, name = match.groups()
                if name in (info.writes if verb == "write" else info.reads) or name not in (*readable, *INPUTS):
                    continue
                function = match.group(0)[:-1]
                if name not in (*readable, *RESERVED_INPUTS) and _defines(texts, function.strip()):
                    continue  # a function of the method itself, written before there was such an input
                line = text.count("\n", 0, match.start()) + 1
                self.fault(f"{file}:{line}", f"{function}: {_missing(verb, name, at)}")
        return None


def _defines(texts: list[tuple[str, str]], function: str) -> bool:
    """Whether a text defines ``function``: a type precedes its name."""
    pattern = re.compile(rf"^\s*(?!return\b)[a-z]\w*\s+{function}\s*\(", re.MULTILINE)
    return any(pattern.search(text) for _, text in texts)


def _missing(verb: str, name: str, at: str) -> str:
    if verb == "write":
        return f"{name!r} is not in {at}.writes" if name not in INPUTS else f"{name!r} is a read-only input"
    return f"{name!r} is not in {'the reads of the method' if name in INPUTS else f'{at}.reads'}"


def _shader_texts(
    folders: tuple[Path, ...], entry: str, seen: set[str] | None = None, chain: tuple[str, ...] = ()
) -> Iterator[tuple[str, str]]:
    """The file and its includes without comments, line breaks preserved.  Raises GraphicsError."""
    seen = set() if seen is None else seen
    if entry in seen:
        return
    if len(chain) > MAX_INCLUDES:
        raise GraphicsError(f"shader {chain[0]} includes files more than {MAX_INCLUDES} deep")
    seen.add(entry)
    text = read_source(entry, folders, chain[-1] if chain else "")
    text = _COMMENT.sub(lambda m: "\n" * m.group(0).count("\n"), text)
    yield entry, text
    for include in _INCLUDE.findall(text):
        yield from _shader_texts(folders, include, seen, (*chain, entry))
