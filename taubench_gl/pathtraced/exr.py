"""Reads one OpenEXR file: named planes over its display window; and writes one.

Files that are read are untrusted.  The header's kind and sizes are checked before pixels are decoded, a part that the
library drops silently is an error, and text that the library prints to the terminal becomes part of the error message.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import OpenEXR

from taubench_gl.data_files import by_descriptor, opened
from taubench_gl.errors import PathTracedError
from taubench_gl.memory_budget import require
from taubench_gl.outputs import write_atomically

Array = np.ndarray
Window = tuple[int, int, int, int]
"""A window of an image: x0, y0, x1, y1 in pixels, both ends included, +y down, as OpenEXR stores it."""

MAGIC = b"\x76\x2f\x31\x01"
_NON_IMAGE_FLAG = 1 << 11  # version field, bit 11: the file holds deep data
MAX_SIDE = 16384
"""Largest accepted width or height of the data and display windows, in pixels."""

MAX_CHANNELS = 4096
"""Most channels of one file, all parts together.  Files of renderers have about a hundred; the time that the library
takes to open a file grows with the square of their number."""
_MULTIPART_FLAG = 1 << 12  # version field, bit 12


@dataclass(frozen=True, slots=True)
class ExrImage:
    """Planes of one file.  Row 0 is the top row of the display window."""

    path: Path
    size: tuple[int, int]  # width, height of the display window
    _planes: dict[str, tuple[Array | None, Window]] = field(repr=False)
    _display: Window = field(repr=False)
    chromaticities: tuple[float, ...] | None = None  # xy of red, green, blue and white; None: those of Rec. 709

    @property
    def names(self) -> tuple[str, ...]:
        """Full channel names, ``Layer.Pass.R``.  Channels of a named part start with its name."""
        return tuple(self._planes)

    def plane(self, name: str) -> Array:
        """Values of the channel ``name``, (h, w) float32 over the display window; NaN outside the data window. uint is
        converted to float.

        Raises PathTracedError for a subsampled channel, which has no value for every pixel.
        """
        values, window = self._planes[name]
        if values is None:
            hint = "write every channel at full size (luminance-chroma images do not)"
            raise PathTracedError(f"channel {name} is subsampled", where=str(self.path), hint=hint)
        if window == self._display:
            return np.ascontiguousarray(values, dtype=np.float32)
        width, height = self.size
        out = np.full((height, width), np.nan, dtype=np.float32)
        x, y = window[0] - self._display[0], window[1] - self._display[1]
        x0, y0 = max(x, 0), max(y, 0)
        x1, y1 = min(x + values.shape[1], width), min(y + values.shape[0], height)
        if x0 < x1 and y0 < y1:
            out[y0:y1, x0:x1] = values[y0 - y : y1 - y, x0 - x : x1 - x]
        return out


def read_exr(path: str | Path) -> ExrImage:
    """Read one image: single-part or multi-part; half, float or uint; any compression that the library supports.

    Raises PathTracedError for missing, damaged, truncated and deep files, and for sizes above MAX_SIDE
    or the memory limit.
    """
    path = Path(path)
    with opened(path, PathTracedError) as file:
        headers = _headers(path, file)
        display = _check_headers(path, headers)
        parts = _parts(path, file, expected=len(headers))
    planes: dict[str, tuple[Array, Window]] = {}
    for part, header in zip(parts, headers, strict=True):
        window = _window(header["dataWindow"])
        shape = (window[3] - window[1] + 1, window[2] - window[0] + 1)
        for name, channel in part.channels.items():
            # Subsampled planes (luminance-chroma images) have no value per pixel.
            whole = channel.pixels is not None and channel.pixels.shape == shape
            planes.setdefault(_full_name(name, header), (channel.pixels if whole else None, window))
    size = (display[2] - display[0] + 1, display[3] - display[1] + 1)
    primaries = headers[0].get("chromaticities")
    return ExrImage(path, size, planes, display, primaries if isinstance(primaries, tuple) else None)


@dataclass(frozen=True, slots=True)
class ExrHeader:
    """Size, channel names, attributes and views of a file's headers."""

    size: tuple[int, int]  # width, height of the display window
    names: tuple[str, ...]  # full channel names, as in ExrImage
    attributes: frozenset[str]  # names of the attributes of the first part
    views: tuple[str, ...] = ()  # of a multi-view (stereo) file, the default one first; () for one view


def read_header(path: str | Path) -> ExrHeader:
    """Read size and names without decoding pixels.  Raises PathTracedError as ``read_exr`` does."""
    path = Path(path)
    with opened(path, PathTracedError) as file:
        headers = _headers(path, file)
    x0, y0, x1, y1 = _check_headers(path, headers)
    names = dict.fromkeys(_full_name(c.name, h) for h in headers for c in h["channels"])
    listed = headers[0].get("multiView")
    views = listed if isinstance(listed, list) else [h.get("view") for h in headers]
    views = dict.fromkeys(view for view in views if view and isinstance(view, str))  # attributes may have any type
    return ExrHeader((x1 - x0 + 1, y1 - y0 + 1), tuple(names), frozenset(headers[0]), tuple(views))


def prefixed(prefix: str, name: str) -> str:
    """``prefix.name``, or ``name`` without a prefix."""
    return f"{prefix}.{name}" if prefix else name


def merge(images: Sequence[tuple[str, ExrImage]]) -> ExrImage:
    """Combine files of equal size into one image; channels become ``prefix.channel``.  Raises PathTracedError."""
    first = images[0][1]
    planes = {prefixed(prefix, n): p for prefix, image in images for n, p in image._planes.items()}
    chromaticities = next((image.chromaticities for _, image in images if image.chromaticities), None)
    windows = {image._display for _, image in images}
    if len(windows) > 1:
        raise PathTracedError("the files of one frame have different display windows", where=str(first.path))
    return ExrImage(first.path, first.size, planes, first._display, chromaticities)


def write_exr(path: Path, planes: Mapping[str, Array], attributes: Mapping[str, Any] | None = None) -> None:
    """Write planes, (h, w) by channel name, as one part with ZIP compression, completely or not at all.

    Row 0 is the top row.  Missing folders are created.  Raises OutputError.
    """
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **(attributes or {})}
    data = io.BytesIO()
    # Written from memory: OpenEXR accepts only UTF-8 paths, and its errors do not say why a write fails.
    OpenEXR.File(header, {name: np.ascontiguousarray(plane) for name, plane in planes.items()}).write(data)
    write_atomically(path, data.getvalue(), parents=True)


def _full_name(channel: str, header: Mapping[str, Any]) -> str:
    """``R`` in part ``ViewLayer.Combined`` -> ``ViewLayer.Combined.R``; Blender 5 writes the full name already.

    In parts of several views the view stands before the component, as in one part: ``ViewLayer.Combined.left.R``.
    """
    part, view = header.get("name") or "", header.get("view")
    view = view if isinstance(view, str) else ""
    if view and part[: -len(view)].endswith(("-", ".", "_")) and part.endswith(view):
        part = part[: -len(view) - 1]
    name = channel if not part or channel == part or channel.startswith(part + ".") else f"{part}.{channel}"
    *layers, component = name.split(".")
    return ".".join([*layers, view, component]) if view and view not in layers[-1:] else name


def _channel_count(file: BinaryIO, multipart: bool) -> int:
    """Channels of all headers, without the library; counts up to the first damage, which the library reports."""
    count = 0
    file.seek(8)
    while count <= MAX_CHANNELS:
        attributes = 0
        while name := _text_from(file):
            kind, size = _text_from(file), int.from_bytes(file.read(4), "little", signed=True)
            attributes += 1
            if size < 0 or kind is None:
                return count
            if kind == b"chlist" and name == b"channels":
                count += _channels_in(file.read(size)) if size <= MAX_CHANNELS * 512 else MAX_CHANNELS + 1
            else:
                file.seek(size, 1)
        if not multipart or not attributes or name is None:  # an empty header ends the list
            break
    return count


def _channels_in(data: bytes) -> int:
    """Entries of a channel list: a name that ends with 0, then 16 bytes; an empty name ends the list."""
    count = place = 0
    while place < len(data) and data[place]:
        place = data.find(b"\0", place) + 17
        count += 1
        if place < 17:
            break
    return count


def _text_from(file: BinaryIO) -> bytes | None:
    """A text of at most 255 bytes that ends with 0; None at the end of the file and for a longer one."""
    text = bytearray()
    while len(text) < 256:
        byte = file.read(1)
        if not byte:
            return None
        if byte == b"\0":
            return bytes(text)
        text += byte
    return None


def _headers(path: Path, file: BinaryIO) -> list[dict[str, Any]]:
    """The header of each part.  Raises PathTracedError unless the first 8 bytes are those of a flat OpenEXR image."""
    head = file.read(8)
    if head[:4] != MAGIC:
        raise PathTracedError("is not an OpenEXR file", where=str(path), hint="its first bytes are another format's")
    if len(head) < 8:
        raise _damaged(path, "the file ends within its header")
    if _channel_count(file, bool(int.from_bytes(head[4:8], "little") & _MULTIPART_FLAG)) > MAX_CHANNELS:
        raise PathTracedError(f"has more than {MAX_CHANNELS} channels", where=str(path), hint="export fewer passes")
    if int.from_bytes(head[4:], "little") & _NON_IMAGE_FLAG:
        raise _deep(path)
    try:
        headers = [part.header for part in _parts(path, file)]
        for header in headers:
            [channel.name for channel in header["channels"]]
        return headers
    except UnicodeDecodeError as error:  # the library decodes a header when it is asked for
        raise _from_library(path, error) from None


def _check_headers(path: Path, headers: list[dict[str, Any]]) -> Window:
    """The display window that all parts share.  Raises PathTracedError for deep, oversized or inconsistent parts."""
    if not headers:
        raise _damaged(path, "no part has a readable header")
    total, display = 0, _window(headers[0]["displayWindow"])
    for header in headers:
        if "deep" in str(header.get("type", "")).lower():
            raise _deep(path)
        if _window(header["displayWindow"]) != display:
            raise PathTracedError("its parts have different display windows", where=str(path), hint="export one size")
        for kind, window in (("data", _window(header["dataWindow"])), ("display", display)):
            width, height = window[2] - window[0] + 1, window[3] - window[1] + 1
            if width < 1 or height < 1:
                raise _damaged(path, f"its {kind} window is {width}x{height} pixels")
            if max(width, height) > MAX_SIDE:
                hint = f"the limit is {MAX_SIDE} pixels a side; the header may be damaged"
                raise PathTracedError(f"its {kind} window is {width}x{height} pixels", where=str(path), hint=hint)
            if kind == "data":
                total += width * height * sum(_sample_bytes(c) for c in header["channels"])
    require(int(total), "its pixels", PathTracedError, str(path))
    return display


def _parts(path: Path, file: BinaryIO, *, expected: int | None = None) -> list[Any]:
    """Parts of the file.  ``expected`` None: headers only; otherwise with pixels, and this many parts must decode.

    The library raises several exception types.  It drops a part that it cannot decode and only prints a message.
    """
    printed, native = io.StringIO(), []
    try:
        with contextlib.redirect_stdout(printed), _native_stderr(native):
            parts = OpenEXR.File(by_descriptor(file), separate_channels=True, header_only=expected is None).parts
    except Exception as error:
        raise _from_library(path, error) from None
    if expected is not None and len(parts) != expected:
        message = f"{expected - len(parts)} of {expected} parts cannot be decoded"
        detail = "".join([printed.getvalue(), *native])
        raise _damaged(path, message if expected > 1 else "its pixels cannot be decoded", detail)
    return parts


@contextlib.contextmanager
def _native_stderr(captured: list[str]) -> Iterator[None]:
    """Append to ``captured`` the text that native code writes to file descriptor 2."""
    try:
        sys.stderr.flush()
        saved = os.dup(2)
    except (OSError, ValueError, AttributeError):  # the process has no standard error
        yield
        return
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            file.seek(0)
            captured.append(file.read(2000).decode(errors="replace"))


def _from_library(path: Path, error: Exception) -> PathTracedError:
    if isinstance(error, MemoryError):
        hint = "write fewer passes or a smaller image"
        return PathTracedError("does not fit into memory", where=str(path), hint=hint)
    if "deep" in str(error).lower():
        return _deep(path)
    if isinstance(error, UnicodeDecodeError):
        return _damaged(path, "a name in its header is not text")
    return _damaged(path, str(error).replace(str(path), "the file"))


def _damaged(path: Path, fault: str, detail: str = "") -> PathTracedError:
    detail = re.sub(r"^.*?\(EXR_ERR_\w+\)|^Warning:[^\n]* - ", "", detail.replace(str(path), ""), flags=re.M)
    first = next((line.strip() for line in detail.splitlines() if line.strip()), "")
    detail = f": {first[:160]}" if first else ""
    message = f"damaged or cut off: {fault[:200]}{detail}"
    return PathTracedError(message, where=str(path), hint="render or copy it again")


def _deep(path: Path) -> PathTracedError:
    return PathTracedError("is a deep image (many samples per pixel)", where=str(path), hint="export flat images")


def _window(box: Any) -> Window:
    (x0, y0), (x1, y1) = box
    return int(x0), int(y0), int(x1), int(y1)


def _sample_bytes(channel: Any) -> float:
    return 4.0 / (max(1, channel.xSampling) * max(1, channel.ySampling))
