"""Writes the named levels of ``evaluate --quality`` from a study and records it: ``cost_levels.py STUDY [FOLDER]``.

``balanced`` is the defaults.  ``draft`` is the fastest of the Pareto front, ``highest`` the most exact
of the front; ``fast`` and ``accurate`` are the points whose times are nearest to the geometric middle between balanced
and those.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taubench_gl.cost.parameters import PARAMETERS
from taubench_gl.preset import LEVEL_FIELDS, LEVELS, save_level
from taubench_gl.settings import Settings

Study = Mapping[str, Any]
Point = Mapping[str, Any]
OVERALL = "overall"
RECORDED = Path(__file__).resolve().parents[1] / "docs" / "cost-levels.json"


def main() -> int:
    study = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    folder = Path(sys.argv[2]) if len(sys.argv) > 2 else None
    if folder is None:
        study["provenance"]["command"] = "tools/cost_study"  # without the folders of this machine
        RECORDED.write_text(json.dumps(study, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    for name, (values, measured) in levels(study).items():
        save_level(LEVELS[name] if folder is None else folder / f"{name}.toml", values, measured)
    return 0


def levels(study: Study) -> dict[str, tuple[dict[str, Any], dict[str, Any]]]:
    """Level -> its settings, and what it costs and loses."""
    named = chosen_points(study)
    return {name: (settings_of(point), measured(study, point)) for name, point in named.items()}


def chosen_points(study: Study) -> dict[str, Point]:
    """Level -> its point of the study."""
    points = {p["name"]: p for p in study["points"]}
    front = [points[name] for name in study["fronts"][OVERALL]]
    front = [p for p in front if p["usable"]]
    balanced = points["baseline"]
    draft, highest = front[0], front[-1]
    return {
        "draft": draft,
        "fast": _between(study, front, draft, balanced),
        "balanced": balanced,
        "accurate": _between(study, front, balanced, highest),
        "highest": highest,
    }


def _between(study: Study, front: list[Point], low: Point, high: Point) -> Point:
    """Of the points with times between ``low`` and ``high`` the nearest to their geometric middle: one of the front, or
    of all that are measured where the front has none."""
    ends = [math.log(p["ms"]["median"]) for p in (low, high)]
    measured = [p for p in study["points"] if p["usable"] and p["ms"] and p["masks"]]
    for points in (front, measured):
        between = [p for p in points if ends[0] < math.log(p["ms"]["median"]) < ends[1]]
        if between:
            return min(between, key=lambda p: abs(math.log(p["ms"]["median"]) - 0.5 * sum(ends)))
    return high


def settings_of(point: Point) -> dict[str, Any]:
    """LEVEL_FIELDS of the defaults with the values of ``point``: parameters, or fields of a level."""
    settings = Settings()
    for name, value in point["values"].items():
        known = PARAMETERS.get(name)
        settings = settings.replace(**{name: value}) if known is None else known.apply(settings, value)
    return {name: settings.get(name) for name in LEVEL_FIELDS}


def measured(study: Study, point: Point) -> dict[str, Any]:
    """For the reader of the preset."""
    width, height = study["size"]
    return {
        "scene": study["scene"]["name"],
        "size": f"{width}x{height}",
        "wrong_percent": {c: round(e["percent"], 3) for c, e in point["masks"].items()},
        "ms_per_frame": round(point["ms"]["median"], 2),
        "times_balanced": round(point["against_baseline"]["ratio"], 3),
        "reference_samples": study["reference"]["samples"],
        "noise_floor_percent": round(study["reference"]["floor"][OVERALL], 3),
        "rounds": point["ms"]["samples"],
        "machine_busy": study["machine_state"]["busy"],
        "driver": study["machine"]["driver"],
        "renderer": study["machine"]["renderer"],
        "date": study["date"],
    }


if __name__ == "__main__":
    sys.exit(main())
