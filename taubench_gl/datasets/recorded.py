"""Recorded cameras: CSV or JSON logs of time, position and rotation, as of a headset or an engine.

Columns (CSV with a header; any order, others are ignored) or keys (JSON, a list of objects):

    time              seconds, increasing; the first becomes 0
    x, y, z           meters, world, +Y up
    qx, qy, qz, qw    unit quaternion world_from_view; the camera looks along its -Z, +Y up, as in glTF and OpenXR

JSON may also be an object of three lists: time (N), position (N, 3), rotation (N, 4) as xyzw.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.data_files import read_csv, read_json
from taubench_gl.errors import SceneError

Array = np.ndarray

COLUMNS = ("time", "x", "y", "z", "qx", "qy", "qz", "qw")
SUFFIXES = (".csv", ".json")

UNIT_TOLERANCE = 0.05
"""A quaternion whose length differs more from 1 is an error; a smaller difference is normalized."""


@dataclass(frozen=True, slots=True)
class RecordedPath:
    """N >= 2 poses: times (N,) seconds from 0, increasing; position (N, 3) meters; rotation (N, 4) unit xyzw."""

    times: Array
    position: Array
    rotation: Array

    @property
    def fps(self) -> float:
        """The median rate of the log, 1/s."""
        return float(1.0 / np.median(np.diff(self.times)))


def read_recorded(path: str | Path) -> RecordedPath:
    """Read a log.  Raises SceneError that names the line or the missing part."""
    path = Path(path)
    rows, names = _json_rows(path) if path.suffix.lower() == ".json" else _csv_rows(path)
    if len(rows) < 2:
        raise SceneError(f"holds {len(rows)} poses", where=path.name, hint="a camera path needs at least two")
    table = np.array(rows, dtype=np.float64)
    bad = np.flatnonzero(~np.all(np.isfinite(table), axis=1))
    if len(bad):
        raise SceneError("a number is not finite", where=f"{path.name}{names[bad[0]]}")
    step = np.flatnonzero(np.diff(table[:, 0].astype(np.float32)) <= 0)
    if len(step):
        i = int(step[0]) + 1
        raise SceneError(f"time {table[i, 0]:g} does not follow {table[i - 1, 0]:g}", where=f"{path.name}{names[i]}",
                         hint="times increase, in seconds")  # fmt: skip
    length = np.linalg.norm(table[:, 4:], axis=1)
    bad = np.flatnonzero(np.abs(length - 1.0) > UNIT_TOLERANCE)
    if len(bad):
        raise SceneError(f"quaternion of length {length[bad[0]]:.4g}, expected 1", where=f"{path.name}{names[bad[0]]}")
    rotation = table[:, 4:] / length[:, None]
    # q and -q are the same rotation: successive keys on one hemisphere, so that lerp takes the short way.
    flips = np.cumprod(np.where(np.sum(rotation[1:] * rotation[:-1], axis=1) < 0, -1.0, 1.0))
    rotation[1:] *= flips[:, None]
    return RecordedPath(table[:, 0] - table[0, 0], table[:, 1:4], rotation)


def _csv_rows(path: Path) -> tuple[list[list[float]], list[str]]:
    lines = read_csv(path, SceneError)
    header = [name.strip().lower() for name in next(lines, (1, []))[1]]
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        raise SceneError(f"no column {', '.join(missing)}", where=f"{path.name}:1",
                         hint=f"the first line names the columns {','.join(COLUMNS)}")  # fmt: skip
    places = [header.index(name) for name in COLUMNS]
    rows, names = [], []
    for number, cells in lines:
        if not any(cell.strip() for cell in cells):
            continue
        where = f":{number}"
        if len(cells) < len(header):
            raise SceneError(f"{len(cells)} of {len(header)} columns", where=f"{path.name}{where}")
        rows.append([_number(cells[k], path, where) for k in places])
        names.append(where)
    return rows, names


def _json_rows(path: Path) -> tuple[list[list[float]], list[str]]:
    data = read_json(path, fault=SceneError)
    if isinstance(data, dict):
        parts = [data.get(name) for name in ("time", "position", "rotation")]
        lists = all(isinstance(part, list) for part in parts)
        if not lists or len({len(part) for part in parts}) != 1:
            raise SceneError("needs lists time, position and rotation of one length", where=path.name)
        data = [
            dict(zip(COLUMNS, (t, *_list(p, 3, path, i), *_list(q, 4, path, i)), strict=True))
            for i, (t, p, q) in enumerate(zip(*parts, strict=True))
        ]
    if not isinstance(data, list):
        raise SceneError("is neither a list of poses nor an object of lists", where=path.name)
    rows = []
    for i, pose in enumerate(data):
        missing = [name for name in COLUMNS if not isinstance(pose, dict) or name not in pose]
        if missing:
            raise SceneError(f"no {', '.join(missing)}", where=f"{path.name}#/{i}")
        rows.append([_number(pose[name], path, f"#/{i}") for name in COLUMNS])
    return rows, [f"#/{i}" for i in range(len(rows))]


def _list(value: Any, count: int, path: Path, i: int) -> list[Any]:
    if not isinstance(value, list) or len(value) != count:
        raise SceneError(f"expected {count} numbers", where=f"{path.name}#/{i}")
    return value


def _number(value: Any, path: Path, where: str) -> float:
    try:
        if isinstance(value, bool):
            raise TypeError
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise SceneError(f"{str(value)[:40]!r} is not a number", where=f"{path.name}{where}") from None
