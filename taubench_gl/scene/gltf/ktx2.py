"""KTX 2 images of KHR_texture_basisu (ETC1S and UASTC), transcoded to RGBA by the package opengl_basisu."""

from __future__ import annotations

import importlib
import io
from typing import Any

import numpy as np

from taubench_gl.scene.files import MAX_SIDE, ImageSource, MakeError, image_file

Array = np.ndarray

IDENTIFIER = b"\xabKTX 20\xbb\r\n\x1a\n"
HEADER = 104
"""Bytes of the header, the index, and the entry of one level."""


def is_ktx2(source: ImageSource, error: MakeError) -> bool:
    """Whether an image is a KTX 2 file."""
    return _start(source, len(IDENTIFIER), error) == IDENTIFIER


def ktx2_size(source: ImageSource, error: MakeError) -> tuple[int, int]:
    """Width and height of the header, pixels.  Raises ``error``, also where opengl_basisu is not installed."""
    _library(error)
    with image_file(source, error) as file:
        header, total = file.read(HEADER), file.seek(0, io.SEEK_END)
    width, height, depth, layers, faces = (int.from_bytes(header[i : i + 4], "little") for i in range(20, 40, 4))
    if len(header) < HEADER or not width or not height or depth or layers or faces != 1:
        raise error("is not a KTX 2 file with one two-dimensional image", "export the texture again")
    if max(width, height) > MAX_SIDE:
        raise error(f"image is {width} x {height} pixels; the limit is {MAX_SIDE} a side", None)
    # Offset and length of the largest level.
    if sum(int.from_bytes(header[i : i + 8], "little") for i in (80, 88)) > total:
        raise error("image is cut off", "export the texture again")
    return width, height


def decode_ktx2(source: ImageSource, error: MakeError) -> Array:
    """RGBA pixels of the largest level, (h, w, 4) uint8, row 0 = top.  Raises ``error``."""
    library, size = _library(error), ktx2_size(source, error)
    with image_file(source, error) as file:
        data = file.read()
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


def _start(source: ImageSource, count: int, error: MakeError) -> bytes:
    with image_file(source, error) as file:
        return file.read(count)
