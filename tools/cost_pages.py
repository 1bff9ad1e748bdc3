"""Writes docs/cost-measured.md and its figures from the studies of tools/cost_study: ``cost_pages.py OUT DOCS``.

OUT/NAME are the studies of all scenes, OUT/again/NAME the same ones run again, OUT/answers/NAME, NAME-again and
NAME-longer those at 480x270.  A section without studies in OUT is kept.
"""

from __future__ import annotations

import base64
import json
import shutil
import statistics
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.cost.analysis import SAME_TIME, MaskError, Point, compare_errors, time_of
from taubench_gl.option_groups import OVERALL
from taubench_gl.report.cost import answer, plot_study, three
from taubench_gl.report.table import Column, Row, Table, to_markdown

Study = Mapping[str, Any]

FASTER = SAME_TIME**2
"""Ratio of times beyond noise: SAME_TIME is about one standard deviation of the ratio from run to run."""

ENOUGH = 10
"""Configurations of a study that counts for the defaults."""

ABOUT = """# Cost studies: measurements

Written by `tools/record cost`; words: [cost.md](cost.md). Measured before exposures belonged to the scene:
the demo at 480x270 had 0.266, now 1.018. The combinations and the rule of the recommendation
were chosen with results on the demo: it is no independent test. Fewer than three rounds separate no configurations by
time."""


def main() -> int:
    out, docs = Path(sys.argv[1]), Path(sys.argv[2])
    page = docs / "cost-measured.md"
    studies, again, answers = read(out), read(out / "again"), read(out / "answers")
    written: dict[str, list[str]] = {
        "Recommendations on all scenes": scene_table(studies, again) if studies else [],
        "The defaults": [defaults_text(studies)] if studies else [],
        "Answers of five minutes at 480x270": [answer_text(*item) for item in answers.items()]
        + ([figure(docs, answers["demo-longer"])] if "demo-longer" in answers else []),
    }
    kept = dict(part.split("\n\n", 1) for part in page.read_text(encoding="utf-8").split("\n## ")[1:])
    parts = [ABOUT]
    for title, lines in written.items():
        parts += [f"## {title}", *(lines or [kept[title]])]
    page.write_text("\n\n".join(map(str.strip, parts)) + "\n", encoding="utf-8")
    return 0


def answer_text(name: str, study: Study) -> str:
    """The three lines of a study, and what it measured."""
    scene, _, run = name.partition("-")
    runs = {"": "5 minutes", "again": "5 minutes again, from scratch", "longer": "continued for up to 7 minutes"}
    rivals = ", ".join(beating([study], study["chosen"]["configuration"])) or "nothing"
    lines = [*answer(study), f"{study['pairs']} pairs, {study['date']}; beaten by {rivals}"]
    return "\n".join([f"**{scene}, {runs[run]}**", "", *(f"- {line}" for line in lines)])


def figure(docs: Path, study: Study) -> str:
    with tempfile.TemporaryDirectory() as folder:
        plot_study(study, Path(folder))
        shutil.copy(Path(folder) / "front.png", docs / "images" / "cost-demo.png")
    return "![Mask error against time, demo](images/cost-demo.png)"


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
        error = {OVERALL: MaskError(every, 100.0 * float(every.mean()), 0.0)}
        rounds = [statistics.geometric_mean(of) for of in zip(*(p["ms"]["rounds"] for p in same))]
        out.append(Point(name, first["label"], first["role"], first["values"], error, time=time_of(rounds)))
    return out


def beating(studies: Sequence[Study], name: str) -> list[str]:
    """Configurations that over all scenes together beat ``name`` beyond noise, in time or exactness, and are not worse
    in the other."""
    points = pooled(studies)
    floor = statistics.fmean(s["reference"]["floor"].get(OVERALL) or 0.0 for s in studies)
    one = next(p for p in points if p.name == name)
    return [p.label for p in points if beats(p, one, floor)]


def beats(a: Point, b: Point, floor: float) -> bool:
    """Whether ``a`` is better than ``b`` beyond noise, in time or exactness, and not worse in the other."""
    ratio, less_exact = b.time.median / a.time.median, compare_errors(a, b, OVERALL, floor)
    return (ratio > FASTER and less_exact <= 0) or (ratio >= 1.0 and less_exact < 0)


def timed_of(study: Study) -> int:
    """Configurations with masks and times."""
    return sum(1 for p in study["points"] if p["ms"] and p["masks"])


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], title: str) -> str:
    named = tuple(Row(label, tuple(cells)) for label, *cells in rows)
    return to_markdown([Table("cost", title, tuple(map(Column, heads)), named)])


def scene_table(studies: Mapping[str, Study], again: Mapping[str, Study]) -> list[str]:
    """Whether each recommendation is on the printed front, is beaten, and is kept when the study runs again."""
    rows, first = [], next(iter(studies.values()))
    for name, study in studies.items():
        chosen, labels = study["chosen"]["configuration"], {p["name"]: p["label"] for p in study["points"]}
        second = again.get(name)
        kept = "not run again" if second is None else labels[second["chosen"]["configuration"]]
        on_front = "yes" if chosen in study["fronts"][OVERALL] else "no"
        beaten = ", ".join(beating([study], chosen)) or "nothing"
        row = [labels[chosen], on_front, beaten, "the same" if kept == labels[chosen] else kept, str(timed_of(study))]
        rows.append([name, *row, *(facts(s) for s in (study, second) if s is not None)])
        rows[-1] += [""] * (8 - len(rows[-1]))
    heads = ("recommended", "on the front", "beaten by", "run again", "configurations timed", "first run", "second run")
    where = f"{first['machine']['renderer']}, {first['machine']['cores']} cores; clock: {first['clock']}"
    title = f"{'x'.join(map(str, first['size']))}, {where}"
    words = (
        "Beaten: by a measured configuration that is better beyond noise in time (a third) or exactness and not worse "
        "in the other. Runs: samples per pixel of the reference; noise floor, and that of half the samples; rounds; "
        "share of the CPU time that other processes took; change of times."
    )
    return [words, table(heads, rows, title)]


def facts(study: Study) -> str:
    """One run in short."""
    reference, state = study["reference"], study["machine_state"]
    floors = [reference[k].get(OVERALL) for k in ("floor", "floor_before")]
    floor = " %, ".join(three(f) for f in floors if f is not None)
    rounds = max(p["ms"]["samples"] for p in study["points"] if p["ms"])
    other, drift = (100.0 * (state[k] or 0.0) for k in ("other_work", "drift"))
    busy = ", BUSY" if state["busy"] else ""
    return f"{reference['samples']} spp; {floor} %; {rounds} rounds; {other:.0f} %; {drift:.0f} %{busy}"


def defaults_text(studies: Mapping[str, Study]) -> str:
    """Whether anything measured beats the defaults, over the scenes together and on each."""
    whole = {name: s for name, s in studies.items() if timed_of(s) >= ENOUGH}
    over_all = beating(list(whole.values()), "baseline")
    on_each = {name: beating([s], "baseline") for name, s in whole.items()}
    scenes = [f"{name}: {', '.join(found)}" for name, found in on_each.items() if found]
    return (
        f"Over {', '.join(whole)} together, of {len(pooled(list(whole.values())))} configurations that all of them "
        f"have measured, the defaults are beaten beyond noise by {'; '.join(over_all) or 'none'}. On single "
        f"scenes: {'; '.join(scenes) or 'by none'}."
    )


if __name__ == "__main__":
    sys.exit(main())
