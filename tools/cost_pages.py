"""Writes docs/cost-measured.md and its figures from the studies of tools/cost_study: ``cost_pages.py OUT DOCS``.

OUT/NAME are the studies of all scenes, OUT/again/NAME the same ones run again, OUT/answers/NAME those of five minutes
at 480x270, OUT/optuna.json the record of tools/cost_optuna.py.
"""

from __future__ import annotations

import base64
import json
import shutil
import statistics
import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.cost.analysis import MaskError, Point, compare_errors, compare_times, time_of
from taubench_gl.cost.preset import LEVELS
from taubench_gl.report.cost_plots import plot_study
from taubench_gl.report.cost_tables import OVERALL, answer, three

Study = Mapping[str, Any]

ENOUGH = 10
"""Configurations of a study that counts for the defaults."""

ABOUT = """# Cost studies: measurements

Written by `DOCS=1 tools/cost_study`; words: [cost.md](cost.md)."""


def main() -> int:
    out, docs = Path(sys.argv[1]), Path(sys.argv[2])
    studies, again, answers = read(out), read(out / "again"), read(out / "answers")
    optuna = out / "optuna.json"
    parts = [ABOUT, "## Levels", *level_table(), "## Recommendations on all scenes", *scene_table(studies, again)]
    parts += ["## The defaults", defaults_text(studies)]
    (out / "figures").mkdir(exist_ok=True)
    for name, study in answers.items():
        parts += [f"## Five minutes at {'x'.join(map(str, study['size']))}: {name}", *answer_text(study)]
        parts += [f"![Mask error against time, {name}](images/cost-{name}.png)"]
        for path in plot_study(study, out / "figures"):
            if path.name == "front.png":
                shutil.copy(path, docs / "images" / f"cost-{name}.png")
    if optuna.is_file():
        parts += ["## Optuna", *optuna_table(json.loads(optuna.read_text(encoding="utf-8")))]
    (docs / "cost-measured.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    return 0


def read(folder: Path) -> dict[str, Study]:
    return {f.parent.name: json.loads(f.read_text(encoding="utf-8")) for f in sorted(folder.glob("*/study.json"))}


def pooled(studies: Sequence[Study]) -> list[Point]:
    """The configurations that all studies have measured, as points of one study of all scenes.

    The pixels of all scenes together are one sample, and the time is the geometric mean over the scenes, by round.
    """
    found = [{p["name"]: p for p in s["points"] if p["masks"] and p["ms"] and p["usable"]} for s in studies]
    out = []
    for name, first in found[0].items():
        same = [of[name] for of in found if name in of]
        if len(same) < len(studies):
            continue
        bits = [base64.b64decode(p["wrong"]) for p in same]
        counts = [s["pixels"]["count"] for s in studies]
        wrong = [np.unpackbits(np.frombuffer(b, np.uint8), count=n) for b, n in zip(bits, counts, strict=True)]
        every = np.concatenate(wrong).astype(bool)
        error = {OVERALL: MaskError(every, 100.0 * float(every.mean()), 0.0, 0.0)}
        rounds = [statistics.geometric_mean(of) for of in zip(*(p["ms"]["rounds"] for p in same))]
        out.append(Point(name, first["label"], first["role"], first["values"], error, time=time_of(rounds)))
    return out


def floor_of(studies: Sequence[Study]) -> float:
    return statistics.fmean(s["reference"]["floor"].get(OVERALL) or 0.0 for s in studies)


def beats(a: Point, b: Point, floor: float) -> bool:
    """Whether ``a`` is better than ``b`` beyond noise, in time or in exactness, and not worse in the other."""
    slower, less_exact = compare_times(a.time, b.time), compare_errors(a, b, OVERALL, floor)
    no_slower = slower <= 0 and a.time.median <= b.time.median
    return (slower < 0 and less_exact <= 0) or (less_exact < 0 and no_slower)


def beating(studies: Sequence[Study], name: str) -> list[Point]:
    """The configurations that beat ``name`` over all scenes together."""
    points, floor = pooled(studies), floor_of(studies)
    one = next(p for p in points if p.name == name)
    return [p for p in points if beats(p, one, floor)]


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Markdown; the first column is to the left."""
    lines = [heads, ["---", *["---:"] * (len(heads) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def timed_of(study: Study) -> int:
    """Configurations with masks and times."""
    return sum(1 for p in study["points"] if p["ms"] and p["masks"])


def answer_text(study: Study) -> list[str]:
    about = f"{study['pairs']} pairs, {', '.join(study['columns'])}; {study['date']}"
    return [about, "\n".join(f"- {line}" for line in answer(study))]


def scene_table(studies: Mapping[str, Study], again: Mapping[str, Study]) -> list[str]:
    """Whether each recommendation is on the printed front, is beaten, and is kept when the study runs again."""
    rows = []
    for name, study in studies.items():
        chosen, labels = study["chosen"]["configuration"], {p["name"]: p["label"] for p in study["points"]}
        beaten = ", ".join(p.label for p in beating([study], chosen)) or "nothing"
        second = again.get(name)
        kept = "not run again" if second is None else labels[second["chosen"]["configuration"]]
        on_front = "yes" if chosen in study["fronts"][OVERALL] else "no"
        floor, state = study["reference"]["floor"].get(OVERALL) or 0.0, study["machine_state"]
        busy = f"{state['load']:.1f}, {100.0 * (state['drift'] or 0.0):.0f} %{', BUSY' if state['busy'] else ''}"
        row = [name, labels[chosen], on_front, beaten, kept, str(timed_of(study)), str(study["reference"]["samples"])]
        rows.append([*row, three(floor), study["clock"], busy])
    heads = ["scene", "recommended", "on the front", "beaten by", "when run again", "configurations timed"]
    heads += ["reference, samples per pixel", "noise floor, %", "clock", "load, drift of the baseline"]
    first = next(iter(studies.values()))
    about = (
        f"{'x'.join(map(str, first['size']))}, {first['pairs']} pairs, {first['machine']['renderer']}, "
        f"{first['machine']['cores']} cores shared with other work. Beaten: by a measured configuration that is better "
        "beyond noise in time or exactness and not worse in the other."
    )
    return [about, table(heads, rows)]


def defaults_text(studies: Mapping[str, Study]) -> str:
    """Whether anything measured beats ``balanced``, over the scenes together and on each."""
    whole = {name: s for name, s in studies.items() if timed_of(s) >= ENOUGH}
    over_all = [p.label for p in beating(list(whole.values()), "baseline")]
    on_each = {name: [p.label for p in beating([s], "baseline")] for name, s in whole.items()}
    scenes = [f"{name}: {', '.join(found)}" for name, found in on_each.items() if found]
    return (
        f"Over {', '.join(whole)} together, of {len(pooled(list(whole.values())))} configurations that all of them "
        f"have measured, `balanced` is beaten beyond noise by {'; '.join(over_all) or 'none'}. On single scenes: "
        f"{'; '.join(scenes) or 'by none'}."
    )


def level_table() -> list[str]:
    """What each level costs and loses, as its preset says."""
    found = {name: tomllib.loads(path.read_text(encoding="utf-8")) for name, path in LEVELS.items()}
    first, defaults = found["balanced"]["measured"], found["balanced"]["settings"]
    columns = list(first["wrong_percent"])
    about = (
        f"Percent of wrong masks by column; ms/frame of {first['scene']}, {first['size']}, {first['renderer']}, "
        f"{first['driver']}, {first['date']}; reference: {first['reference_samples']} samples per pixel; noise floor "
        f"overall {three(first['noise_floor_percent'])} %; {first['rounds']} rounds of timing"
        + (", on a busy machine: times are rough." if first["machine_busy"] else ".")
    )
    rows = []
    for name, preset in found.items():
        measured, settings = preset["measured"], preset["settings"]
        changed = ", ".join(f"{k} {v}" for k, v in settings.items() if defaults.get(k) != v) or "–"
        wrong = [three(measured["wrong_percent"][c]) for c in columns]
        rows.append([name, three(measured["ms_per_frame"]), f"{measured['times_balanced']:.3g}x", *wrong, changed])
    return [about, table(["level", "ms/frame", "of balanced", *columns, "differs from the defaults"], rows)]


def optuna_table(record: Study) -> list[str]:
    """How often the sampler found something that beats a declared configuration of the front."""
    rows = [
        [r["scene"], str(r["seconds"]), str(r["trials"]), f"{len(r['declared_beaten'])} of {len(r['declared'])}",
         f"{len(r['found_beaten'])} of {len(r['found'])}"]
        for r in record["scenes"]
    ]  # fmt: skip
    wins = sum(1 for r in record["scenes"] if r["declared_beaten"])
    about = (
        f"Optuna {record['optuna']}, TPE with two objectives, for the seconds below, about as long as the declared "
        "configurations had. Both fronts are timed together afterwards, in interleaved rounds; beaten as above. It is "
        f"part of `cost` if it beats a declared configuration on three of five scenes: so far on {wins} of {len(rows)}."
    )
    heads = ["scene", "seconds", "trials", "declared ones beaten", "found ones beaten by declared ones"]
    return [about, table(heads, rows)]


if __name__ == "__main__":
    sys.exit(main())
