"""Cameras of path-traced sequences: a JSON sidecar, the camera of a scene file, or a fit to the position pass.

Sidecar (schema ``taubench-gl/camera/1``), glTF axes (+Y up, the camera looks along its local -Z), meters, radians::

    {"schema": "taubench-gl/camera/1", "fps": 24.0, "width": 320, "height": 180,
     "camera": {"kind": "perspective", "yfov": 0.8, "znear": 0.1, "zfar": null},
     "frames": {"12": {"world_from_view": [[...], [...], [...], [...]]},
                "13": {"position": [x, y, z], "rotation": [x, y, z, w], "yfov": 0.7}}}

Each frame has ``world_from_view`` (4x4, rows) or ``position`` and ``rotation`` (xyzw), and may override the keys of
``camera``.  ``kind`` is perspective (``yfov``) or orthographic (``ymag``, half the height in meters).  ``zfar`` null is
infinity.  ``fps``, ``width`` and ``height`` are optional.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from msgspec import Meta, Struct

from taubench_gl import math3d
from taubench_gl.animation import CameraTrack, Poser, View
from taubench_gl.data_files import convert, one_line, read_json
from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced.fit import fit_camera
from taubench_gl.pathtraced.passes import PathTracedFrame
from taubench_gl.scene.model import Camera, Scene

Array = np.ndarray
Row = tuple[float, float, float, float]
CAMERA_SCHEMA = "taubench-gl/camera/1"
CAMERA_FILE = "camera.json"
"""Name of the sidecar in a folder of frames."""

MAX_MISMATCH_PX = 0.5
"""A camera whose projection of the position pass is farther off than this (median, pixels) did not render the files."""

RATES = (24.0, 30.0, 60.0, 25.0, 50.0, 12.0, 15.0, 48.0, 72.0, 90.0, 120.0, *(n * 1000 / 1001 for n in (24, 30, 60)))
"""Frame rates that are tried where the rate of a scene's camera does not fit, the first of equal ones preferred."""

SAME_DEPTH = 0.01
"""Relative difference up to which depth is that of positions."""

PLACED_PX = 0.05
"""Residuals below this, pixels, are equal: rounding of positions."""

_INTRINSICS = ("yfov", "ymag", "znear", "zfar")
_CHECK_POINTS = 4000
_ORTHOGRAPHIC_ZFAR = 1e4  # meters, where a sidecar gives none: an orthographic projection needs a far plane


@dataclass(frozen=True, slots=True)
class CameraFile:
    """Contents of a sidecar."""

    views: dict[int, View]  # by frame number
    matrices: dict[int, Array]  # world_from_view as the file has it, (4, 4) float64, by frame number
    fps: float | None = None
    size: tuple[int, int] | None = None  # width, height in pixels


class _Entry(Struct):
    """A frame of a sidecar, with the keys that all frames share."""

    world_from_view: tuple[Row, Row, Row, Row] | None = None
    position: tuple[float, float, float] | None = None
    rotation: Row | None = None
    kind: Literal["perspective", "orthographic"] = "perspective"
    yfov: float | None = None
    ymag: float | None = None
    znear: float | None = None
    zfar: float | None = None
    shift: float | None = None


class _Sidecar(Struct):
    schema: Literal["taubench-gl/camera/1"]
    frames: Annotated[dict[Annotated[str, Meta(pattern="^-?[0-9]{1,9}$")], dict[str, Any]], Meta(min_length=1)]
    camera: dict[str, Any] = {}
    fps: float | None = None
    width: float | None = None
    height: float | None = None


def read_camera_file(path: str | Path) -> CameraFile:
    """Read a sidecar.  Raises PathTracedError with the faulty key, or a JSON pointer to the faulty frame."""
    hint = "give a camera file, as 'reference render' writes it"
    values = read_json(path, fault=PathTracedError, hint=hint)
    with one_line(path, PathTracedError, hint=hint):
        file = convert(values, _Sidecar)
    views, matrices = {}, {}
    for number, frame in file.frames.items():
        where = f"{path}#/frames/{number}"
        with one_line(where, PathTracedError):
            entry = convert(file.camera | frame, _Entry)
        view = views[int(number)] = _read_view(entry, where)
        matrix = entry.world_from_view or math3d.affine(view.world_from_view, view.position)
        matrices[int(number)] = np.asarray(matrix, dtype=np.float64)
    size = None if file.width is None or file.height is None else (int(file.width), int(file.height))
    return CameraFile(views, matrices, file.fps, size)


def camera_file_text(views: Mapping[int, View], fps: float, size: tuple[int, int]) -> str:
    """The sidecar of ``views`` (by frame number) as JSON.  ``size``: width, height in pixels."""
    frames = {str(frame): camera_entry(view) for frame, view in sorted(views.items())}
    head = {"schema": CAMERA_SCHEMA, "fps": fps, "width": size[0], "height": size[1]}
    return json.dumps(head | {"frames": frames}, indent=1) + "\n"


def camera_entry(view: View) -> dict[str, Any]:
    """One view as the sidecar has it: ``world_from_view``, ``kind``, ``yfov`` or ``ymag``, ``znear``, ``zfar``.

    ``shift`` only where there is one (``View.shift``).
    """
    camera = view.camera
    lens = {"yfov": camera.yfov} if camera.kind == "perspective" else {"ymag": camera.ymag}
    matrix = math3d.affine(view.world_from_view, view.position).tolist()
    shift = {"shift": view.shift} if view.shift else {}
    zfar = camera.zfar if math.isfinite(camera.zfar) else None
    return {"world_from_view": matrix, "kind": camera.kind, **lens, "znear": camera.znear, "zfar": zfar} | shift


def _read_view(entry: _Entry, where: str) -> View:
    if entry.world_from_view is not None:
        matrix = np.array(entry.world_from_view)
        rotation, position = matrix[:3, :3], matrix[:3, 3]
    elif entry.position is not None and entry.rotation is not None:
        position, rotation = np.array(entry.position), math3d.mat3_from_quat(np.array(entry.rotation))
    else:
        raise PathTracedError("has no pose", where=where, hint="give world_from_view, or position and rotation")
    if abs(np.linalg.det(rotation) - 1) > 1e-3 or np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3:
        hint = "right-handed and without scale; -Z looks forward"
        raise PathTracedError("is not a rotation", where=where, hint=hint)
    intrinsics = {name: value for name in _INTRINSICS if (value := getattr(entry, name)) is not None}
    lens, most, unit = ("yfov", math.pi, "radians") if entry.kind == "perspective" else ("ymag", math.inf, "meters")
    if not 0 < intrinsics.get(lens, 0.0) < most:
        hint = f"give {unit} between 0 and {most:g}"
        raise PathTracedError(f"{lens} is {intrinsics.get(lens, 'missing')}", where=where, hint=hint)
    if entry.kind == "orthographic":
        intrinsics.setdefault("zfar", _ORTHOGRAPHIC_ZFAR)
        intrinsics["xmag"] = intrinsics["ymag"]
    camera = Camera(kind=entry.kind, **intrinsics)
    if not 0 <= camera.znear < camera.zfar:
        raise PathTracedError(f"znear {camera.znear} is not below zfar {camera.zfar}", where=where)
    return View(position, math3d.orthonormal(rotation), camera, shift=entry.shift or 0.0)


class PathTracedCamera(Protocol):
    """Gives the view of every frame."""

    def describe(self) -> str:
        """Text for the summary: where the camera comes from."""

    def _view(self, number: int, frame: PathTracedFrame) -> View:
        """The view of frame ``number`` with the principal point in the image center.  Raises PathTracedError."""

    def view(self, number: int, frame: PathTracedFrame) -> View:
        """The view of frame ``number``, with the principal point of the mapping.  Raises PathTracedError."""
        view, (right, down) = self._view(number, frame), frame.mapping.principal_point
        return replace(view, principal_px=(right, -down)) if right or down else view

    def place(self, number: int, frame: PathTracedFrame) -> None:
        """Find out by a frame with surfaces where the camera's time begins, if that is not known yet."""

    def advice(self, number: int, frame: PathTracedFrame) -> str:
        """What would make the camera match the positions of frame ``number``, as a sentence; "" where nothing does."""
        return ""


class SidecarCamera(PathTracedCamera):
    """Views of a JSON sidecar."""

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self.file = read_camera_file(path)

    def describe(self) -> str:
        return f"camera file {self.path.name}"

    def _view(self, number: int, frame: PathTracedFrame) -> View:
        if number not in self.file.views:
            low, high = min(self.file.views), max(self.file.views)
            raise PathTracedError(f"has no frame {number}", where=str(self.path), hint=f"it has {low} to {high}")
        if self.file.size is not None and self.file.size != frame.size:
            camera_size, file_size = ("x".join(map(str, size)) for size in (self.file.size, frame.size))
            raise PathTracedError(f"is for {camera_size} pixels, the files have {file_size}", where=str(self.path))
        return self.file.views[number]

    def advice(self, number: int, frame: PathTracedFrame) -> str:
        fitting = [n for n, view in self.file.views.items() if n != number and residual(view, frame).fits]
        return f"the pose of frame {min(fitting, key=lambda n: abs(n - number))} fits" if fitting else ""


class SceneCamera(PathTracedCamera):
    """The camera of a scene file.  Frame i is at (i + ``offset``) / fps seconds."""

    def __init__(self, scene: Scene, track: CameraTrack, fps: float):
        self.scene, self.track, self._fps = scene, track, fps
        self._poser, self.offset, self._placed = Poser(scene, fps), 0, False

    def describe(self) -> str:
        shift = f", frame {-self.offset} at 0 s" if self.offset else ""
        return f"{self.track.describe()} of the scene file{shift}"

    def _view(self, number: int, frame: PathTracedFrame) -> View:
        return self.track.view_at(self._poser.sample((number + self.offset) / self._fps))

    def place(self, number: int, frame: PathTracedFrame) -> None:
        """Set the offset that explains the position pass: programs count frames from 0 or from 1.  Default: 0."""
        if not self._placed and residual(self.view(number, frame), frame) is not None:
            _, self.offset = self._fitting(number, frame, (self._fps,)) or (self._fps, 0)
            self._placed = True

    def _fitting(self, number: int, frame: PathTracedFrame, rates: Sequence[float]) -> tuple[float, int] | None:
        """The rate and the offset that explain frame ``number`` best, the first of equal ones; None: none does."""
        found = {}
        for tried in ((fps, offset) for offset in (0, -1, 1) for fps in rates):
            other = SceneCamera(self.scene, self.track, tried[0])
            other.offset = tried[1]
            found[tried] = residual(other.view(number, frame), frame)
        best = min(found, key=lambda tried: max(found[tried].median_px, PLACED_PX))
        return best if found[best].fits else None

    def advice(self, number: int, frame: PathTracedFrame) -> str:
        best = self._fitting(number, frame, RATES)
        return f"--fps {best[0]:.6g} fits" if best else ""


class FittedCamera(PathTracedCamera):
    """Estimated from the position pass, each frame on its own."""

    def __init__(self) -> None:
        self._worst = 0.0
        self._last = ""

    def describe(self) -> str:
        return f"{self._last or 'estimated from the position pass'}; worst frame {self._worst:.2g} px"

    def _view(self, number: int, frame: PathTracedFrame) -> View:
        if frame.position is None:
            message = f"frame {number} has no position pass to estimate a camera from"
            raise PathTracedError(message, hint="give --camera-file or --scene-file")
        if frame.relative:
            message = f"frame {number} has positions relative to a camera that is not known"
            raise PathTracedError(message, hint="give --camera-file")
        planar = frame.depth is not None and frame.depth_kind == "planar"
        depth = frame.depth + np.float32(frame.depth_offset) if planar else None
        fit = fit_camera(frame.position, frame.sky, depth, f"frame {number}", frame.mapping.principal_point)
        if frame.half_position and fit.median_px > PLACED_PX:
            message = f"positions of frame {number} are half floats, too coarse to estimate a camera from"
            raise PathTracedError(message, hint="give --camera-file or --scene-file")
        self._worst, self._last = max(self._worst, fit.median_px), fit.describe()
        return fit.view


def relative_position(frame: PathTracedFrame, view: View) -> tuple[Array, Array]:
    """Surface points minus the camera position, world axes, (h, w, 3), and planar depth, (h, w); float64, meters.

    Without a position pass, or with one of half floats beside finer depth, points are reconstructed from depth.  Raises
    PathTracedError where such depth is not that of the positions.
    """
    forward, planar = -view.world_from_view[:, 2], None
    if frame.position is not None:
        relative = frame.position.astype(np.float64) - (0.0 if frame.relative else view.position)
        with np.errstate(invalid="ignore"):  # where the sky is infinitely far
            planar = relative @ forward
        if not (frame.half_position and frame.finer_depth):
            return relative, planar
    height, width = frame.depth.shape
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    depth = frame.depth.astype(np.float64)
    relative = points_at(view, pixels, depth, frame.depth_kind, frame.size, frame.depth_offset)
    found = relative @ forward
    if planar is not None:
        off, far = (float(np.nanmedian(values[~frame.sky])) for values in (np.abs(found - planar), np.abs(planar)))
        if off > 4.0 * rounding_m(frame) + SAME_DEPTH * far:
            message = f"depth is {off:.3g} m (median) off that of the positions, which are half floats"
            hint = "set depth in the mapping to the kind that 'check' names, or do not name it"
            raise PathTracedError(message, hint=hint)
    return relative, found


def points_at(view: View, pixels: Array, depth: Array, kind: str, size: tuple[int, int], offset: float = 0.0) -> Array:
    """Points (..., 3) that ``pixels`` (..., 2; column, row) show at ``depth`` (...), which is planar or a distance.

    ``offset``: planar distance in front of the camera where depth starts, as renderers with a near plane store it.
    Relative to the camera of ``view``, world axes, float64, meters.
    """
    view_from_clip = np.linalg.inv(view.clip_from_view(*size))
    x, y = (2.0 * pixels[..., 0] + 1.0) / size[0] - 1.0, 1.0 - (2.0 * pixels[..., 1] + 1.0) / size[1]
    points = np.stack(np.broadcast_arrays(x, y, 0.5, 1.0), axis=-1) @ view_from_clip.T
    points = points[..., :3] / points[..., 3:]
    if view.camera.kind == "perspective":
        scale = np.linalg.norm(points, axis=-1) if kind == "distance" else -points[..., 2]
        points = points * (depth / scale - offset / points[..., 2])[..., None]
    else:
        points = np.concatenate([points[..., :2], -depth[..., None] - offset], axis=-1)
    with np.errstate(invalid="ignore"):  # where the sky is infinitely far
        return points @ view.world_from_view.T


def project(view: View, points: Array, size: tuple[int, int], *, relative: bool = False) -> Array:
    """Pixel coordinates (column, row) of (..., 3) points; pixel centers are integers.  (..., 2) float64, NaN behind.

    ``points`` are in world axes, relative to the camera position if ``relative``.
    """
    width, height = size
    offsets = points.astype(np.float64) - (0.0 if relative else view.position)
    matrix = view.clip_from_relative(width, height)
    clip = offsets @ matrix[:, :3].T + matrix[:, 3]
    ndc = clip[..., :2] / np.where(clip[..., 3:] > 0, clip[..., 3:], np.nan)
    return (ndc * [1.0, -1.0] + 1.0) * 0.5 * np.array(size) - 0.5


@dataclass(frozen=True, slots=True)
class Residual:
    """How far the positions of a frame project from the pixel centers that show them, pixels, +x right, +y down."""

    median_px: float  # median length; inf: most points are behind the camera
    offset_px: tuple[float, float]  # median, of the whole image
    spread_px: float  # median length without ``offset_px``: samples differ from pixel to pixel
    rounding_px: float = 0.0  # of half-float positions

    @property
    def fits(self) -> bool:
        """Whether the camera can have rendered the frame."""
        return self.median_px <= MAX_MISMATCH_PX + self.rounding_px

    @property
    def whole_px(self) -> tuple[int, int]:
        """The move of the principal point, right and down, by which the camera would fit; (0, 0): there is none."""
        whole = -np.round(self.offset_px) + 0.0
        left = np.hypot(*(self.offset_px + whole)) + self.spread_px
        return tuple(whole.astype(int).tolist()) if not self.fits and left <= MAX_MISMATCH_PX else (0, 0)

    def describe(self) -> str:
        """What is wrong with a frame that does not fit."""
        if not math.isfinite(self.median_px):
            return "its points are behind the camera"
        common = "all by {:+.2f}, {:+.2f}".format(*self.offset_px)
        return f"median {self.median_px:.3g} px off" + f" ({common} px right, down)" * any(self.whole_px)


def residual(view: View, frame: PathTracedFrame) -> Residual | None:
    """``Residual`` of a frame and the camera of ``view``; None without positions of surfaces.

    Positions of half floats may be off by their rounding too.
    """
    if frame.position is None:
        return None
    rows, columns = np.nonzero(~frame.sky & np.isfinite(frame.position).all(axis=-1))
    step = max(1, len(rows) // _CHECK_POINTS)
    rows, columns = rows[::step], columns[::step]
    at = project(view, frame.position[rows, columns], frame.size, relative=frame.relative)
    offsets = at - np.stack([columns, rows], axis=-1)
    if not len(offsets):
        return None
    front = np.isfinite(offsets).all(axis=-1)
    if np.mean(front) < 0.5:
        return Residual(math.inf, (0.0, 0.0), 0.0)
    offsets = offsets[front]
    offset = np.median(offsets, axis=0)
    rounding = _rounding_px(view, frame) if frame.half_position else 0.0
    median, spread = (float(np.median(np.hypot(*each.T))) for each in (offsets, offsets - offset))
    return Residual(median, tuple((offset + 0.0).tolist()), spread, rounding)


def rounding_m(frame: PathTracedFrame) -> float:
    """Median rounding error of the frame's positions if they are half floats, meters."""
    stored = np.abs(frame.position[~frame.sky & np.isfinite(frame.position).all(axis=-1)])
    return float(np.median(np.linalg.norm(0.5 * np.spacing(stored.astype(np.float16)).astype(np.float64), axis=-1)))


def _rounding_px(view: View, frame: PathTracedFrame) -> float:
    width, height = frame.size
    forward = (frame.position[~frame.sky] - (0.0 if frame.relative else view.position)) @ -view.world_from_view[:, 2]
    depth = 1.0 if view.camera.parallel else max(float(np.nanmedian(forward)), 1e-6)
    return rounding_m(frame) * 0.5 * height * float(view.clip_from_view(width, height)[1, 1]) / depth


def checked_view(camera: PathTracedCamera, number: int, frame: PathTracedFrame) -> tuple[View, Residual | None]:
    """The view of frame ``number`` and its ``Residual``; None without positions of surfaces.

    Raises PathTracedError above the residual's limit: the masks of another camera would be meaningless.
    """
    camera.place(number, frame)
    view = camera.view(number, frame)
    found = residual(view, frame)
    if found is None or found.fits:
        return view, found
    hint = "check the file, --fps, the frame numbers and the mapping's 'up'; or leave the camera to be estimated"
    if advice := camera.advice(number, frame):
        hint = f"{advice}; {hint}"
    elif any(found.whole_px):
        point = [a + b for a, b in zip(frame.mapping.principal_point, found.whole_px, strict=True)]
        hint = f"if every frame is off by as much, set principal_point = {point} in the mapping"
    message = f"{camera.describe()} does not match the position pass of frame {number}: {found.describe()}"
    raise PathTracedError(message, hint=hint)
