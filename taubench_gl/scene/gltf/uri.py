"""Data URIs and files beside the scene.  Nothing outside the scene's folder is ever opened, nothing is fetched."""

from __future__ import annotations

import base64
import binascii
import re
from pathlib import Path
from urllib.parse import unquote

from taubench_gl.scene.gltf.document import Document

_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.\-]*:")


def read_uri(document: Document, uri: str, pointer: str, media_types: tuple[str, ...]) -> bytes:
    """Bytes behind ``uri``; a file is read once however often it is named.  Raises SceneError."""
    if uri[:5].lower() == "data:":
        return _data_uri(document, uri, pointer, media_types)
    path = resolve(document, uri, pointer)
    if path not in document.external:
        try:
            document.external[path] = path.read_bytes()
        except OSError as e:
            raise document.error(f"{_short(uri)} cannot be read: {e.strerror}", pointer) from None
    return document.external[path]


def resolve(document: Document, uri: str, pointer: str) -> Path:
    """The regular file that a relative URI names, inside the scene's folder after following links."""
    name = _decode(document, uri, pointer)
    inside = "keep the file in the scene's folder and refer to it by a relative path"
    for text in (uri, name):
        if _SCHEME.match(text) or text.startswith(("/", "\\")):
            raise document.error(f"{_short(uri)} is absolute or has a scheme; only files beside the scene are read",
                                 pointer, inside)  # fmt: skip
    folder = document.path.parent
    try:
        target = (folder / name).resolve()
        if not target.is_relative_to(folder.resolve()):
            raise document.error(f"{_short(uri)} leads out of the scene's folder", pointer, inside)
        if target.is_file():
            return target
        what = "is not a regular file" if target.exists() else "does not exist"
    except (OSError, RuntimeError, ValueError):  # name too long, link loop, NUL
        what = "is not a usable file name"
    raise document.error(f"{_short(uri)} {what}", pointer, f"put it beside {document.path.name}")


def _decode(document: Document, uri: str, pointer: str) -> str:
    try:
        name = unquote(uri, errors="strict")
    except UnicodeDecodeError:
        raise document.error(f"{_short(uri)} is not percent-encoded UTF-8", pointer) from None
    if not name or "\0" in name:
        raise document.error("is not a file name", pointer)
    return name


def _data_uri(document: Document, uri: str, pointer: str, media_types: tuple[str, ...]) -> bytes:
    header, comma, payload = uri[5:].partition(",")
    media_type, *parameters = header.split(";")
    if not comma or parameters[-1:] != ["base64"] or not all("=" in p for p in parameters[:-1]):
        raise document.error("is not a base64 data URI", pointer)
    if media_type.lower() not in media_types:
        raise document.error(f"data URI of type {_short(media_type)!r}, expected {' or '.join(media_types)}", pointer)
    try:
        return base64.b64decode(payload if "%" not in payload else unquote(payload), validate=True)
    except (binascii.Error, ValueError) as e:
        raise document.error(f"data URI is not valid base64: {e}", pointer) from None


def _short(text: str) -> str:
    return text if len(text) <= 80 else text[:77] + "..."
