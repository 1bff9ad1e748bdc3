"""GLSL sources: include-once resolution, defines, and errors that name the original file and line.

moderngl's include is a single pass, and Mesa drops the source number of ``#line``.  So sources are expanded here, and
a map from expanded line to ``file:line`` translates the driver's messages.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from taubench_gl.data_files import read_text
from taubench_gl.errors import GraphicsError
from taubench_gl.paths import SHADERS

if TYPE_CHECKING:
    import moderngl

MAX_SOURCE_BYTES = 1 << 20
"""Most bytes of one shader file."""

MAX_INCLUDES = 100
"""Most includes within each other."""

VERSION = "#version 450\n"
_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$')
# Mesa: "0:12(5): error"; NVIDIA: "0(12) : error"; AMD and Intel on Windows: "ERROR: 0:12:"
_DRIVER_LINE = re.compile(r"\b0[:(](\d+)(?:\(\d+\))?\)?\s*:")


@dataclass(frozen=True, slots=True)
class Source:
    """Expanded GLSL and where each of its lines came from (``origin[i]`` belongs to line i + 1)."""

    text: str
    origin: tuple[str, ...]

    def translate(self, message: str) -> str:
        """The driver's message with its line numbers replaced by ``file:line``."""

        def name(match: re.Match[str]) -> str:
            line = int(match.group(1))
            return f"{self.origin[line - 1]}:" if 0 < line <= len(self.origin) else match.group(0)

        return _DRIVER_LINE.sub(name, message)


def resolve(
    entry: str, defines: Mapping[str, object] | None = None, preamble: str = "", roots: tuple[Path, ...] = (SHADERS,)
) -> Source:
    """Expand ``entry`` with ``defines``; ``preamble`` is GLSL text derived in Python.

    ``entry`` and includes are paths in the first of ``roots`` that has them.
    """
    lines, origin = [VERSION.rstrip("\n")], ["version"]
    for name, value in sorted((defines or {}).items()):
        lines.append(f"#define {name} {int(value) if isinstance(value, bool) else value}")
        origin.append(f"define {name}")
    for number, line in enumerate(preamble.splitlines(), 1):
        lines.append(line)
        origin.append(f"preamble:{number}")
    _expand(entry, roots, lines, origin, seen=set(), chain=())
    return Source("\n".join(lines) + "\n", tuple(origin))


def _expand(
    entry: str, roots: tuple[Path, ...], lines: list[str], origin: list[str], seen: set[str], chain: tuple[str, ...]
) -> None:
    if entry in chain:
        raise GraphicsError(f"shader includes form a cycle: {' > '.join((*chain, entry))}")
    if entry in seen:
        return
    if len(chain) > MAX_INCLUDES:
        raise GraphicsError(f"shader {chain[0]} includes files more than {MAX_INCLUDES} deep")
    seen.add(entry)
    for text, places, include in _parts(entry, read_source(entry, roots, chain[-1] if chain else "")):
        lines += text
        origin += places
        if include:
            _expand(include, roots, lines, origin, seen, (*chain, entry))


@lru_cache(maxsize=256)
def _parts(entry: str, text: str) -> list[tuple[list[str], list[str], str]]:
    """Lines between the includes of a file, where they came from, and the file that follows them; "" after the last."""
    parts: list[tuple[list[str], list[str], str]] = [([], [], "")]
    for number, line in enumerate(text.splitlines(), 1):
        if include := _INCLUDE.match(line):
            parts[-1] = (*parts[-1][:2], include.group(1))
            parts.append(([], [], ""))
        else:
            parts[-1][0].append(line)
            parts[-1][1].append(f"{entry}:{number}")
    return parts


def find_source(entry: str, roots: tuple[Path, ...]) -> Path:
    """The file in the first of ``roots`` that has it, else where it would be in the first.

    Raises GraphicsError for a path that leads out of its folder, by its name or by a symbolic link.
    """
    places = []
    for root in roots:
        path, there = _packaged(entry) if root == SHADERS else _place(entry, root)
        if there:
            return path
        places.append(path)
    return places[0]


def _place(entry: str, root: Path) -> tuple[Path, bool]:
    """Where ``entry`` is in the folder ``root``, without links, and whether it is there.  Raises GraphicsError."""
    try:
        path = (root / entry).resolve()
        inside, there = path.is_relative_to(root.resolve()), path.exists()
    except (OSError, ValueError, RuntimeError):  # too long, a NUL, a loop of links
        raise GraphicsError(f"shader {entry[:80]!r} is not the name of a file") from None
    if not inside:
        raise GraphicsError(f"shader {entry} is not inside the folder {root.name}")
    return path, there


@lru_cache(maxsize=512)
def _packaged(entry: str) -> tuple[Path, bool]:
    """``_place`` in the folder of the package, whose files stay where they are while the program runs."""
    return _place(entry, SHADERS)


def read_source(entry: str, roots: tuple[Path, ...], by: str = "") -> str:
    """The text of ``entry``, a regular file of at most MAX_SOURCE_BYTES; ``by``: what includes it.

    Raises GraphicsError.
    """
    path = find_source(entry, roots)
    try:
        return _read(path, path.stat().st_mtime_ns if path.exists() else 0)
    except GraphicsError as error:
        included = f" (included by {by})" if by else ""
        raise GraphicsError(f"shader {entry} cannot be read{included}: {error.what}") from None


@lru_cache(maxsize=256)
def _read(path: Path, modified: int) -> str:
    """The text of a shader file, read once for each time at which it was ``modified``."""
    return read_text(path, GraphicsError, max_bytes=MAX_SOURCE_BYTES)


class ShaderCache:
    """Programs by entry points and defines, compiled when first requested and only once."""

    def __init__(self, ctx: moderngl.Context):
        self._ctx = ctx
        self._programs: dict[tuple, moderngl.Program | moderngl.ComputeShader] = {}

    def __len__(self) -> int:
        return len(self._programs)

    @property
    def names(self) -> list[str]:
        """Entry points with their defines, as compiled so far."""
        return [
            " + ".join(key[0]) + (f" [{' '.join(n for n, _ in key[1])}]" if key[1] else "") for key in self._programs
        ]

    def compute(
        self, entry: str, defines: Mapping[str, object] | None = None, preamble: str = ""
    ) -> moderngl.ComputeShader:
        key = ((entry,), tuple(sorted((defines or {}).items())), preamble)
        if key not in self._programs:
            self._programs[key] = self._compiled(resolve(entry, defines, preamble))
        return self._programs[key]

    def render(
        self,
        vertex: str,
        fragment: str,
        defines: Mapping[str, object] | None = None,
        preamble: str = "",
        outputs: str = "",
    ) -> moderngl.Program:
        """The program of a vertex and a fragment stage.  ``outputs``: GLSL text for the fragment stage alone (its
        ``out`` variables).
        """
        key = ((vertex, fragment), tuple(sorted((defines or {}).items())), preamble + outputs)
        if key not in self._programs:
            v, f = resolve(vertex, defines, preamble), resolve(fragment, defines, f"{preamble}\n{outputs}")
            self._programs[key] = self._compiled(v, f)
        return self._programs[key]

    def _compiled(self, *sources: Source) -> moderngl.Program | moderngl.ComputeShader:
        """A program of one compute stage, or of a vertex and a fragment stage."""
        if len(sources) == 1:
            return compile_compute(self._ctx, *sources)
        vertex, fragment = (source.text for source in sources)
        return _compile(lambda: self._ctx.program(vertex_shader=vertex, fragment_shader=fragment), list(sources))

    def release(self) -> None:
        for program in self._programs.values():
            program.release()
        self._programs.clear()


def compile_compute(ctx: moderngl.Context, source: Source) -> moderngl.ComputeShader:
    """A compute program of ``source``; GraphicsError names the files and lines of its first faults."""
    return _compile(lambda: ctx.compute_shader(source.text), [source])


def _compile(make, sources: list[Source]):
    import moderngl

    try:
        return make()
    except moderngl.Error as error:
        text = str(error)
        # moderngl names the failing stage in a header; with two sources pick the one whose stage it names.
        source = sources[-1] if "fragment_shader" in text.lower() or len(sources) == 1 else sources[0]
        body = [line.strip() for line in text.splitlines() if _DRIVER_LINE.search(line)]
        faults = [line for line in body if "error" in line.lower()] or body or text.splitlines()[-3:]
        body = faults[:3]  # the first faults; the rest mostly follows from them
        raise GraphicsError(f"shader does not compile: {source.translate('; '.join(body))}") from None
