"""Recorded cameras: the path of a file in meters, with the axes of glTF, and the camera that plays it in a scene."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation.curves import key_tolerance, segment, slerp
from taubench_gl.animation.recorded import Choices, Poses, read_poses
from taubench_gl.animation.state import FrameState, View
from taubench_gl.camera_path_settings import AXES, NODE, START, WORLD, CameraPathSettings
from taubench_gl.errors import SceneError, SettingsError, choice_hint, printable
from taubench_gl.metrics.activity import euler_yxz
from taubench_gl.scene.model import Scene

Array = np.ndarray

MOST_OFF, NOTED_OFF = 0.05, 2e-3
"""Difference of a length from 1 that is an error, or a note; numbers of three decimals differ by up to 1e-3."""

GAP_STEPS = 4.0
"""Median steps above which samples are missing."""

STEEP, TURN, ROLL = 80.0, 90.0, 5.0
"""Degrees: pitch, step and range of roll that a head rarely has."""


@dataclass(frozen=True, slots=True)
class RecordedPath:
    """N >= 2 samples of a camera, in meters; +Y up, the camera looks along its -Z.

    At the end of a gap that is not bridged two samples have one time: the last pose before it, and the first after it.
    """

    name: str  # of the file, with its format
    taken: str  # what was read, one line
    notes: tuple[str, ...]  # on what is unusual
    rate: float  # distinct samples per second
    times: Array  # (N,) seconds from 0, ascending
    position: Array  # (N, 3)
    rotation: Array  # (N, 4) unit xyzw, world_from_view
    yfov: Array | None  # (N,) radians; None: the file has no lens
    cuts: Array  # seconds of the jumps that are cuts

    @property
    def fps(self) -> float:
        """The median rate of the samples, 1/s."""
        steps = np.diff(self.times)
        return float(1.0 / np.median(steps[steps > 0]))


class RecordedCamera:
    """A camera that follows ``path``: rotation by slerp along the shorter arc, position linear; the ends hold.

    ``place``: of ``CameraPathSettings``; ``base``: the view of the scene's camera at time 0, which has place and lens;
    ``unit_scale``: scene units per meter.  Raises SettingsError for a place that is not known.
    """

    def __init__(self, scene: Scene, path: RecordedPath, place: str, base: View, unit_scale: float = 1.0):
        self.path, self.base, self.name = path, base, printable(f"recorded camera {path.name}")
        self.duration = float(path.times[-1])
        self.node = None  # whose space the path is in; None: the world
        self._turn, self._shift = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3)
        if place == START:
            first = math3d.mat3_from_quat(path.rotation[0])
            turn = euler_yxz(base.world_from_view)[0] - euler_yxz(first)[0]
            self._turn = math3d.quat_from_axis_angle(np.eye(3)[1], turn)
            self._shift = base.position - unit_scale * math3d.mat3_from_quat(self._turn) @ path.position[0]
        elif place != WORLD:
            names = [f"{NODE}{name}" for name in scene.nodes.names]
            if place not in names:
                hint = choice_hint(place, (START, WORLD, *names))
                raise SettingsError(
                    f"no place {place!r} in scene {scene.name!r}", hint=hint, setting="camera_path_place"
                )
            self.node = names.index(place)
        self._linear = unit_scale * math3d.mat3_from_quat(self._turn)

    def describe(self) -> str:
        """Short description of the camera, for messages."""
        return self.name

    def placed(self) -> tuple[Array, Array]:
        """Positions (N, 3), scene units, and quaternions (N, 4) of the samples, in the space of ``node``."""
        rotation = math3d.quat_multiply(self._turn, self.path.rotation)
        return self.path.position @ self._linear.T + self._shift, rotation

    def view_at(self, state: FrameState) -> View:
        """The view at ``state.time``."""
        path, lens = self.path, self.base.camera
        i, j, u, _ = segment(path.times, state.time, math.inf)  # samples are no keys of frames
        linear, shift = self._linear, self._shift
        if self.node is not None:
            world = state.world[self.node]
            linear, shift = world[:3, :3] @ linear, world[:3, 3]
        if path.yfov is not None:
            lens = replace(lens, kind="perspective", yfov=float(path.yfov[i] + u * (path.yfov[j] - path.yfov[i])))
        position = path.position[i] + u * (path.position[j] - path.position[i])
        rotation = math3d.mat3_from_quat(slerp(path.rotation[i], path.rotation[j], np.float64(u)))
        return View(linear @ position + shift, math3d.orthonormal(linear @ rotation), lens)

    def cut_frames(self, frames: range, fps: float) -> list[int]:
        """The frames among ``frames`` in whose pair the camera jumps over missing samples."""
        jumps = {math.ceil((t - key_tolerance(t, math.inf)) * fps) for t in self.path.cuts.tolist()}
        return sorted(jumps & set(frames[1:]))

    def notes(self, fps: float) -> list[str]:
        """What was read, and what to look at in a run at ``fps``."""
        path, notes = self.path, [self.path.taken, *self.path.notes]
        if fps > 1.01 * path.rate:
            text = f"{fps:g} fps are more than the {path.rate:.4g} distinct samples a second of {path.name}"
            notes.append(f"{text}: frames between them are interpolated, and variances are of the samples")
        return notes


def read_camera_path(options: CameraPathSettings) -> RecordedPath:
    """The path of ``camera_path``.  Raises SceneError that names line or key, SettingsError for a missing option."""
    path = Path(options.camera_path or "")
    choices = Choices(options, path)
    poses = read_poses(path, choices)
    times = _seconds(poses, choices) / options.camera_path_speed
    proper, off = _proper(poses)
    axes = choices("axes", "" if poses.format.axes else "the convention of the camera's axes") or poses.format.axes
    up = choices("up", "" if poses.format.up else "the axis that points up") or poses.format.up
    choices.require_used()
    last = np.append(np.diff(times) > 0, True)  # of samples at one time
    if np.count_nonzero(last) < 2:
        what = f"holds {np.count_nonzero(last)} poses"
        raise SceneError(what, where=path.name, hint="a camera path needs at least two, of different times")
    position, rotation = (each[last] for each in _in_gl(poses, proper, axes, up, options.camera_path_scale))
    times, yfov = times[last], None if poses.yfov is None else poses.yfov[last]
    raw = np.column_stack([poses.position, poses.rotation.reshape(len(last), -1)])[last]
    moved = np.any(np.diff(raw, axis=0), axis=1)
    distinct, step = times[np.append(True, moved)], np.diff(times)
    rate = 1.0 / float(np.median(np.diff(distinct))) if len(distinct) > 1 else 0.0
    gaps = np.flatnonzero(step > GAP_STEPS * np.median(step))
    jumps = gaps if options.camera_path_gaps != "slerp" else gaps[:0]
    flips = np.sum(poses.rotation[1:] * poses.rotation[:-1], axis=1) < 0 if poses.rotation.ndim == 2 else []
    direction = "world to camera" if poses.format.inverse else "camera to world"
    unit = "no positions" if not poses.format.position else "meters" if poses.format.scale else "of unknown scale"
    taken = (
        f"{path.name}: {poses.format.name}, {axes} axes, {up} up, {direction}, {unit}; {len(times)} samples in "
        f"{times[-1]:.4g} s, {1.0 / np.median(step):.4g} a second, {len(distinct)} distinct; "
        f"{len(gaps)} gaps, {len(moved) - moved.sum()} repeats, {len(last) - len(times)} superseded, "
        f"{np.count_nonzero(flips)} flips of sign"
    )
    q = math3d.quat_from_mat3(rotation)
    q[1:] *= np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0))[:, None]  # one hemisphere
    kept = np.insert(np.arange(len(times)), jumps + 1, jumps)
    return RecordedPath(
        f"{path.name} ({poses.format.name})", printable(taken), tuple(_notes(off, rotation, q)), rate,
        np.insert(times, jumps + 1, times[jumps + 1]), position[kept], q[kept], None if yfov is None else yfov[kept],
        times[jumps + 1] if options.camera_path_gaps == "cut" else times[:0],
    )  # fmt: skip


def _seconds(poses: Poses, choices: Choices) -> Array:
    """Seconds from the first sample, (N,).  Raises SceneError where time runs backward."""
    if poses.times is None:
        return np.arange(len(poses.places)) / (poses.fps or choices("fps", "the rate, samples a second,"))
    for place, time, before in zip(poses.places[1:], poses.times[1:], poses.times):
        if time < before:
            raise SceneError(f"time {time} is before {before}", where=place, hint="times must ascend")
    return np.array([float(time - poses.times[0]) for time in poses.times]) / poses.format.per_second


def _proper(poses: Poses) -> tuple[Array, float]:
    """Proper rotations (N, 3, 3), and the largest difference of a length from 1.  Raises SceneError."""
    quaternions = poses.rotation.ndim == 2
    off = np.abs(np.linalg.norm(poses.rotation, axis=1).reshape(len(poses.places), -1) - 1.0).max(axis=1)
    bad = (off > MOST_OFF) | (not quaternions and np.linalg.det(poses.rotation) < 0.0)
    if np.any(bad):
        what = "quaternion of another length than 1" if quaternions else "matrix that is no rotation"
        raise SceneError(what, where=poses.places[int(np.argmax(bad))])
    if quaternions:
        return math3d.mat3_from_quat(math3d.normalize(poses.rotation)), float(off.max())
    u, _, v = np.linalg.svd(poses.rotation)
    return u @ v, float(off.max())


def _in_gl(poses: Poses, rotation: Array, axes: str, up: str, scale: float) -> tuple[Array, Array]:
    """Positions (N, 3) and world_from_view (N, 3, 3) with the axes of glTF.  ``rotation``: of ``_proper``."""
    position = poses.position
    if poses.format.inverse:
        rotation = np.swapaxes(rotation, 1, 2)
        position = -np.einsum("nij,nj->ni", rotation, position)
    file_from_view = np.stack([_axis(word) for word in AXES[axes].split()], axis=1)
    right = _axis("y" if up[-1] == "x" else "x")
    # Left-handed axes of the camera make the file's world left-handed too.
    back = np.linalg.det(file_from_view) * np.cross(right, _axis(up))
    world_from_file = np.stack([right, _axis(up), back])
    turned = rotation if poses.level else world_from_file @ rotation @ file_from_view
    return scale * position @ world_from_file.T, turned


def _axis(word: str) -> Array:
    return np.eye(3)["xyz".index(word[-1])] * (-1.0 if word[0] == "-" else 1.0)


def _notes(off: float, rotation: Array, q: Array) -> Iterator[str]:
    """What is unusual.  ``off``: of a length from 1; ``rotation`` (N, 3, 3) and ``q`` (N, 4): of the samples."""
    if off > NOTED_OFF:
        yield f"rotations of the camera path are normalized: lengths differ from 1 by up to {off:.2g}"
    angles = np.degrees(np.unwrap(euler_yxz(rotation), axis=0))
    steep = np.mean(np.abs(angles[:, 1]) > STEEP)
    turns = np.count_nonzero(np.degrees(math3d.quat_angle(q[1:], q[:-1])) > TURN)
    _, pitch, roll = np.ptp(np.percentile(angles, (5, 95), axis=0), axis=0)
    if steep >= 0.1:
        yield f"the camera path looks more than {STEEP:g} degrees up or down in {steep:.0%} of it: axes or order?"
    if turns:
        yield f"the camera path turns by more than {TURN:g} degrees in {turns} steps: axes, order or sorting?"
    if roll > max(pitch, ROLL):
        yield f"the camera path rolls by {roll:.3g} degrees and pitches by {pitch:.3g}: axes or order?"
