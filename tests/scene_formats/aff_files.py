"""AFF text for tests, and a second implementation of BART's splines: basis matrices and SciPy rotations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

Array = np.ndarray

VIEW = "v\nfrom 0 0 10\nat 0 0 0\nup 0 1 0\nangle 40\nhither 0.01\nresolution 80 60\n"
TRIANGLE = "p 3 0 0 0 1 0 0 0 1 0\n"


def write(folder: Path, text: str, name: str = "scene.aff") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def keys(rows: Array) -> str:
    return f"{len(rows)}\n" + "\n".join(" ".join(repr(float(x)) for x in row) for row in rows) + "\n"


def tangents(times: Array, tcb: Array, i: int, before: Array, here: Array, after: Array) -> tuple[Array, Array]:
    """Tangents of the segment from key ``i``, at its start and end; ``before`` .. ``after``: key differences."""
    te, co, bi = tcb[i]
    out = (1 - te) * ((1 + co) * (1 + bi) * before + (1 - co) * (1 - bi) * here) / 2
    out = out * 2 * (times[i + 1] - times[i]) / (times[i + 1] - times[i - 1])
    te, co, bi = tcb[i + 1]
    into = (1 - te) * ((1 - co) * (1 + bi) * here + (1 + co) * (1 - bi) * after) / 2
    into = into * 2 * (times[i + 1] - times[i]) / (times[i + 2] - times[i])
    return out, into


def spline(times: Array, values: Array, tcb: Array, t: float) -> Array:
    """Kochanek-Bartels in matrix form for increasing times; the first and last key only affect tangents."""
    t = min(max(t, times[1]), times[-2])
    i = int(np.clip(np.searchsorted(times, t, side="right") - 1, 1, len(times) - 3))
    before, here, after = values[i] - values[i - 1], values[i + 1] - values[i], values[i + 2] - values[i + 1]
    out, into = tangents(times, tcb, i, before, here, after)
    s = (t - times[i]) / (times[i + 1] - times[i])
    basis = np.array([[2, -2, 1, 1], [-3, 3, -2, -1], [0, 0, 1, 0], [1, 0, 0, 0]], dtype=float)
    return np.array([s**3, s * s, s, 1.0]) @ basis @ np.array([values[i], values[i + 1], out, into])


def rotation_spline(times: Array, rotations: Rotation, tcb: Array, t: float) -> Rotation:
    """Squad with Kochanek-Bartels tangents for keys less than 180 degrees apart, by quaternions and slerp."""
    t = min(max(t, times[1]), times[-2])
    i = int(np.clip(np.searchsorted(times, t, side="right") - 1, 1, len(times) - 3))
    q = [rotations[j] for j in range(i - 1, i + 3)]
    before, here, after = ((q[j].inv() * q[j + 1]).as_rotvec() for j in range(3))
    out, into = tangents(times, tcb, i, before, here, after)
    s = (t - times[i]) / (times[i + 1] - times[i])
    p, r = q[1].as_quat(), q[2].as_quat()
    r = r if np.dot(p, r) >= 0 else -r
    a, b = _turned(p, (out - here) / 2), _turned(r, (here - into) / 2)
    return Rotation.from_quat(_slerp(_slerp(p, r, s), _slerp(a, b, s), 2 * s * (1 - s)))


def _turned(q: Array, vector: Array) -> Array:
    """q times the quaternion of a rotation vector, with its sign."""
    half = np.linalg.norm(vector) / 2
    x = np.append(vector / 2 * (np.sin(half) / half if half else 1.0), np.cos(half))
    return np.append(q[3] * x[:3] + x[3] * q[:3] + np.cross(q[:3], x[:3]), q[3] * x[3] - q[:3] @ x[:3])


def _slerp(x: Array, y: Array, u: float) -> Array:
    angle = np.arccos(np.clip(x @ y, -1, 1))
    return x if angle < 1e-9 else (np.sin((1 - u) * angle) * x + np.sin(u * angle) * y) / np.sin(angle)
