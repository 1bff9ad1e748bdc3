"""The files that a check compares, each read once, and what a reading of their conventions makes of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import View
from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced import cameras as cams
from taubench_gl.pathtraced.cameras import PathTracedCamera, points_at, project
from taubench_gl.pathtraced.check_vectors import FEW_PIXELS
from taubench_gl.pathtraced.passes import PathTracedFrame, to_y_up
from taubench_gl.pathtraced.readings import BACKWARDS, Reading, corrected_motion
from taubench_gl.pathtraced.sequence import PathTracedSequence

Array = np.ndarray

SCENE, PREVIOUS, STILL = BASES = ("the scene", "previous positions", "still surfaces")
"""What vectors are compared with: the first two know the motion of every surface."""

SAME_POINT = 0.01
"""Largest distance of a file's surface point from the scene's, relative to its depth."""

_MATRICES: dict[str, Callable[[Array], Array]] = {
    "transposed": np.transpose, "inverse": np.linalg.inv, "inverse transposed": lambda m: np.linalg.inv(m.T),
    "rotation transposed": lambda m: math3d.affine(m[:3, :3].T, m[:3, 3]),
    "y down, z forward": lambda m: m @ np.diag([1.0, -1.0, -1.0, 1.0]),
}  # fmt: skip
_SEARCHED = 300  # pixels of each frame in the search; shares are then counted over all


@dataclass(frozen=True, slots=True)
class SceneTruth:
    """One frame of the scene file, rasterized.  Arrays (h, w, ...) float64, row 0 at the top; NaN without a surface."""

    position: Array  # (h, w, 3) relative to the camera, world axes, meters
    motion: Array  # (h, w, 2) pixels, previous - current, +x right, +y down
    still: Array  # (h, w, 2) what ``motion`` is if the surface does not move
    sky: Array  # (h, w) bool


Truth = Callable[[Collection[int]], Mapping[int, SceneTruth]]
"""Frame numbers of files -> their truth."""


@dataclass(frozen=True, slots=True)
class Samples:
    """Pixels of one file.  Arrays (N, ...) float64, as the mapping reads them; None: no such pass."""

    at: Array  # flat indices into the image
    pixels: Array  # column, row
    position: Array | None
    depth: Array | None
    prev_position: Array | None
    motion: Array | None

    @classmethod
    def of(cls, frame: PathTracedFrame, mask: Array, most: int | None = None) -> Samples:
        """The pixels of ``mask`` (h, w), at most ``most`` of them, chosen at random with a fixed seed."""
        at = np.random.default_rng(0).permutation(np.flatnonzero(mask))[:most]
        named = (frame.position, frame.depth, frame.prev_position, frame.motion)
        taken = (None if a is None else a.reshape(mask.size, *a.shape[2:])[at].astype(np.float64) for a in named)
        return cls(at, np.stack([at % frame.size[0], at // frame.size[0]], axis=-1).astype(np.float64), *taken)


@dataclass
class Files:
    """The files that are checked.  ``placed`` samples have a surface point, ``every`` and ``few`` a vector as well.

    ``starts``: first files of the pairs; ``render``: gives the truth of the scene; None: it is not known;
    ``offsets`` of the scene's camera not tried yet.
    """

    sequence: PathTracedSequence
    camera: PathTracedCamera
    frames: dict[int, PathTracedFrame]
    starts: list[int] = field(default_factory=list)
    render: Truth | None = None
    offsets: list[int] = field(default_factory=lambda: [-1, 0, 1])
    placed: dict[int, Samples] = field(default_factory=dict)
    every: dict[int, Samples] = field(default_factory=dict)
    few: dict[int, Samples] = field(default_factory=dict)
    views: dict[tuple[int, int, str, str, str], View | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.offsets = [offset for offset in self.offsets if offset != getattr(self.camera, "offset", None)]
        for number, frame in self.frames.items():
            use = ~frame.sky
            if frame.position is not None:
                use = use & np.isfinite(frame.position).all(axis=-1)
            elif frame.depth is not None:
                use = use & np.isfinite(frame.depth) & (frame.depth > 0)
            self.placed[number] = Samples.of(frame, use)
            if frame.motion is not None:
                use = use & np.isfinite(frame.motion).all(axis=-1)
            self.every[number] = Samples.of(frame, use)
            if frame.prev_position is not None and frame.motion is not None:
                moving = use & frame.motion.any(axis=-1)  # objects that move before a still camera
                use = moving if moving.sum() >= FEW_PIXELS else use
            self.few[number] = Samples.of(frame, use, _SEARCHED)

    @property
    def any_frame(self) -> PathTracedFrame:
        """The first file's frame: all files have the same passes."""
        return next(iter(self.frames.values()))

    @cached_property
    def truth(self) -> Mapping[int, SceneTruth]:
        """What the scene shows in each frame; empty if it is not known or there are no vectors."""
        return {} if self.render is None or self.any_frame.motion is None else self.render(self.frames)

    @staticmethod
    def steps(reading: Reading) -> int:
        """Frames by which the camera that a file needs has another number."""
        return {"ahead": -1, "behind": 1}.get(reading.order, 0)

    def shifted(self, reading: Reading | None) -> bool:
        """Move the scene's camera by the frame that ``reading`` needs; None, no reading fits: to the next offset.

        Beside other mistakes it could not be placed in time.  False where nothing is left to try.
        """
        if not isinstance(self.camera, cams.SceneCamera):
            return False
        offset = self.camera.offset + self.steps(reading) if reading else next(iter(self.offsets), self.camera.offset)
        if offset == self.camera.offset or offset not in self.offsets:
            return False
        self.offsets.remove(offset)
        self.camera.offset = offset
        self.views.clear()
        self.__dict__.pop("truth", None)
        return True

    @property
    def positions(self) -> bool:
        """Whether there is a position pass."""
        return self.any_frame.position is not None

    @property
    def geometry(self) -> bool:
        """Whether surface points are known: there is a position or a depth pass."""
        return self.positions or self.any_frame.depth is not None

    @cached_property
    def fitted(self) -> bool:
        """Whether the camera is estimated from the files, which shows neither axes nor units."""
        return isinstance(self.camera, cams.FittedCamera)

    @property
    def bases(self) -> tuple[str, ...]:
        """What vectors can be compared with, the best first."""
        there = {SCENE: bool(self.truth), PREVIOUS: self.any_frame.prev_position is not None, STILL: self.geometry}
        return tuple(basis for basis in BASES if there[basis])

    def view(self, number: int, reading: Reading) -> View | None:
        """The camera of file ``number`` by ``reading``; None where the camera file has none for it."""
        shown = number + self.steps(reading)
        if "backwards" in reading.order:
            shown = self.sequence.frames[0] + self.sequence.frames[-1] - number
        key = number, shown, reading.rows * self.fitted, reading.matrix, reading.lens
        if key not in self.views:
            try:
                self.views[key] = self._view(number, shown, Reading(rows=key[2], matrix=key[3], lens=key[4]))
            except (PathTracedError, KeyError):
                self.views[key] = None
        return self.views[key]

    def _view(self, number: int, shown: int, reading: Reading) -> View | None:
        if reading.rows and self.view(number, Reading()) is not None:  # one of both row orders is right
            return None
        frame = self.frames[number]
        view = self.camera.view(shown, _flipped(frame) if reading.rows else frame)
        if reading.matrix:
            matrix = _MATRICES[reading.matrix](self.camera.file.matrices[shown])
            view = replace(view, position=matrix[:3, 3].copy(), world_from_view=math3d.orthonormal(matrix[:3, :3]))
        if reading.lens and view.camera.kind == "perspective":
            width, height = self.sequence.size
            yfov = 2.0 * math.atan(math.tan(0.5 * view.camera.yfov) * height / width)
            view = replace(view, camera=replace(view.camera, yfov=yfov))
        return view

    def pixels(self, samples: Samples, reading: Reading) -> Array:
        """Column and row, row 0 at the top, (N, 2)."""
        # A file whose first row is the bottom one: row r of the array is row height - 1 - r of the image.
        return samples.pixels * [1, -1] + [0, self.sequence.size[1] - 1] if reading.rows else samples.pixels

    def points(self, samples: Samples, reading: Reading, view: View, position: Array | None) -> Array:
        """Surface points, relative to the camera of ``view``, world axes, (N, 3) meters; no ``position``: of depth."""
        mapping = self.sequence.mapping
        if position is None:
            depth, kind = samples.depth * reading.factor, reading.depth or self.any_frame.depth_kind
            offset = self.any_frame.depth_offset * reading.factor
            return points_at(view, self.pixels(samples, reading), depth, kind, self.sequence.size, offset)
        points = self.turned(position * reading.factor, reading)
        space = reading.positions or mapping.positions
        if space == "view":
            return points @ view.world_from_view.T
        return points - view.position if space == "world" else points

    def turned(self, vectors: Array, reading: Reading) -> Array:
        """Vectors (..., 3) that the mapping turned to glTF axes, turned as ``reading`` says."""
        if not reading.up:
            return vectors
        return vectors @ to_y_up(np.eye(3), self.sequence.mapping.up).T @ to_y_up(np.eye(3), reading.up)

    def misplaced(self, number: int, reading: Reading, *, few: bool = False) -> Array | None:
        """Projections of the position pass minus their pixels, (N, 2); None without a view or samples."""
        view, samples = self.view(number, reading), (self.few if few else self.placed)[number]
        if few and len(samples.at) < FEW_PIXELS:
            samples = self.placed[number]
        if view is None or not len(samples.at):
            return None
        points = self.points(samples, reading, view, samples.position)
        return project(view, points, self.sequence.size, relative=True) - self.pixels(samples, reading)

    def pair(self, first: int, reading: Reading) -> tuple[int, int]:
        """Current and previous file of files ``first`` and ``first + 1``."""
        return (first, first + 1) if reading.order in BACKWARDS else (first + 1, first)

    def moved(self, first: int, reading: Reading, basis: str, *, few: bool = False) -> Array | None:
        """Motion of the surface points of a pair by ``basis``, (N, 2) pixels, NaN: unknown; None without views."""
        samples = (self.few if few else self.every)[self.pair(first, reading)[0]]
        if basis == SCENE:
            return self.of_scene("motion", self.pair(first, reading)[0], samples, reading)
        view, before = (self.view(number, reading) for number in self.pair(first, reading))
        if view is None or before is None:
            return None
        size, points = self.sequence.size, self.points(samples, reading, view, samples.position)
        there = points + (view.position - before.position)
        if basis == PREVIOUS:
            there = self.points(samples, reading, before, samples.prev_position)
        # Both ends are projected: the samples of a jittered frame are not at the pixel centers.
        return project(before, there, size, relative=True) - project(view, points, size, relative=True)

    def of_scene(self, name: str, number: int, samples: Samples, reading: Reading) -> Array | None:
        """An array of the truth of file ``number`` at ``samples``, (N, ...); None without truth."""
        if number not in self.truth:
            return None
        column, row = self.pixels(samples, reading).astype(int).T
        return getattr(self.truth[number], name)[row, column]

    def image(self, samples: Samples, values: Array | None, components: int = 2) -> Array:
        """``values`` (N, components) at their pixels, (h * w, components); NaN elsewhere, everywhere for None."""
        out = np.full((self.any_frame.sky.size, components), np.nan)
        if values is not None:
            out[samples.at] = values
        return out

    def motion(self, samples: Samples, readings: Sequence[Reading]) -> Array:
        """The motion pass by each reading, (K, N, 2) pixels."""
        return corrected_motion(samples.motion, readings, self.sequence.mapping, self.sequence.size)


def _flipped(frame: PathTracedFrame) -> PathTracedFrame:
    """The frame's geometry with its rows in reverse order."""
    names = [name for name in ("position", "depth", "sky") if getattr(frame, name) is not None]
    return replace(frame, **{name: getattr(frame, name)[::-1] for name in names})
