"""glTF files as JSON and bytes: the binary container (.glb; glTF 2.0, section 4) and additions to a document."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import Any

import numpy as np

from taubench_gl.errors import SceneError

Array = np.ndarray
Json = dict[str, Any]

GLB_MAGIC = b"glTF"
JSON_CHUNK, BIN_CHUNK = 0x4E4F534A, 0x004E4942

_COMPONENT = {"float32": 5126, "uint8": 5121}
_TYPE = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_DAMAGED = "the file is damaged or truncated: export or download it again"


def read_container(data: bytes, name: str) -> tuple[memoryview, memoryview | None, int]:
    """JSON chunk, BIN chunk (None: there is none) and the number of bytes after the container.

    ``name``: of the file, for errors.  Checks every length.  Raises SceneError.
    """

    def bad(message: str, hint: str = _DAMAGED) -> SceneError:
        return SceneError(message, where=name, hint=hint)

    if data[:4] != GLB_MAGIC:
        raise bad(f"not a binary glTF file: begins with {data[:4]!r} instead of {GLB_MAGIC!r}", "check the file format")
    if len(data) < 12:
        raise bad(f"binary glTF header truncated after {len(data)} bytes")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise bad(f"binary glTF version {version}, only 2 is supported", "convert the file to glTF 2.0")
    if length < 12 or length > len(data):
        raise bad(f"header declares {length} bytes, the file has {len(data)}")
    view, offset, chunks, seen = memoryview(data), 12, {}, 0
    while offset < length:
        if offset + 8 > length:
            raise bad(f"chunk header at byte {offset} is truncated")
        size, kind = struct.unpack_from("<II", data, offset)
        offset += 8
        if offset + size > length:
            raise bad(f"chunk at byte {offset - 8} declares {size} bytes, {length - offset} remain")
        if seen == 0 and kind != JSON_CHUNK:
            raise bad(f"first chunk is {kind:#010x}, must be JSON")
        if kind in chunks:
            raise bad(f"two chunks of type {kind:#010x}")
        if kind == BIN_CHUNK and seen != 1:
            raise bad("BIN chunk is not the second chunk")
        if kind in (JSON_CHUNK, BIN_CHUNK):
            chunks[kind] = view[offset : offset + size]
        offset, seen = offset + size, seen + 1
    if not chunks.get(JSON_CHUNK):
        raise bad("has no JSON chunk, or an empty JSON chunk")
    return chunks[JSON_CHUNK], chunks.get(BIN_CHUNK), len(data) - length


def container_bytes(json_text: bytes, binary: bytes | None) -> bytes:
    """The .glb file with these chunks, padded to 4 bytes; ``binary`` None: no BIN chunk."""
    json_text += b" " * (-len(json_text) % 4)
    chunks = struct.pack("<II", len(json_text), JSON_CHUNK) + json_text
    if binary is not None:
        binary += bytes(-len(binary) % 4)
        chunks += struct.pack("<II", len(binary), BIN_CHUNK) + binary
    return GLB_MAGIC + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def add_accessor(root: Json, data: bytearray, values: Array, *, buffer: int = 0, bounds: bool = False) -> int:
    """Append ``values`` to ``data``, the bytes of a buffer, with their view and accessor.  Returns its index.

    ``values``: float32 or uint8, (n,), or (n, k) of vectors of k numbers; ``bounds``: with minimum and maximum.
    """
    columns = values.reshape(len(values), -1)
    data += bytes(-len(data) % 4)
    views, accessors = root.setdefault("bufferViews", []), root.setdefault("accessors", [])
    views.append({"buffer": buffer, "byteOffset": len(data), "byteLength": values.nbytes})
    data += np.ascontiguousarray(values).tobytes()
    accessor: Json = {"bufferView": len(views) - 1, "componentType": _COMPONENT[values.dtype.name],
                      "count": len(values), "type": _TYPE[columns.shape[1]]}  # fmt: skip
    if bounds:
        accessor |= {"min": columns.min(axis=0).tolist(), "max": columns.max(axis=0).tolist()}
    accessors.append(accessor)
    return len(accessors) - 1


def add_channels(root: Json, data: bytearray, animation: Json, tracks: Iterable[tuple], *, buffer: int = 0) -> None:
    """Add ``tracks`` (target, times, values, interpolation) to ``animation``; equal times are stored once.

    ``target``: of a channel, in JSON; ``times``: (K,) seconds; ``values``, ``data``: as in ``add_accessor``.
    """
    channels, samplers = animation.setdefault("channels", []), animation.setdefault("samplers", [])
    clocks: dict[bytes, int] = {}
    for target, times, values, interpolation in tracks:
        seconds = np.asarray(times, dtype=np.float32)
        clock = seconds.tobytes()
        if clock not in clocks:
            clocks[clock] = add_accessor(root, data, seconds, buffer=buffer, bounds=True)
        output = add_accessor(root, data, values, buffer=buffer)
        channels.append({"sampler": len(samplers), "target": target})
        samplers.append({"input": clocks[clock], "output": output, "interpolation": interpolation})


def add_facts(root: Json, facts: Json) -> None:
    """Add entries to ``asset.extras.taubench_gl``, which the scene reader reads; other entries are kept."""
    asset = root.setdefault("asset", {})
    extras = asset.get("extras")
    extras = extras if isinstance(extras, dict) else {}
    earlier = extras.get("taubench_gl")
    asset["extras"] = extras | {"taubench_gl": (earlier if isinstance(earlier, dict) else {}) | facts}
