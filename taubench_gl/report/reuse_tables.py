"""Tables of a reuse evaluation (schema ``taubench-gl/reuse/1``) and of a threshold fit, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from taubench_gl.report.tables import Column, Row, Table

Summary = Mapping[str, Any]

_QUALITY = (
    ("psnr_db", Column("PSNR", "dB", 2)), ("ssim", Column("SSIM", "", 4)), ("flip", Column("FLIP", "", 4)),
    ("relmse", Column("relMSE", "", 5)), ("tpsnr_db", Column("tPSNR", "dB", 2)),
    ("flicker", Column("flicker", "", 5)),
)  # fmt: skip
_REUSE = (
    ("reused_percent", Column("reused", "%", 2)), ("mean_weight", Column("mean weight", "", 3)),
    ("wrongly_reused_percent", Column("wrongly reused", "%", 2)),
    ("wrongly_rejected_percent", Column("wrongly rejected", "%", 2)),
)  # fmt: skip


def reuse_tables(summary: Summary) -> list[Table]:
    """Quality; reuse, time and memory; error by class.  Methods that failed are a row of dashes with the reason."""
    methods = summary["methods"]
    notes = reuse_notes(summary)
    quality = [_row(label, m, "mean", [n for n, _ in _QUALITY]) for label, m in methods.items()]
    tables = [Table(1, "Quality against the reference", tuple(c for _, c in _QUALITY), tuple(quality), notes)]
    columns = (*(c for _, c in _REUSE), Column("time", "ms", 3), Column("memory", "MiB", 2))
    rows = [_cost_row(label, m) for label, m in methods.items()]
    clock = f"Time: median of the method's own passes, clock: {summary['clock']}; shading the input: "
    shading = summary["input"]["shading_ms"]
    clock += "done elsewhere." if shading is None else f"{shading:.2f} ms."
    tables.append(Table(2, "Reuse, time and memory", columns, tuple(rows), (clock, _judged(summary))))
    tables.append(_class_table(summary))
    return tables


def reuse_notes(summary: Summary) -> tuple[str, ...]:
    """What every number of the evaluation depends on."""
    s, given, reference = summary["settings"], summary["input"], summary["reference"]
    kind = given["kind"]
    if given["light_samples"]:
        kind += f" ({given['light_samples']} lights, {given['indirect_samples']} virtual lights, seed {given['seed']})"
    against = f"{reference['samples']} samples per pixel" if reference["kind"] == "max" else reference["path"]
    first = f"{summary['scene']['name']}: {s['width']}x{s['height']}, {s['fps']:g} fps, "
    first += f"means over frames {s['first_frame'] + 1} to {s['last_frame']} (N = {summary['judged_frames']}); "
    return (f"{first}input: {kind}; reference: {reference['kind']}, {against}.", *given["notes"])


def fit_table(fit: Summary) -> Table:
    """Every point that a fit tried."""
    names = list(fit["settings"])
    columns = tuple(Column(n, "", 6) for n in names) + (Column(fit["metric"], "", 6),)
    rows = []
    for i, point in enumerate(fit["points"], start=1):
        best = point["settings"] == fit["best"]["settings"]
        values = (*(_number(point["settings"][n]) for n in names), point["value"])
        reasons = {len(names): point["failed"] or "not measured"} if point["value"] is None else {}
        rows.append(Row(f"{i}{' (best)' if best else ''}", values, reasons=reasons))
    notes = (f"{fit['method']}: {fit['better']} is better.", *fit["notes"])
    return Table(1, f"{fit['metric']} against settings of {fit['method']}", columns, tuple(rows), notes)


def _row(label: str, method: Summary, block: str, names: list[str]) -> Row:
    if method["failed"]:
        return Row(label, (None,) * len(names), reasons={0: method["failed"]})
    values = method[block]
    why = method["reasons"]
    reasons = {i: why.get(n, "not measured") for i, n in enumerate(names) if values[n] is None}
    return Row(label, tuple(values[n] for n in names), reasons=reasons)


def _cost_row(label: str, method: Summary) -> Row:
    row = _row(label, method, "reuse", [n for n, _ in _REUSE])
    size = method["memory_bytes"]
    memory = None if size is None else size / 2**20
    return Row(label, (*row.values, method.get("time_ms"), memory), reasons=row.reasons)


def _class_table(summary: Summary) -> Table:
    classes = list(summary["classes"])
    columns = tuple(Column(name, "", 4) for name in classes)
    good = {label: m for label, m in summary["methods"].items() if not m["failed"]}
    rows = []
    for label, method in good.items():
        measure = _class_measure(method)
        values = tuple(method["classes"][c].get(measure) for c in classes)
        rows.append(Row(label, values, reasons={i: "no such pixel" for i, v in enumerate(values) if v is None}))
    if good:
        first = next(iter(good.values()))["classes"]
        rows.append(Row("share of pixels, %", tuple(first[c]["percent"] for c in classes)))
    measure = _class_measure(next(iter(good.values()))) if good else "flip"
    meaning = "; ".join(f"{name}: {doc}" for name, doc in summary["classes"].items())
    return Table(3, f"Mean {measure} by class of pixel", columns, tuple(rows), (f"{meaning}.", _judged(summary)))


def _class_measure(method: Summary) -> str:
    return "flip" if any("flip" in entry for entry in method["classes"].values()) else "relmse"


def _judged(summary: Summary) -> str:
    if summary["judged_by"] == "truth":
        return "Right, wrong and classes: by the masks of the noise-free frames."
    return "Classes: by geometry alone, for there is no noise-free mask."


def _number(value: Any) -> Any:
    return int(value) if isinstance(value, bool) else value
