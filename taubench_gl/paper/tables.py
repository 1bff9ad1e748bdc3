"""Tables 1 to 4 of the paper's scenes, each row beside the paper's and their difference."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
from taubench_gl.run import Run

PaperRow = Mapping[str, Any]

COUNTS = ("dynamic_rigid_objects", "armatures", "static_point_lights", "dynamic_point_lights")
POSITION = ("mean", "variance", "max")
ROTATION = tuple((axis, key) for axis in ("pitch", "yaw", "roll") for key in ("mean", "variance"))
FITTED_NOTE = "the stand-in was made to have the paper's value"
LIGHT_NOTE = "the stand-in's lights and exposure were fitted to the paper's value, path-traced at 1920x1080"
DIFFERENCE = "difference"


def paper_row(name: str) -> PaperRow:
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
    columns = tuple(Column(CENSUS[key].label, definition=CENSUS[key].tooltip) for key in COUNTS)
    notes = ["bones per armature: the paper gives 52; ours: " + _bones(results)]
    return _beside(
        1, "Animation details", columns, results, "counts",
        lambda run: [(run.summary["census"] or {}).get(key) for key in COUNTS],
        lambda row: [row["census"][key] for key in COUNTS], notes,
    )  # fmt: skip


def _bones(results: Sequence[SceneResult]) -> str:
    each = []
    for result in results:
        census = (result.camera.summary["census"] or {}) if result.camera is not None else {}
        if census.get("armatures"):
            each.append(f"{result.scene.label} {census['bones'] / census['armatures']:g}")
    return ", ".join(each) or "no armature"


def _position(results: Sequence[SceneResult]) -> Table:
    columns = tuple(camera_column("position", key, key, "m") for key in POSITION)
    return _beside(
        2, "Change in the camera's position per frame", columns, results, "camera position",
        lambda run: [(run.summary["camera"].get("position") or {}).get(key) for key in POSITION],
        lambda row: [row["position"][key] for key in POSITION],
        [f"At {CAMERA_FPS:g} frames a second, the paper's capture rate: it does not state the rate of this table."],
    )  # fmt: skip


def _rotation(results: Sequence[SceneResult]) -> Table:
    columns = tuple(
        camera_column(axis, key, f"{axis} {key[:3] if key == 'variance' else key}", "deg") for axis, key in ROTATION
    )
    return _beside(
        3, "Change in the camera's rotation per frame", columns, results, "camera rotation",
        lambda run: [(run.summary["camera"].get(axis) or {}).get(key) for axis, key in ROTATION],
        lambda row: [row["rotation"][f"{axis}_{key}"] for axis, key in ROTATION],
    )  # fmt: skip


def _beside(
    number: int,
    title: str,
    columns: tuple[Column, ...],
    results: Sequence[SceneResult],
    fact: str,
    ours: Callable[[Run], list[Any]],
    theirs: Callable[[PaperRow], list[Any]],
    notes: Sequence[str] = (),
) -> Table:
    """A table of the camera jobs: per scene our row, the paper's and the difference."""
    rows: list[Row] = []
    for result in results:
        paper = theirs(paper_row(result.scene.row))
        if result.camera is None:
            rows.append(_missing(result.scene.label, len(columns), result.failed[CAMERA_JOB]))
            rows.append(_paper(result.scene.row, paper))
            continue
        values = ours(result.camera)
        samples = result.camera.summary | {"pairs": result.camera.summary["camera"]["samples"]}  # one pair was drawn
        row = table_row(result.scene.label, values, samples)
        rows += [_marked(row, dict.fromkeys(range(len(values)), FITTED_NOTE) if fact in result.scene.fitted else {})]
        rows += [_paper(result.scene.row, paper), _difference(values, paper)]
    return Table(number, title, (*columns, *SAMPLING_COLUMNS), tuple(rows), tuple(notes))


def _discard(results: Sequence[SceneResult], fitted: Mapping[str, Fitted], quick: bool) -> Table:
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
            marks = {i: _light_note(light) for i, name in enumerate(COLUMNS) if name in result.scene.fitted}
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
    sides = [[None if one is None else one[side] for one in ends] for side in (0, 1)]
    texts = (f"{label}, 95 % from", f"{label}, 95 % to")
    return [table_row(text, side, summary, "of every pixel of every pair") for text, side in zip(texts, sides)]


def _light_note(light: str) -> str:
    return (
        LIGHT_NOTE if light == image_name("path-traced", RENDER_FPS) else f"{LIGHT_NOTE}; this row is of {light} light"
    )


def _lobes(results: Sequence[SceneResult]) -> Table | None:
    """direct and indirect of each lobe, which the paper names as future work."""
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
    return Table(
        "lobes",
        "Discarded pixels by lobe, mean over the animation",
        (*columns, *SAMPLING_COLUMNS),
        tuple(rows),
        (note,),
    )


def _fit(fitted: Mapping[str, Fitted]) -> Table:
    """The thresholds that fit the paper's Table 4 best, with the residual of every dataset."""
    scenes = list(dict.fromkeys(scene for fit in fitted.values() for scene in fit.residuals))
    columns = [
        Column("threshold", "", 4, "One value for all scenes; position in meters"),
        Column("rms", "pp", 2, "Of the residuals"),
    ]
    columns += [Column(scene, "pp", 2, "Our rate at the threshold - the paper's") for scene in scenes]
    rows = []
    for name in FEATURES:
        fit = fitted.get(name)
        left = [None if fit is None else fit.residuals.get(scene) for scene in scenes]
        values = (None if fit is None else fit.threshold, None if fit is None else fit.rms, *left)
        label = f"{name} [{UNITS[name]}]" if name in UNITS else name
        rows.append(Row(label, values, reasons={i: "not measured" for i, v in enumerate(values) if v is None}))
    notes = ("Least squares over the datasets' discard-versus-threshold curves; stand-ins never enter the fit.",)
    return Table("thresholds", "Thresholds fitted to the paper's Table 4", tuple(columns), tuple(rows), notes)


def _paper(name: str, values: Sequence[Any], fps: float | None = None) -> Row:
    reasons = {i: "the paper has a dash" for i, value in enumerate(values) if value is None}
    return Row(name, (*values, fps, None), paper=True, reasons=reasons)


def _difference(ours: Sequence[Any], theirs: Sequence[Any]) -> Row:
    pairs = zip(ours, theirs, strict=True)
    return Row(DIFFERENCE, (*(None if a is None or b is None else a - b for a, b in pairs), None, None))


def _missing(label: str, count: int, why: str) -> Row:
    return Row(label, (None,) * (count + 2), reasons=dict.fromkeys(range(count), why))


def _marked(row: Row, marks: Mapping[int, str]) -> Row:
    return Row(row.label, row.values, row.paper, {**row.reasons, **marks}, row.percent_of)
