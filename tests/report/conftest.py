"""A synthetic run with known numbers."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from taubench_gl.conventions import HISTOGRAM_BINS, SUMMARY_SCHEMA, Reason
from taubench_gl.features import FEATURES, MASK_WORDS
from taubench_gl.metrics.counts import bin_of, edges
from taubench_gl.metrics.reuse_rate import ReuseStats
from taubench_gl.run import Run
from taubench_gl.run_schema import COUNT_COLUMNS, FRAME_COLUMNS

WIDTH, HEIGHT, PAIRS = 40, 20, 12
_STATS = ("mean", "variance", "max", "median", "p95")


def _statistics(start: float) -> dict[str, Any]:
    numbers = {key: start + i for i, key in enumerate(_STATS)}
    return {**numbers, "without_cuts": {key: value / 2 for key, value in numbers.items()}}


def _curve(seed: int) -> dict[str, Any]:
    distances = np.random.default_rng(seed).lognormal(-3.0, 1.5, PAIRS * WIDTH * HEIGHT // 2)
    counts = np.bincount(bin_of(distances), minlength=HISTOGRAM_BINS)
    return {"edges": edges().tolist(), "counts": counts.tolist(), "comparable": int(counts.sum())}


def _reuse() -> ReuseStats:
    """PAIRS equal pairs of 640 surface pixels: 480 reusable, 104 off-screen, 40 disoccluded, 16 turned, 4 occluding."""
    stats, words = ReuseStats({"indirect": "no indirect light here"}), np.zeros(MASK_WORDS, dtype=np.int64)
    words[0], words[Reason.OUTSIDE], words[Reason.NORMAL] = 480, 104, 12
    words[Reason.POSITION | Reason.DISOCCLUDED] = 40
    words[Reason.POSITION | Reason.OCCLUDING | Reason.NORMAL] = 4
    words[Reason.SKY | Reason.HISTORY_SKY], words[Reason.SKY | Reason.OUTSIDE] = 100, 60
    for _ in range(PAIRS):
        stats.add(words)
    return stats


_SUMMARY = {
    "schema": SUMMARY_SCHEMA,
    "reusable": _reuse().block("camera", np.zeros(PAIRS, dtype=bool)),
    "mask_histogram": _reuse().histogram(),
    "scene": {"name": "walk [1] | 50 %_x", "path": "walk.glb", "sha256": "0" * 64},
    "settings": {
        "width": WIDTH, "height": HEIGHT, "fps": 24.0, "first_frame": 0, "last_frame": PAIRS,
        "reprojection": "camera", "sampling": "nearest", "thresholds": {name: 32 / 255 for name in FEATURES},
    },
    "pairs": PAIRS,
    "census": {
        "dynamic_rigid_objects": 3, "armatures": 2, "bones": 40, "static_point_lights": 5, "dynamic_point_lights": 7,
    },
    "camera": {
        **{name: _statistics(start) for name, start in zip(("position", "yaw", "pitch", "roll", "angle"), range(5))},
        "fps": 24.0, "samples": PAIRS, "cuts": [], "source": "framing orbit: the file has no camera",
    },
    "discard": {
        name: {"mean_percent": 1.5 * i, "comparable_mean_percent": 2.5 * i if i else None, "max_percent": 9.0}
        for i, name in enumerate(("frustum", *FEATURES[:-1]))
    },
    "curves": {name: _curve(i) for i, name in enumerate(FEATURES[:-1])},
    "notes": [],
}  # fmt: skip
_SUMMARY["discard"]["indirect"] = {
    "mean_percent": None, "comparable_mean_percent": None, "max_percent": None, "reason": "no indirect light here",
}  # fmt: skip
_SUMMARY["curves"]["indirect"] = None


@pytest.fixture
def summary() -> dict[str, Any]:
    return copy.deepcopy(_SUMMARY)


@pytest.fixture
def frames() -> list[dict[str, Any]]:
    return _frames()


def _frames() -> list[dict[str, Any]]:
    rows = []
    for i in range(1, PAIRS + 1):
        row: dict[str, Any] = dict.fromkeys(FRAME_COLUMNS)
        row |= dict.fromkeys(COUNT_COLUMNS, 0) | {"frame": i, "time_s": i / 24, "pixels": WIDTH * HEIGHT}
        row |= {"frustum": 10 * i, "comparable": WIDTH * HEIGHT - 10 * i, "normal": 300 - 20 * i, "color": 7 * (i % 4)}
        row |= {"indirect": None, "translation_m": 0.1 * i, "angle_deg": 1 / i, "camera_cut": 0, "gimbal": 0}
        rows.append(row)
    return rows


@pytest.fixture
def run(summary: dict[str, Any], frames: list[dict[str, Any]]) -> Run:
    return Run(summary, frames)


@pytest.fixture(scope="session")
def make_run() -> Callable[[], Run]:
    """The synthetic run for session and module fixtures: every call returns a new copy."""
    return lambda: Run(copy.deepcopy(_SUMMARY), _frames())
