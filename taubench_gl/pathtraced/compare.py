"""How far two runs of the same frames agree: columns, masks pixel by pixel, features, and what each cost.

NumPy only.  ``compare_runs`` compares, ``save_comparison`` writes the result as text, JSON, HTML and a picture.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.conventions import COLUMNS, FEATURE_BIT, FRUSTUM
from taubench_gl.errors import OutputError
from taubench_gl.metrics.feature_errors import FeatureErrors
from taubench_gl.outputs import output_folder, write_atomically
from taubench_gl.pathtraced.compare_report import comparison_html, comparison_text, save_worst_picture
from taubench_gl.run import Run, load_run

Array = np.ndarray
BITS = {"frustum": FRUSTUM} | FEATURE_BIT
AGREEMENT_SCHEMA = "taubench-gl/agreement/1"
NO_MASKS = "masks were not saved by both runs (evaluate them with --save masks,channels)"
NO_CHANNELS = "channels were not saved by both runs (evaluate them with --save masks,channels)"
_MASKS, _CHANNELS = "masks/mask_{:05d}.npz", "channels/channels_{:05d}.npz"


def compare_runs(first: str | Path | Run, second: str | Path | Run) -> dict[str, Any]:
    """Compare two runs; the second is the reference.

    ``columns``: both means, their difference in points, and the noise floors where known.  ``masks`` (where both runs
    saved masks): intersection over union of each mask over all common pairs, and the share of pixels that agree
    outside a band of one pixel on either side of the second mask's edges, where a sub-pixel difference flips pixels.
    ``features`` (where both saved channels): the distribution of each error, see ``metrics.feature_errors``.  ``time``:
    seconds per frame of both.  ``worst``: the pair whose masks differ on most pixels.  A block that cannot be had is
    ``{"reason": why}``.  Raises OutputError for runs of different sizes or without a common pair.
    """
    a, b = (run if isinstance(run, Run) else load_run(run) for run in (first, second))
    _require_keys(a)
    _require_keys(b)
    sizes = [(r.summary["settings"]["width"], r.summary["settings"]["height"]) for r in (a, b)]
    if sizes[0] != sizes[1]:
        x, y = ("x".join(map(str, size)) for size in sizes)
        raise OutputError(f"the runs have different sizes, {x} and {y}", hint="evaluate one of them again with --size")
    frames = sorted({row["frame"] for row in a.frames} & {row["frame"] for row in b.frames})
    if not frames:
        raise OutputError(
            "the runs have no pair of frames in common", hint="evaluate the same --frames at the same --fps"
        )
    masks, worst = _masks(a, b, frames)
    return {
        "schema": AGREEMENT_SCHEMA,
        "runs": [str(r.out or r.summary["scene"]["name"]) for r in (a, b)],
        "size": list(sizes[0]),
        "fps": [r.summary["settings"].get("fps") for r in (a, b)],
        "pairs": len(frames),
        "settings_that_differ": _different_settings(a, b),
        "columns": {column: _column(a, b, column, frames) for column in COLUMNS},
        "masks": masks,
        "features": _features(a, b, frames),
        "time": _time(a, b),
        "worst": worst,
        "provenance": [r.summary.get("provenance") for r in (a, b)],
    }


def save_comparison(result: dict[str, Any], out: str | Path) -> list[Path]:
    """agreement.txt, agreement.json, agreement.html (one file, its picture within) and, with masks, worst.png.

    ``result`` is ``compare_runs``'s of two runs on disk.  -> the files written.  Raises OutputError.
    """
    out = output_folder(out)
    written = []
    picture = None
    if "frame" in result["worst"]:
        picture = save_worst_picture(out / "worst.png", result, *_worst_arrays(result))
        written.append(picture)
    texts = {
        "agreement.txt": "\n".join(comparison_text(result)) + "\n",
        "agreement.json": json.dumps(result, indent=2, allow_nan=False) + "\n",
        "agreement.html": comparison_html(result, None if picture is None else picture.read_bytes()),
    }
    for name, text in texts.items():
        write_atomically(out / name, text)
        written.append(out / name)
    return written


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


def _require_keys(run: Run) -> None:
    """Raises OutputError where the summary, of another program perhaps, lacks what runs are compared by."""
    for keys in ("scene", "discard", "settings.width", "settings.height"):
        value: Any = run.summary
        for key in keys.split("."):
            value = (value or {}).get(key)
        if not value:
            raise OutputError(f"summary.json has no {keys}", where=str(run.out or "run"), hint="evaluate it again")


def _column(a: Run, b: Run, column: str, frames: list[int]) -> dict[str, Any]:
    shares = []
    for run in (a, b):
        rows = {row["frame"]: row for row in run.frames}
        counts = [(rows[f][column], rows[f]["pixels"]) for f in frames]
        if any(count is None for count, _ in counts):
            reason = run.summary["discard"][column].get("reason", "not measured")
            return {"difference_points": None, "reason": f"{run.summary['scene']['name']}: {reason}"}
        shares.append(float(np.mean([100.0 * count / pixels for count, pixels in counts])))
    floors = [noise_floor_percent(run.summary).get(column) for run in (a, b)]
    return {"percent": shares, "difference_points": shares[0] - shares[1], "noise_floor_percent": floors}


def noise_floor_percent(summary: Mapping[str, Any]) -> dict[str, float | None]:
    """Column -> mean percentage of pixels that noise alone discards; empty if the run has no second seed."""
    return {column: (entry or {}).get("mean_percent") for column, entry in (summary.get("noise_floor") or {}).items()}


def _masks(a: Run, b: Run, frames: list[int]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The block ``masks``, and the block ``worst``."""
    pairs = saved_pairs(a.out, b.out, frames, _MASKS)
    if not pairs:
        return {"reason": NO_MASKS}, {"reason": NO_MASKS}
    measured = {n: all(r.frames[0].get(n) is not None for r in (a, b)) for n in BITS}
    judged = sum(int(bit) for name, bit in BITS.items() if measured[name])
    sums = {name: np.zeros(4, dtype=np.int64) for name in BITS if measured[name]}
    worst = (-1, 0)
    for frame, first, second in pairs:
        words = [lazy["mask"].astype(np.uint32) for lazy in (first, second)]
        for name in sums:
            sums[name] += mask_agreement(*((word & int(BITS[name])) != 0 for word in words))
        differ = int(np.count_nonzero((words[0] ^ words[1]) & np.uint32(judged)))
        worst = max(worst, (differ, -frame))
    out = {}
    for name, (both, either, equal, outside) in sums.items():
        out[name] = {
            "iou": float(both / either) if either else 1.0,
            "agree_outside_band_percent": float(100.0 * equal / outside) if outside else None,
            "pixels": int(either),
        }
    pixels = a.summary["settings"]["width"] * a.summary["settings"]["height"]
    return out, {"frame": -worst[1], "differing_percent": 100.0 * worst[0] / pixels, "judged_bits": judged}


def _features(a: Run, b: Run, frames: list[int]) -> dict[str, Any]:
    pairs = saved_pairs(a.out, b.out, frames, _CHANNELS)
    if not pairs:
        return {"reason": NO_CHANNELS}
    told = b.summary["settings"]
    scale = told.get("unit_scale") or 1.0
    errors = FeatureErrors(same_place_m=told["thresholds"]["position"], unit_scale=scale)
    for _, first, second in pairs:
        errors.add(first, second)
    return errors.summary()


def _time(a: Run, b: Run) -> dict[str, Any]:
    """Seconds per frame of both and their ratio (second / first)."""
    entries = [seconds_per_frame(run.summary) for run in (a, b)]
    out: dict[str, Any] = {"runs": entries}
    if all("seconds" in entry for entry in entries) and entries[0]["seconds"] > 0:
        out["ratio"] = entries[1]["seconds"] / entries[0]["seconds"]
    return out


def seconds_per_frame(summary: dict[str, Any]) -> dict[str, Any]:
    """What making one frame took, without masks and files: ``seconds`` and ``clock``, or ``reason``."""
    path_traced = summary.get("path_traced")
    if path_traced is not None:
        render = path_traced.get("render") or {}
        if render.get("seconds_per_frame") is None:
            return {"reason": "nobody recorded how long these files took to render ('reference render' does)"}
        samples = f"{render['samples']} sample{'s' * (render['samples'] != 1)}"
        made = f"Cycles, {samples}, {render['bounces']} bounces"
        return {"seconds": render["seconds_per_frame"], "clock": render["clock"], "of": made}
    timing = summary.get("timing") or {}
    passes = {name: ms for name, ms in (timing.get("passes") or {}).items() if name != "masks" and ms is not None}
    if not passes:
        return {"reason": "the run recorded no times"}
    made = (summary.get("provenance") or {}).get("renderer") or "rasterizer"
    return {"seconds": 1e-3 * sum(passes.values()), "clock": f"medians of passes, {timing.get('clock')}", "of": made}


def _different_settings(a: Run, b: Run) -> dict[str, list[Any]]:
    """Settings on which a column depends and that the runs do not share."""
    both = ("fps", "reprojection", "sampling", "thresholds", "unit_scale", "exposure", "tone_map")
    values = {name: [run.summary["settings"].get(name) for run in (a, b)] for name in both}
    return {name: pair for name, pair in values.items() if pair[0] != pair[1]}


def saved_pairs(first: Path | None, second: Path | None, frames: list[int], name: str) -> list[tuple[int, Any, Any]]:
    """(frame, first's, second's ``Saved``) of every frame that both folders hold; none where a folder is None.

    ``name``: of a frame's file, a format with its number as argument 0.
    """
    if first is None or second is None:
        return []
    paths = [(f, first / name.format(f), second / name.format(f)) for f in frames]
    return [(f, Saved(x), Saved(y)) for f, x, y in paths if x.is_file() and y.is_file()]


class Saved:
    """Arrays of one .npz, read when asked for, so that a long run never lies in memory whole."""

    def __init__(self, path: Path):
        self._path = path

    def __contains__(self, name: str) -> bool:
        return self._read(lambda arrays: name in arrays)

    def __getitem__(self, name: str) -> Array:
        return self._read(lambda arrays: arrays[name])

    def _read(self, take: Any) -> Any:
        try:
            with np.load(self._path) as arrays:
                return take(arrays)
        except (OSError, ValueError, KeyError) as error:
            raise OutputError(f"cannot be read: {error}", where=str(self._path)) from None


def _worst_arrays(result: dict[str, Any]) -> tuple[list[Array], list[Array] | None]:
    """Mask words of the worst pair, and its colours where both runs saved them."""
    frame = result["worst"]["frame"]
    folders = [Path(name) for name in result["runs"]]
    masks = [Saved(folder / _MASKS.format(frame))["mask"].astype(np.uint32) for folder in folders]
    kept = saved_pairs(*folders, [frame], _CHANNELS)
    colors = None
    if kept and all("color" in arrays for arrays in kept[0][1:]):
        colors = [arrays["color"][..., :3] for arrays in kept[0][1:]]
    return masks, colors
