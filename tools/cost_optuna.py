"""Whether Optuna finds better configurations than the declared ones in the same time.

``cost_optuna.py STUDIES SECONDS RECORD NAME=SCENE@FRAMES...``: STUDIES/NAME is a finished study of tools/cost_study,
whose reference is used again.  Optuna's multi-objective sampler (TPE) gets SECONDS for masks and times.  What it finds
on its Pareto front and the declared front are then timed together, in interleaved rounds.  RECORD receives the results.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import optuna

sys.path.insert(0, str(Path(__file__).parent))
from cost_pages import beats

from taubench_gl.animation import camera_of_run
from taubench_gl.cost.analysis import OVERALL, Point, mask_errors, time_of
from taubench_gl.cost.configurations import Configuration, configuration
from taubench_gl.cost.pixels import discarded, rendered_masks, unpack
from taubench_gl.cost.records import RECORDS_FILE
from taubench_gl.cost.study import Subject, make_subject
from taubench_gl.cost.timing import OpenConfiguration, Pool
from taubench_gl.evaluation import resolve_lighting
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings

SPACE = {
    "storage": ("half", "float"), "shadow_size": (256, 512, 1024), "shadow_filter": ("hard", "bilinear"),
    "shadow_lights": (4, 24), "indirect": ("none", "rsm", "probes"), "indirect_samples": (256, 1024, 4096),
    "probes": (96, 768, 3072),
}  # fmt: skip
ROUNDS, SEED = 3, 0


class Search:
    """Trials on one scene: error and time of any values of SPACE."""

    def __init__(self, subject: Subject, words: str, columns: list[str]):
        self._subject, self._columns = subject, columns
        self._reference = {c: discarded(unpack(words), c) for c in columns}
        self.points: dict[str, Point] = {}

    def measure(self, values: Mapping[str, Any]) -> Point:
        """Masks at the pixels of the study, and one visit."""
        c = configuration("single", dict(values), self._subject.baseline)
        if c.name not in self.points:
            point = self.masks(c)
            with self._subject.gpu:
                opened = self._open(c)
                ms = opened.visit()
                opened.release()
            self.points[c.name] = replace(point, time=time_of([ms]))
        return self.points[c.name]

    def masks(self, c: Configuration) -> Point:
        words = rendered_masks(self._subject.pixels, c.settings)
        errors = mask_errors({k: discarded(words, k) for k in self._columns}, self._reference)
        return Point(c.name, c.label, c.role, c.values, errors)

    def _open(self, c: Configuration) -> OpenConfiguration:
        return OpenConfiguration(self._subject.gpu, self._subject.scene, self._subject.camera, c, time.process_time)

    def timed(self, configurations: list[Configuration]) -> dict[str, list[float]]:
        """Milliseconds in interleaved rounds."""
        found: dict[str, list[float]] = {c.name: [] for c in configurations}
        with self._subject.gpu, Pool(self._open, self._subject.gpu.software) as pool:
            for _ in range(ROUNDS):
                for c in configurations:
                    found[c.name].append(pool.visit(c)["frame_ms"])
        return found


def compare(name: str, scene_path: str, frames: str, studies: Path, seconds: float) -> dict[str, Any]:
    there = json.loads((studies / name / "study.json").read_text(encoding="utf-8"))
    lines = [json.loads(line) for line in (studies / name / RECORDS_FILE).read_text(encoding="utf-8").splitlines()]
    words = [line for line in lines if line["kind"] == "reference"][-1]["words"]
    scene = load_scene(scene_path)
    settings = Settings(size="x".join(map(str, there["size"])), frames=frames)
    settings = resolve_lighting(scene, settings, camera_of_run(scene, settings.sequence)).settings
    subject = make_subject(scene, settings, ("levels", "combinations"), (), None, None)
    assert len(subject.sample) == there["pixels"]["count"]
    search, started = Search(subject, words, there["columns"]), time.monotonic()
    found = make_subject(scene, settings, tuple(SPACE), (), None, None).plan.inapplicable
    space = {n: v for n, v in SPACE.items() if n not in found}
    tried = optuna.create_study(directions=["minimize"] * 2, sampler=optuna.samplers.TPESampler(seed=SEED))

    def trial(t: optuna.Trial) -> tuple[float, float]:
        point = search.measure({n: t.suggest_categorical(n, v) for n, v in space.items()})
        return point.error(), point.time.median

    tried.optimize(trial, timeout=seconds)
    spent = time.monotonic() - started
    found = {configuration("single", t.params, subject.baseline).name: t.params for t in tried.best_trials}
    found_by = [configuration("single", values, subject.baseline) for values in found.values()]
    plan = {c.name: c for c in subject.plan.configurations}
    declared = [plan[n] for n in there["fronts"][OVERALL] if n in plan and not plan[n].traced]
    times = search.timed([*declared, *found_by])
    points = {c.name: replace(search.masks(c), time=time_of(times[c.name])) for c in (*declared, *found_by)}
    floor = there["reference"]["floor"].get(OVERALL) or 0.0

    def beaten(mine: list[Configuration], by: list[Configuration]) -> list[str]:
        return [c.name for c in mine if any(beats(points[o.name], points[c.name], floor) for o in by)]

    return {
        "scene": name,
        "seconds": round(spent),
        "trials": len(tried.trials),
        "declared": [c.name for c in declared],
        "found": [c.name for c in found_by],
        "declared_beaten": beaten(declared, found_by),
        "found_beaten": beaten(found_by, declared),
        "points": {n: {"percent": p.error(), "rounds": list(p.time.rounds)} for n, p in points.items()},
    }


def main() -> int:
    studies, seconds, record = Path(sys.argv[1]), float(sys.argv[2]), Path(sys.argv[3])
    rows = json.loads(record.read_text(encoding="utf-8"))["scenes"] if record.exists() else []
    for given in sys.argv[4:]:
        name, _, rest = given.partition("=")
        path, _, frames = rest.rpartition("@")
        rows = [r for r in rows if r["scene"] != name] + [compare(name, path, frames, studies, seconds)]
        text = json.dumps({"optuna": optuna.__version__, "scenes": rows}, indent=1)
        record.write_text(text + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
