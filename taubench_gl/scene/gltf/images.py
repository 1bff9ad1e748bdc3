"""Images: headers are read with the scene, pixels only when asked for."""

from __future__ import annotations

import io
import threading
import warnings
from functools import partial
from pathlib import Path

import numpy as np
import PIL.Image

from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.accessors import Accessors
from taubench_gl.scene.gltf.document import Document
from taubench_gl.scene.gltf.uri import read_uri, resolve
from taubench_gl.scene.model import Image

Array = np.ndarray

MEDIA_TYPES = ("image/png", "image/jpeg", "image/webp")
FORMATS = ("PNG", "JPEG", "WEBP")
MAX_SIDE = 16384
"""Largest width or height.  Pillow's own limit of about 179 million pixels holds beside it."""

Source = Path | bytes | memoryview

_warnings_lock = threading.Lock()  # warnings.catch_warnings is not thread-safe


def read_image(document: Document, accessors: Accessors, index: int) -> Image:
    """One image with its size from the header.  Raises SceneError."""
    image, pointer = document.root.images[index], f"/images/{index}"
    if (image.uri is None) == (image.buffer_view is None):
        raise document.error("must have either a uri or a bufferView", pointer)
    if image.mime_type is not None and image.mime_type not in MEDIA_TYPES:
        raise document.error(f"image of type {image.mime_type} is not supported", pointer, "use PNG, JPEG or WebP")
    if image.buffer_view is not None:
        source: Source = accessors.view_bytes(image.buffer_view, f"{pointer}/bufferView")
    elif image.uri[:5].lower() == "data:":
        source = read_uri(document, image.uri, f"{pointer}/uri", MEDIA_TYPES)
    else:
        source = resolve(document, image.uri, f"{pointer}/uri")
    # The closure must not keep the whole document in memory, only what errors need.
    bare = Document(document.path, schema.Root(asset=document.root.asset))
    with _open(bare, source, pointer) as opened:
        size = opened.size
    if isinstance(source, Path):
        document.identity.add_file(source)
    name = image.name or (source.stem if isinstance(source, Path) else "")
    return Image(name, size, partial(_decode, bare, source, pointer))


def unused_image(document: Document, index: int) -> Image:
    """Stand-in for an image no material samples: its file is never opened."""
    error = document.error("is sampled by no material, so it was not read", f"/images/{index}")

    def decode() -> Array:
        raise error

    return Image(document.root.images[index].name, (0, 0), decode)


def _open(document: Document, source: Source, pointer: str) -> PIL.Image.Image:
    file = io.BytesIO(source) if isinstance(source, (bytes, memoryview)) else source
    try:
        with _warnings_lock, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            opened = PIL.Image.open(file, formats=FORMATS)
    except PIL.UnidentifiedImageError:
        raise document.error("is not a PNG, JPEG or WebP image", pointer, "export the texture again") from None
    except (OSError, ValueError, SyntaxError, PIL.Image.DecompressionBombError) as e:
        raise document.error(f"image cannot be read: {e}", pointer) from None
    if max(opened.size) > MAX_SIDE:
        opened.close()
        raise document.error(
            f"image is {opened.size[0]} x {opened.size[1]} pixels, more than {MAX_SIDE} a side", pointer
        )
    return opened


def _decode(document: Document, source: Source, pointer: str) -> Array:
    """(h, w, 4) uint8, row 0 = top."""
    try:
        with _open(document, source, pointer) as opened:
            opened.load()
            if opened.mode.startswith("I"):  # 16 bits of grey; Pillow's own conversion would clip instead of scale
                grey = (np.asarray(opened).astype(np.int64) >> 8).clip(0, 255).astype(np.uint8)
                return np.dstack([grey, grey, grey, np.full_like(grey, 255)])
            return np.array(opened.convert("RGBA"))
    except (OSError, ValueError, SyntaxError, EOFError) as e:
        raise document.error(f"image cannot be decoded: {e}", pointer, "export the texture again") from None
