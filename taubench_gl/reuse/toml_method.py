"""A folder with ``method.toml`` and GLSL files -> Method.  Reports all errors together, before any GL call."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from taubench_gl.data_files import read_toml
from taubench_gl.errors import GraphicsError, MethodError
from taubench_gl.gpu.shader import MAX_INCLUDES, read_source
from taubench_gl.paths import PACKAGE
from taubench_gl.reuse.contract import (
    FORMATS,
    MAX_BLOCK,
    MAX_READS,
    MAX_REPEAT,
    MAX_WRITES,
    MIN_BLOCK,
    REPORTS,
    RESULT,
    RESULT_FORMAT,
    SIZES,
    Format,
    Method,
    PassInfo,
    Setting,
    name_error,
    parse_reads,
    parse_setting,
    suggestion,
)
from taubench_gl.reuse.frame import INPUTS, RESERVED_INPUTS
from taubench_gl.reuse.stages import parse_stages

FILE = "method.toml"
BUILTIN = PACKAGE / "reuse" / "methods"
_KEYS = (
    *("name", "title", "base", "cite", "reads", "history", "buffers", "settings", "keyframe", "upscales", "stages"),
    "pass",
)
_PASS_KEYS = ("shader", "reads", "writes", "repeat", "block", "size")
_MAX_BYTES = 1 << 20
_ENTRY = re.compile(r"\bvoid\s+reuse\s*\(\s*(?:in\s+)?ivec2\b")
_BLOCK_ENTRY = re.compile(r"\bvoid\s+reuse_block\s*\(\s*(?:in\s+)?ivec2\b[^,)]*,\s*(?:in\s+)?int\b")
_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"', re.MULTILINE)
_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
_USE = re.compile(r"\b(fetch|nearest|sample|cubic|write)_([a-z][a-z0-9_]*)\s*\(")


def load_folder(folder: Path) -> Method:
    """The method in ``folder``.  Raises MethodError, which lists all errors with TOML key or file and line."""
    path = folder / FILE
    raw = read_toml(path, fault=MethodError, max_bytes=_MAX_BYTES)
    method, errors = _Parser(folder, raw).run()
    if errors:
        raise MethodError("; ".join(errors), where=str(path))
    return method


class _Parser:
    """Collects all errors."""

    def __init__(self, folder: Path, raw: Mapping[str, Any]):
        self.folder, self.raw = folder, raw
        self.errors: list[str] = []
        self.base: Path | None = None
        self.files: set[str] = set()  # shaders of the passes, and their includes
        self.inputs: tuple[str, ...] = ()
        self.upscales = False
        self.input_sized: set[str] = set()

    def run(self) -> tuple[Method | None, list[str]]:
        for key in self.raw:
            if key not in _KEYS:
                self.errors.append(f"{key}: unknown key{suggestion(key, _KEYS)}")
        name = self.text("name", self.folder.resolve().name)
        title = self.text("title", name)
        self.base = self.base_folder()
        cite = self.texts("cite")
        reads = self.inputs = self.reads()
        self.upscales = self.raw.get("upscales", False)
        if not isinstance(self.upscales, bool):
            self.errors.append(f"upscales: {self.upscales!r} is not true or false")
        history, buffers = self.formats("history"), self.formats("buffers", taken=self.table("history"))
        settings = self.settings({**history, **buffers})
        keyframe = self.count("keyframe", self.raw.get("keyframe"), settings, 1 << 20)
        passes = self.passes(reads, history, buffers, settings)
        stages, errors = parse_stages(self.raw.get("stages", {}), name, self.files)
        self.errors += errors
        if self.errors:
            return None, self.errors
        method = Method(name, title, cite, reads, settings, history, buffers, passes, self.folder, keyframe,
                        where=str(self.folder), upscales=self.upscales,
                        input_sized=frozenset(self.input_sized), stages=stages, reports=_reports(passes),
                        base=self.base)  # fmt: skip
        return method, []

    # ------------------------------------------------------------------------------------------------ simple values
    def text(self, key: str, default: str) -> str:
        value = self.raw.get(key, default)
        if isinstance(value, str) and value.strip():
            return value.strip()
        self.errors.append(f"{key}: {value!r} is not text")
        return default

    def base_folder(self) -> Path | None:
        """Folder of the built-in method whose shaders this method uses where it has none of its own."""
        value = self.raw.get("base")
        known = sorted(path.parent.name for path in BUILTIN.glob(f"*/{FILE}"))
        if value is None or value in known:
            return None if value is None else BUILTIN / value
        self.errors.append(f"base: there is no built-in method in GLSL {value!r}{suggestion(str(value), known)}")
        return None

    def texts(self, key: str) -> tuple[str, ...]:
        value = self.raw.get(key, [])
        value = [value] if isinstance(value, str) else value
        if isinstance(value, list) and all(isinstance(v, str) for v in value):
            return tuple(value)
        self.errors.append(f"{key}: is not text or a list of texts")
        return ()

    def table(self, key: str) -> Mapping[str, Any]:
        value = self.raw.get(key, {})
        return value if isinstance(value, dict) else {}

    def count(self, key: str, value: Any, settings: Mapping[str, Setting], most: int) -> int | str | None:
        """An integer from 1 to ``most``, or the name of an int setting within these bounds."""
        if value is None or (isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= most):
            return value
        if isinstance(value, str) and value in settings:
            s = settings[value]
            if s.kind == "int" and (s.minimum or 0) >= 1 and s.maximum is not None and s.maximum <= most:
                return value
            self.errors.append(f"{key}: setting {value!r} must be an integer with min >= 1 and max <= {most}")
            return None
        names = [n for n, s in settings.items() if s.kind == "int"]
        self.errors.append(f"{key}: {value!r} is not an integer from 1 to {most} and not an int setting "
                           f"(available: {', '.join(names) or 'none'})")  # fmt: skip
        return None

    # -------------------------------------------------------------------------------------------------- declarations
    def reads(self) -> tuple[str, ...]:
        value = self.raw.get("reads")
        if not isinstance(value, list) or not value:
            self.errors.append(f"reads: must be a list of inputs (available: {', '.join(INPUTS)})")
            return ()
        reads, errors = parse_reads(value)
        self.errors += errors
        return reads

    def formats(self, key: str, taken: Mapping[str, Any] | None = None) -> dict[str, Format]:
        if not isinstance(self.raw.get(key, {}), dict):
            self.errors.append(f'{key}: must be a table such as accumulated = "rgba32f"')
        found = {}
        for name, value in self.table(key).items():
            what = "history" if key == "history" else "buffer"
            error = name_error(name, what, taken or (), self.inputs, bool(self.upscales))
            if isinstance(value, dict):
                value = self.sized(f"{key}.{name}", str(name), value)
            if error:
                self.errors.append(f"{key}: {error}")
            elif not isinstance(value, str) or value not in FORMATS:
                self.errors.append(f"{key}.{name}: {value!r} is not a format (available: {', '.join(FORMATS)})")
            if not error:  # one error for a wrong format, not one for each use of the name
                found[name] = FORMATS.get(str(value), RESULT_FORMAT)
        return found

    def sized(self, at: str, name: str, table: Mapping[str, Any]) -> Any:
        """The format of ``{ format, size }``."""
        self.errors += [f"{at}.{key}: unknown key (allowed: format, size)"
                        for key in table if key not in ("format", "size")]  # fmt: skip
        if self.size(at, table) == "input":
            self.input_sized.add(name)
        return table.get("format")

    def size(self, at: str, table: Mapping[str, Any]) -> str:
        """The key ``size`` of a history, buffer or pass."""
        value = table.get("size", SIZES[0])
        if value not in SIZES:
            self.errors.append(f"{at}.size: {value!r} is not {' or '.join(SIZES)}")
        elif value != SIZES[0] and not self.upscales:
            self.errors.append(f"{at}.size: both sizes are equal without 'upscales = true'")
        return value if value in SIZES else SIZES[0]

    def settings(self, taken: Mapping[str, Any]) -> dict[str, Setting]:
        if not isinstance(self.raw.get("settings", {}), dict):
            self.errors.append("settings: must be a table")
        found = {}
        for name, raw in self.table("settings").items():
            if error := name_error(name, "setting", taken, self.inputs, bool(self.upscales)):
                self.errors.append(f"settings: {error}")
                continue
            setting, errors = parse_setting(name, raw)
            self.errors += [f"settings.{name}.{error}" for error in errors]
            if setting:
                found[name] = setting
        return found

    # -------------------------------------------------------------------------------------------------------- passes
    def passes(
        self,
        reads: tuple[str, ...],
        history: Mapping[str, Format],
        buffers: Mapping[str, Format],
        settings: Mapping[str, Setting],
    ) -> tuple[PassInfo, ...]:
        raw = self.raw.get("pass")
        if not isinstance(raw, list) or not raw or not all(isinstance(p, dict) for p in raw):
            self.errors.append("pass: at least one [[pass]] with shader and writes is required")
            return ()
        kept = {**history, **buffers, RESULT: RESULT_FORMAT}
        written: list[str] = []
        found = []
        for number, entry in enumerate(raw):
            at = f"pass[{number}]"
            self.errors += [f"{at}.{key}: unknown key{suggestion(key, _PASS_KEYS)}"
                            for key in entry if key not in _PASS_KEYS]  # fmt: skip
            writes = self.names(f"{at}.writes", entry.get("writes"), [*kept, *REPORTS])
            readable = [*reads, *(f"prev_{name}" for name in history), *written]
            requested = entry.get("reads")
            chosen = tuple(readable) if requested is None else self.names(f"{at}.reads", requested, readable, kept)
            if requested is None:
                chosen = tuple(n for n in chosen if n not in writes)
            repeat = self.count(f"{at}.repeat", entry.get("repeat", 1), settings, MAX_REPEAT)
            for what, names, most in (("reads", chosen, MAX_READS), ("writes", writes, MAX_WRITES)):
                if len(names) > most and (what == "writes" or requested is not None):
                    self.errors.append(f"{at}.{what}: {len(names)} textures; the limit per pass is {most}")
            block = self.block(f"{at}.block", entry.get("block"))
            info = PassInfo(str(entry.get("shader")), chosen, writes, repeat or 1, block, self.size(at, entry))
            known = (*reads, *kept, *REPORTS, *(f"prev_{n}" for n in history))
            self.shader(at, entry.get("shader"), info, known)
            written += [name for name in writes if name not in written and name not in REPORTS]
            for name in writes:
                own = "input" if name in self.input_sized else "output"
                if own != info.size:
                    self.errors.append(f"{at}.writes: {name!r} has the {own} size, the pass the {info.size} size")
            found.append(info)
        for name in kept:
            if name not in written:
                what = "history" if name in history else "buffer" if name in buffers else "the image"
                self.errors.append(f"pass: no pass writes {name!r} ({what})")
        return tuple(found)

    def names(self, key: str, value: Any, known: list[str], later: Mapping[str, Any] | None = None) -> tuple[str, ...]:
        if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
            self.errors.append(f"{key}: must be a list of names (available: {', '.join(known)})")
            return ()
        for name in value:
            if name in known:
                continue
            if later and name in later:
                self.errors.append(f"{key}: {name!r} is read before a pass writes it")
            else:
                declare = ": add it to the method's reads" if name in INPUTS else suggestion(name, known)
                self.errors.append(f"{key}: unknown name {name!r}{declare}")
        return tuple(dict.fromkeys(name for name in value if name in known))

    def block(self, key: str, value: Any) -> tuple[int, int] | None:
        """Width and height in pixels of the blocks of a block pass."""
        if value is None:
            return None
        sides = value if isinstance(value, list) and len(value) == 2 else [None]
        if all(isinstance(v, int) and not isinstance(v, bool) and MIN_BLOCK <= v <= MAX_BLOCK for v in sides):
            return value[0], value[1]
        self.errors.append(f"{key}: {value!r} is not [width, height] with integers from {MIN_BLOCK} to {MAX_BLOCK}")
        return None

    def shader(self, at: str, value: Any, info: PassInfo, known: tuple[str, ...]) -> None:
        """Check that the shader exists, defines its entry function, and uses only what its pass declares."""
        if not isinstance(value, str) or not value:
            self.errors.append(f"{at}.shader: must be the name of a GLSL file in this folder")
            return
        texts = []
        try:
            texts = list(_shader_texts(tuple(f for f in (self.folder, self.base) if f), value))
        except GraphicsError as error:
            self.errors.append(f"{at}.shader: {value[:80]}: {error.what}")
            return
        self.files |= {file for file, _ in texts}
        entry, signature = (_ENTRY, "reuse(ivec2 p)")
        if info.block:
            entry, signature = (_BLOCK_ENTRY, "reuse_block(ivec2 block, int thread)")
        if not any(entry.search(text) for _, text in texts):
            self.errors.append(f"{at}.shader: {value} has no function 'void {signature}'")
        for file, text in texts:
            for match in _USE.finditer(text):
                verb, name = match.groups()
                allowed = info.writes if verb == "write" else info.reads
                if name in allowed or name not in (*known, *INPUTS):
                    continue
                if name not in (*known, *RESERVED_INPUTS) and _defines(texts, match.group(0)[:-1].strip()):
                    continue  # a function of the method itself, written before there was such an input
                line = text.count("\n", 0, match.start()) + 1
                self.errors.append(f"{file}:{line}: {match.group(0)[:-1]}: {_missing(verb, name, at)}")


def _reports(passes: tuple[PassInfo, ...]) -> tuple[str, ...]:
    return tuple(name for name in REPORTS if any(name in info.writes for info in passes))


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
