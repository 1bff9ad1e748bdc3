"""One glTF file while it is being read: decoded JSON, bytes of its buffers, notes, and errors that say where."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from taubench_gl.errors import SceneError
from taubench_gl.scene.gltf import schema
from taubench_gl.scene.identity import Identity
from taubench_gl.scene.model import Note

T = TypeVar("T")


@dataclass
class Document:
    """``buffers`` holds each buffer's bytes; None where the file gives it none (meshopt fallback, placeholders)."""

    path: Path
    root: schema.Root
    binary: bool = False  # GLB
    chunk: memoryview | None = None  # its BIN chunk
    buffers: list[memoryview | None] = field(default_factory=list)
    external: dict[Path, bytes] = field(default_factory=dict)  # files the buffers lie in, in order of first use
    notes: dict[Note, None] = field(default_factory=dict)  # an ordered set
    identity: Identity = field(default_factory=Identity)

    def error(self, what: str, pointer: str = "", hint: str | None = None) -> SceneError:
        """A SceneError that names this file and a JSON pointer.  Returned, so that the caller raises it."""
        return SceneError(what, where=f"{self.path.name}#{pointer}" if pointer else self.path.name, hint=hint)

    def note(self, message: str, pointer: str = "") -> None:
        """Keep a decision for the user; the same one is kept once."""
        self.notes[Note(message, pointer)] = None

    def item(self, collection: str, index: int, pointer: str) -> Any:
        """The object ``root.<collection>[index]``, or an error at ``pointer`` where the reference is made."""
        items = getattr(self.root, collection) or []
        if index >= len(items):
            name = re.sub(r"_(.)", lambda m: m[1].upper(), collection)
            raise self.error(f"refers to {name}[{index}], the file has {len(items)}", pointer)
        return items[index]

    def extension(self, owner: schema.Property, name: str, kind: type[T], pointer: str) -> T | None:
        """One extension object of ``owner`` (itself at ``pointer``), decoded as ``kind``; None where it is absent."""
        value = owner.extensions.get(name)
        if value is None:
            return None
        try:
            return msgspec.convert(value, kind)
        except msgspec.ValidationError as e:
            what, inner = explain(e)
            raise self.error(what, f"{pointer}/extensions/{name}{inner}") from None


def explain(error: msgspec.ValidationError) -> tuple[str, str]:
    """msgspec's message as (what is wrong, JSON pointer)."""
    what, _, path = str(error).partition(" - at `$")
    pointer = re.sub(r"\[(\d+|\.\.\.)\]", lambda m: "/*" if m[1] == "..." else f"/{m[1]}", path.rstrip("`"))
    return what.replace("`", ""), pointer.replace(".", "/")
