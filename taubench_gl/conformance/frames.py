"""The frames of an engine for one case, from OpenEXR or NPZ files, in the units of the truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taubench_gl.conformance.cases import FRAMES, Case
from taubench_gl.conformance.truth import Truth
from taubench_gl.data_files import stored_arrays
from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced.cameras import relative_position
from taubench_gl.pathtraced.exr import ExrImage
from taubench_gl.pathtraced.passes import (
    EXPORT_PRESET,
    ChannelIndex,
    PassMap,
    PathTracedFrame,
    load_mapping,
    read_frame,
)
from taubench_gl.pathtraced.sequence import PathTracedSequence, find_frames

Array = np.ndarray
EXR, NPZ = "exr:", "npz:"
LETTERS = "XYZW"
"""Names of the components of an array of an NPZ file, as channels."""


@dataclass(frozen=True, slots=True)
class EngineFrame:
    """One frame of an engine, row 0 at the top.  None: it has no such pass."""

    sky: Array  # (h, w) bool, no surface
    motion: Array | None  # (h, w, 2) float64, previous - current, pixels, +x right, +y down, without jitter
    points: Array | None  # (h, w, 3) float64, surface points relative to the camera of the truth, meters
    normal: Array | None = None  # (h, w, 3) world
    rejected: Array | None = None  # (h, w) bool: the engine does not use its history
    step_px: Array | float = 0.0  # (h, w, 2) half a step of the stored vectors: that of half floats, else 0
    step_m: Array | float = 0.0  # (h, w) a step of the stored positions
    exact_zero: bool = True  # files can store vectors that are exactly zero, and vectors contain no jitter
    world: bool = True  # points come from world positions, not relative ones or depth

    @property
    def judgeable(self) -> bool:
        """Whether it shows if the scene was loaded as written."""
        return self.points is not None or self.normal is not None


class EngineFrames:
    """Frames of all cases in a folder of an engine: CASE/ANYTHING0000.exr or .npz, one number for each frame.

    ``spec``: exr:DIR or npz:DIR.  Raises PathTracedError for another one, and for a mapping that does not exist.
    """

    def __init__(self, spec: str, mapping: str | Path | None = None, layer: str | None = None):
        self.kind = next((kind for kind in (EXR, NPZ) if spec.startswith(kind)), "")
        self.folder = Path(spec.removeprefix(self.kind))
        if not self.kind or not self.folder.is_dir():
            raise PathTracedError("is no folder of frames", where=spec, hint="give exr:DIR or npz:DIR")
        self._named = None if mapping is None else load_mapping(mapping)
        self._mapping, self._layer = mapping, layer

    def has(self, case: str) -> bool:
        """Whether there are files of ``case``."""
        return any((self.folder / case).glob(f"*.{self.kind[:3]}"))

    def open(self, case: Case) -> tuple[Truth, list[EngineFrame]]:
        """The truth of ``case`` at the size of the frames, and the frames in its units.

        Raises PathTracedError for damaged files, another number of frames and several sizes.
        """
        folder = self.folder / case.name
        if self.kind == EXR:
            sequence = PathTracedSequence.open(folder, mapping=self._mapping, layer=self._layer)
            frames = [sequence.read(number, geometry=False) for number in sequence.frames]
        else:
            mapping = self._named or load_mapping(EXPORT_PRESET)
            files = find_frames(folder / "*.npz").values()
            frames = [_read_npz(path, mapping) for paths in files for path in paths]
        if len(frames) != FRAMES or len({frame.size for frame in frames}) != 1:
            message = f"has {len(frames)} frames of {len({frame.size for frame in frames})} sizes"
            raise PathTracedError(message, where=str(folder), hint=f"a case has {FRAMES} frames of one size")
        truth = Truth(case, frames[0].size)
        return truth, [_convert(frame, truth, k) for k, frame in enumerate(frames)]


def half_step(values: Array) -> Array:
    """Half the distance of neighboring half floats at ``values``, 0 unless all of them are half floats."""
    finite = values[np.isfinite(values)]
    with np.errstate(over="ignore"):
        half = finite.astype(np.float16).astype(np.float64)
        # in units of a float32 step: a conversion of units rounds
        stored = np.abs(half - finite) <= 2e-7 * np.abs(finite)
        if not len(finite) or not stored.all() or not np.any(finite % 1.0):
            return np.zeros(values.shape)
        return 0.5 * np.spacing(np.abs(np.nan_to_num(values)).astype(np.float16)).astype(np.float64)


def _read_npz(path: Path, mapping: PassMap) -> PathTracedFrame:
    with stored_arrays(path, PathTracedError) as arrays:
        values = {name: np.atleast_3d(arrays[name]) for name in arrays.files if np.ndim(arrays[name]) in (2, 3)}
    images = {name: array for name, array in values.items() if min(array.shape[:2]) > 4}  # matrices are smaller
    sizes = {array.shape[1::-1] for array in images.values()}
    if len(sizes) != 1:
        hint = "one array (h, w, components) per pass"
        raise PathTracedError("has no images of one size", where=str(path), hint=hint)
    size = sizes.pop()
    window = (0, 0, size[0] - 1, size[1] - 1)
    planes = {f"{name}.{letter}": (array[..., i], window)
              for name, array in images.items() for i, letter in zip(range(array.shape[2]), LETTERS)}  # fmt: skip
    image = ExrImage(path, size, planes, window)
    return read_frame(image, ChannelIndex(image.names, mapping), geometry=False)


def _convert(frame: PathTracedFrame, truth: Truth, number: int) -> EngineFrame:
    view, mapping = truth.view(number), frame.mapping
    points = None
    if frame.position is not None or frame.depth is not None:
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            points = relative_position(frame, view)[0]
    sky, normal = frame.sky, frame.normal
    if normal is not None and mapping.normals == "view":
        normal = normal @ view.world_from_view.T
    if points is None and normal is not None:
        sky = ~np.any(normal, axis=-1)
    motion, step = frame.motion, 0.0
    if motion is not None:
        motion = motion.astype(np.float64)
        unit = np.abs(mapping.motion.factors(frame.size)).astype(np.float64)
        step = half_step(motion / unit) * unit if mapping.motion.encoding == "linear" else 0.0
        if mapping.motion.jitter == "included":
            motion = motion - truth.jitter_motion(number)
    # half positions beside finer depth are not what points are made of
    placed = frame.position is not None and not (frame.half_position and frame.finer_depth)
    stored, metric = frame.position if placed else frame.depth, 0.0
    if stored is not None:
        stored = np.abs(np.nan_to_num(stored.astype(np.float64), posinf=0.0, neginf=0.0)) / mapping.meters
        metric = 2 * half_step(stored) + np.spacing(stored.astype(np.float32))
        metric = (metric.max(axis=-1) if metric.ndim == 3 else metric) * mapping.meters
    kept = frame.kept
    return EngineFrame(
        sky, motion, points, normal, None if kept is None else kept <= 0.0, step, metric,
        exact_zero=mapping.motion.zero == "0" and mapping.motion.jitter == "excluded",
        world=placed and not frame.relative,
    )  # fmt: skip
