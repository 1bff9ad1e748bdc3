"""File formats of exports: one class each, with the interface ``Writer``."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.animation import View
from taubench_gl.errors import SettingsError
from taubench_gl.export.channels import channel_named, stored_as
from taubench_gl.export.frames import ExportFrame
from taubench_gl.outputs import cannot_write, folder_in, plain_text, write_arrays
from taubench_gl.pathtraced.exr import write_exr
from taubench_gl.pathtraced.passes import EXPORT_ATTRIBUTE

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class ExportSpec:
    """Contents of an export.  ``frames``: the requested frame numbers; ``names``: the channels that exist;
    ``cuts``: first frames of new shots among them; ``view``: of any frame."""

    scene: str
    size: tuple[int, int]
    fps: float
    frames: range
    names: tuple[str, ...]
    precision: str
    cuts: tuple[int, ...] = ()
    view: Callable[[int], View] | None = None


class Writer:
    """Writes the files of a format into a folder."""

    names: tuple[str, ...] | None = None
    """Channels that files of the format have, where it does not leave the choice; else empty."""

    def __init__(self, out: Path, spec: ExportSpec):
        self.out, self.spec = out, spec

    def prepare(self) -> None:
        """Create files that all frames share.  Called again when an export is resumed; existing files are kept."""

    def done(self, frame: int) -> bool:
        """Whether the frame is written completely."""

    def write(self, frame: ExportFrame) -> None:
        """Write one frame, completely or not at all."""

    def remove(self) -> None:
        """Delete all files of this format."""


@contextlib.contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Turns an OSError inside the block into an OutputError."""
    try:
        yield
    except OSError as error:
        raise cannot_write(path, error) from None


class _PerFrame(Writer):
    """Writes one file per frame."""

    suffix = ""

    def path(self, frame: int) -> Path:
        return self.out / f"frame_{frame:05d}{self.suffix}"

    def done(self, frame: int) -> bool:
        return self.path(frame).is_file()

    def remove(self) -> None:
        for path in self.out.glob(f"frame_*{self.suffix}"):
            path.unlink()

    def stored(self, frame: ExportFrame) -> dict[str, Array]:
        """Channels in the precision of the export."""
        types = {name: stored_as(channel_named(name), self.spec.precision) for name in self.spec.names}
        with np.errstate(over="ignore"):  # values above 65504 become infinite in half precision
            return {name: frame.channels[name].astype(types[name], copy=False) for name in self.spec.names}


class ExrWriter(_PerFrame):
    """Multilayer OpenEXR, one part, ZIP; channel names of the channel table; matrices as attributes."""

    suffix = ".exr"

    def write(self, frame: ExportFrame) -> None:
        planes = {}
        for name, values in self.stored(frame).items():
            for i, exr in enumerate(channel_named(name).exr):
                planes[exr] = values[..., i]
        write_exr(self.path(frame.number), planes, exr_attributes(self.spec, frame))


def exr_attributes(spec: ExportSpec, frame: ExportFrame) -> dict[str, Any]:
    """Attributes in the header of an EXR file.  ``worldToCamera`` is OpenEXR's (float, acts on row vectors, +Y up, -Z
    forward).

    ``taubench.*`` are float64 and act on column vectors, as in ``camera_matrices``.
    """
    camera = frame.camera
    world_to_camera = np.linalg.inv(camera["world_from_view"]).T
    return {
        "worldToCamera": np.ascontiguousarray(world_to_camera, dtype=np.float32),
        "taubench.worldFromView": camera["world_from_view"],
        "taubench.clipFromView": camera["clip_from_view"],
        "taubench.intrinsics": camera["intrinsics"],
        "taubench.jitterPx": camera["jitter_px"],
        "taubench.frame": frame.number,
        "taubench.timeSeconds": float(frame.time_s),
        "taubench.scene": plain_text(spec.scene),
        EXPORT_ATTRIBUTE: "relative to the camera, world axes, scene units",
    }


class NpzWriter(_PerFrame):
    """Compressed NumPy archives: every channel by its name, and the camera matrices."""

    suffix = ".npz"

    def write(self, frame: ExportFrame) -> None:
        arrays = self.stored(frame) | frame.camera
        write_arrays(self.path(frame.number), arrays | {"frame": frame.number, "time_s": frame.time_s})


def zarr_module() -> Any:
    """The package zarr.  Raises SettingsError where it is not installed."""
    try:
        import zarr
    except ImportError:
        raise SettingsError("zarr is not installed", hint="pip install 'taubench-gl[export]'") from None
    return zarr


class ZarrWriter(Writer):
    """Zarr v3 group ``frames.zarr``: one array (N, h, w, components) per channel, one chunk per frame.

    ``written`` (N,) bool is set last; a frame is complete only then.
    """

    def __init__(self, out: Path, spec: ExportSpec):
        self.path, self.spec = out / "frames.zarr", spec
        self._group: Any = None

    def prepare(self) -> None:
        zarr = zarr_module()
        with _writing(self.path):
            folder_in(self.path.parent, self.path.name)
            self._open(zarr)

    def _open(self, zarr: Any) -> None:
        if (self.path / "zarr.json").is_file():
            self._group = zarr.open_group(self.path, mode="r+")
            if self._group.attrs.get("complete_layout"):
                return
        spec, count = self.spec, len(self.spec.frames)
        self._group = group = zarr.open_group(self.path, mode="w", zarr_format=3)
        for name in spec.names:
            info = channel_named(name)
            dtype = stored_as(info, spec.precision)
            shape = (spec.size[1], spec.size[0], info.components)
            group.create_array(
                name, shape=(count, *shape), chunks=(1, *shape), dtype=dtype,
                fill_value=np.nan if dtype.kind == "f" else 0,
                dimension_names=("frame", "y", "x", "component"), attributes={"unit": info.unit, "doc": info.doc},
            )  # fmt: skip
        shapes = {"world_from_view": (4, 4), "clip_from_view": (4, 4), "intrinsics": (3, 3), "jitter_px": (2,)}
        for name, shape in shapes.items():
            group.create_array(name, shape=(count, *shape), chunks=(1, *shape), dtype="float64", fill_value=np.nan)
        numbers = np.array(spec.frames, dtype=np.int64)
        group.create_array("frame", data=numbers)
        group.create_array("time_s", data=numbers / spec.fps)
        group.create_array("written", shape=(count,), chunks=(1,), dtype="bool", fill_value=False)
        group.attrs.update({"scene": spec.scene, "fps": spec.fps, "complete_layout": True})

    def done(self, frame: int) -> bool:
        try:
            return bool(self._group["written"][self.spec.frames.index(frame)])
        except Exception:  # a chunk truncated by a killed process raises an error of its codec
            return False

    def write(self, frame: ExportFrame) -> None:
        row = self.spec.frames.index(frame.number)
        with _writing(self.path):
            for name in self.spec.names:
                self._group[name][row] = frame.channels[name].astype(self._group[name].dtype, copy=False)
            for name, values in frame.camera.items():
                self._group[name][row] = values
            self._group["written"][row] = True

    def remove(self) -> None:
        import shutil

        shutil.rmtree(self.path, ignore_errors=True)
