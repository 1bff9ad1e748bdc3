"""What the search decides from the records alone: the same again when a study is called again."""

from __future__ import annotations

from dataclasses import replace

from study_tools import situation_of

from taubench_gl.conventions import COLUMNS
from taubench_gl.study.laps import PASSES, ROUGH, Laps
from taubench_gl.study.plan import make_plan
from taubench_gl.study.rounds import SWEEPS
from taubench_gl.study.search import Search

MS = {"base": 20.0, "best": 320.0, "scale=0.5": 5.0, "samples_per_pixel=4": 80.0}
OFF = {"base": 0.2, "best": 0.0, "scale=0.5": 1.0, "samples_per_pixel=4": 0.05}


class Lines:
    """Records of a study without its file."""

    def __init__(self, *lines):
        self.lines = list(lines)

    def of(self, kind):
        return [line for line in self.lines if line["kind"] == kind]

    def add(self, line):
        self.lines.append(line)


def error(name):
    columns = {c: {"percent": None, "reason": "not asked for"} for c in COLUMNS}
    percent = 10.0 + OFF[name]
    told = {"columns": columns | {"direct": {"percent": percent, "pairs": {}}}, "curves": {}}
    return {"kind": "error", "setting": name} | told


def visits(rounds, factor=1.0):
    return [
        {"kind": "time", "setting": n, "pass": 0, "round": r, "passes": {}}
        | {"frame_ms": ms * (1.0 if n == "base" else factor**r)}
        for r in rounds
        for _ in range(SWEEPS)
        for n, ms in MS.items()
    ]


def laps(records, fronts=("direct",), wanted=6):
    situation = situation_of(pairs=40)
    plan = make_plan(situation, ("scale", "samples_per_pixel"))
    plan = replace(plan, settings=tuple(s for s in plan.settings if s.name in MS))
    best = plan.named("best").choice
    search = Search(situation, plan.knobs, fronts, wanted, dict.fromkeys(fronts, 1e-4), best)
    return Laps(search, plan, {f: ("direct",) for f in fronts}, records, "best", None)


def test_rounds_after_the_search_do_not_change_what_it_found():
    records = Lines(*map(error, MS), *visits(range(ROUGH)))
    before = laps(records).seen()
    records.lines += visits(range(ROUGH, 7), factor=1.3)  # all that a study without a second pass still makes
    assert laps(records).seen() == before
    assert laps(records)._margin() == laps(Lines(*map(error, MS), *visits(range(ROUGH))))._margin()


def test_passes_are_used_up_for_the_fronts_that_were_asked_for():
    told = {"kind": "pass", "wanted": 6, "fronts": ["direct", "all"], "kept": []}
    again = [v | {"pass": PASSES} for v in visits(range(ROUGH))]

    def next_errors(**asked):
        return laps(Lines(*map(error, MS), *visits(range(ROUGH)), *[told] * PASSES, *again), **asked).screen()

    assert next_errors() == [], "asked for before"
    assert next_errors(wanted=7), "more are wanted"
    assert next_errors(fronts=("color",)), "another front"


def test_after_a_pass_only_fronts_that_are_short_are_looked_into():
    told = {"kind": "pass", "wanted": 4, "fronts": ["direct"], "kept": []}
    records = Lines(*map(error, MS), *visits(range(ROUGH)), told, *[v | {"pass": 1} for v in visits(range(ROUGH))])
    assert laps(records, wanted=4)._short() == (), "all four stand on it, by the rule"
    assert laps(records, wanted=4).screen() == laps(records, wanted=4).lap() == []
    assert laps(records, wanted=5)._short() == ("direct",)
    assert laps(records, wanted=5).screen()


def test_what_was_tried_and_not_kept_is_not_expected_again():
    records = Lines(*map(error, MS), *visits(range(ROUGH)))
    due = laps(records).screen()
    records.lines += [error("base") | {"setting": s.name, "settings": {"pairs": "all"}} for s in due]
    found = laps(records)
    assert {s.name for s in due} <= {s.name for s in found.expected(found.seen())}
    tried = due[0]
    records.add({"kind": "lap", "after": 0, "tries": [{"setting": tried.name, "choice": tried.choice}]})
    records.add({"kind": "pass", "wanted": 6, "fronts": ["direct"], "kept": []})
    records.lines += [v | {"pass": 1} for v in visits(range(ROUGH))]
    found = laps(records)
    assert tried.name not in {s.name for s in (*found.expected(found.seen()), *found.seen())}


def test_errors_that_a_study_was_measuring_come_first():
    records = Lines(*map(error, MS), *visits(range(ROUGH)))
    due = laps(records).screen()
    assert len(due) > 1 and records.of("screen")
    records.lines.append(error("base") | {"setting": due[0].name})
    assert [s.name for s in laps(records).screen()] == [s.name for s in due[1:]]
    assert len(records.of("screen")) == 1, "nothing new is decided before"
