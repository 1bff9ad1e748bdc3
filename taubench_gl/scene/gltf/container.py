"""From a path to a Document: .gltf and .glb containers, JSON, and the bytes of every buffer."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any

import msgspec

from taubench_gl.errors import SceneError
from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.document import Document, explain
from taubench_gl.scene.gltf.uri import read_uri

GLB_MAGIC = b"glTF"
JSON_CHUNK, BIN_CHUNK = 0x4E4F534A, 0x004E4942
BUFFER_MEDIA_TYPES = ("application/octet-stream", "application/gltf-buffer")
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")

_decoder = msgspec.json.Decoder(schema.Root)


def open_document(path: Path) -> Document:
    """Read the file and all its buffers.  Raises SceneError."""
    data = _read(path)
    binary = data[:4] == GLB_MAGIC or path.suffix.lower() == ".glb"
    json_bytes, chunk, extra = _split_glb(data, path) if binary else (data, None, 0)
    document = Document(path, _decode(json_bytes, path), binary, chunk)
    if extra:
        document.note(f"{extra} bytes after the end of the binary container are ignored")
    _check_version(document)
    document.identity.add(data)
    for index, buffer in enumerate(document.root.buffers or []):
        document.buffers.append(_buffer_bytes(document, buffer, index))
    for external in document.external.values():
        document.identity.add(external)
    return document


def _read(path: Path) -> bytes:
    try:
        if path.is_dir():
            raise SceneError("is a folder, not a scene file", where=str(path), hint="name the .gltf or .glb inside it")
        if path.exists() and not path.is_file():
            raise SceneError("is not a regular file", where=str(path))
        data = path.read_bytes()
    except FileNotFoundError:
        raise SceneError("no such file", where=str(path), hint="check the path") from None
    except (OSError, ValueError) as e:
        raise SceneError(f"cannot be read: {getattr(e, 'strerror', None) or e}", where=str(path)) from None
    if not data:
        raise SceneError("is empty", where=path.name, hint="export the scene again")
    return data


def _split_glb(data: bytes, path: Path) -> tuple[memoryview, memoryview | None, int]:
    """JSON chunk, BIN chunk and the number of bytes after the container, with every length checked."""

    def bad(what: str, hint: str = "the file is damaged or cut off: export or download it again") -> SceneError:
        return SceneError(what, where=path.name, hint=hint)

    if data[:4] != GLB_MAGIC:
        raise bad(f"not a binary glTF file: begins with {data[:4]!r} instead of {GLB_MAGIC!r}", "is it really a .glb?")
    if len(data) < 12:
        raise bad(f"binary glTF header cut off after {len(data)} bytes")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise bad(f"binary glTF version {version}, only 2 is supported", "convert the file to glTF 2.0")
    if length < 12 or length > len(data):
        raise bad(f"header says {length} bytes, the file has {len(data)}")
    view, offset, chunks, seen = memoryview(data), 12, {}, 0
    while offset < length:
        if offset + 8 > length:
            raise bad(f"chunk header at byte {offset} is cut off")
        size, kind = struct.unpack_from("<II", data, offset)
        offset += 8
        if offset + size > length:
            raise bad(f"chunk at byte {offset - 8} says {size} bytes, {length - offset} are left")
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
        raise bad("has no JSON chunk, or an empty one")
    return chunks[JSON_CHUNK], chunks.get(BIN_CHUNK), len(data) - length


def _decode(data: bytes | memoryview, path: Path) -> schema.Root:
    if bytes(data[:3]) == b"\xef\xbb\xbf":
        raise SceneError(
            "begins with a byte order mark, which glTF forbids", where=path.name, hint="save as UTF-8 without BOM"
        )
    try:
        try:
            return _decoder.decode(data)
        except msgspec.ValidationError as e:
            if "Expected `int`, got `float`" not in str(e):
                raise
            # JSON does not tell 1 from 1.0, and glTF allows both for integers: read again with integral floats as ints.
            return msgspec.convert(_integral(msgspec.json.decode(data)), schema.Root)
    except msgspec.ValidationError as e:
        what, pointer = explain(e)
        hint = "glTF forbids empty arrays: leave the property out" if "length >= 1" in what else None
        raise SceneError(what, where=f"{path.name}#{pointer}", hint=hint) from None
    except RecursionError:
        raise SceneError("JSON is nested too deeply", where=path.name) from None
    except (ValueError, UnicodeError) as e:
        raise SceneError(f"is not valid JSON{_line_column(str(e), data)}: {e}", where=path.name) from None


def _integral(value: Any) -> Any:
    if isinstance(value, float) and value.is_integer() and abs(value) < 2**53:
        return int(value)
    if isinstance(value, list):
        return [_integral(v) for v in value]
    if isinstance(value, dict):
        return {k: _integral(v) for k, v in value.items()}
    return value


def _line_column(message: str, data: bytes | memoryview) -> str:
    match = re.search(r"\(byte (\d+)\)", message)
    if match is None:
        return ""
    before = bytes(data[: int(match[1])])
    return f" at line {before.count(10) + 1} column {len(before) - before.rfind(10)}"


def _check_version(document: Document) -> None:
    asset = document.root.asset
    for name, text in (("version", asset.version), ("minVersion", asset.min_version)):
        if text is None:
            continue
        match = re.fullmatch(r"(\d{1,9})\.(\d{1,9})", text)
        if match is None:
            raise document.error(f"{text!r} is not a version number like 2.0", f"/asset/{name}")
        if int(match[1]) != 2 or (name == "minVersion" and int(match[2]) > 0):
            raise document.error(
                f"glTF {text} is not supported, only 2.0 is", f"/asset/{name}", "convert the file to glTF 2.0"
            )


def _buffer_bytes(document: Document, buffer: schema.Buffer, index: int) -> memoryview | None:
    pointer = f"/buffers/{index}"
    if buffer.uri is not None:
        data = read_uri(document, buffer.uri, f"{pointer}/uri", BUFFER_MEDIA_TYPES)
    elif index == 0 and document.chunk is not None:
        data = document.chunk
    elif index == 0 and document.binary and not any(name in buffer.extensions for name in MESHOPT):
        raise document.error("buffer has neither a uri nor a BIN chunk", pointer, "the file lacks its data")
    else:
        return None  # legal as long as nothing reads it: fallbacks of meshopt, placeholders
    if len(data) < buffer.byte_length:
        raise document.error(
            f"byteLength is {buffer.byte_length}, the data has {len(data)} bytes",
            f"{pointer}/byteLength",
            "the data is cut off: export or download the file again",
        )
    return memoryview(data)[: buffer.byte_length]
