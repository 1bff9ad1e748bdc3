"""Environment images: equirectangular radiance from .hdr (Radiance RGBE) and .exr (OpenEXR) files.

Files are untrusted: size and layout are checked before pixels are decoded, and every fault is one line.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np

from taubench_gl.errors import SettingsError

Array = np.ndarray

MAX_SIZE = (8192, 4096)
"""Largest accepted width and height, pixels."""

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
        """Width, height."""
        return self.radiance.shape[1], self.radiance.shape[0]


def read_environment(path: str | Path) -> EnvironmentImage:
    """Read an environment image; a file that has not changed is read once.  Raises SettingsError."""
    path = Path(path)
    try:
        about = path.stat()
    except (OSError, ValueError) as error:
        raise _fault(path, f"cannot be opened: {getattr(error, 'strerror', None) or error}") from None
    if not path.is_file():
        raise _fault(path, "is not a file")
    return _read(path, about.st_mtime_ns, about.st_size)


def _fault(path: Path, what: str, hint: str | None = None) -> SettingsError:
    return SettingsError(f"environment image {what}", where=str(path), hint=hint, setting="environment")


@lru_cache(maxsize=2)
def _read(path: Path, modified: int, size: int) -> EnvironmentImage:
    """``modified`` and ``size`` of the file: part of the key of the cache."""
    import OpenImageIO as oiio

    try:
        sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise _fault(path, f"cannot be read: {error.strerror}") from None
    source = oiio.ImageInput.open(str(path))
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
    finally:
        source.close()
    pixels = np.asarray(pixels, dtype=np.float32).reshape(height, width, end - first)
    radiance = np.ascontiguousarray(pixels[..., [i - first for i in order]])
    if bad := int(np.count_nonzero(~np.isfinite(radiance))):
        raise _fault(path, f"has {bad} value{'s' * (bad > 1)} that are not finite")
    negative = int(np.count_nonzero(radiance < 0))
    radiance = np.maximum(radiance, 0.0)
    radiance.flags.writeable = False
    return EnvironmentImage(path, sha256, radiance, negative)


def _first_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[0] if lines else "unknown format"
