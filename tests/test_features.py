"""The feature table: its records agree with the reason bits, and a new feature is a bit, a record and a distance."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from taubench_gl.conventions import FRUSTUM, NOT_COMPARABLE, Reason
from taubench_gl.features import COUNTED_BITS, TABLE

ROOT = Path(__file__).resolve().parents[1]

ADDED = {
    "taubench_gl/conventions.py": ("    SHADOWED = 1 << 15", "    ROUGHNESS = 1 << 16\n    SHADOWED = 1 << 15"),
    "taubench_gl/features.py": (
        "TABLE: tuple[Feature, ...] = (\n",
        """TABLE: tuple[Feature, ...] = (
    Feature(
        "roughness", "material", Reason.ROUGHNESS, Distance.CHANNELS, "1",
        "Perceptual roughness differs from history by more than the threshold", "Misregistered pixels of roughness",
        (0x44, 0xAA, 0x99), ":", part="yyy", threshold=0.05,
    ),
""",
    ),
    "shaders/masks/masks.comp.glsl": (
        "float distance_direct(",
        "float distance_roughness(vec3 now, vec3 before) { return abs(now.x - before.x); }\nfloat distance_direct(",
    ),
}
"""All that a feature ``roughness`` takes: file -> (text, replacement)."""

EVALUATION = """
import json, sys
import numpy as np
from taubench_gl import Settings
from taubench_gl.conventions import NOT_COMPARABLE, Reason
from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.metrics.masks import value_of
from taubench_gl.report import paper
from taubench_gl.report.run_page import ReportRun, report_data

wrong = bits = above = pixels = 0

def check(pair):
    global wrong, bits, above, pixels
    discarded = (pair.mask & np.uint32(Reason.ROUGHNESS)) != 0
    distance = pair.distances.features["roughness"]
    comparable = (pair.mask & np.uint32(NOT_COMPARABLE)) == 0
    now, before = (value_of("roughness", pair.read("material", previous=old))[..., 0] for old in (False, True))
    still = (pair.motion == 0).all(axis=-1) & comparable
    wrong += int((discarded != (comparable & (distance > np.float32(0.05)))).sum())
    wrong += int((np.abs(distance - np.abs(now - before))[still] > 1e-6).sum())
    bits, above, pixels = bits + int(discarded.sum()), above + int((distance[comparable] >= 0.125).sum()), pixels + 1

settings = Settings(size="96x54", frames="0:3", columns="frustum,position,normal,roughness", exposure=1.0)
run = evaluate_scene(sys.argv[1], settings, Observers(on_pair=check, channels=("material",), distances=True))
curve = run.summary["curves"]["roughness"]
data = report_data([ReportRun(run.summary, run.frames)], ["demo"])
print(json.dumps({
    "wrong": wrong, "bits": bits, "above": above, "rows": sum(row["roughness"] for row in run.frames),
    "curve": curve["at_or_above"][curve["edges"].index(0.125)],
    "percent": run.summary["discard"]["roughness"]["mean_percent"],
    "columns": [column.name for table in paper.paper_tables([run.summary]) for column in table.columns],
    "labels": [reason["label"] for reason in data["runs"][0]["reasons"]],
    "threshold": run.summary["settings"]["thresholds"]["roughness"],
}))
"""


def test_the_bits_of_the_table_are_those_of_the_reason_word() -> None:
    bits = [int(bit) for feature in TABLE for bit in (feature.bit, *feature.details)]
    rest = NOT_COMPARABLE | FRUSTUM | Reason.SKY | Reason.HISTORY_SKY
    assert len(set(bits)) == len(bits)
    assert sum(bits) + int(rest) == sum(map(int, Reason)) == (1 << COUNTED_BITS) - 1


def test_a_new_feature_is_a_bit_a_record_and_a_distance(tmp_path) -> None:
    for folder in ("taubench_gl", "shaders", "assets"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    for name, (text, replacement) in ADDED.items():
        source = (tmp_path / name).read_text(encoding="utf-8")
        assert source.count(text) == 1
        (tmp_path / name).write_text(source.replace(text, replacement), encoding="utf-8")
    assert len(ADDED) <= 4
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    command = [sys.executable, "-c", EVALUATION, str(tmp_path / "assets" / "demo.glb")]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["wrong"] == 0
    assert found["bits"] == found["rows"] > 0
    assert found["above"] == found["curve"] > 0
    assert found["percent"] == pytest.approx(100.0 * found["rows"] / (2 * 96 * 54), rel=1e-15)
    assert "roughness" in found["columns"] and "roughness" in found["labels"]
    assert found["threshold"] == 0.05
