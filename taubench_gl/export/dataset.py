"""Training data of exported or rendered frames: windows of consecutive frames, cropped, as a torch ``Dataset``.

``TrainingWindows`` cuts NumPy arrays; only ``TrainingWindows[i]`` needs torch.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from taubench_gl.data_files import read_json, stored_arrays
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import plan_scene
from taubench_gl.evaluation.owner import opened_gpu
from taubench_gl.export.channels import RADIANCE_OF_ALL, channel_named, choose_channels, clean_name, noisy_name
from taubench_gl.export.frames import FrameSource
from taubench_gl.export.run import MANIFEST, Manifest
from taubench_gl.features import COLUMNS
from taubench_gl.option_groups import TrainingOptions
from taubench_gl.pathtraced.exr import read_exr
from taubench_gl.reuse.helpers import REJECT
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

try:
    from torch.utils.data import Dataset
except ImportError:  # an optional package
    Dataset = object

Array = np.ndarray
Window = tuple[slice, slice]
"""Rows and columns of an image."""

FEATURES = ("base_color", "normal", "depth")
"""Channels of a window by default."""


class Frames(Protocol):
    """Frames of one scene: their numbers without a gap, ``size`` (width, height), and the names of their channels."""

    numbers: range
    size: tuple[int, int]
    names: tuple[str, ...]

    def read(self, number: int, names: Sequence[str], window: Window) -> dict[str, Array]:
        """Channels of a frame, (h, w, components) of ``window``, row 0 at the top."""


@dataclass(frozen=True, slots=True)
class RenderedFrames:
    """Frames in memory.  ``channels``: name -> (N, h, w, components)."""

    numbers: range
    channels: Mapping[str, Array]

    @classmethod
    def render(
        cls, scene: Scene | str | Path, settings: Settings, *, channels: Sequence[str] = FEATURES, **light: Any
    ) -> RenderedFrames:
        """The frames of ``settings``, as ``export`` writes them.  Raises TaubenchError.

        ``channels``: of an export, besides ``motion`` and ``mask``; ``light``: its options ``input``, ``seeds``,
        ``reference`` and so on.
        """
        training = TrainingOptions(**light)
        plan = plan_scene(scene, settings.replace(columns=COLUMNS if training.wanted else settings.metrics.columns))
        resolved = plan.settings.replace(columns=settings.metrics.columns, pairs="all")
        names = choose_channels((*channels, "motion", "mask"))
        with (
            opened_gpu(resolved) as owner,
            FrameSource(owner.gpu, plan.animated, resolved, names, training=training) as source,
        ):
            drawn = [frame.channels for frame in source.frames(plan.frames)]
        return cls(plan.frames, {name: np.stack([frame[name] for frame in drawn]) for name in drawn[0]})

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.channels)

    @property
    def size(self) -> tuple[int, int]:
        height, width = next(iter(self.channels.values())).shape[1:3]
        return width, height

    def read(self, number: int, names: Sequence[str], window: Window) -> dict[str, Array]:
        return {name: self.channels[name][(self.numbers.index(number), *window)] for name in names}


class ExportedFrames:
    """The frames of a finished export of format npz, zarr or exr.  Raises TaubenchError."""

    def __init__(self, folder: str | Path):
        self.folder = Path(folder)
        about = read_json(self.folder / MANIFEST, Manifest)
        self.numbers, self.names, self._format = range(*about["frames"]), tuple(about["channels"]), about["format"]
        self.size = about["settings"]["width"], about["settings"]["height"]
        self._group: Any = None

    def read(self, number: int, names: Sequence[str], window: Window) -> dict[str, Array]:
        if self._format == "zarr":
            if self._group is None:  # opened once in each loader process
                import zarr

                self._group = zarr.open_group(self.folder / "frames.zarr", mode="r")
            return {name: self._group[name][(self.numbers.index(number), *window)] for name in names}
        path = self.folder / f"frame_{number:05d}.{self._format}"
        if self._format == "npz":
            with stored_arrays(path) as stored:
                return {name: stored[name][window] for name in names}
        image = read_exr(path)
        planes = {name: [image.plane(exr)[window] for exr in channel_named(name).exr] for name in names}
        return {name: np.stack(planes[name], axis=-1, dtype=self._dtype(name), casting="unsafe") for name in names}

    @staticmethod
    def _dtype(name: str) -> np.dtype:
        """NumPy type of a channel in memory: that of unsigned integers is kept, all others are float32."""
        dtype = channel_named(name).dtype
        return dtype if dtype.kind == "u" else np.dtype(np.float32)


class TrainingWindows(Dataset):
    """Windows of ``length`` consecutive frames of ``sequences``, one for each first frame and seed of the noise.

    An item has tensors (length, components, h, w), float32: ``noisy`` and ``clean``, radiance x exposure of the input
    and of the reference, where exported; ``motion``, pixels, previous - current, +y down, 0 where undefined;
    ``reusable``: 1 where there is history that no geometry mask discards, 0 in the first frame of a window; and
    the channels of ``features``.  The masks are those of reuse methods with reprojection ``motion``.

    ``crop``: width and height of a window, at places that ``seed``, ``epoch`` and item determine; None: whole images.
    ``stride``: frames from one window to the next.  Raises SettingsError.
    """

    def __init__(
        self,
        sequences: Sequence[Frames],
        *,
        length: int = 4,
        crop: tuple[int, int] | None = None,
        stride: int = 1,
        features: Sequence[str] = FEATURES,
        seed: int = 0,
    ):
        if min(length, stride) < 1:
            raise SettingsError("a window has at least one frame, and the next begins at least one later")
        self._sequences, self._length, self._crop, self._seed = tuple(sequences), length, crop, seed
        self._features, self.epoch = tuple(features), 0
        self.items: list[tuple[int, int, int | None]] = []
        """(number of the sequence, first frame, number of the noisy image or None) of every window."""
        for number, frames in enumerate(self._sequences):
            if missing := sorted({*self._features, "motion", "mask"} - {*frames.names}):
                raise SettingsError(f"the frames have no channel {missing[0]}", hint="export it, or leave it out")
            if crop is not None and not all(0 < c <= s for c, s in zip(crop, frames.size, strict=True)):
                width, height = frames.size
                raise SettingsError(f"crop {crop[0]}x{crop[1]} is no part of {width}x{height}", hint="crop less")
            seeds = [k for k in range(len(frames.names)) if noisy_name(k, RADIANCE_OF_ALL) in frames.names] or [None]
            starts = range(frames.numbers.start, frames.numbers.stop - length + 1, stride)
            self.items += [(number, start, k) for start in starts for k in seeds]

    def __len__(self) -> int:
        return len(self.items)

    def window(self, item: int) -> tuple[slice, slice]:
        """Rows and columns of an item in this ``epoch``."""
        width, height = self._sequences[self.items[item][0]].size
        if self._crop is None:
            return slice(0, height), slice(0, width)
        rng = np.random.default_rng((self._seed, self.epoch, item))
        x, y = (int(rng.integers(0, whole - part + 1)) for whole, part in zip((width, height), self._crop))
        return slice(y, y + self._crop[1]), slice(x, x + self._crop[0])

    def arrays(self, item: int) -> dict[str, Array]:
        """An item as NumPy arrays."""
        number, start, noisy = self.items[item]
        frames, window = self._sequences[number], self.window(item)
        light = {"clean": clean_name(RADIANCE_OF_ALL)}
        light |= {} if noisy is None else {"noisy": noisy_name(noisy, RADIANCE_OF_ALL)}
        light = {name: channel for name, channel in light.items() if channel in frames.names}
        read = (*light.values(), *self._features, "motion", "mask")
        rows = [frames.read(start + k, read, window) for k in range(self._length)]
        stacked = {name: np.moveaxis(np.stack([row[name] for row in rows]), -1, 1) for name in read}
        out = {name: stacked[channel][:, :3] for name, channel in light.items()}
        out |= {name: stacked[name] for name in self._features}
        out["motion"] = np.nan_to_num(stacked["motion"], nan=0.0)
        out["reusable"] = (stacked["mask"] & np.uint32(REJECT)) == 0
        out["reusable"][0] = False
        return {name: np.ascontiguousarray(values, dtype=np.float32) for name, values in out.items()}

    def __getitem__(self, item: int) -> dict[str, Any]:
        import torch

        return {name: torch.from_numpy(values) for name, values in self.arrays(item).items()}
