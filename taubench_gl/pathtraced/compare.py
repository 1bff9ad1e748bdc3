"""Compares a run with a reference run of the same frames: columns, masks per pixel, features, seconds per frame.

Works without OpenGL.  ``compare_runs`` compares, ``compare_report`` makes tables of the result.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from taubench_gl.conventions import MIXED, mixed_definitions
from taubench_gl.data_files import stored_arrays
from taubench_gl.errors import OutputError
from taubench_gl.features import COLUMN_BITS, COLUMNS, LIGHT_FEATURES
from taubench_gl.metrics.feature_errors import FeatureErrors
from taubench_gl.run import Run, load_run

Array = np.ndarray
Summary = Mapping[str, Any]
SCHEMA = "taubench-gl/reference-comparison/1"
NO_MASKS = "masks were not saved by both runs (evaluate them with --save masks,channels)"
NO_CHANNELS = "no surface is in channels that both runs saved (evaluate them with --save masks,channels)"
_MASKS, _CHANNELS = "masks/mask_{:05d}.npz", "channels/channels_{:05d}.npz"
_COMPARED_SETTINGS = (
    "fps", "reprojection", "sampling", "thresholds", "unit_scale", "exposure", "environment", "tone_map",
)  # fmt: skip


def compare_runs(run: str | Path | Run, reference: str | Path | Run) -> dict[str, Any]:
    """Compare ``run`` with ``reference`` over their common pairs.

    ``columns``: both means in percent of all pixels, their difference in percentage points, known noise floors.
    ``masks`` (if both saved masks): intersection over union of each mask over all pairs, and the share of equal pixels
    outside a band of one pixel on either side of the reference mask's edges, where sub-pixel differences flip pixels.
    ``features`` (if both saved channels): distribution of each error, see ``metrics.feature_errors``.  ``time``:
    seconds per frame.  ``worst``: the pair whose masks differ in most pixels.  A block without data is
    ``{"reason": why}``.  Raises OutputError for runs of different sizes, definitions, light units
    or exposures, and without a common pair.
    """
    a, b = (r if isinstance(r, Run) else load_run(r) for r in (run, reference))
    _require_files(a)
    _require_files(b)
    _require_keys(a)
    _require_keys(b)
    sizes = [(r.summary["settings"]["width"], r.summary["settings"]["height"]) for r in (a, b)]
    if sizes[0] != sizes[1]:
        x, y = ("x".join(map(str, size)) for size in sizes)
        raise OutputError(f"the runs have different sizes, {x} and {y}", hint="evaluate one of them again with --size")
    if mixed := mixed_definitions((a.summary, b.summary)):
        raise OutputError(mixed, hint=MIXED)
    _require_same_light(a, b)
    frames = sorted({row["frame"] for row in a.frames} & {row["frame"] for row in b.frames})
    if not frames:
        hint = "evaluate the same --frames at the same --fps"
        raise OutputError("the runs have no pair of frames in common", hint=hint)
    masks, worst = _masks(a, b, frames)
    return {
        "schema": SCHEMA,
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


def _require_files(run: Run) -> None:
    """Raises OutputError for a run of which some masks or channels are missing, so that others would be compared."""
    for folder in (Path(_MASKS).parent, Path(_CHANNELS).parent):
        lost = [name for name in run.missing if Path(name).parent == folder]
        if lost and run.out is not None and (run.out / folder).is_dir():
            hint = f"evaluate again, or remove the whole folder {folder} to compare without it"
            raise OutputError("a file of the run is missing", where=str(run.out / lost[0]), hint=hint)


def _require_same_light(a: Run, b: Run) -> None:
    """Raises OutputError for runs that measure light in different units or at different exposures."""
    if not all(any(_measures(run, column) for column in LIGHT_FEATURES) for run in (a, b)):
        return
    units = [run.summary["settings"].get("light_unit") for run in (a, b)]
    if None not in units and units[0] != units[1]:
        hint = f"render or evaluate one of them again with --light-unit {units[1]}"
        raise OutputError(f"the runs have different light units, {units[0]} and {units[1]}", hint=hint)
    exposures = [run.summary["settings"].get("exposure") for run in (a, b)]
    if None not in exposures and exposures[0] != exposures[1]:
        first, second = (f"{value:g}" if isinstance(value, int | float) else str(value) for value in exposures)
        message = f"the runs have different exposures, {first} and {second}"
        raise OutputError(message, hint=f"evaluate the reference again with --exposure {first}")


def _measures(run: Run, column: str) -> bool:
    return ((run.summary.get("discard") or {}).get(column) or {}).get("mean_percent") is not None


def mask_agreement(first: Array, second: Array) -> tuple[int, int, int, int]:
    """Pixel counts of two masks, (h, w) bool: intersection, union, equal outside the band, all outside the band.

    The band is ``edge_band`` of the second mask.
    """
    outside = ~edge_band(second)
    equal = first == second
    counts = (first & second).sum(), (first | second).sum(), (equal & outside).sum(), outside.sum()
    return tuple(int(n) for n in counts)


def edge_band(mask: Array) -> Array:
    """Pixels whose 3x3 neighborhood has both values of ``mask``.  (h, w) bool -> (h, w) bool."""
    window = {"size": 3, "mode": "nearest"}
    return maximum_filter(mask, **window) & ~minimum_filter(mask, **window)


def noise_floor_percent(summary: Summary) -> dict[str, float | None]:
    """Column -> mean percentage of pixels that noise alone discards; empty if the run has no second seed."""
    return {column: (entry or {}).get("mean_percent") for column, entry in (summary.get("noise_floor") or {}).items()}


def seconds_per_frame(summary: Summary) -> dict[str, Any]:
    """Time to render one frame, without masks and files: ``seconds``, ``clock`` and ``of``, or ``reason``."""
    path_traced = summary.get("path_traced")
    if path_traced is not None:
        render = path_traced.get("render") or {}
        if render.get("seconds_per_frame") is None:
            return {"reason": "the render times of these files are not recorded ('reference render' records them)"}
        samples = f"{render['samples']} sample{'s' * (render['samples'] != 1)}"
        renderer = f"Cycles, {samples}, {render['bounces']} bounces"
        return {"seconds": render["seconds_per_frame"], "clock": render["clock"], "of": renderer}
    timing = summary.get("timing") or {}
    passes = {name: ms for name, ms in (timing.get("passes") or {}).items() if name != "masks" and ms is not None}
    if not passes:
        return {"reason": "the run has no recorded times"}
    renderer = (summary.get("provenance") or {}).get("renderer") or "rasterizer"
    clock = f"medians of passes, {timing.get('clock')}"
    return {"seconds": 1e-3 * sum(passes.values()), "clock": clock, "of": renderer}


def _require_keys(run: Run) -> None:
    """Raises OutputError if the summary, perhaps of another program, lacks a value that the comparison needs."""
    for keys in ("scene", "discard", "settings.width", "settings.height"):
        value: Any = run.summary
        for key in keys.split("."):
            value = (value or {}).get(key)
        if not value:
            raise OutputError(f"summary.json has no {keys}", where=str(run.out or "run"), hint="evaluate it again")


def _different_settings(a: Run, b: Run) -> dict[str, list[Any]]:
    """Settings that change columns and differ between the runs -> both values."""
    values = {name: [run.summary["settings"].get(name) for run in (a, b)] for name in _COMPARED_SETTINGS}
    unknown = None in values["environment"]  # of renders by other programs
    return {name: p for name, p in values.items() if p[0] != p[1] and not (unknown and name == "environment")}


def _column(a: Run, b: Run, column: str, frames: list[int]) -> dict[str, Any]:
    shares = []
    for run in (a, b):
        rows = {row["frame"]: row for row in run.frames}
        counts = [(rows[f][column], rows[f]["pixels"]) for f in frames]
        if any(count is None for count, _ in counts):
            reason = run.summary["discard"][column].get("reason", "not measured")
            return {"difference_pp": None, "reason": f"{run.summary['scene']['name']}: {reason}"}
        shares.append(float(np.mean([100.0 * count / pixels for count, pixels in counts])))
    floors = [noise_floor_percent(run.summary).get(column) for run in (a, b)]
    return {"percent": shares, "difference_pp": shares[0] - shares[1], "noise_floor_percent": floors}


def _masks(a: Run, b: Run, frames: list[int]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The blocks ``masks`` and ``worst``."""
    bits = {
        name: int(bit) for name, bit in COLUMN_BITS.items() if all(r.frames[0].get(name) is not None for r in (a, b))
    }
    compared = np.uint32(sum(bits.values()))
    sums = {name: np.zeros(4, dtype=np.int64) for name in bits}
    worst = None  # differing pixels, -frame: the first of equally bad pairs
    for frame, *saved in _saved_pairs(a.out, b.out, frames, _MASKS, {"mask"}):
        words = [arrays["mask"].astype(np.uint32) for arrays in saved]
        for name, bit in bits.items():
            sums[name] += mask_agreement(*((word & bit) != 0 for word in words))
        differ = int(np.count_nonzero((words[0] ^ words[1]) & compared))
        worst = max(worst or (differ, -frame), (differ, -frame))
    if worst is None:
        return {"reason": NO_MASKS}, {"reason": NO_MASKS}
    out = {}
    for name, (intersection, union, equal, outside) in sums.items():
        out[name] = {
            "iou": float(intersection / union) if union else 1.0,
            "equal_outside_band_percent": float(100.0 * equal / outside) if outside else None,
            "pixels": int(union),
        }
    pixels = a.summary["settings"]["width"] * a.summary["settings"]["height"]
    return out, {"frame": -worst[1], "differing_percent": 100.0 * worst[0] / pixels}


def _features(a: Run, b: Run, frames: list[int]) -> dict[str, Any]:
    settings = b.summary["settings"]
    scale = settings.get("unit_scale") or 1.0
    errors = FeatureErrors(same_place_m=settings["thresholds"]["position"], unit_scale=scale)
    needed = {"position", "camera_position"}
    for _, first, second in _saved_pairs(a.out, b.out, frames, _CHANNELS, needed):
        errors.add(first, second)
    return errors.summary() or {"reason": NO_CHANNELS}


def _time(a: Run, b: Run) -> dict[str, Any]:
    """Seconds per frame of both runs, and the ratio reference / run."""
    entries = [seconds_per_frame(run.summary) for run in (a, b)]
    out: dict[str, Any] = {"runs": entries}
    if all("seconds" in entry for entry in entries) and entries[0]["seconds"] > 0:
        out["ratio"] = entries[1]["seconds"] / entries[0]["seconds"]
    return out


def _saved_pairs(
    first: Path | None, second: Path | None, frames: list[int], name: str, needed: set[str]
) -> Iterator[tuple[int, dict[str, Array], dict[str, Array]]]:
    """Frame, arrays of the first and of the second run, for frames whose file both folders have.

    ``name``: format of the file name, with the frame number as its argument.  A folder may be None: no frames.  Raises
    OutputError for a damaged file, or one without the arrays ``needed``.
    """
    for frame in frames if first is not None and second is not None else ():
        files = first / name.format(frame), second / name.format(frame)
        if all(file.is_file() for file in files):
            yield frame, _arrays(files[0], needed), _arrays(files[1], needed)


def _arrays(path: Path, needed: set[str]) -> dict[str, Array]:
    """All arrays of a file, those ``needed`` among them.  Read here, where their faults are OutputError."""
    with stored_arrays(path) as arrays:
        return {name: arrays[name] for name in needed.union(arrays)}
