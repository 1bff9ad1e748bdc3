"""The files of a scene: reading and decoding them, finding those it refers to, and one checksum over all of them.

A scene refers to other files by relative paths.  Nothing outside the scene's folder is opened.
"""

from __future__ import annotations

import io
import math
import re
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import BinaryIO

import numpy as np
import PIL.Image

from taubench_gl.data_files import hashed, opened, read_bytes
from taubench_gl.errors import SceneError
from taubench_gl.scene.model import Image, Texture
from taubench_gl.scene.notes import Notes
from taubench_gl.srgb import srgb_encode

Array = np.ndarray
ImageSource = Path | bytes | memoryview
MakeError = Callable[[str, str | None], SceneError]
"""(message, hint) -> the error, with its location."""

MAX_TEXT_BYTES = 2**30
"""Size limit of a text file."""
LARGEST = 1e30
"""Limit on the magnitude of numbers of OBJ, MTL and AFF: they fit a float32, their squares a float64."""
MAX_SIDE = 16384
"""Limit on the width and height of a texture."""
ROWS_AT_ONCE = 256
"""Rows of an image that are converted to RGBA at a time."""
TEXT_SCENE_IMAGES = ("PNG", "JPEG", "WEBP", "PPM", "BMP", "TGA", "TIFF")
"""Image formats read for OBJ and AFF scenes."""

_ABSOLUTE = re.compile(r"[A-Za-z][A-Za-z0-9+.\-]*:|[/\\]")
_pillow_lock = threading.Lock()  # the limit of Pillow and warnings.catch_warnings belong to the process


def read_file(path: Path, where: str | None = None, max_bytes: int = MAX_TEXT_BYTES) -> bytes:
    """The content of a regular file of at most ``max_bytes`` that is not empty.

    ``where``: what refers to the file, by default the file itself.  Raises SceneError for anything else.
    """
    data = read_bytes(path, SceneError, max_bytes=max_bytes, where=where)
    if not data:
        raise SceneError("is empty", where=where or str(path), hint="export the scene again")
    require_content(data, path, where)
    return data


def require_content(start: bytes, path: Path, where: str | None = None) -> None:
    """Raise SceneError for a file whose first bytes show that its content was never downloaded."""
    text = start[:512].lstrip().lower()
    if text.startswith(b"version https://git-lfs"):
        raise SceneError("is a Git LFS pointer, not the file", where=where or str(path), hint="run git lfs pull")
    if text.startswith((b"<!doctype html", b"<html")):
        kind = "glTF file" if path.suffix.lower() in (".glb", ".gltf", ".vrm") else f"{path.suffix} file"
        hint = "download the file itself, not the page about it"
        raise SceneError(f"is a web page (HTML), not a {kind}", where=where or str(path), hint=hint)


def read_text_file(path: Path, where: str | None = None) -> bytes:
    """``read_file`` for text of at most ``MAX_TEXT_BYTES``; raises SceneError for binary content."""
    data = read_file(path, where)
    if b"\0" in data[:4096]:
        raise _no_text(path, where)
    return data


def read_any_text(path: Path, notes: Notes, where: str | None = None) -> tuple[bytes, bytes]:
    """The bytes of a text file, and its text in UTF-8 without byte order mark.

    Strict ``notes``: the two are the same.  Raises SceneError for binary content.
    """
    data = read_file(path, where)
    text, place = data, where or path.name
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        notes.repair("text-encoding", _no_text(path, where), where=place)
        text = str(data, "utf-16", "replace").encode("utf-8")
    elif data.startswith(b"\xef\xbb\xbf"):
        fault = SceneError("begins with a byte order mark", where=place, hint="save as UTF-8 without BOM")
        notes.repair("byte-order-mark", fault, where=place)
        text = data[3:]
    if b"\0" in text[:4096]:
        raise _no_text(path, where)
    return data, text


def _no_text(path: Path, where: str | None) -> SceneError:
    return SceneError("is not a text file", where=where or str(path), hint="check the file format")


def find_referenced(folder: Path, name: str, backslashes: bool = True) -> Path | str:
    """The regular file ``name`` inside ``folder`` after following links, or the reason why there is none, in words.

    ``backslashes``: whether a backslash separates folders, as in files written on Windows.
    """
    shown = shortened(name)
    if not name or "\0" in name:
        return f"{shown} is not a file name"
    if _ABSOLUTE.match(name):
        return f"{shown} is absolute or has a scheme; only files in the scene's folder are read"
    try:
        target = (folder / (name.replace("\\", "/") if backslashes else name)).resolve()
        if not target.is_relative_to(folder.resolve()):
            return f"{shown} is outside the scene's folder"
        if target.is_file():
            return target
        return f"{shown} is not a regular file" if target.exists() else f"{shown} does not exist"
    except (OSError, RuntimeError, ValueError):  # name too long, link loop
        return f"{shown} is not a valid file name"


def number_of(word: str | bytes) -> float:
    """A number of a text file; NaN for a word that is none."""
    try:
        return float(word)
    except ValueError:
        return math.nan


def shortened(text: str, limit: int = 80) -> str:
    """``text`` in quotes, cut to ``limit`` characters, for messages."""
    return repr(text if len(text) <= limit else text[: limit - 3] + "...")


@contextmanager
def open_image(source: ImageSource, formats: tuple[str, ...], error: MakeError) -> Iterator[PIL.Image.Image]:
    """An opened image whose size is known and whose pixels are not decoded.  Raises ``error``."""
    with image_file(source, error) as file:
        try:
            with _pillow_lock, warnings.catch_warnings():
                warnings.simplefilter("ignore")
                PIL.Image.MAX_IMAGE_PIXELS, pixels = MAX_SIDE**2, PIL.Image.MAX_IMAGE_PIXELS
                try:
                    image = PIL.Image.open(file, formats=formats)
                finally:
                    PIL.Image.MAX_IMAGE_PIXELS = pixels
        except PIL.UnidentifiedImageError:
            raise error(f"is not an image of type {', '.join(formats)}", "export the texture again") from None
        except (OSError, ValueError, SyntaxError, PIL.Image.DecompressionBombError) as e:
            raise error(f"image cannot be read: {e}", None) from None
        with image:
            if max(image.size) > MAX_SIDE:
                raise error(f"image is {image.size[0]} x {image.size[1]} pixels; the limit is {MAX_SIDE} a side", None)
            yield image


def image_file(source: ImageSource, error: MakeError) -> BinaryIO:
    """The bytes of an image, open for reading.  Raises ``error``."""
    if not isinstance(source, Path):
        return io.BytesIO(source)
    try:
        return opened(source, SceneError)
    except SceneError as e:
        raise error(e.what, e.hint) from None


def check_image(source: ImageSource, formats: tuple[str, ...], error: MakeError) -> None:
    """Raise ``error`` for an image that is cut off or whose checksums are wrong, without decoding the others.

    Only an image without its format's end mark is decoded, since some programs write more after it.
    """
    with image_file(source, error) as file:
        start = file.read(8)
        length = file.seek(0, io.SEEK_END)
        file.seek(max(0, length - 12))
        end = file.read(12)
    whole = {
        b"\x89PNG": end[:-4].endswith(b"IEND"),
        b"\xff\xd8": end[-2:] == b"\xff\xd9",
        b"RIFF": length >= 8 + int.from_bytes(start[4:8], "little"),
    }
    if any(complete for mark, complete in whole.items() if start.startswith(mark)):
        return
    decode_image(source, formats, error)


def decode_image(source: ImageSource, formats: tuple[str, ...], error: MakeError, data: bool = False) -> Array:
    """RGBA pixels (h, w, 4) uint8, row 0 = top.  Raises ``error``.

    Floating-point gray, which is linear, is limited to 0..1, and encoded as sRGB unless it is ``data``.
    """
    with open_image(source, formats, error) as image:
        try:
            image.load()
            if image.mode.startswith(("I", "F")):  # Pillow's conversion clips instead of scaling
                if image.mode == "F":
                    linear = np.nan_to_num(np.asarray(image, np.float64)).clip(0.0, 1.0)
                    gray = np.round(255.0 * (linear if data else srgb_encode(linear))).astype(np.uint8)
                else:
                    gray = (np.asarray(image).astype(np.int64) >> 8).clip(0, 255).astype(np.uint8)
                return np.dstack([gray, gray, gray, np.full_like(gray, 255)])
            out = np.empty((image.height, image.width, 4), np.uint8)
            for top in range(0, image.height, ROWS_AT_ONCE):  # Pillow holds what it converts three times
                rows = image.crop((0, top, image.width, min(top + ROWS_AT_ONCE, image.height)))
                out[top : top + ROWS_AT_ONCE] = rows.convert("RGBA")
            return out
        except (OSError, ValueError, SyntaxError, EOFError, MemoryError) as e:
            raise error(f"image cannot be decoded: {e}", "export the texture again") from None


def read_image(path: Path, check: bool = False, data: bool = False) -> Image:
    """A texture of an OBJ or AFF scene: size from the header, pixels decoded on demand.

    ``check``: also raise for an image that is cut off; ``data``: it holds no colors.  Raises SceneError.
    """

    def error(message: str, hint: str | None) -> SceneError:
        return SceneError(message, where=path.name, hint=hint)

    with open_image(path, TEXT_SCENE_IMAGES, error) as opened:
        size = opened.size
    if check:
        check_image(path, TEXT_SCENE_IMAGES, error)
    return Image(path.stem, size, partial(decode_image, path, TEXT_SCENE_IMAGES, error, data))


class ImagePool:
    """The images of an OBJ or AFF scene, in the order of first use."""

    def __init__(self, notes: Notes):
        self._notes = notes
        self._index: dict[tuple[Path, bool], int | None] = {}  # None: unreadable
        self.images: list[Image] = []

    @property
    def files(self) -> list[Path]:
        """The files of ``images``."""
        return [path for (path, _), index in self._index.items() if index is not None]

    def texture(self, path: Path, data: bool = False) -> Texture | None:
        """The texture in a file, of colors or ``data``; None for one that is damaged, which is a repair."""
        key = path, data
        if key not in self._index:
            self._index[key] = None
            try:
                image = read_image(path, check=not self._notes.strict, data=data)
            except SceneError as error:
                self._notes.repair("texture-unreadable", error, detail=path.name)
            else:
                self._index[key] = len(self.images)
                self.images.append(image)
        index = self._index[key]
        return None if index is None else Texture(index)

    def packed(self, roughness: Texture | None, metallic: Texture | None) -> Texture | None:
        """Two gray textures as one of glTF: roughness in green, metallic in blue, white where there is none."""
        parts = {channel: self.images[t.image] for channel, t in ((1, roughness), (2, metallic)) if t is not None}
        if not parts:
            return None
        first = next(iter(parts.values()))

        def decode() -> Array:
            out = np.full((first.size[1], first.size[0], 4), 255, np.uint8)
            for channel, image in parts.items():
                gray = PIL.Image.fromarray(image.decode()[..., 0])
                out[..., channel] = np.asarray(gray.resize(first.size, PIL.Image.Resampling.BILINEAR))
            return out

        self.images.append(Image(first.name, first.size, decode))
        return replace(roughness or metallic, image=len(self.images) - 1)


class Identity:
    """SHA-256 over the bytes of every file a scene is read from, in the order in which its reader opens them.

    Results measured on different bytes are never combined.  The checksum of a scene in one file is the file's own.
    Images enter by their file bytes and are not decoded; images that no material samples do not enter.
    """

    def __init__(self) -> None:
        self._digest = sha256()
        self._added: set[Path] = set()
        self.files = 0
        """Number of files added."""

    def add(self, data: bytes | memoryview) -> None:
        """Add the bytes of a file that is in memory."""
        self._digest.update(data)
        self.files += 1

    def add_file(self, path: Path) -> None:
        """Add a file from disk.  Adding it again changes nothing.  Raises SceneError."""
        if path in self._added:
            return
        self._added.add(path)
        self.files += 1
        hashed(path, SceneError, self._digest)

    def hexdigest(self) -> str:
        """64 hexadecimal digits over everything added."""
        return self._digest.hexdigest()
