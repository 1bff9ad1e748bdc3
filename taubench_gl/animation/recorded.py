"""Files of recorded cameras -> poses, in the conventions of their format, which is recognized by content.

TUM              t x y z qx qy qz qw: camera to world, optical axes
KITTI            3x4 matrices by rows: camera to world of the first camera, optical axes, no times
EuRoC            CSV: nanoseconds, x y z, qw qx qy qz of the body, +Z up
COLMAP           images.txt: qw first, world to camera, two lines an image, no times, in no order
transforms.json  camera to world, OpenGL axes, no times, in no order
nerfstudio       camera_path: camera to world by rows, OpenGL axes, vertical field of view in degrees
Open3D           JSON: world to camera by columns; .log: camera to world by rows; optical axes, no times
.chan            frame, tx ty tz, rx ry rz in degrees, and perhaps the vertical field of view
WebXR (iwer)     milliseconds, x y z, qx qy qz qw: OpenGL axes, +Y up
CSV              named columns: time, position, and a quaternion or angles in degrees
CSV, JSON        with the columns or keys ``COLUMNS``: seconds, meters, world_from_view, OpenGL axes, +Y up; JSON is a
                 list of objects, or an object of lists time (N), position (N, 3) and rotation (N, 4)
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl import math3d
from taubench_gl.camera_path_settings import CameraPathSettings
from taubench_gl.data_files import read_json, read_text
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.fields import declared

Array = np.ndarray
Rows = list[tuple[str, list[Any]]]
"""Samples as a file has them: for each, its place in the file, for messages, and its cells."""

Turned = tuple[list[int], Array, str]
"""Columns of three angles in degrees, their signs, and their axes in the order in which they turn."""

HEADING = "ZXY"
"""Axes in the order in which angles turn: roll, then pitch, then heading, as Table 3 has them."""

FORMATS = "TUM, KITTI, EuRoC, COLMAP, transforms.json, nerfstudio, Open3D, .chan, WebXR, CSV with named columns"
MOST = 1e30
"""Bound on the numbers of a file, so that their squares and determinants are finite."""

COLUMNS = ("time", "x", "y", "z", "qx", "qy", "qz", "qw")

_BY_ROWS = (3, 7, 11), (0, 1, 2, 4, 5, 6, 8, 9, 10)
_BY_COLUMNS = (12, 13, 14), (0, 4, 8, 1, 5, 9, 2, 6, 10)


@dataclass(frozen=True, slots=True)
class Format:
    """Conventions of a format; None: its files do not say.

    ``position``, ``rotation``: columns of a sample; a rotation is a quaternion xyzw, a matrix by rows, or angles.
    """

    name: str
    axes: str | None = None  # of the camera, a name of AXES
    up: str | None = None
    position: tuple[int, ...] = (1, 2, 3)
    rotation: tuple[int, ...] = (4, 5, 6, 7)
    width: int = 8  # columns of a sample
    inverse: bool = False  # world to camera
    scale: bool = True  # whether the unit of positions is known
    per_second: float = 1.0  # units of time in a second


TUM = Format("TUM", "optical")
KITTI = Format("KITTI", "optical", "-y", *_BY_ROWS, width=12)
EUROC = Format("EuRoC", None, "+z", per_second=1e9)
COLMAP = Format("COLMAP images.txt", "optical", None, (5, 6, 7), (2, 3, 4, 1), inverse=True, scale=False)
TRANSFORMS = Format("transforms.json", "opengl", "+z", *_BY_ROWS, width=16, scale=False)
NERFSTUDIO = Format("nerfstudio camera path", "opengl", "+z", *_BY_ROWS, width=17, scale=False)
OPEN3D = Format("Open3D JSON", "optical", None, *_BY_COLUMNS, width=18, inverse=True)
OPEN3D_LOG = Format("Open3D .log", "optical", None, *_BY_ROWS, width=16)
CHAN = Format(".chan", "opengl", None, rotation=(4, 5, 6), width=7)
WEBXR = Format("WebXR (iwer)", "opengl", "+y", per_second=1e3)
CSV, OWN = Format("CSV"), Format("columns of this package", "opengl", "+y")

_QUATERNION = "(?:q|quat|quaternion|rot|rotation|orientation|qrs)"
_POSITION, _ANGLES = "(?:p|t|pos|position|translation|prsr)", "(?:r|rot|rotation|euler)"
_TIME = re.compile(r"(?:time|timestamp|t|frame)[\s_]*[\[(]?(s|ms|us|ns)?[\])]?")
_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


@dataclass(frozen=True, slots=True)
class Poses:
    """N poses in the file's world, with the conventions of its format."""

    format: Format
    places: list[str]  # of the samples in the file, for messages
    position: Array  # (N, 3)
    rotation: Array  # (N, 4) xyzw of any length, or (N, 3, 3)
    times: list[Decimal] | None = None
    fps: float | None = None  # samples a second where there are no times
    yfov: Array | None = None  # (N,) radians
    level: bool = False  # whether rotations are in a world with +Y up and OpenGL axes, whatever positions are in


class Choices:
    """What the user says about a file.  Raises SettingsError for what is missing, and for what the file says."""

    def __init__(self, options: CameraPathSettings, path: Path):
        self._options, self._path, self._asked = options, path, set[str]()

    def __call__(self, name: str, missing: str = "") -> Any:
        """The value of ``camera_path_NAME``; ``missing``: what the file does not say, if a value is needed."""
        self._asked.add(name)
        setting = declared(CameraPathSettings)[f"camera_path_{name}"]
        value = getattr(self._options, setting.name)
        if value is None and missing:
            hint = f"give {setting.option}: {setting.meaning}"
            raise SettingsError(f"{missing} is not in the file", where=self._path.name, hint=hint, setting=setting.name)
        return value

    def require_used(self) -> None:
        """Raise for an option that was given and never asked for."""
        for name in {"fps", "order", "body"} - self._asked:
            if self(name) is not None:
                hint = "leave it out: it follows from the file"
                raise SettingsError(f"camera-path-{name} has no effect", where=self._path.name, hint=hint)


def read_poses(path: Path, choices: Choices) -> Poses:
    """Read a file of any format.  Raises SceneError that names the line or key, SettingsError for a missing option."""
    # Open3D does not end the comment of a TUM file: the first pose is on its line.
    text = read_text(path, SceneError).replace("<qw>", "<qw>\n", 1)
    if text.lstrip()[:1] in ("{", "["):
        return _json(path)
    lines = [(f"{path.name}:{i}", line.strip()) for i, line in enumerate(text.splitlines(), 1) if line.strip()]
    rows: Rows = [(place, line.split()) for place, line in lines if line[0] != "#"]
    if len(rows) < 2:
        raise SceneError("holds fewer than two poses", where=path.name, hint=f"give one of {FORMATS}")
    first = next(i for i, (_, line) in enumerate(lines) if line[0] != "#")
    if not _is_number(re.split(r"[,;\s]", lines[first][1])[0]):
        return _csv(lines[first:], choices)
    if first and re.search("[,;]", lines[first][1]):  # the header is a comment
        return _csv(lines[first - 1 :], choices)
    cells = rows[0][1]
    if len(cells) >= 10 and not _is_number(cells[9]):
        # Only lines of images have a name; those of points, which may be missing or empty, have numbers alone.
        images = [(place, row) for place, row in rows if len(row) >= 10 and not _is_number(row[9])]
        images.sort(key=lambda image: _natural(" ".join(image[1][9:])))
        return _poses(COLMAP, [(place, row[:8]) for place, row in images])
    if len(cells) == 3 and [len(row) for _, row in rows[1:5]] == [4] * 4:
        blocks = [rows[i : i + 5] for i in range(0, len(rows), 5)]
        return _poses(OPEN3D_LOG, [(block[0][0], [cell for _, row in block[1:] for cell in row]) for block in blocks])
    if len(cells) == 12:
        return _poses(KITTI, rows)
    if len(cells) == 8 and any(abs(np.linalg.norm(q) - 1.0) < 0.5 for q in _table(rows, 8, TUM.rotation)):
        return _poses(TUM, rows, _times(rows))
    if len(cells) in (7, 8):
        format = replace(CHAN, width=len(cells), per_second=choices("fps", "its rate, frames a second,"))
        yfov = np.radians(_table(rows, 8, (7,))[:, 0]) if len(cells) == 8 else None
        return _poses(format, rows, _times(rows), _angles(choices, {"rx": 4, "ry": 5, "rz": 6}), yfov=yfov)
    raise SceneError(f"is none of {FORMATS}", where=rows[0][0], hint="see docs/camera-paths.md")


def _csv(lines: list[tuple[str, str]], choices: Choices) -> Poses:
    """Poses of a header and its lines."""
    separator = next((mark for mark in ",;\t" if mark in lines[0][1]), None)
    header = [name.strip(' "').lower() for name in lines[0][1].lstrip("#").split(separator)]
    plain = [re.sub(r"\[.*?\]|\(.*?\)|[^a-z0-9]", "", name) for name in header]
    names = {name: plain.index(name) for name in plain if name}
    rows: Rows = [(place, line.split(separator)) for place, line in lines[1:] if line[0] != "#"]

    def columns(prefix: str, letters: str) -> tuple[int, ...]:
        found = {name[-1]: i for name, i in names.items() if re.fullmatch(f"{prefix}[{letters}]", name)}
        return tuple(found[letter] for letter in letters) if len(found) == len(letters) else ()

    format, turned = OWN if set(COLUMNS) <= names.keys() else EUROC if "qrsw" in names else CSV, None
    bare = columns("", "xyzw")  # of a quaternion
    rotation = columns(_QUATERNION, "xyzw") or bare
    if not rotation:
        angles = dict(zip(("rx", "ry", "rz"), columns(_ANGLES, "xyz"), strict=False))
        turned = _angles(choices, names | angles, lines[0][0])
    times = [(i, found[1]) for i, name in enumerate(header) if (found := _TIME.fullmatch(name))]
    if times and format is not EUROC:
        known = times[0][1] or ("s" if format is OWN else None)
        unit = _SECOND[known] if known else choices("fps", "the unit of its times, how many make a second,")
        format = replace(format, per_second=unit)
    position = columns(_POSITION + ("" if bare else "?"), "xyz")
    heading = turned is not None and "," in choices("order")
    if heading:
        format = replace(format, axes="opengl", up=None if position else "+y")
    format = replace(format, position=position, rotation=rotation, width=len(header), scale=bool(position))
    poses = _poses(format, rows, _times(rows, times[0][0]) if times else None, turned, level=heading)
    missing = "" if choices("axes") else "the pose of the camera in the body"
    if "qrsw" not in names or not (body := choices("body", missing)):
        return poses
    matrix = _body(body)
    turn = math3d.quat_multiply(poses.rotation, math3d.quat_from_mat3(matrix[:3, :3]))
    moved = poses.position + math3d.mat3_from_quat(math3d.normalize(poses.rotation)) @ matrix[:3, 3]
    return replace(poses, format=replace(format, axes="optical"), position=moved, rotation=turn)


def _body(text: str) -> Array:
    """Pose of the camera on its body (EuRoC's T_BS), (4, 4): 16 numbers, or those of ``data`` in a sensor.yaml.  Raises
    SceneError.
    """
    found = re.search(r"data:\s*\[([^\]]*)\]", text if "," in text else read_text(text, SceneError))
    return _table([(text, (found[1] if found else text).split(","))], 16, range(16)).reshape(4, 4)


def _angles(choices: Choices, names: Mapping[str, int], where: str = "") -> Turned:
    """Which columns are angles, and how they turn.  Raises SceneError, SettingsError."""
    order = choices("order", "the order of its angles")
    parts = order.lower().split(",")[::-1] if "," in order else [f"r{axis}" for axis in order.lower()]
    columns = [names[part.lstrip("-")] for part in parts if part.lstrip("-") in names]
    if len(parts) != 3 or len(set(columns)) != 3:
        raise SceneError(f"no three columns {order!r:.60}", where=where or None, hint=f"it has {', '.join(names)}")
    signs = [-1.0 if part[0] == "-" else 1.0 for part in parts]
    return columns, np.array(signs), HEADING if "," in order else order


def _json(path: Path) -> Poses:
    data = read_json(path, fault=SceneError)
    keys = set(data) if isinstance(data, dict) else set()

    def rows(key: str, items: Any, row: Callable[[Any], Any]) -> Rows:
        """Numbers of each of ``items``, of which ``row`` picks numbers and lists."""
        out: Rows = []
        for i, item in enumerate(items if isinstance(items, list) else []):
            place = f"{path.name}#/{key}{i}"
            try:
                out.append((place, np.hstack([np.ravel(np.array(part, dtype=object)) for part in row(item)]).tolist()))
            except (KeyError, TypeError, IndexError, ValueError) as error:
                raise SceneError(f"is no pose: {error!s:.60} is missing or no list", where=place) from None
        if not out:
            raise SceneError(f"is none of {FORMATS}", where=path.name, hint="see docs/camera-paths.md")
        return out

    if "schema" in keys:
        found = rows("frames/", data.get("frames"), lambda frame: frame[:8])
        return _poses(WEBXR, found, _times(found))
    if "camera_path" in keys:
        found = rows("camera_path/", data["camera_path"], lambda camera: [camera["camera_to_world"], camera["fov"]])
        fps = None if data.get("fps") is None else _number(data["fps"], f"{path.name}#/fps")
        return _poses(NERFSTUDIO, found, fps=fps, yfov=np.radians(_table(found, 17, (16,))[:, 0]))
    if "parameters" in keys:
        found = rows("parameters/", data["parameters"], lambda view: [
            view["extrinsic"], view["intrinsic"]["height"], view["intrinsic"]["intrinsic_matrix"][4]])  # fmt: skip
        height, focal = _table(found, 18, (16, 17)).T
        return _poses(OPEN3D, found, yfov=2.0 * np.arctan2(0.5 * height, focal))
    if "frames" in keys:
        found = rows("frames/", data["frames"], lambda frame: [frame["transform_matrix"]])
        names = [_natural(str(frame.get("file_path", ""))) for frame in data["frames"]]
        found = [found[i] for i in sorted(range(len(found)), key=names.__getitem__)]
        lens = [_number(data[name], f"{path.name}#/{name}") for name in ("h", "fl_y") if name in keys]
        yfov = np.full(len(found), 2.0 * math.atan2(0.5 * lens[0], lens[1])) if len(lens) == 2 else None
        return _poses(TRANSFORMS, found, yfov=yfov)
    if keys >= {"time", "position", "rotation"}:
        parts = [data[name] for name in ("time", "position", "rotation")]
        if not all(isinstance(part, list) and len(part) == len(parts[0]) for part in parts):
            raise SceneError("needs lists time, position and rotation of one length", where=path.name)
        found = rows("", [*zip(*parts, strict=True)], lambda pose: pose)
    else:
        found = rows("", data, lambda pose: [pose[name] for name in COLUMNS])
    return _poses(OWN, found, _times(found))


def _poses(
    format: Format, rows: Rows, times: list[Decimal] | None = None, turned: Turned | None = None, *,
    fps: float | None = None, yfov: Array | None = None, level: bool = False,
) -> Poses:  # fmt: skip
    """Poses of the columns that ``format`` names, or with angles ``turned``.  Raises SceneError."""
    if turned is None:
        rotation = _table(rows, format.width, format.rotation)
        rotation = rotation.reshape(-1, 3, 3) if len(format.rotation) == 9 else rotation
    else:
        columns, signs, axes = turned
        radians = np.radians(signs * _table(rows, format.width, columns))
        rotation = np.array([0.0, 0.0, 0.0, 1.0])
        for axis, angles in zip(axes, radians.T, strict=True):
            rotation = math3d.quat_multiply(math3d.quat_from_axis_angle(np.eye(3)["XYZ".index(axis)], angles), rotation)
    position = _table(rows, format.width, format.position) if format.position else np.zeros((len(rows), 3))
    return Poses(format, [place for place, _ in rows], position, rotation, times, fps, yfov, level)


def _table(rows: Rows, width: int, columns: Sequence[int]) -> Array:
    """Numbers in some columns of rows that all have ``width``, (N, columns) float64.  Raises SceneError."""
    for place, cells in rows:
        if len(cells) != width:
            raise SceneError(f"{len(cells)} of {width} columns", where=place)
    return np.array([[_number(cells[k], place) for k in columns] for place, cells in rows])


def _times(rows: Rows, column: int = 0) -> list[Decimal]:
    """Times as written: of nanoseconds since 1970 a float64 keeps no more than every 256th."""
    _table(rows, len(rows[0][1]), (column,))
    return [Decimal(str(cells[column]).strip()) for _, cells in rows]


def _natural(name: str) -> list[tuple[int, str]]:
    """Key that sorts names as people count: image2 before image10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]


def _is_number(text: str) -> bool:
    return re.fullmatch(r"[-+]?[\d.]+(e[-+]?\d+)?", text, re.IGNORECASE) is not None


def _number(value: Any, place: str) -> float:
    """A cell as a finite number.  Raises SceneError."""
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not abs(number) < MOST:
        raise SceneError(f"{str(value)[:40]!r} is not a number below {MOST:g}", where=place)
    return number
