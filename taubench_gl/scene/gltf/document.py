"""One glTF file while it is read: container, JSON, buffers, URIs, extensions, and errors that carry a JSON pointer."""

from __future__ import annotations

import base64
import binascii
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import unquote, unquote_to_bytes

import msgspec

from taubench_gl.data_files import opened, read_bytes
from taubench_gl.errors import SceneError
from taubench_gl.memory_budget import Budget, limit, over, require
from taubench_gl.scene.files import MAX_TEXT_BYTES, Identity, find_referenced, read_file, shortened
from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.container import GLB_MAGIC, read_container
from taubench_gl.scene.gltf.lenient import Lenient
from taubench_gl.scene.notes import Notes

T = TypeVar("T")


class OverMemory(SceneError):
    """The file takes more memory than the limit; never repaired."""


@dataclass
class Document:
    """Decoded JSON, buffers and notes of one file.

    ``buffers`` holds the bytes of each buffer; None where the file has none (meshopt fallback, placeholder).
    """

    path: Path
    root: schema.Root
    binary: bool = False  # GLB
    chunk: memoryview | None = None  # its BIN chunk
    buffers: list[memoryview | None] = field(default_factory=list)
    external: dict[Path, bytes] = field(default_factory=dict)  # contents of buffer files, in order of first use
    notes: Notes = field(default_factory=Notes)
    repaired: bytes | None = None  # its JSON after repairs; None: as in the file
    identity: Identity = field(default_factory=Identity)
    budget: Budget = field(default_factory=Budget)  # of what is allocated while it is read

    def error(self, message: str, pointer: str = "", hint: str | None = None) -> SceneError:
        """A SceneError at a JSON pointer of this file, for the caller to raise."""
        return SceneError(message, where=f"{self.path.name}#{pointer}" if pointer else self.path.name, hint=hint)

    def reserve(self, kind: str, count: int, pointer: str) -> None:
        """Count bytes that are about to be allocated for the object at ``pointer``.  Raises SceneError."""
        if (message := self.budget.add(kind, count)) is not None:
            place = f"{self.path.name}#{pointer}" if pointer else self.path.name
            raise OverMemory(message, where=place, hint=over(self.budget.limit))

    @property
    def strict(self) -> bool:
        return self.notes.strict

    def note(self, message: str, pointer: str = "") -> None:
        """Record a decision that concerns the whole file; equal notes are recorded once."""
        self.notes.add(message, pointer)

    def remark(self, kind: str, pointer: str = "", count: int = 1, detail: str = "") -> None:
        """Count findings that are noted in every mode (``scene.notes.REMARKS``)."""
        self.notes.remark(kind, pointer, count, detail)

    def repair(
        self, kind: str, message: str, pointer: str = "", hint: str | None = None, *, count: int = 1, detail: str = ""
    ) -> None:
        """Count departures from glTF that the caller repairs (``scene.notes.REPAIRS``).

        Raises SceneError where the document is read strictly.
        """
        error = self.error(message, pointer, hint)
        self.notes.repair(kind, error, count=count, detail=detail, where=pointer or self.path.name)

    def item(self, collection: str, index: int, pointer: str) -> Any:
        """The object ``root.<collection>[index]``.  Raises SceneError at ``pointer``, where the reference is."""
        items = getattr(self.root, collection) or []
        if index >= len(items):
            raise self.error(self._missing(collection, index), pointer)
        return items[index]

    def has(self, collection: str, index: int, pointer: str, repair: str) -> bool:
        """Whether there is an object ``root.<collection>[index]``; without it, the reference is a ``repair``."""
        there = index < len(getattr(self.root, collection) or [])
        if not there:
            self.repair(repair, self._missing(collection, index), pointer)
        return there

    def _missing(self, collection: str, index: int) -> str:
        name = re.sub(r"_(.)", lambda m: m[1].upper(), collection)
        return f"refers to {name}[{index}]; the file has {len(getattr(self.root, collection) or [])}"

    def extension(self, owner: schema.Property, name: str, kind: type[T], pointer: str) -> T | None:
        """One extension object of ``owner``, which is at ``pointer``, decoded as ``kind``; None where it is absent."""
        value = owner.extensions.get(name)
        if value is None:
            return None
        try:
            return msgspec.convert(value, kind)
        except msgspec.ValidationError as e:
            message, inner = explain(e)
            fault = self.error(message, where := f"{pointer}/extensions/{name}{inner}")
        if self.strict or name in COMPRESSION:
            raise fault
        value = Lenient(self.notes, f"{pointer}/extensions/{name}").conform(value, kind)
        try:
            return msgspec.convert(value, kind)
        except msgspec.ValidationError:
            self.repair("extension-invalid", message, where, detail=name)
            return None


def explain(error: msgspec.ValidationError) -> tuple[str, str]:
    """msgspec's message, split into (what is wrong, JSON pointer)."""
    message, _, path = str(error).partition(" - at `$")
    pointer = re.sub(r"\[(\d+|\.\.\.)\]", lambda m: "/*" if m[1] == "..." else f"/{m[1]}", path.rstrip("`"))
    return message.replace("`", ""), pointer.replace(".", "/")


def read_uri(document: Document, uri: str, pointer: str, media_types: tuple[str, ...]) -> bytes:
    """The bytes of a data URI of one of ``media_types``, or of a file.  A file is read once.  Raises SceneError."""
    if is_data_uri(uri):
        return _data_uri(document, uri, pointer, media_types)
    path = resolve_uri(document, uri, pointer)
    if path not in document.external:
        try:
            data = read_bytes(path, SceneError, max_bytes=limit())
            document.reserve("files", len(data), pointer)
            document.external[path] = data
        except SceneError as e:
            raise document.error(f"{shortened(uri)} {e.what}", pointer) from None
    return document.external[path]


def is_data_uri(uri: str) -> bool:
    return uri[:5].lower() == "data:"


def resolve_uri(document: Document, uri: str, pointer: str) -> Path:
    """The regular file inside the scene's folder that a relative URI refers to.  Raises SceneError."""
    try:
        name = unquote(uri, errors="strict")
    except UnicodeDecodeError:
        raise document.error(f"{shortened(uri)} is not percent-encoded UTF-8", pointer) from None
    target = find_referenced(document.path.parent, name, backslashes=False)
    if isinstance(target, str) and not document.strict:
        file_name = target  # as the file has it: a percent sign that encodes nothing, backslashes
        for other in dict.fromkeys((uri, name, uri.replace("\\", "/"), name.replace("\\", "/"))):
            target = find_referenced(document.path.parent, other, backslashes=False)
            if not isinstance(target, str):
                document.repair("uri-spelling", file_name, pointer)
                break
        else:
            target = file_name
    if isinstance(target, str):
        raise document.error(target, pointer, f"put the file into the folder of {document.path.name}")
    return target


def _data_uri(document: Document, uri: str, pointer: str, media_types: tuple[str, ...]) -> bytes:
    header, comma, payload = uri[5:].partition(",")
    media_type, *parameters = header.split(";")
    if not comma:
        raise document.error("is not a base64 data URI", pointer)
    if parameters[-1:] != ["base64"] or not all("=" in p for p in parameters[:-1]):
        document.repair("data-uri", "is not a base64 data URI", pointer)
    elif media_type.lower() not in media_types:
        expected = " or ".join(media_types)
        document.repair("data-uri", f"data URI of type {shortened(media_type)}, expected {expected}", pointer)
    if "base64" not in parameters:
        return unquote_to_bytes(payload)
    payload = payload if "%" not in payload else unquote(payload)
    try:
        return base64.b64decode(payload, validate=True)
    except (binascii.Error, ValueError) as e:
        fault = f"data URI is not valid base64: {e}"
    # Line breaks, the alphabet of URLs and missing padding.
    plain = "".join(payload.split()).translate(str.maketrans("-_", "+/")).rstrip("=")
    try:
        data = base64.b64decode(plain + "=" * (-len(plain) % 4), validate=True)
    except (binascii.Error, ValueError):
        raise document.error(fault, pointer) from None
    document.repair("data-uri", fault, pointer)
    return data


BUFFER_MEDIA_TYPES = ("application/octet-stream", "application/gltf-buffer")
MESHOPT = frozenset({"EXT_meshopt_compression", "KHR_meshopt_compression"})
COMPRESSION = MESHOPT | {"KHR_draco_mesh_compression"}
"""Extensions without which there is no geometry: an invalid one is an error in every mode."""

OBJECT_BYTES = 400
"""Memory of one object of the JSON, about."""

_decoder = msgspec.json.Decoder(schema.Root)
_VERSION_1 = re.compile(rb'"asset"\s*:\s*\{[^{}]*"version"\s*:\s*"(1(?:\.\d+)?)"')


def open_document(path: Path, strict: bool = False) -> Document:
    """Read a .gltf or .glb file and all its buffers.  Raises SceneError."""
    with opened(path, SceneError) as file:
        most = limit() if file.read(4) == GLB_MAGIC else MAX_TEXT_BYTES
    data = read_file(path, max_bytes=most)
    notes = Notes(strict)
    binary = data[:4] == GLB_MAGIC or path.suffix.lower() == ".glb"
    json_bytes, chunk, extra = read_container(data, path.name) if binary else (data, None, 0)
    require(OBJECT_BYTES * bytes(json_bytes).count(b"{"), "its JSON", SceneError, path.name)
    root, repaired = _decode(json_bytes, path, notes)
    document = Document(path, root, binary, chunk, notes=notes, repaired=repaired)
    if extra:
        document.note(f"{extra} bytes after the end of the binary container are ignored")
    document.reserve("files", len(data), "")
    _check_version(document)
    document.identity.add(data)
    for index, buffer in enumerate(document.root.buffers or []):
        document.buffers.append(_buffer_bytes(document, buffer, index))
    for external in document.external.values():
        document.identity.add(external)
    return document


def _decode(data: bytes | memoryview, path: Path, notes: Notes) -> tuple[schema.Root, bytes | None]:
    """The document, and its JSON where that had to be repaired."""
    original = data
    if bytes(data[:3]) == b"\xef\xbb\xbf":
        fault = "begins with a byte order mark, which glTF forbids"
        notes.repair("byte-order-mark", SceneError(fault, where=path.name, hint="save as UTF-8 without BOM"))
        data = data[3:]
    data = _utf8(data, path, notes)
    try:
        try:
            return _decode_strictly(data), None if data is original else bytes(data)
        except msgspec.ValidationError:
            if notes.strict:
                raise
            raw = Lenient(notes, "").conform(_integral(msgspec.json.decode(data)), schema.Root)
            return msgspec.convert(raw, schema.Root), msgspec.json.encode(raw)
    except msgspec.ValidationError as e:
        _refuse_version_1(data, path)
        message, pointer = explain(e)
        hint = "glTF forbids empty arrays: omit the property" if "length >= 1" in message else None
        raise SceneError(message, where=f"{path.name}#{pointer}", hint=hint) from None
    except RecursionError:
        raise SceneError("JSON is nested too deeply", where=path.name) from None
    except (ValueError, UnicodeError) as e:
        raise SceneError(f"is not valid JSON{_line_column(str(e), data)}: {e}", where=path.name) from None


def _refuse_version_1(data: bytes | memoryview, path: Path) -> None:
    """Raise SceneError for a file of glTF 1.0, whose collections are objects."""
    match = _VERSION_1.search(bytes(data))
    if match is not None:
        message = f"is glTF {match[1].decode()}, only 2.0 is supported"
        raise SceneError(message, where=path.name, hint="convert it to glTF 2.0")


def _utf8(data: bytes | memoryview, path: Path, notes: Notes) -> bytes | memoryview:
    """``data`` with bytes that are not UTF-8 replaced; strict: unchanged, the decoder refuses them."""
    if notes.strict:
        return data
    try:
        str(data, "utf-8")
    except UnicodeDecodeError:
        text = str(data, "utf-8", "replace")
        notes.repair("text-encoding", SceneError("is not UTF-8", where=path.name))
        return text.encode("utf-8")
    return data


def _decode_strictly(data: bytes | memoryview) -> schema.Root:
    """The document by the strict schema.  Raises msgspec.ValidationError or DecodeError."""
    try:
        return _decoder.decode(data)
    except msgspec.ValidationError as e:
        if "Expected `int`, got `float`" not in str(e):
            raise
        # JSON does not distinguish 1 from 1.0, and glTF allows both for integers: convert integral floats to int.
        return msgspec.convert(_integral(msgspec.json.decode(data)), schema.Root)


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
    if buffer.byte_length == 0:
        document.repair("empty-object", "byteLength is 0", f"{pointer}/byteLength", detail="buffers")
        return memoryview(b"")
    if buffer.uri is not None:
        data = read_uri(document, buffer.uri, f"{pointer}/uri", BUFFER_MEDIA_TYPES)
    elif index == 0 and document.chunk is not None:
        data = document.chunk
    elif index == 0 and document.binary and not MESHOPT & buffer.extensions.keys():
        raise document.error("buffer has neither a uri nor a BIN chunk", pointer, "the file has no data")
    else:
        return None  # legal while nothing reads it: meshopt fallbacks, placeholders
    if len(data) < buffer.byte_length:
        document.repair(
            "short-buffer",
            f"byteLength is {buffer.byte_length}; the data has {len(data)} bytes",
            f"{pointer}/byteLength",
            "the data is truncated: export or download the file again",
        )
    return memoryview(data)[: buffer.byte_length]
