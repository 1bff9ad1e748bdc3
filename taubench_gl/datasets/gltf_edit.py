"""Adds nodes and animations to a glTF file; everything else stays unchanged, unknown extensions and extras included.

The JSON is edited untyped, because a typed document would drop unknown properties.  The result is a single file:
external buffers and images are embedded.
"""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.data_files import parse_json
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.memory_budget import limit
from taubench_gl.outputs import text_bytes, write_atomically
from taubench_gl.scene.files import read_file
from taubench_gl.scene.gltf.container import GLB_MAGIC, Json, add_channels, add_facts, container_bytes, read_container
from taubench_gl.scene.gltf.document import MESHOPT, open_document, read_uri
from taubench_gl.scene.gltf.materials import IMAGE_MEDIA_TYPES

_MAGIC = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg", b"RIFF": "image/webp",
          b"\xabKTX 20\xbb": "image/ktx2"}  # fmt: skip


class GltfEditor:
    """A glTF file to which nodes and animations are added.  Raises SceneError for a file that cannot be read."""

    def __init__(self, path: str | Path):
        self.path = Path(path)
        document = open_document(self.path)
        try:
            self.root: Json = parse_json(document.repaired or _json_text(self.path))
        except (ValueError, RecursionError) as error:  # in parts that the scene reader skips
            raise SceneError(f"is not valid JSON: {error}", where=str(self.path)) from None
        self._blob = bytearray()
        self._embed_images(document)
        self._merge_buffers(document.buffers)

    def node(self, parent: int | None, scene: int, **properties: Any) -> int:
        """Add a node below ``parent``; None: a root of ``scenes[scene]``.  Returns its index."""
        index = self._append("nodes", properties)
        owner = self.root["scenes"][scene] if parent is None else self.root["nodes"][parent]
        owner.setdefault("nodes" if parent is None else "children", []).append(index)
        return index

    def insert_above(self, node: int, name: str) -> int:
        """Add a node between ``node`` and its parents, in all scenes.  Returns its index."""
        index = len(self.root["nodes"])
        for owner, key in (*((s, "nodes") for s in self.root.get("scenes", ())),
                           *((n, "children") for n in self.root["nodes"])):  # fmt: skip
            if node in owner.get(key, ()):
                owner[key] = [index if child == node else child for child in owner[key]]
        return self._append("nodes", {"name": name, "children": [node]})

    def camera(self, name: str, yfov: float, znear: float, zfar: float | None) -> int:
        lens = {"yfov": yfov, "znear": znear, "aspectRatio": 16 / 9} | ({} if zfar is None else {"zfar": zfar})
        return self._append("cameras", {"name": name, "type": "perspective", "perspective": lens})

    def animation(self, name: str, tracks: list[tuple]) -> None:
        """Add an animation of ``tracks`` (node, path, times, values, interpolation); without tracks nothing is
        added."""
        if not tracks:
            return
        new: Json = {"name": name}
        add_channels(self.root, self._blob, new, (
            ({"node": node, "path": path}, times, np.asarray(values, dtype=np.float32), interpolation)
            for node, path, times, values, interpolation in tracks))  # fmt: skip
        self._append("animations", new)

    def note(self, **facts: str) -> None:
        """Add entries to ``asset.extras.taubench_gl``, which this package reads; other entries are kept."""
        add_facts(self.root, facts)

    def save(self, path: str | Path) -> None:
        """Write a .glb, or a .gltf with embedded data.  Raises OutputError, SettingsError."""
        path = Path(path)
        if path.suffix.lower() not in (".glb", ".gltf"):
            raise SettingsError(f"{path.name} does not end in .glb or .gltf")
        blob = bytes(self._blob) + bytes(-len(self._blob) % 4)
        buffer: Json = self.root["buffers"][0]
        buffer["byteLength"] = len(blob)
        if path.suffix.lower() == ".gltf":
            buffer["uri"] = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
        text = text_bytes(json.dumps(self.root, separators=(",", ":"), ensure_ascii=False, allow_nan=False))
        if path.suffix.lower() == ".glb":
            text = container_bytes(text, blob)
        write_atomically(path, text, parents=True)

    def _append(self, collection: str, item: Json) -> int:
        items = self.root.setdefault(collection, [])
        items.append(item)
        return len(items) - 1

    def _embed_images(self, document: Any) -> None:
        """External images become data URIs; a missing one keeps its URI."""
        for i, image in enumerate(self.root.get("images", ())):
            uri = image.get("uri")
            if uri is None or uri[:5].lower() == "data:":
                continue
            try:
                data = read_uri(document, uri, f"/images/{i}/uri", IMAGE_MEDIA_TYPES)
            except SceneError:
                continue
            kind = next((kind for magic, kind in _MAGIC.items() if data.startswith(magic)), None)
            if kind is not None:
                image["uri"] = f"data:{kind};base64," + base64.b64encode(data).decode()

    def _merge_buffers(self, buffers: list[memoryview | None]) -> None:
        """Merge all data into buffer 0; buffers without data (fallbacks of meshopt) stay separate."""
        old = self.root.get("buffers", [])
        moved_to: list[tuple[int, int]] = []  # index of the new buffer, byte offset in it
        new_buffers: list[Json] = [{"byteLength": 0}]
        for description, data in zip(old, buffers, strict=True):
            if data is None:
                moved_to.append((len(new_buffers), 0))
                new_buffers.append(description)
            else:
                self._blob += bytes(-len(self._blob) % 8)
                moved_to.append((0, len(self._blob)))
                self._blob += data
        for view in self.root.get("bufferViews", ()):
            compressed = [view["extensions"][name] for name in MESHOPT if name in view.get("extensions", ())]
            for reference in (view, *compressed):
                index, base = moved_to[reference["buffer"]]
                reference["buffer"] = index
                if base:
                    reference["byteOffset"] = reference.get("byteOffset", 0) + base
        self.root["buffers"] = new_buffers


def _json_text(path: Path) -> bytes:
    """The JSON text of a file that ``open_document`` accepts."""
    data = read_file(path, max_bytes=limit())
    return bytes(read_container(data, path.name)[0]) if data[:4] == GLB_MAGIC else data
