"""KTX 2 images of KHR_texture_basisu (ETC1S and UASTC), transcoded to RGBA by the package opengl_basisu."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.scene.files import MAX_SIDE, ImageSource, MakeError

Array = np.ndarray

IDENTIFIER = b"\xabKTX 20\xbb\r\n\x1a\n"
HEADER = 104
"""Bytes of the header, the index, and the entry of one level."""
MAX_PIXELS = 2**27
"""Limit on the pixels of one image: half a gigabyte of RGBA."""


def is_ktx2(source: ImageSource, error: MakeError) -> bool:
    """Whether an image is a KTX 2 file."""
    return _start(source, len(IDENTIFIER), error) == IDENTIFIER


def ktx2_size(source: ImageSource, error: MakeError) -> tuple[int, int]:
    """Width and height of the header, pixels.  Raises ``error``, also where opengl_basisu is not installed."""
    _library(error)
    header = _start(source, HEADER, error)
    width, height, depth, layers, faces = (int.from_bytes(header[i : i + 4], "little") for i in range(20, 40, 4))
    if len(header) < HEADER or not width or not height or depth or layers or faces != 1:
        raise error("is not a KTX 2 file with one two-dimensional image", "export the texture again")
    if max(width, height) > MAX_SIDE or width * height > MAX_PIXELS:
        raise error(f"image is {width} x {height} pixels; the limit is {MAX_SIDE} a side", None)
    # Offset and length of the largest level.
    if sum(int.from_bytes(header[i : i + 8], "little") for i in (80, 88)) > _length(source):
        raise error("image is cut off", "export the texture again")
    return width, height


def decode_ktx2(source: ImageSource, error: MakeError) -> Array:
    """RGBA pixels of the largest level, (h, w, 4) uint8, row 0 = top.  Raises ``error``."""
    library, size = _library(error), ktx2_size(source, error)
    data = source.read_bytes() if isinstance(source, Path) else bytes(source)
    try:
        image = library.open(data).transcode("rgba8")
    except ValueError as e:  # BasisuError is one
        raise error(f"image cannot be decoded: {e}", "export the texture again") from None
    pixels = np.asarray(image.data, dtype=np.uint8)
    if pixels.shape != (size[1], size[0], 4):
        raise error(f"image decodes to {pixels.shape}, its header declares {size}", "export the texture again")
    return pixels


def _library(error: MakeError) -> Any:
    try:
        return importlib.import_module("opengl_basisu")
    except ImportError:
        hint = "pip install 'taubench-gl[ktx2]'"
        raise error("is a KTX 2 image, and the Python module opengl_basisu is not installed", hint) from None


def _length(source: ImageSource) -> int:
    return source.stat().st_size if isinstance(source, Path) else len(source)


def _start(source: ImageSource, count: int, error: MakeError) -> bytes:
    if not isinstance(source, Path):
        return bytes(source[:count])
    try:
        with source.open("rb") as file:
            return file.read(count)
    except OSError as e:
        raise error(f"cannot be read: {e.strerror}", None) from None
