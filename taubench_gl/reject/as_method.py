"""A rejection test as a reuse method: a folder with method.toml and shaders, for ``reuse evaluate``.  No OpenGL.

The method is a running mean, or restir-di; what differs between two of them is the history that they reject.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

from taubench_gl.data_files import read_text, read_toml
from taubench_gl.errors import MethodError, OutputError
from taubench_gl.gpu.shader import resolve
from taubench_gl.outputs import output_folder, write_atomically
from taubench_gl.paths import PACKAGE
from taubench_gl.reject.contract import COMMENT, RejectionTest, constants

READS = (
    "radiance", "motion", "position", "normal", "prev_position", "ids", "history_position", "history_normal",
    "history_ids",
)  # fmt: skip

FILE, RESTIR = "method.toml", PACKAGE / "reuse" / "methods" / "restir-di"
GATE_READS = ("mask", *READS[1:])

TOML = """\
title = "Running mean, history rejected by {title}"
reads = [{reads}]

[history]
accumulated = "rgba32f" # rgb: mean, a: frames in it
moved = "rg32f"         # motion of the frame

[settings]
threshold = {{ {threshold} }}
cap = {{ default = 16, min = 1, max = 1000000, scale = "log", doc = "limit on the frames in the mean" }}

[[pass]]
shader = "reuse.glsl"
writes = ["accumulated", "moved", "result", "reprojected_history"]
"""


def method_files(test: RejectionTest) -> dict[str, str]:
    """File name -> text of the folder of a running mean."""
    reads = ", ".join(f'"{name}"' for name in READS)
    toml = TOML.format(title=_title(test), reads=reads, threshold=_threshold(test))
    return {FILE: toml, "reuse.glsl": _shader(test, "accumulate")}


def gate_files(test: RejectionTest) -> dict[str, str]:
    """File name -> text of the folder of restir-di whose history reservoirs ``test`` rejects.

    Raises MethodError for a test of color: reservoirs have no shaded image.
    """
    if test.kind == "color":
        hint = "--history mean, or tests of geometry"
        raise MethodError(f"test {test.name} compares colors, which reservoirs do not have", hint=hint)
    raw, out = read_toml(RESTIR / FILE, fault=MethodError), {}
    for folder in (RESTIR.parent / raw["base"], RESTIR):
        out |= {path.name: read_text(path, fault=MethodError) for path in sorted(folder.glob("*.glsl"))}
    toml = read_text(RESTIR / FILE, fault=MethodError)
    reads = ", ".join(f'"{name}"' for name in GATE_READS)
    for text, other in (
        (f'title = "{raw["title"]}"', f'title = "{raw["title"]}; history rejected by {_title(test)}"'),
        (f'base = "{raw["base"]}"\nreads = ["motion", "mask"]', f"reads = [{reads}]"),
        ("[history]\n", '[history]\nmoved = "rg32f" # motion of the frame\n'),
        ("[settings]\n", f"[settings]\nthreshold = {{ {_threshold(test)} }}\n"),
        ('"motion", "mask"]\nwrites = ["combined",', f'{reads}, "prev_moved"]\nwrites = ["combined", "moved",'),
    ):
        if toml.count(text) != 1:
            raise ValueError(f"restir-di/{FILE}: {text!r} is {toml.count(text)} times in it")
        toml = toml.replace(text, other)
    return {**out, "gate.glsl": _shader(test, "gate"), FILE: toml}


def _title(test: RejectionTest) -> str:
    return test.title.replace('"', "'").replace("\\", "/")


def _threshold(test: RejectionTest) -> str:
    """The setting ``threshold`` as keys of TOML."""
    most = max(1e6, 10.0 * test.threshold)
    return f'default = {test.threshold!r}, min = 0.0, max = {most!r}, doc = "history is rejected above it"'


def _shader(test: RejectionTest, name: str) -> str:
    """``difference`` of a test and the shader of this name that calls it."""
    contract, caller = ("\n".join(resolve(f"reject/{n}.glsl").text.splitlines()[1:]) for n in ("contract", name))
    return "\n\n".join([contract, difference(test), caller]) + "\n"


def difference(test: RejectionTest) -> str:
    """``difference`` of a test; of a combination the largest of its parts, each divided by its threshold."""
    texts = [own_names(f"{constants(part)}\n{part.shader}", f"part{i}_") for i, part in enumerate(test.single)]
    values = [f"part{i}_difference(now, history, pixel)" for i in range(len(texts))]
    if test.parts:
        values = [f"{v} / {max(p.threshold, 1e-30)!r}" for v, p in zip(values, test.parts, strict=True)]
    largest = values[0]
    for value in values[1:]:
        largest = f"max({largest}, {value})"
    entry = f"float difference(Point now, Point history, Pixel pixel) {{ return {largest}; }}"
    return "\n".join([*texts, entry])


def own_names(text: str, prefix: str) -> str:
    """GLSL with ``prefix`` before every constant, function and struct that ``text`` declares.

    Parts of a combination may declare equal names, also those of the method around them.  Members, which follow a dot
    or stand in a struct, keep their names, as does what the contract declares.
    """
    text = COMMENT.sub(" ", text)
    declared = {m.group(1) for m in _DECLARATION.finditer(_outside(_outside(text, "{}"), "()"))} - {"radiance_at_pixel"}
    structs = [m.span() for m in _STRUCT.finditer(text)]

    def renamed(match: re.Match[str]) -> str:
        dot, name = match.groups()
        is_member = dot or (any(a < match.start() < b for a, b in structs) and text[match.end() :].lstrip()[0] in ";,[")
        return match.group() if is_member or name not in declared else prefix + name

    return _NAME.sub(renamed, text)


_DECLARATION = re.compile(r"(?:\b[A-Za-z_]\w*\s|,|\])\s*([A-Za-z_]\w*)\s*(?=[=;(\[{,])")
_STRUCT = re.compile(r"\bstruct\s+\w+\s*\{[^}]*\}")
_NAME = re.compile(r"(\.\s*)?\b([A-Za-z_]\w*)")


def _outside(text: str, pair: str) -> str:
    """``text`` without what stands between the two characters of ``pair``, such as brackets."""
    depth, out = 0, []
    for c in text:
        depth -= c == pair[1]
        out += [c] * (depth == 0)
        depth += c == pair[0]
    return "".join(out)


HISTORIES: dict[str, tuple[str, Callable[[RejectionTest], dict[str, str]]]] = {
    "mean": ("reject", method_files),
    "reservoirs": ("gate", gate_files),
}
"""What a test can reject: name -> prefix of the folders, and the function that makes their files."""


def write_methods(tests: Sequence[RejectionTest], out: Path, history: str = "mean") -> list[Path]:
    """Write a folder for each test into ``out``; the folders.  Raises OutputError for one that exists.

    ``history``: of HISTORIES.
    """
    prefix, files = HISTORIES[history]
    texts = [files(test) for test in tests]
    folders = [out / f"{prefix}_{test.name.replace('+', '_and_')}" for test in tests]
    for folder in folders:
        if folder.exists():
            raise OutputError("exists", where=str(folder), hint="give --out a new folder")
    for folder, made in zip(folders, texts, strict=True):
        output_folder(folder)
        for name, text in made.items():
            write_atomically(folder / name, text)
    return folders
