"""Declarations of methods -> Method: a folder with ``method.toml`` and GLSL files, or a Python class.

``Declaration`` checks what both have in common.  All errors are reported together, before any GL call.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from taubench_gl.data_files import read_toml
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
    REPORTS,
    RESULT,
    RESULT_FORMAT,
    SAMPLE_REPORTS,
    SIZES,
    Format,
    Method,
    PassInfo,
    Setting,
    Stage,
    suggestion,
)
from taubench_gl.reuse.frame import INPUTS, RESERVED_INPUTS

FILE = "method.toml"
BUILTIN = PACKAGE / "reuse" / "methods"
SHARED_KEYS = ("name", "title", "cite", "reads", "settings", "upscales", "stages")
"""Keys of method.toml that are also attributes of a class."""

KEYS = (*SHARED_KEYS, "base", "light", "structs", "history", "buffers", "keyframe", "pass")
PASS_KEYS = ("shader", "reads", "writes", "repeat", "block", "size")
SETTING_KEYS = ("default", "min", "max", "choices", "scale", "doc")
STAGE_KEYS = ("doc", "paper", "shader", "missing")
LIBRARIES = ("numpy", "torch")
"""Values of ``arrays`` of a class."""

INCOMPLETE = "-class"
"""End of the name of a method that is of a class of methods, and lacks stages that others of it have."""

MAX_METHOD_BYTES = 1 << 20
"""Size limit of a method.toml and of a method in Python."""
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
_READ_WORDS = {"material": ("roughness", "metallic"), "emitted": ("remodulate",)}
"""Functions that are generated where an input is read."""


def load_folder(folder: Path) -> Method:
    """The method in ``folder``.  Raises MethodError, which lists all errors with TOML key or file and line."""
    path = folder / FILE
    raw = read_toml(path, fault=MethodError, max_bytes=MAX_METHOD_BYTES)
    declared = _Folder(folder, raw)
    names = ("history", "buffers", "passes", "keyframe", "folder", "base", "structs")
    fields = {name: getattr(declared, name) for name in names}
    fields["input_sized"] = frozenset(declared.input_sized)
    fields["reports"] = tuple(name for name in REPORTS if any(name in info.writes for info in declared.passes))
    return declared.method(str(path), declared.files, where=str(folder), **fields)


def method_from_class(cls: type, where: str = "") -> Method:
    """A Method from a class with ``reads`` and ``step``.  Raises MethodError, which lists all errors."""
    raw = {key: getattr(cls, key) for key in SHARED_KEYS if hasattr(cls, key)}
    declared = Declaration(raw, cls.__name__)
    declared.declare_settings(())
    if not callable(getattr(cls, "step", None)):
        declared.fault("step", "must be a function step(self, frame)")
    if getattr(cls, "arrays", "numpy") not in LIBRARIES:
        declared.fault("arrays", f"{cls.arrays!r} is not {' or '.join(LIBRARIES)}")
    reports = declared.names(
        "reports", getattr(cls, "reports", ()), [name for name in REPORTS if name not in SAMPLE_REPORTS]
    )
    where = where or f"{cls.__module__}:{cls.__qualname__}"
    return declared.method(where, factory=cls, where=where, reports=reports)


class Declaration:
    """Checks ``raw``, the keys of method.toml or the attributes of a class, and collects all errors."""

    def __init__(self, raw: Mapping[str, Any], name: str):
        self.raw, self.errors = raw, []
        self.name = self.text("name", name)
        self.title = self.text("title", self.name)
        self.cite = self.texts("cite")
        self.own_light = raw.get("light") == "own"
        self.reads = self.names("reads", raw.get("reads") or ([] if self.own_light else None), list(INPUTS))
        self.upscales = raw.get("upscales", False)
        if not isinstance(self.upscales, bool):
            self.fault("upscales", f"{self.upscales!r} is not true or false")
        self.settings: dict[str, Setting] = {}

    def method(self, origin: str, shaders: Collection[str] | None = None, **rest: Any) -> Method:
        """The method.  Raises MethodError at ``origin``.

        ``shaders``: files of its passes, None for a method in Python; ``rest``: fields that one kind of methods has.
        """
        stages = self.stages(shaders)
        if self.errors:
            raise MethodError("; ".join(self.errors), where=origin)
        common = {"settings": self.settings, "stages": stages, "upscales": self.upscales}
        own = tuple(name for name in (EMITTED, LIGHTS) if self.own_light and name not in self.reads)
        return Method(self.name, self.title, self.cite, (*self.reads, *own), **common, **rest)

    def fault(self, key: str, message: str) -> None:
        self.errors.append(f"{key}: {message}")

    # ------------------------------------------------------------------------------------------------ simple values
    def known_keys(self, at: str, table: Mapping[str, Any], allowed: Collection[str]) -> None:
        """A fault for each key of ``table`` that is not among ``allowed``; ``at``: its place, "" or ending in a dot."""
        for key in table:
            if key not in allowed:
                self.fault(f"{at}{key}", f"unknown key{suggestion(str(key), allowed)}")

    def text(self, key: str, default: str) -> str:
        value = self.raw.get(key, default)
        if isinstance(value, str) and value.strip():
            return value.strip()
        self.fault(key, f"{value!r} is not text")
        return default

    def texts(self, key: str) -> tuple[str, ...]:
        value = self.raw.get(key, [])
        value = [value] if isinstance(value, str) else value
        if isinstance(value, (list, tuple)) and all(isinstance(v, str) for v in value):
            return tuple(value)
        self.fault(key, "is not text or a list of texts")
        return ()

    def table(self, key: str, example: str) -> Mapping[str, Any]:
        value = self.raw.get(key, {})
        if isinstance(value, Mapping):
            return value
        self.fault(key, f"must be a table such as {example}")
        return {}

    def names(self, key: str, value: Any, allowed: list[str], later: Collection[str] = ()) -> tuple[str, ...]:
        """Those of ``allowed`` in ``value``, without duplicates.  ``later``: names that are known, but not yet."""
        if not isinstance(value, (list, tuple)) or not all(isinstance(v, str) for v in value):
            self.fault(key, f"must be a list of names (available: {', '.join(allowed)})")
            return ()
        for name in value:
            if name in allowed:
                continue
            if name in later:
                self.fault(key, f"{name!r} is read before a pass writes it")
            else:
                input_name = name in INPUTS and key.endswith("reads")
                hint = ": add it to the method's reads" if input_name else suggestion(name, allowed)
                self.fault(key, f"unknown name {name!r}{hint}")
        return tuple(dict.fromkeys(name for name in value if name in allowed))

    # ------------------------------------------------------------------------------------------- settings and stages
    def name_error(self, name: object, kind: str, used_names: Collection[str] = ()) -> str | None:
        """Why ``name`` is not a valid name for a history, buffer or setting, or None.  It becomes part of the shader.

        A later input is no reserved name where the method does not read it.
        """
        no_name = f"{name!r} is not a name for a {kind}"
        if not isinstance(name, str) or not _NAME.fullmatch(name) or "__" in name:
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
        for name, raw in self.table("settings", "alpha = { default = 0.1, min = 0, max = 1 }").items():
            if error := self.name_error(name, "setting", used_names):
                self.fault("settings", error)
            elif setting := self.setting(name, raw):
                self.settings[name] = setting

    def setting(self, name: str, raw: object) -> Setting | None:
        """A setting from ``0.1`` or ``{default, min, max, choices, scale, doc}``; None with errors."""
        table, at, before = raw if isinstance(raw, Mapping) else {"default": raw}, f"settings.{name}", len(self.errors)
        self.known_keys(f"{at}.", table, SETTING_KEYS)
        default, choices, doc = table.get("default"), table.get("choices", ()), table.get("doc", "")
        words = choices if isinstance(choices, (list, tuple)) else [None]
        if not all(isinstance(word, str) and _NAME.fullmatch(word) for word in words):
            return self.fault(f"{at}.choices", "not a list of lower-case words")
        kind = "choice" if choices else {bool: "bool", int: "int", float: "float"}.get(type(default))
        if default is None or kind is None:
            return self.fault(f"{at}.default", f"{default!r} is not a number, true, false, or one of choices")
        for key in ("min", "max"):
            bound, number = table.get(key), kind in ("float", "int")
            if bound is not None and not (number and isinstance(bound, (int, float)) and not isinstance(bound, bool)):
                return self.fault(f"{at}.{key}", f"{bound!r} is not a number, or the setting is not a number")
        scale = table.get("scale", "linear")
        if scale not in ("linear", "log"):
            self.fault(f"{at}.scale", f"{scale!r} is not linear or log")
        if not isinstance(doc, str):
            self.fault(f"{at}.doc", f"{doc!r} is not text")
        setting = Setting(name, kind, default, table.get("min"), table.get("max"), tuple(choices), scale, str(doc))
        if scale == "log" and not (setting.minimum or 0) > 0:
            self.fault(f"{at}.scale", "log needs a min above 0")
        if error := setting.error(default):
            self.fault(f"{at}.default", error)
        return setting if len(self.errors) == before else None

    def stages(self, shaders: Collection[str] | None) -> tuple[Stage, ...]:
        """The stages of the method's paper.  ``shaders``: files of its passes, None for a method in Python."""
        out = []
        for name, entry in self.table("stages", "accumulation = { doc = ..., paper = ..., shader = ... }").items():
            at = f"stages.{name}"
            if not isinstance(name, str) or not _STAGE_NAME.fullmatch(name):
                self.fault(at, "is not a name: lower-case letters, digits, single _")
            elif not isinstance(entry, Mapping):
                self.fault(at, "must be a table with doc, paper, and shader or missing")
            else:
                self.known_keys(f"{at}.", entry, STAGE_KEYS)
                out.append(self.stage(at, name, {key: entry.get(key) for key in STAGE_KEYS}, shaders))
        return tuple(out)

    def stage(self, at: str, name: str, texts: Mapping[str, Any], shaders: Collection[str] | None) -> Stage:
        for key, value in texts.items():
            absent = value is None and key not in ("doc", "paper")
            if not absent and not (isinstance(value, str) and value.strip()):
                self.fault(f"{at}.{key}", f"{value!r} is not text")
        shader, missing = texts["shader"], texts["missing"]
        if shaders is None and shader is not None:
            self.fault(f"{at}.shader", "a method in Python has none")
        if shaders is not None and missing is None and shader not in shaders:
            available = ", ".join(sorted(shaders))
            self.fault(f"{at}.shader", f"{shader!r} is not a file of its passes (available: {available})")
        if missing is not None and shader is not None:
            self.fault(at, "has both shader and missing")
        if missing is not None and not (
            self.name.endswith(INCOMPLETE) or ("without" in self.name and name in self.name)
        ):
            names = f"{self.name}_without_{name}, or {self.name}{INCOMPLETE}"
            self.fault(at, f"a missing stage is in the method's name: {names}")
        return Stage(name, **texts)


class _Folder(Declaration):
    """The declaration of a method in GLSL."""

    def __init__(self, folder: Path, raw: Mapping[str, Any]):
        super().__init__(raw, folder.resolve().name)
        self.known_keys("", raw, KEYS)
        self.folder, self.base = folder, self.base_folder()
        self.files: set[str] = set()  # shaders of the passes, and their includes
        self.input_sized: set[str] = set()
        if "light" in raw and (not self.own_light or self.upscales):
            self.fault("light", 'must be "own", of a method that does not upscale')
        self.structs = self.declare_structs()
        self.formats = {**FORMATS, **{s.name: Format(s.name, 0, "f4", s.name, s) for s in self.structs}}
        self.history: dict[str, Format] = {}
        self.buffers: dict[str, Format] = {}
        self.declare_formats("history", "history", self.history)
        self.declare_formats("buffers", "buffer", self.buffers)
        self.image_formats = {**self.history, **self.buffers, RESULT: RESULT_FORMAT}
        self.declare_settings({**self.history, **self.buffers})
        self.keyframe = self.count("keyframe", raw.get("keyframe"), 1 << 20)
        self.passes = self.declare_passes()

    def base_folder(self) -> Path | None:
        """Folder of the built-in method whose shaders this method uses where it has none of its own."""
        value = self.raw.get("base")
        methods = sorted(path.parent.name for path in BUILTIN.glob(f"*/{FILE}"))
        if value is None or value in methods:
            return None if value is None else BUILTIN / value
        return self.fault("base", f"there is no built-in method in GLSL {value!r}{suggestion(str(value), methods)}")

    def declare_structs(self) -> tuple[Struct, ...]:
        """The method's own formats: name -> fields and their types."""
        out = []
        for name, fields in self.table("structs", '{ Reservoir = { light = "int", weight = "float" } }').items():
            at = f"structs.{name}"
            if not _STRUCT_NAME.fullmatch(name):
                self.fault(at, "is not a name: a capital letter, then letters and digits")
            elif not isinstance(fields, Mapping) or not fields:
                self.fault(at, 'must be a table such as { light = "int", weight = "float" }')
            elif wrong := [
                f for f, t in fields.items() if t not in TYPES or not _NAME.fullmatch(f) or f in _GLSL_WORDS
            ]:
                self.fault(f"{at}.{wrong[0]}", f"is not a name with one of the types {', '.join(TYPES)}")
            else:
                out.append(Struct(name, *(Field(field, kind, "") for field, kind in fields.items())))
        return tuple(out)

    def declare_formats(self, key: str, kind: str, formats: dict[str, Format]) -> None:
        """Fill ``formats``.  One error for a wrong format, not one for each use of the name."""
        for name, value in self.table(key, 'accumulated = "rgba32f"').items():
            if isinstance(value, dict):
                self.known_keys(f"{key}.{name}.", value, ("format", "size"))
                if self.size(f"{key}.{name}", value) == "input":
                    self.input_sized.add(name)
                value = value.get("format")
            if error := self.name_error(name, kind, self.history):
                self.fault(key, error)
                continue
            if not isinstance(value, str) or value not in self.formats:
                self.fault(f"{key}.{name}", f"{value!r} is not a format (available: {', '.join(self.formats)})")
            formats[name] = self.formats.get(str(value), RESULT_FORMAT)

    def size(self, at: str, table: Mapping[str, Any]) -> str:
        """The key ``size`` of a history, buffer or pass."""
        value = table.get("size", SIZES[0])
        if value not in SIZES:
            self.fault(f"{at}.size", f"{value!r} is not {' or '.join(SIZES)}")
        elif value != SIZES[0] and not self.upscales:
            self.fault(f"{at}.size", "both sizes are equal without 'upscales = true'")
        return value if value in SIZES else SIZES[0]

    def count(self, key: str, value: Any, most: int) -> int | str | None:
        """An integer from 1 to ``most``, or the name of an int setting within these bounds."""
        if value is None or (isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= most):
            return value
        if isinstance(value, str) and value in self.settings:
            s = self.settings[value]
            if s.kind == "int" and (s.minimum or 0) >= 1 and s.maximum is not None and s.maximum <= most:
                return value
            return self.fault(key, f"setting {value!r} must be an integer with min >= 1 and max <= {most}")
        names = ", ".join(n for n, s in self.settings.items() if s.kind == "int") or "none"
        message = f"{value!r} is not an integer from 1 to {most} and not an int setting (available: {names})"
        return self.fault(key, message)

    # -------------------------------------------------------------------------------------------------------- passes
    def declare_passes(self) -> tuple[PassInfo, ...]:
        raw = self.raw.get("pass")
        if not isinstance(raw, list) or not raw or not all(isinstance(p, dict) for p in raw):
            self.fault("pass", "at least one [[pass]] with shader and writes is required")
            return ()
        written_images: list[str] = []
        passes = []
        for number, entry in enumerate(raw):
            at = f"pass[{number}]"
            self.known_keys(f"{at}.", entry, PASS_KEYS)
            writes = self.names(f"{at}.writes", entry.get("writes"), [*self.image_formats, *REPORTS])
            readable = [*self.reads, *(f"prev_{name}" for name in self.history), *written_images]
            if "reads" in entry:
                reads = self.names(f"{at}.reads", entry["reads"], readable, self.image_formats)
                if len(reads) > MAX_READS:
                    self.fault(f"{at}.reads", f"{len(reads)} textures; the limit per pass is {MAX_READS}")
            else:
                reads = tuple(name for name in readable if name not in writes)
            if not self.own_light and (foreign := [name for name in writes if name in SAMPLE_REPORTS]):
                self.fault(f"{at}.writes", f'{foreign[0]} is of methods with light = "own"')
            if len(writes) > MAX_WRITES:
                self.fault(f"{at}.writes", f"{len(writes)} textures; the limit per pass is {MAX_WRITES}")
            repeat = self.count(f"{at}.repeat", entry.get("repeat", 1), MAX_REPEAT)
            block = self.block(f"{at}.block", entry.get("block"))
            if block and self.own_light:
                self.fault(f"{at}.block", 'a pass of a method with light = "own" runs once per pixel')
            info = PassInfo(str(entry.get("shader")), reads, writes, repeat or 1, block, self.size(at, entry))
            self.check_shader(at, entry.get("shader"), info)
            written_images += [name for name in writes if name not in written_images and name not in REPORTS]
            for name in writes:
                image_size = "input" if name in self.input_sized else "output"
                if image_size != info.size:
                    self.fault(f"{at}.writes", f"{name!r} has the {image_size} size, the pass the {info.size} size")
            passes.append(info)
        for name in self.image_formats:
            if name not in written_images:
                kind = "history" if name in self.history else "buffer" if name in self.buffers else "the image"
                self.fault("pass", f"no pass writes {name!r} ({kind})")
        return tuple(passes)

    def block(self, key: str, value: Any) -> tuple[int, int] | None:
        """Width and height in pixels of the blocks of a block pass."""
        if value is None:
            return None
        sides = value if isinstance(value, list) and len(value) == 2 else [None]
        if all(isinstance(v, int) and not isinstance(v, bool) and MIN_BLOCK <= v <= MAX_BLOCK for v in sides):
            return value[0], value[1]
        return self.fault(key, f"{value!r} is not [width, height] with integers from {MIN_BLOCK} to {MAX_BLOCK}")

    def check_shader(self, at: str, value: Any, info: PassInfo) -> None:
        """Check that the shader exists, defines its entry function, and uses only what its pass declares."""
        if not isinstance(value, str) or not value:
            return self.fault(f"{at}.shader", "must be the name of a GLSL file in this folder")
        try:
            texts = list(_shader_texts(tuple(f for f in (self.folder, self.base) if f), value))
        except GraphicsError as error:
            return self.fault(f"{at}.shader", f"{value[:80]}: {error.what}")
        self.files |= {file for file, _ in texts}
        entry, signature = (_ENTRY, "reuse(ivec2 p)")
        if info.block:
            entry, signature = (_BLOCK_ENTRY, "reuse_block(ivec2 block, int thread)")
        if not any(entry.search(text) for _, text in texts):
            self.fault(f"{at}.shader", f"{value} has no function 'void {signature}'")
        readable = (*self.reads, *self.image_formats, *REPORTS, *(f"prev_{name}" for name in self.history))
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
