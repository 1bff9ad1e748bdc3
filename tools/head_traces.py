"""Synthetic head motion of the benchmark's track: sums of waves with the statistics of measured heads.

Writes ``taubench_gl/benchmark/suites/heads/*.csv``.  No person was recorded.  Each angle is the sum of a slow band of
waves (turns of the head) and a fast one (steps, tremor), whose amplitudes follow from the mean change per frame at 24
and at 90 fps.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "taubench_gl" / "benchmark" / "suites" / "heads"
SECONDS, RATE = 8.4, 90.0

MEANS = {
    "seated": {"pitch": (0.45, 0.13), "yaw": (1.26, 0.34), "roll": (0.28, 0.08)},
    "walking": {"pitch": (0.60, 0.17), "yaw": (1.12, 0.30), "roll": (0.42, 0.12)},
    "busy": {"pitch": (1.46, 0.42), "yaw": (4.10, 1.11), "roll": (0.91, 0.26)},
}
"""Mean change per frame in degrees at 24 and 90 fps, of public recordings: seated viewers of 360-degree video, a walk
around an object, and the busiest six seconds.  Of these only the yaw at 24 fps was measured; the rest keeps the ratios
of seated."""

SEEDS = {"seated": 29, "walking": 43, "busy": 9}
"""Of 60, among those whose first 0.5 to 8 s, the frames of the suite, differ least from the means of the whole."""

SLOW, FAST = (0.08, 0.7), (3.0, 7.0)
"""Hz."""


def waves(rng: np.random.Generator, times: np.ndarray, low: float, high: float) -> np.ndarray:
    frequencies, phases = rng.uniform(low, high, 9), rng.uniform(0.0, 2.0 * np.pi, 9)
    return np.sin(2.0 * np.pi * np.outer(times, frequencies) + phases).sum(axis=1)


def mean_changes(times: np.ndarray, degrees: np.ndarray) -> list[float]:
    """Mean absolute change per frame at 24 and at 90 fps."""
    return [
        float(np.abs(np.diff(np.interp(np.arange(0.0, times[-1] - 0.2, 1.0 / fps), times, degrees))).mean())
        for fps in (24.0, 90.0)
    ]


def angle(rng: np.random.Generator, times: np.ndarray, means: tuple[float, float]) -> np.ndarray:
    slow, fast = waves(rng, times, *SLOW), waves(rng, times, *FAST)

    def off(log_sizes: np.ndarray) -> np.ndarray:
        a, b = np.exp(log_sizes)
        return np.log(mean_changes(times, a * slow + b * fast)) - np.log(means)

    a, b = np.exp(least_squares(off, np.log([5.0, 0.05])).x)
    return a * slow + b * fast


def trace(name: str, seed: int) -> str:
    """Lines of the CSV file."""
    rng, times = np.random.default_rng(seed), np.arange(round(SECONDS * RATE) + 1) / RATE
    yaw, pitch, roll = (angle(rng, times, MEANS[name][axis]) for axis in ("yaw", "pitch", "roll"))
    q = Rotation.from_euler("YXZ", np.stack([yaw, pitch, roll], axis=1), degrees=True).as_quat()
    sway = np.stack([waves(rng, times, 0.1, 0.6) for _ in range(3)], axis=1) * (0.010, 0.004, 0.010)
    place = sway + (0.0, 1.2, 0.0)
    if name == "walking":  # 0.8 m/s to and fro on a line of 1.2 m, with the bob of two steps a second
        along = 0.6 * np.sin(times * 0.8 / 0.6)
        place = sway + np.stack([along, 1.6 + 0.02 * np.sin(2.0 * np.pi * 2.0 * times), 0.0 * times], axis=1)
    rows = np.column_stack([times, place, q])
    head = f"# Synthetic: no person was recorded.  Statistics of measured heads ({name}), by tools/head_traces.py."
    cells = ("%.6f", "%.4f", "%.4f", "%.4f", "%.6f", "%.6f", "%.6f", "%.6f")
    lines = (",".join(form % value for form, value in zip(cells, row, strict=True)) for row in rows)
    return "\n".join([head, "time,x,y,z,qx,qy,qz,qw", *lines]) + "\n"


def main() -> None:
    """Write the files."""
    FOLDER.mkdir(exist_ok=True)
    for name, seed in SEEDS.items():
        (FOLDER / f"{name}.csv").write_text(trace(name, seed))


if __name__ == "__main__":
    sys.exit(main())
