"""Path-traced sequences: numbered OpenEXR files of a folder, one or several per frame."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taubench_gl.conventions import FILE_NUMBER
from taubench_gl.data_files import hashed
from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced.exr import ExrImage, merge, prefixed, read_exr, read_header
from taubench_gl.pathtraced.passes import (
    EXPORT_ATTRIBUTE,
    EXPORT_PRESET,
    ChannelIndex,
    PassMap,
    PathTracedFrame,
    linear_radiance,
    load_mapping,
    missing_columns,
    read_frame,
    read_light,
)

Array = np.ndarray

PREFIX = "exr:"
_NUMBERED = re.compile(rf"^(.*?)({FILE_NUMBER})$")


def is_sequence(spec: object) -> bool:
    """Whether a scene argument names an EXR sequence: ``exr:DIR`` or ``exr:DIR/name*.exr``."""
    return str(spec).startswith(PREFIX)


def find_frames(spec: str | Path) -> dict[int, tuple[Path, ...]]:
    """Frame number -> files of that frame, by the last number of their names.  Raises PathTracedError for none."""
    where = Path(str(spec).removeprefix(PREFIX))
    if where.is_dir():
        files = [p for p in where.iterdir() if p.suffix.lower() == ".exr" and not p.name.startswith(".")]
    elif any(c in where.name for c in "*?["):
        files = [p for p in where.parent.glob(where.name) if p.is_file() and not p.name.startswith(".")]
    elif where.is_file():
        files = [where]
    else:
        raise PathTracedError("is no folder of EXR files", where=str(where), hint="give exr:DIR or 'exr:DIR/name*.exr'")
    files_of: dict[int, list[Path]] = {}
    spelled: dict[tuple[str, int], Path] = {}
    for path in sorted(files):
        numbered = _NUMBERED.match(path.stem)
        if numbered:
            number = int(numbered[2])
            other = spelled.setdefault((numbered[1], number), path)
            if other is not path:
                message = f"{other.name} and {path.name} have the same number {number}"
                raise PathTracedError(message, where=str(where), hint="write all numbers with as many digits")
            files_of.setdefault(number, []).append(path)
    if not files_of:
        message = "no name ends in a frame number" if files else "holds no .exr file"
        raise PathTracedError(message, where=str(where), hint="name them as in frame_0001.exr")
    return {frame: tuple(paths) for frame, paths in sorted(files_of.items())}


@dataclass(frozen=True, slots=True)
class PathTracedSequence:
    """A path-traced sequence on disk.  ``open`` reads the headers of the first frame, ``read`` the pixels of one."""

    path: Path
    files: Mapping[int, tuple[Path, ...]]  # by frame number, ascending
    size: tuple[int, int]  # width, height in pixels
    mapping: PassMap
    index: ChannelIndex
    exported: bool  # written by ``export``

    @classmethod
    def open(
        cls, spec: str | Path, *, mapping: str | Path | None = None, layer: str | None = None, view: str | None = None
    ) -> PathTracedSequence:
        """Find the files and read the first frame's headers.  Raises PathTracedError.

        ``mapping`` as for ``load_mapping``; None: taubench for the files of ``export``, else blender.  ``layer``,
        ``view``: as in ``ChannelIndex``.
        """
        files = find_frames(spec)
        named = None if mapping is None else load_mapping(mapping)  # its faults come before those of the files
        first = next(iter(files.values()))
        headers = [read_header(path) for path in first]
        exported = all(EXPORT_ATTRIBUTE in header.attributes for header in headers)
        passes = named or load_mapping(EXPORT_PRESET if exported else None)
        size = headers[0].size
        names = [prefixed(_prefix(first, path), n) for path, header in zip(first, headers) for n in header.names]
        try:
            views = tuple(dict.fromkeys(name for header in headers for name in header.views))
            index = ChannelIndex(names, passes, layer, view, views)
        except PathTracedError as error:
            raise PathTracedError(error.what, where=str(first[0]), hint=error.hint) from None
        return cls(Path(str(spec).removeprefix(PREFIX)), files, size, passes, index, exported)

    @property
    def frames(self) -> tuple[int, ...]:
        """All frame numbers, ascending."""
        return tuple(self.files)

    @property
    def folder(self) -> Path:
        return self.path if self.path.is_dir() else self.path.parent

    @property
    def name(self) -> str:
        return self.folder.resolve().name

    def select(self, bounds: tuple[int | None, int | None]) -> range:
        """Frame numbers in [A, B); negative bounds count from the last.  Raises PathTracedError on gaps."""
        first, last = self.frames[0], self.frames[-1]
        start, stop = (end if end is None or end >= 0 else last + 1 + end for end in bounds)
        selected = [f for f in self.frames if (start is None or f >= start) and (stop is None or f < stop)]
        if not selected:
            hint = f"choose within {first}:{last + 1}"
            raise PathTracedError("no frame is in the given range", where=str(self.path), hint=hint)
        span = range(selected[0], selected[-1] + 1)
        missing = sorted(set(span) - set(selected))
        if missing:
            a, b = _longest_run(selected)
            listed = ", ".join(map(str, missing[:8])) + (", ..." if len(missing) > 8 else "")
            hint = f"render them, or give --frames {a}:{b}: pairs need consecutive frames"
            raise PathTracedError(f"{len(missing)} frames are missing: {listed}", where=str(self.path), hint=hint)
        return span

    def require(self, size: tuple[int, int], frames: Collection[int] = (), *, of: str) -> None:
        """Raise PathTracedError unless the sequence has this size and all ``frames``.  ``of``: who needs them."""
        where = str(self.path)
        if self.size != size:
            pixels, expected = ("x".join(map(str, s)) for s in (self.size, size))
            raise PathTracedError(f"is {pixels} pixels, {of} {expected}", where=where, hint="give one --size to both")
        lost = sorted(set(frames) - set(self.frames))
        if lost:
            raise PathTracedError(f"lacks frame {lost[0]} of {of}", where=where, hint="give --frames that it has")

    def require_centered(self) -> None:
        """Raise PathTracedError for images that are shifted by whole pixels: drawn ones beside them are not."""
        if any(self.mapping.principal_point):
            message = f"its mapping shifts images by {self.mapping.principal_point} pixels, which drawn images are not"
            raise PathTracedError(message, where=str(self.path), hint="shift the files, and leave out principal_point")

    def missing(self, lobes: Collection[str] = ()) -> dict[str, str]:
        """Columns (and ``lobe_bounce``) without their passes in the first frame -> reason."""
        return missing_columns(self.index, lobes)

    def read(self, frame: int, lobes: Collection[str] = (), *, geometry: bool = True) -> PathTracedFrame:
        """Decode one frame.  Raises PathTracedError if its size or its passes differ from the first frame's.

        ``geometry``: as in ``read_frame``.
        """
        return read_frame(self._decode(frame), self.index, lobes, geometry=geometry)

    def radiance(self, frame: int, exposure: float = 1.0) -> Array:
        """Combined pass of one frame times ``exposure``, linear, (h, w, 3) float32; no other pass is needed.

        Raises PathTracedError, also for a pass that is not linear.
        """
        combined = read_light(self._decode(frame), self.index, "combined")
        where = f"{self.path}, frame {frame}"
        return linear_radiance(combined, self.mapping, exposure, where)

    def emission(self, frame: int) -> Array | None:
        """The pass of emission of one frame, (h, w, 3) float32; None where the first frame has none."""
        return read_light(self._decode(frame), self.index, "emission") if "emission" in self.index else None

    def _decode(self, frame: int) -> ExrImage:
        """The channels of one frame.  Raises PathTracedError as ``read`` does."""
        paths = self.files[frame]
        images = [read_exr(path) for path in paths]
        for image in images:
            if image.size != self.size:
                image_size, expected = ("x".join(map(str, s)) for s in (image.size, self.size))
                raise PathTracedError(f"is {image_size} pixels, the first frame is {expected}", where=str(image.path))
        image = images[0] if len(images) == 1 else merge([(_prefix(paths, i.path), i) for i in images])
        self._check_passes(image)
        return image

    def sha256(self) -> str:
        """Hash of the bytes of all files, in frame order."""
        digest = hashlib.sha256()
        for path in (p for paths in self.files.values() for p in paths):
            hashed(path, PathTracedError, digest)
        return digest.hexdigest()

    def _check_passes(self, image: ExrImage) -> None:
        present = set(image.names)
        for name in self.mapping.passes:
            lost = [c for c in (self.index.channels(name) if name in self.index else ()) if c not in present]
            if lost:
                message, hint = f"lacks {', '.join(lost)}, which the first frame has", "all frames need the same passes"
                raise PathTracedError(message, where=str(image.path), hint=hint)


def _prefix(group: tuple[Path, ...], path: Path) -> str:
    """Layer name of a file's channels if a frame has several files: the file name without the number."""
    if len(group) == 1:
        return ""
    return _NUMBERED.match(path.stem).group(1).rstrip("._- ")


def _longest_run(frames: list[int]) -> tuple[int, int]:
    runs, start = [], 0
    for i in range(1, len(frames) + 1):
        if i == len(frames) or frames[i] != frames[i - 1] + 1:
            runs.append((frames[start], frames[i - 1] + 1))
            start = i
    return max(runs, key=lambda run: run[1] - run[0])
