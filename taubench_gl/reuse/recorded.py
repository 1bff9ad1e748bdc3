"""Frames made elsewhere, evaluated as a method: ``exr:DIR`` in ``--methods``; and the folder of saved results.

``exr:DIR`` stands for the result of any program: linear radiance in numbered OpenEXR files with the frame numbers and
the size of the evaluation.  Settings are given as for a method, ``exr:DIR@mapping=unreal@offset=1``.  A folder with
folders ``seed0``, ``seed1``, ... has one sequence per seed.  ``ResultWriter`` writes results in this layout, so that
saved results can be evaluated again.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import moderngl
import numpy as np

from taubench_gl.data_files import read_json
from taubench_gl.errors import MethodError, OutputError, PathTracedError, SettingsError
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.owner import Owner
from taubench_gl.outputs import cannot_write, plain_text, write_atomically
from taubench_gl.pathtraced.exr import write_exr
from taubench_gl.pathtraced.sequence import PREFIX, PathTracedSequence
from taubench_gl.reuse.contract import suggestion
from taubench_gl.reuse.frame import FrameInputs

Array = np.ndarray

SETTINGS = ("mapping", "layer", "view", "offset", "scale", "label")
"""Settings of ``exr:DIR``: pass names, view layer, view of stereo files, number of the file minus that of the frame,
factor on radiance, name in all outputs."""

RESULTS = "results"
INDEX = "index.json"
SCHEMA = "taubench-gl/results/1"
RESERVED = ("input", "reference")
"""Images of every evaluation, which no method can be called."""


@dataclass(frozen=True, slots=True)
class RecordedFrames:
    """A sequence to evaluate as a method.  Fields as SETTINGS; ``mapping`` None: that of the evaluation."""

    folder: str
    mapping: str | None = None
    layer: str | None = None
    view: str | None = None
    offset: int = 0
    scale: float = 1.0

    @classmethod
    def parse(cls, source: str, settings: Mapping[str, Any]) -> RecordedFrames:
        """The sequence ``source`` (``exr:DIR``) with ``settings``, text or values.  Raises MethodError."""
        faults = [f"there is no setting {n!r}{suggestion(n, SETTINGS)}" for n in settings if n not in SETTINGS]
        values: dict[str, Any] = {
            name: str(settings[name]) for name in ("mapping", "layer", "view") if name in settings
        }
        for name, kind, expected in (("offset", int, "an integer"), ("scale", float, "a number above 0")):
            try:
                values[name] = kind(settings.get(name, getattr(_DEFAULT, name)))
            except ValueError:
                faults.append(f"setting {name}: {settings[name]!r} is not {expected}")
        scale = values.get("scale", 1.0)
        if not (np.isfinite(scale) and scale > 0):
            faults.append(f"setting scale: {settings['scale']!r} is not a number above 0")
        if faults:
            raise MethodError("; ".join(faults), where=f"method {source!r}")
        return cls(source.removeprefix(PREFIX), **values)

    @staticmethod
    def label(source: str, requested: str | None) -> str:
        """The label of ``exr:DIR``: ``requested``, else its name.  Raises SettingsError for a reserved name."""
        if requested in RESERVED:
            raise SettingsError(f"label is {requested!r}, which every evaluation has", hint="give another @label=")
        return requested or RecordedFrames(source.removeprefix(PREFIX)).name

    @property
    def name(self) -> str:
        """A name for tables: ``exr:`` and the name of the folder."""
        return PREFIX + (Path(self.folder).name or self.folder)

    def open(self, size: tuple[int, int], frames: range, mapping: str | None, seed: int) -> PathTracedSequence:
        """The sequence of ``seed``, with all ``frames`` and of this size.  Raises MethodError."""
        folder = Path(self.folder)
        if any(folder.glob("seed[0-9]*")):
            folder = folder / f"seed{seed}"
        try:
            spec = f"{PREFIX}{folder}"
            sequence = PathTracedSequence.open(spec, mapping=self.mapping or mapping, layer=self.layer, view=self.view)
            sequence.require(size, [frame + self.offset for frame in frames], of="the evaluation")
        except PathTracedError as error:
            raise _method_error(self, error) from None
        if "combined" not in sequence.index:
            raise MethodError(
                f"has no combined pass by the pass names of {sequence.mapping.name}",
                where=f"method '{self.name}'",
                hint=f"give {self.name}@mapping=NAME or a TOML file",
            )
        return sequence


_DEFAULT = RecordedFrames("")


def _method_error(recorded: RecordedFrames, error: PathTracedError) -> MethodError:
    where = f"method '{recorded.name}'" + (f": {error.where}" if error.where else "")
    return MethodError(error.what, where=where, hint=error.hint)


class RecordedRunner(Owner):
    """Frames of files in the place of a ``MethodRunner``."""

    time_ms = None  # another program ran

    def __init__(
        self,
        gpu: Gpu,
        recorded: RecordedFrames,
        size: tuple[int, int],
        frames: range,
        *,
        mapping: str | None = None,
        seed: int = 0,
    ):
        """Open the files of ``seed``.  Raises MethodError for another size, missing frames or no combined pass."""
        super().__init__()
        self.size, self.bytes = size, None
        self.recorded, self._frames = recorded, frames
        self.sequence = recorded.open(size, frames, mapping, seed)
        self.values = {"mapping": self.sequence.mapping.name, "offset": recorded.offset, "scale": recorded.scale}
        self._texture = self.own(gpu.texture(size))

    def step(self, frame: FrameInputs) -> moderngl.Texture:
        """The image of this frame times its exposure; alpha is -1, the weight of history is unknown.

        Raises MethodError for files that cannot be read.
        """
        number = self._frames[frame.index] + self.recorded.offset
        try:
            radiance = self.sequence.radiance(number, frame.exposure * self.recorded.scale)
        except PathTracedError as error:
            raise _method_error(self.recorded, error) from None
        if not np.isfinite(radiance).all():
            count = int(np.count_nonzero(~np.isfinite(radiance).all(axis=-1)))
            message = f"frame {number}: {count} of {radiance.shape[0] * radiance.shape[1]} pixels are NaN or infinite"
            raise MethodError(message, where=f"method '{self.recorded.name}'")
        weight = np.full((*radiance.shape[:2], 1), -1.0, dtype=np.float32)
        # GL's row 0 is at the bottom
        self._texture.write(np.ascontiguousarray(np.concatenate([radiance, weight], axis=-1)[::-1]))
        return self._texture

    def reported(self, frame: FrameInputs) -> dict[str, Array]:
        """No reports, as ``MethodRunner.reported``: how the files were made is unknown."""
        return {}


class ResultWriter:
    """Writes results as linear EXR: ``results/METHOD/seedK/frame_00012.exr``, R, G, B, exposure not applied.

    ``results/index.json`` (schema ``taubench-gl/results/1``) names the folder of every method; ``input`` and
    ``reference`` are written in the same way.  Files of an earlier evaluation in the folder are removed.
    """

    def __init__(self, out: Path, scene: str = ""):
        self.folder, self._scene = out / RESULTS, scene
        self._folders: dict[str, str] = {}
        self._started = False

    def add(self, frame: int, seed: int, exposure: float, images: Mapping[str, Array]) -> None:
        """``images``: label -> linear radiance times ``exposure``, (h, w, 3 or 4).  Raises OutputError."""
        if not self._started:
            self._remove_former()
            self._started = True
        new = [label for label in images if label not in self._folders]
        for label in new:
            self._folders[label] = self._name(label)
        if new:
            index = {"schema": SCHEMA, "unit": "linear radiance, exposure not applied", "folders": self._folders}
            write_atomically(self.folder / INDEX, json.dumps(index, indent=1) + "\n", parents=True)
        for label, image in images.items():
            radiance = np.asarray(image[..., :3], dtype=np.float64) / exposure
            planes = {name: radiance[..., i].astype(np.float32) for i, name in enumerate("RGB")}
            attributes = {"taubench.frame": frame, "taubench.method": plain_text(label), "taubench.seed": seed,
                          "taubench.exposure": float(exposure), "taubench.scene": plain_text(self._scene)}  # fmt: skip
            write_exr(self.folder / self._folders[label] / f"seed{seed}" / f"frame_{frame:05d}.exr", planes, attributes)

    @property
    def folders(self) -> Mapping[str, str]:
        """Label -> folder in ``results``."""
        return self._folders

    def _name(self, label: str) -> str:
        base = re.sub(r"[^\w.=@+-]+", "_", label).strip("._") or "method"
        used_names = set(self._folders.values()) | (set(RESERVED) - {label})
        names = (base, *(f"{base}_{k}" for k in range(2, len(used_names) + 3)))
        return next(name for name in names if name not in used_names)

    def _remove_former(self) -> None:
        if not (self.folder / INDEX).is_file():
            return
        try:
            stored_folders: Sequence[str] = list(read_json(self.folder / INDEX).get("folders", {}).values())
        except (OutputError, AttributeError):
            return  # not ours
        try:
            for name in stored_folders:
                for path in (self.folder / Path(name).name).glob("seed*/frame_*.exr"):
                    path.unlink()
        except OSError as error:
            raise cannot_write(self.folder, error) from None
