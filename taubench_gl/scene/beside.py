"""Files of the text formats: reading them, and finding what lies beside them.  Nothing outside the folder is opened."""

from __future__ import annotations

import re
import threading
import warnings
from functools import partial
from pathlib import Path

import numpy as np
import PIL.Image

from taubench_gl.errors import SceneError
from taubench_gl.scene.model import Image

Array = np.ndarray

MAX_BYTES = 2**30
"""Largest text file that is read."""
MAX_SIDE = 16384
"""Largest width or height of a texture, as for glTF."""
FORMATS = ("PNG", "JPEG", "WEBP", "PPM", "BMP", "TGA", "TIFF")

_ABSOLUTE = re.compile(r"[A-Za-z][A-Za-z0-9+.\-]*:|[/\\]")
_warnings_lock = threading.Lock()  # warnings.catch_warnings is not thread-safe


def read_bytes(path: Path, where: str | None = None) -> bytes:
    """The whole of a regular file.  Raises SceneError; ``where`` is who asked for it, by default the file itself."""
    where = where or str(path)
    try:
        if path.is_dir():
            raise SceneError("is a folder, not a scene file", where=where)
        if path.exists() and not path.is_file():
            raise SceneError("is not a regular file", where=where)
        if path.exists() and path.stat().st_size > MAX_BYTES:
            raise SceneError(f"{path.name} is larger than {MAX_BYTES >> 20} MiB", where=where)
        data = path.read_bytes()
    except FileNotFoundError:
        raise SceneError("no such file", where=where, hint="check the path") from None
    except (OSError, ValueError) as e:
        raise SceneError(f"cannot be read: {getattr(e, 'strerror', None) or e}", where=where) from None
    if not data:
        raise SceneError("is empty", where=where, hint="export the scene again")
    if b"\0" in data[:4096]:
        raise SceneError("is not a text file", where=where, hint="is it really this format?")
    return data


def find_beside(folder: Path, name: str) -> Path | str:
    """The regular file ``name`` inside ``folder`` after following links, or in words why there is none."""
    shown = repr(name if len(name) <= 80 else name[:77] + "...")
    if not name or "\0" in name:
        return f"{shown} is not a file name"
    if _ABSOLUTE.match(name):
        return f"{shown} is absolute or has a scheme; only files beside the scene are read"
    try:
        target = (folder / name.replace("\\", "/")).resolve()
        if not target.is_relative_to(folder.resolve()):
            return f"{shown} leads out of the scene's folder"
        if target.is_file():
            return target
        return f"{shown} is not a regular file" if target.exists() else f"{shown} does not exist"
    except (OSError, RuntimeError, ValueError):  # name too long, link loop
        return f"{shown} is not a usable file name"


def read_image(path: Path) -> Image:
    """A texture with its size from the header; pixels are decoded when asked for.  Raises SceneError."""
    with _open(path) as opened:
        size = opened.size
    return Image(path.stem, size, partial(_decode, path))


def _open(path: Path) -> PIL.Image.Image:
    try:
        with _warnings_lock, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            opened = PIL.Image.open(path, formats=FORMATS)
    except PIL.UnidentifiedImageError:
        raise SceneError(f"is none of {', '.join(FORMATS)}", where=path.name) from None
    except (OSError, ValueError, SyntaxError, PIL.Image.DecompressionBombError) as e:
        raise SceneError(f"image cannot be read: {e}", where=path.name) from None
    if max(opened.size) > MAX_SIDE:
        opened.close()
        raise SceneError(f"image is {opened.size[0]} x {opened.size[1]}, more than {MAX_SIDE} a side", where=path.name)
    return opened


def _decode(path: Path) -> Array:
    """(h, w, 4) uint8, row 0 = top."""
    try:
        with _open(path) as opened:
            return np.array(opened.convert("RGBA"))
    except (OSError, ValueError, SyntaxError, EOFError) as e:
        raise SceneError(f"image cannot be decoded: {e}", where=path.name) from None
