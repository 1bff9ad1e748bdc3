"""Tables 1 to 4 of the paper's scenes, each row beside the paper's and their difference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from taubench_gl.features import COLUMNS, FEATURES, UNITS
from taubench_gl.glossary import CENSUS
from taubench_gl.glossary import COLUMNS as COLUMN_TERMS
from taubench_gl.paper.fit import Fitted
from taubench_gl.paper.scenes import CAMERA_FPS, RENDER_FPS
from taubench_gl.paper.study import CAMERA as CAMERA_JOB
from taubench_gl.paper.study import SceneResult, image_name
from taubench_gl.report.labels import lighting_text
from taubench_gl.report.paper import SAMPLING_COLUMNS, camera_column, conditions, paper_numbers, table_row
from taubench_gl.report.table import Column, Row, Table

Keys = tuple[str, ...]
"""Keys of nested blocks, from the outermost."""

COUNTS = ("dynamic_rigid_objects", "armatures", "static_point_lights", "dynamic_point_lights")
POSITION = ("mean", "variance", "max")
ROTATION = tuple((axis, key) for axis in ("pitch", "yaw", "roll") for key in ("mean", "variance"))
FITTED_NOTE = "the stand-in was made to have the paper's value"
LIGHT_NOTE = "the stand-in's lights and exposure were fitted to the paper's value, path-traced at 1920x1080"
DIFFERENCE = "difference"


def paper_row(name: str) -> Mapping[str, Any]:
    """The paper's row of a scene.  Raises KeyError."""
    return {scene["name"]: scene for scene in paper_numbers()["scenes"]}[name]


def paper_study_tables(
    results: Sequence[SceneResult], fitted: Mapping[str, Fitted], *, quick: bool = False
) -> list[Table]:
    """Tables 1 to 4; the lobes of Table 4 and the fitted thresholds where there are any."""
    tables = [_counts(results), _position(results), _rotation(results), _discard(results, fitted, quick)]
    lobes = _lobes(results)
    return [*tables, *([lobes] if lobes else []), *([_fit(fitted)] if fitted else [])]


def _counts(results: Sequence[SceneResult]) -> Table:
    """Table 1: animated objects and lights, which both blocks name alike."""
    bones = []
    for result in results:
        census = (result.camera.summary["census"] or {}) if result.camera is not None else {}
        if census.get("armatures"):
            bones.append(f"{result.scene.label} {census['bones'] / census['armatures']:g}")
    columns = tuple(Column(CENSUS[key].label, definition=CENSUS[key].tooltip) for key in COUNTS)
    notes = ["bones per armature: the paper gives 52; ours: " + (", ".join(bones) or "no armature")]
    values = [(("census", key), ("census", key)) for key in COUNTS]
    return _compared(1, "Animation details", columns, results, "counts", values, notes)


def _position(results: Sequence[SceneResult]) -> Table:
    """Table 2: meters per frame."""
    columns = tuple(camera_column("position", key, key, "m") for key in POSITION)
    values = [(("camera", "position", key), ("position", key)) for key in POSITION]
    notes = [f"At {CAMERA_FPS:g} frames a second, the paper's capture rate: it does not state the rate of this table."]
    return _compared(2, "Change in the camera's position per frame", columns, results, "camera position", values, notes)


def _rotation(results: Sequence[SceneResult]) -> Table:
    """Table 3: degrees per frame."""
    columns = tuple(
        camera_column(axis, key, f"{axis} {key[:3] if key == 'variance' else key}", "deg") for axis, key in ROTATION
    )
    values = [(("camera", axis, key), ("rotation", f"{axis}_{key}")) for axis, key in ROTATION]
    return _compared(3, "Change in the camera's rotation per frame", columns, results, "camera rotation", values)


def _compared(
    number: int,
    title: str,
    columns: tuple[Column, ...],
    results: Sequence[SceneResult],
    fact: str,
    values: Sequence[tuple[Keys, Keys]],
    notes: Sequence[str] = (),
) -> Table:
    """A table of the camera jobs: per scene our row, the paper's and the difference.

    ``values``: where each column is in our summary, and where in the paper's row; ``fact``: what a stand-in can be
    fitted to.
    """
    rows: list[Row] = []
    for result in results:
        paper = [value_at(paper_row(result.scene.row), theirs) for _, theirs in values]
        if result.camera is None:
            rows.append(_missing(result.scene.label, len(columns), result.failed[CAMERA_JOB]))
            rows.append(_paper(result.scene.row, paper))
            continue
        summary = result.camera.summary
        measured = [value_at(summary, ours) for ours, _ in values]
        samples = summary | {"pairs": summary["camera"]["samples"]}  # one pair was drawn
        row = table_row(result.scene.label, measured, samples)
        rows += [_marked(row, dict.fromkeys(range(len(values)), FITTED_NOTE) if fact in result.scene.fitted else {})]
        rows += [_paper(result.scene.row, paper), _difference(measured, paper)]
    return Table(number, title, (*columns, *SAMPLING_COLUMNS), tuple(rows), tuple(notes))


def value_at(values: Mapping[str, Any], keys: Keys) -> Any:
    """The value that nested ``keys`` lead to; None where one is missing or null."""
    inner: Any = values
    for key in keys:
        inner = (inner or {}).get(key)
    return inner


def _discard(results: Sequence[SceneResult], fitted: Mapping[str, Fitted], quick: bool) -> Table:
    """Table 4: per scene the paper's row, then ours of every light and rate with interval and difference."""
    rows: list[Row] = []
    notes: list[str] = []
    for result in results:
        paper = [paper_row(result.scene.row)["discard"].get(name) for name in COLUMNS]
        for light, why in result.failed.items():
            if light != CAMERA_JOB:
                rows.append(_missing(f"{result.scene.label}, {light}", len(COLUMNS), why))
        rows.append(_paper(result.scene.row, paper, RENDER_FPS))
        for light, run in result.images.items():
            summary = run.summary
            entries = [summary["discard"].get(name) or {} for name in COLUMNS]
            values = [entry.get("mean_percent") for entry in entries]
            label = f"{result.scene.label}, {light}"
            row = table_row(label, values, summary, *(e.get("reason") for e in entries))
            other = "" if light == image_name("path-traced", RENDER_FPS) else f"; this row is of {light} light"
            marks = {i: f"{LIGHT_NOTE}{other}" for i, name in enumerate(COLUMNS) if name in result.scene.fitted}
            rows += [_marked(row, {i: text for i, text in marks.items() if values[i] is not None})]
            rows += _intervals(label, summary)
            rows.append(_difference(values, paper))
            notes.append(f"{label}: {lighting_text(summary)}; {conditions(summary)}")
    settings = paper_numbers()["settings"]
    notes.append(
        f"Paper: path-traced with {settings['samples_per_pixel']} samples per pixel and {settings['bounces']} bounces "
        f"at {settings['width']}x{settings['height']}; it does not state its thresholds."
    )
    if not fitted:
        notes.append(
            "No thresholds are fitted to it: that needs a dataset of the paper; stand-ins never enter the fit."
        )
    columns = tuple(Column(name, "%", 2, COLUMN_TERMS[name].tooltip) for name in COLUMNS)
    title = "Discarded pixels, mean over the animation" + (" (a sample of its pairs)" if quick else "")
    return Table(4, title, (*columns, *SAMPLING_COLUMNS), tuple(rows), tuple(notes))


def _intervals(label: str, summary: Mapping[str, Any]) -> list[Row]:
    """Two rows, the ends of the 95 % intervals of estimated shares; none where all pixels of all pairs are measured."""
    of_pairs = (summary.get("sampling") or {}).get("columns") or {}
    blocks = [(summary["discard"].get(name) or {}, of_pairs.get(name) or {}) for name in COLUMNS]
    ends = [pixels.get("interval95_percent") or pairs.get("interval95_percent") for pixels, pairs in blocks]
    if not any(ends):
        return []
    sides = [[None if interval is None else interval[side] for interval in ends] for side in (0, 1)]
    texts = (f"{label}, 95 % from", f"{label}, 95 % to")
    return [table_row(text, side, summary, "of every pixel of every pair") for text, side in zip(texts, sides)]


def _lobes(results: Sequence[SceneResult]) -> Table | None:
    """The shares of direct and indirect of each lobe, which the paper names as future work; None without lobes."""
    runs = [(r, light, run) for r in results for light, run in r.images.items() if run.summary.get("lobes")]
    if not runs:
        return None
    names = [(lobe, bounce) for lobe in runs[0][2].summary["lobes"] for bounce in ("direct", "indirect")]
    rows = []
    for result, light, run in runs:
        entries = [run.summary["lobes"][lobe][bounce] for lobe, bounce in names]
        values = [entry.get("mean_percent") for entry in entries]
        why = [entry.get("reason") for entry in entries]
        rows.append(table_row(f"{result.scene.label}, {light}", values, run.summary, *why))
    columns = tuple(Column(f"{bounce} {lobe}", "%", 2) for lobe, bounce in names)
    note = "The paper has no such table: it names separate lobes as future work."
    title = "Discarded pixels by lobe, mean over the animation"
    return Table("lobes", title, (*columns, *SAMPLING_COLUMNS), tuple(rows), (note,))


def _fit(fitted: Mapping[str, Fitted]) -> Table:
    """The thresholds that fit the paper's Table 4 best, with the residual of every dataset."""
    scenes = list(dict.fromkeys(scene for fit in fitted.values() for scene in fit.residuals))
    columns = [Column("threshold", "", 4, "One value for all scenes; position in meters")]
    columns += [Column("rms", "pp", 2, "Of the residuals")]
    columns += [Column(scene, "pp", 2, "Our rate at the threshold - the paper's") for scene in scenes]
    rows = []
    for name in FEATURES:
        fit = fitted.get(name)
        values = (None,) * len(columns)
        if fit is not None:
            values = (fit.threshold, fit.rms, *(fit.residuals.get(scene) for scene in scenes))
        label = f"{name} [{UNITS[name]}]" if name in UNITS else name
        rows.append(Row(label, values, reasons={i: "not measured" for i, v in enumerate(values) if v is None}))
    notes = ("Least squares over the datasets' discard-versus-threshold curves; stand-ins never enter the fit.",)
    return Table("thresholds", "Thresholds fitted to the paper's Table 4", tuple(columns), tuple(rows), notes)


def _paper(name: str, values: Sequence[Any], fps: float | None = None) -> Row:
    """The paper's row of a scene, whose rate is known of images only."""
    reasons = {i: "the paper has a dash" for i, value in enumerate(values) if value is None}
    return Row(name, (*values, fps, None), paper=True, reasons=reasons)


def _difference(ours: Sequence[Any], theirs: Sequence[Any]) -> Row:
    """Our row minus the paper's; None where one of them has no value."""
    pairs = zip(ours, theirs, strict=True)
    return Row(DIFFERENCE, (*(None if a is None or b is None else a - b for a, b in pairs), None, None))


def _missing(label: str, count: int, why: str) -> Row:
    """The row of a scene that failed: ``count`` columns without a value, each for the same reason."""
    return Row(label, (None,) * (count + 2), reasons=dict.fromkeys(range(count), why))


def _marked(row: Row, marks: Mapping[int, str]) -> Row:
    """A row with footnotes, by column."""
    return replace(row, reasons={**row.reasons, **marks})
