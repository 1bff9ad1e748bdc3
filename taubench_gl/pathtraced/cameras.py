"""Where the camera of a path-traced sequence was: a sidecar, a scene file, or a fit to the position pass."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np

from taubench_gl.animation import CameraTrack, Poser, View
from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced.camera_file import CameraFile, CameraPose, read_camera_file
from taubench_gl.pathtraced.fit import fit_camera
from taubench_gl.pathtraced.passes import PathTracedFrame
from taubench_gl.scene.model import Camera, Scene

CHECK_POINTS = 4000
MATCH_PX = 0.5
"""A camera whose projection of the position pass is farther off (median) is not the one that took the picture."""


class PathTracedCamera(Protocol):
    """Gives the view of every frame; ``describe`` says where it comes from."""

    def describe(self) -> str: ...

    def view(self, number: int, frame: PathTracedFrame) -> View: ...


class SidecarCamera:
    """Poses of a JSON sidecar (``pathtraced.camera_file``)."""

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self.file: CameraFile = read_camera_file(path)

    def describe(self) -> str:
        return f"camera file {self.path.name}"

    def view(self, number: int, frame: PathTracedFrame) -> View:
        if number not in self.file.poses:
            low, high = min(self.file.poses), max(self.file.poses)
            raise PathTracedError(f"has no frame {number}", where=str(self.path), hint=f"it has {low} to {high}")
        if self.file.size is not None and self.file.size != frame.size:
            got, expected = ("x".join(map(str, size)) for size in (self.file.size, frame.size))
            raise PathTracedError(f"is for {got} pixels, the files have {expected}", where=str(self.path))
        return view_of(self.file.poses[number])


class SceneCamera:
    """The camera of a scene file: frame i at i / fps seconds, shifted by ``offset`` frames."""

    def __init__(self, scene: Scene, track: CameraTrack, fps: float):
        self._poser, self._track, self._fps = Poser(scene), track, fps
        self.offset = 0

    def describe(self) -> str:
        shift = f", frame {-self.offset} at 0 s" if self.offset else ""
        return f"{self._track.describe()} of the scene file{shift}"

    def view(self, number: int, frame: PathTracedFrame) -> View:
        return self._track.view_at(self._poser.sample((number + self.offset) / self._fps))

    def settle(self, number: int, frame: PathTracedFrame) -> None:
        """Programs count frames from 0 or from 1: take the offset that explains the positions, 0 if it does."""
        if frame.position is None or mismatch_px(self.view(number, frame), frame) <= MATCH_PX:
            return
        errors = {}
        for self.offset in (-1, 1):
            errors[self.offset] = mismatch_px(self.view(number, frame), frame)
        best = min(errors, key=errors.get)
        self.offset = best if errors[best] <= MATCH_PX else 0


class FittedCamera:
    """One fit per frame."""

    def __init__(self) -> None:
        self._worst = 0.0
        self._last = ""

    def describe(self) -> str:
        return f"{self._last or 'estimated from the position pass'}; worst frame {self._worst:.2g} px"

    def view(self, number: int, frame: PathTracedFrame) -> View:
        if frame.position is None:
            raise PathTracedError(
                f"frame {number} has no position pass to estimate a camera from",
                hint="give --camera-file or --scene-file",
            )
        if frame.relative:
            raise PathTracedError(
                f"frame {number} has positions relative to a camera that is not known", hint="give --camera-file"
            )
        depth = frame.depth if frame.depth_kind == "planar" else None
        fit = fit_camera(frame.position, frame.sky, depth, where=f"frame {number}")
        self._worst, self._last = max(self._worst, fit.median_px), fit.describe()
        return view_of(fit.pose)


def view_of(pose: CameraPose) -> View:
    """The View of a sidecar's or a fit's pose."""
    camera = Camera(kind=pose.kind, yfov=pose.yfov, xmag=pose.ymag, ymag=pose.ymag, znear=pose.znear, zfar=pose.zfar)
    return View(pose.position, pose.world_from_view, camera)


def in_world(frame: PathTracedFrame, view: View) -> PathTracedFrame:
    """The frame with world positions (rounded to float32 there), where they are relative to ``view``; else itself."""
    if not frame.relative or frame.position is None:
        return frame
    position = (frame.position.astype(np.float64) + view.position).astype(np.float32)
    return replace(frame, position=position, prev_position=None, relative=False)


def mismatch_px(view: View, frame: PathTracedFrame) -> float:
    """Median distance between each pixel's centre and where ``view`` projects its position.  inf: nothing in front."""
    width, height = frame.size
    rows, columns = np.nonzero(~frame.sky & np.isfinite(frame.position).all(axis=-1))
    if not len(rows):
        return 0.0
    thin = slice(None, None, max(1, len(rows) // CHECK_POINTS))
    rows, columns = rows[thin], columns[thin]
    relative = frame.position[rows, columns].astype(np.float64) - (0.0 if frame.relative else view.position)
    clip = np.column_stack([relative, np.ones(len(relative))]) @ view.clip_from_relative(width, height).T
    front = clip[:, 3] > 0
    if np.mean(front) < 0.5:
        return float("inf")
    ndc = clip[front, :2] / clip[front, 3:]
    x = (ndc[:, 0] + 1.0) * 0.5 * width - 0.5 - columns[front]
    y = (1.0 - ndc[:, 1]) * 0.5 * height - 0.5 - rows[front]
    return float(np.median(np.hypot(x, y)))


def check_camera(camera: PathTracedCamera, number: int, frame: PathTracedFrame) -> float | None:
    """Median pixels by which the camera misses the position pass; None without one.

    Raises PathTracedError above MATCH_PX: masks of a camera that did not take the pictures would mean nothing.
    """
    if isinstance(camera, SceneCamera):
        camera.settle(number, frame)
    if frame.position is None:
        return None
    error = mismatch_px(camera.view(number, frame), frame)
    if error > MATCH_PX:
        off = "everything it sees lies behind it" if error == float("inf") else f"median {error:.3g} px off"
        raise PathTracedError(
            f"{camera.describe()} does not match the position pass of frame {number}: {off}",
            hint="check the file, --fps, the frame numbers and the mapping's 'up'; or leave the camera to be estimated",
        )
    return error
