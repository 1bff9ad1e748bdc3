"""Writes the named levels of ``evaluate --quality`` from a study and records it: ``cost_levels.py STUDY [FOLDER]``.

``balanced`` is the defaults.  ``draft`` is the fastest of the Pareto front, ``accurate`` the most exact.  ``fast`` has
indirect light, which ``draft`` may lack: of the points that have it and that none of these beats the one with the time
nearest to the geometric middle of draft and balanced.  ``highest`` has every parameter at its best, whether or not that
is more exact on this scene.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taubench_gl.cost.configurations import HIGHEST
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
    front = [p for p in front if p["usable"] and p["role"] != "path_traced"]
    draft, balanced = front[0], points["baseline"]
    middle = 0.5 * (_log_ms(draft) + _log_ms(balanced))
    return {
        "draft": draft,
        "fast": min(_with_indirect_light(study), key=lambda p: abs(_log_ms(p) - middle)),
        "balanced": balanced,
        "accurate": front[-1],
        "highest": points[HIGHEST],
    }


def _log_ms(point: Point) -> float:
    return math.log(point["ms"]["median"])


def _with_indirect_light(study: Study) -> list[Point]:
    """Points of the raster method that no other such point beats in time and exactness, fastest first."""
    known = [p for p in study["points"] if p["usable"] and p["ms"] and p["masks"] and p["role"] != "path_traced"]
    out: list[Point] = []
    for p in sorted(known, key=_log_ms):
        if p["values"].get("indirect") != "none" and (not out or _wrong(p) < _wrong(out[-1])):
            out.append(p)
    return out


def _wrong(point: Point) -> float:
    return point["masks"][OVERALL]["percent"]


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
