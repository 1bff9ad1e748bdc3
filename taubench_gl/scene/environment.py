"""Environment images: equirectangular radiance from .hdr (Radiance RGBE) and .exr (OpenEXR) files.

Files are untrusted: size and layout are checked before pixels are decoded, and every fault is one line.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from taubench_gl.data_files import by_descriptor, opened
from taubench_gl.errors import SettingsError
from taubench_gl.memory_budget import require

Array = np.ndarray

MAX_SIZE = (8192, 4096)
"""Largest accepted width and height, pixels."""

MAX_BYTES = 2 << 30
"""Bytes of the largest image file that is read."""

MAX_CHANNELS = 8
"""Most channels that are decoded, those between the first and the last of R, G and B."""


@dataclass(frozen=True)
class EnvironmentImage:
    """Radiance from all directions.

    ``radiance`` (h, w, 3) float32, linear RGB, w = 2 h.  Row 0 is at the top (+Y); the center of the image is +X, and a
    quarter of its width to the right of that is +Z (``metrics.environment.directions``).
    """

    path: Path
    sha256: str
    radiance: Array = field(repr=False)
    negative: int = 0  # values below 0 in the file, which count as 0

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the image in pixels."""
        return self.radiance.shape[1], self.radiance.shape[0]


def read_environment(path: str | Path) -> EnvironmentImage:
    """Read an environment image; a file that has not changed is read once.  Raises SettingsError."""
    path = Path(path)
    with _opened(path) as file:
        about = os.fstat(file.fileno())
    return _read(path, about.st_mtime_ns, about.st_size)


def environment_bytes(path: str | Path) -> int:
    """Memory that the radiance of an environment image takes, from its header.  Raises SettingsError."""
    with _opened(Path(path)) as file, _source(Path(path), file) as source:
        return 12 * source.spec().width * source.spec().height


def _opened(path: Path) -> BinaryIO:
    try:
        return opened(path, SettingsError, max_bytes=MAX_BYTES)
    except SettingsError as error:
        raise _fault(path, error.what) from None


def _fault(path: Path, message: str, hint: str | None = None) -> SettingsError:
    return SettingsError(f"environment image {message}", where=str(path), hint=hint, setting="environment")


@lru_cache(maxsize=2)
def _read(path: Path, modified: int, size: int) -> EnvironmentImage:
    """The image of ``path``, read once for each ``modified`` time and ``size`` of the file."""
    with _opened(path) as file, _source(path, file) as source:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        spec = source.spec()
        width, height = spec.width, spec.height
        require(12 * width * height, "its radiance", SettingsError, str(path))
        names = list(spec.channelnames)
        if not {"R", "G", "B"} <= set(names):
            raise _fault(path, f"has the channels {', '.join(names[:8])}", "R, G and B are needed")
        order = [names.index(channel) for channel in "RGB"]
        first, end = min(order), max(order) + 1
        if end - first > MAX_CHANNELS:
            raise _fault(path, f"has {end - first} channels from the first to the last of R, G and B")
        pixels = source.read_image(0, 0, first, end, "float")
        if pixels is None:
            raise _fault(path, f"is damaged: {_first_line(source.geterror())}")
    pixels = np.asarray(pixels, dtype=np.float32).reshape(height, width, end - first)
    radiance = np.ascontiguousarray(pixels[..., [i - first for i in order]])
    if bad := int(np.count_nonzero(~np.isfinite(radiance))):
        raise _fault(path, f"has {bad} value{'s' * (bad > 1)} that are not finite")
    negative = int(np.count_nonzero(radiance < 0))
    radiance = np.maximum(radiance, 0.0)
    radiance.flags.writeable = False
    return EnvironmentImage(path, sha256, radiance, negative)


@contextmanager
def _source(path: Path, file: BinaryIO) -> Iterator[Any]:
    """An open image whose size and layout are those of an environment.  Raises SettingsError."""
    import OpenImageIO as oiio

    source = oiio.ImageInput.open(by_descriptor(file))
    if source is None:
        raise _fault(path, f"cannot be read: {_first_line(oiio.geterror())}")
    try:
        spec = source.spec()
        width, height = spec.width, spec.height
        if width > MAX_SIZE[0] or height > MAX_SIZE[1]:
            raise _fault(path, f"has {width}x{height} pixels", f"at most {MAX_SIZE[0]}x{MAX_SIZE[1]}")
        if width != 2 * height:
            raise _fault(path, f"has {width}x{height} pixels", "an equirectangular image is twice as wide as high")
        if spec.deep or spec.depth > 1 or (spec.x, spec.y, spec.full_width, spec.full_height) != (0, 0, width, height):
            raise _fault(path, "is not one flat image that fills its window")
        yield source
    finally:
        source.close()


def _first_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[0] if lines else "unknown format"
