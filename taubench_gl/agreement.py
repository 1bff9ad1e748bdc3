"""How far two runs of the same frames agree: columns, masks pixel by pixel, and features.  NumPy only."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.conventions import COLUMNS, FEATURE_BIT, FRUSTUM
from taubench_gl.errors import OutputError
from taubench_gl.run import Run, load_run

Array = np.ndarray
BITS = {"frustum": FRUSTUM} | FEATURE_BIT


def agree(first: str | Path | Run, second: str | Path | Run) -> dict[str, Any]:
    """Compare two runs; the second is the one to be reached (truth).

    ``columns``: both means and their difference in points.  ``masks`` (where both runs saved masks): intersection over
    union of each mask over all common pairs, and the share of pixels that agree outside a band of one pixel on either
    side of the second mask's edges, where a sub-pixel difference flips pixels.  ``features`` (where both saved
    channels): median and 95th percentile of position (millimetres) and normal (degrees) errors.
    Raises OutputError for runs of different sizes or without a common pair.
    """
    a, b = (run if isinstance(run, Run) else load_run(run) for run in (first, second))
    sizes = [(r.summary["settings"]["width"], r.summary["settings"]["height"]) for r in (a, b)]
    if sizes[0] != sizes[1]:
        x, y = ("x".join(map(str, size)) for size in sizes)
        raise OutputError(f"the runs have different sizes, {x} and {y}", hint="evaluate one of them again with --size")
    frames = sorted({row["frame"] for row in a.frames} & {row["frame"] for row in b.frames})
    if not frames:
        raise OutputError(
            "the runs have no pair of frames in common", hint="evaluate the same --frames at the same --fps"
        )
    return {
        "runs": [str(r.out or r.summary["scene"]["name"]) for r in (a, b)],
        "pairs": len(frames),
        "columns": {column: _column(a, b, column, frames) for column in COLUMNS},
        "masks": _masks(a, b, frames),
        "features": _features(a, b, frames),
    }


def mask_agreement(first: Array, second: Array) -> tuple[int, int, int, int]:
    """(intersection, union, equal pixels outside the band, pixels outside the band) of two boolean masks (h, w)."""
    outside = ~edge_band(second)
    equal = first == second
    counts = (first & second).sum(), (first | second).sum(), (equal & outside).sum(), outside.sum()
    return tuple(int(n) for n in counts)


def edge_band(mask: Array) -> Array:
    """Pixels with a neighbour (of eight) on the other side of an edge of ``mask``.  (h, w) bool -> (h, w) bool."""
    padded = np.pad(mask, 1, mode="edge")
    h, w = mask.shape
    shifted = [padded[y : y + h, x : x + w] for y in range(3) for x in range(3)]
    return np.logical_or.reduce(shifted) & ~np.logical_and.reduce(shifted)


def _column(a: Run, b: Run, column: str, frames: list[int]) -> dict[str, Any]:
    shares = []
    for run in (a, b):
        rows = {row["frame"]: row for row in run.frames}
        counts = [(rows[f][column], rows[f]["pixels"]) for f in frames]
        if any(count is None for count, _ in counts):
            reason = run.summary["discard"][column].get("reason", "not measured")
            return {"difference_points": None, "reason": f"{run.summary['scene']['name']}: {reason}"}
        shares.append(float(np.mean([100.0 * count / pixels for count, pixels in counts])))
    return {"percent": shares, "difference_points": shares[0] - shares[1]}


def _masks(a: Run, b: Run, frames: list[int]) -> dict[str, Any]:
    pairs = _saved(a, b, frames, "masks/mask_{:05d}.npz")
    sums = {name: np.zeros(4, dtype=np.int64) for name in BITS}
    for first, second in pairs:
        for name, bit in BITS.items():
            masks = [(words["mask"].astype(np.uint32) & int(bit)) != 0 for words in (first, second)]
            sums[name] += mask_agreement(*masks)
    out = {}
    for name, (both, either, equal, outside) in sums.items():
        if either or name == "frustum":
            out[name] = {
                "iou": both / either if either else 1.0,
                "agree_outside_band_percent": 100.0 * equal / outside if outside else None,
            }
    return out if pairs else {"reason": "masks were not saved by both runs (--save masks)"}


def _features(a: Run, b: Run, frames: list[int]) -> dict[str, Any]:
    pairs = _saved(a, b, frames, "channels/channels_{:05d}.npz")
    errors: dict[str, list[Array]] = {"position_mm": [], "normal_deg": []}
    for first, second in pairs:
        both = (first["position"][..., 3] > 0) & (second["position"][..., 3] > 0)
        apart = first["position"][both, :3].astype(np.float64) - second["position"][both, :3]
        apart += first["camera_position"] - second["camera_position"]
        errors["position_mm"].append(1e3 * np.linalg.norm(apart, axis=-1))
        chord = np.linalg.norm(first["normal"][both, :3].astype(np.float64) - second["normal"][both, :3], axis=-1)
        errors["normal_deg"].append(np.degrees(2.0 * np.arcsin(np.clip(0.5 * chord, 0.0, 1.0))))
    if not pairs:
        return {"reason": "channels were not saved by both runs (--save channels)"}
    out = {}
    for name, parts in errors.items():
        values = np.concatenate(parts)
        values = values[np.isfinite(values)]
        if len(values):
            out[name] = {"median": float(np.median(values)), "p95": float(np.percentile(values, 95))}
    return out


def _saved(a: Run, b: Run, frames: list[int], name: str) -> list[tuple[Any, Any]]:
    if a.out is None or b.out is None:
        return []
    pairs = [(a.out / name.format(f), b.out / name.format(f)) for f in frames]
    return [(_Lazy(x), _Lazy(y)) for x, y in pairs if x.is_file() and y.is_file()]


class _Lazy:
    """Arrays of one .npz, read when asked for, so that a long run never lies in memory whole."""

    def __init__(self, path: Path):
        self._path = path

    def __getitem__(self, name: str) -> Array:
        try:
            with np.load(self._path) as arrays:
                return arrays[name]
        except (OSError, ValueError, KeyError) as error:
            raise OutputError(f"cannot be read: {error}", where=str(self._path)) from None


def agreement_lines(result: dict[str, Any], say: Callable[[str], None]) -> None:
    """The result as plain text, line by line."""
    say(f"{result['runs'][0]} against {result['runs'][1]}, {result['pairs']} pairs")
    say(f"{'column':<10}{'first %':>10}{'second %':>10}{'points':>10}{'IoU':>9}{'outside band %':>16}")
    for column, entry in result["columns"].items():
        if entry["difference_points"] is None:
            say(f"{column:<10}{'–':>10}{'–':>10}{'–':>10}   {entry['reason']}")
            continue
        mask = result["masks"].get(column) if isinstance(result["masks"].get(column), dict) else None
        outside = None if mask is None else mask["agree_outside_band_percent"]
        shown = f"{mask['iou']:>9.4f}" if mask else f"{'–':>9}"
        shown += f"{outside:>16.3f}" if outside is not None else f"{'–':>16}"
        a, b = entry["percent"]
        say(f"{column:<10}{a:>10.3f}{b:>10.3f}{entry['difference_points']:>+10.3f}{shown}")
    for name, entry in result["features"].items():
        if isinstance(entry, dict):
            say(f"{name}: median {entry['median']:.4g}, 95 % below {entry['p95']:.4g}")
    for block in ("masks", "features"):
        if "reason" in result[block]:
            say(f"{block}: {result[block]['reason']}")
