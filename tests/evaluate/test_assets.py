"""The demo scene: contents, the tool that writes it, and the benchmarks that use it."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))
from make_assets import demo

from taubench_gl.evaluation import evaluate_scene
from taubench_gl.paths import PACKAGE
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings

ROOT = PACKAGE.parent
DEMO = ROOT / "assets" / "demo.glb"


def test_demo_scene_is_small_and_licensed() -> None:
    assert DEMO.stat().st_size < 300_000
    assert "CC0-1.0" in (ROOT / "assets" / "README.md").read_text()
    scene = load_scene(DEMO)
    assert 2.0 <= scene.duration <= 3.0
    assert not scene.notes, [str(n) for n in scene.notes]
    assert len(scene.playing) == len(scene.animations) == 6


def test_demo_scene_has_every_feature() -> None:
    run = evaluate_scene(DEMO, Settings(width=160, height=90, shadow_size=64, indirect="none"))
    census = run.summary["census"]
    assert census["armatures"] == 1 and census["bones"] == 6 and census["morphs"] == 1
    assert census["dynamic_rigid_objects"] >= 6 and census["static_rigid_objects"] >= 6
    assert census["static_point_lights"] == 2 and census["dynamic_point_lights"] == 2
    camera = run.summary["camera"]
    assert camera["position"]["mean"] > 0.05 and camera["yaw"]["mean"] > 0.5 and camera["cuts"] == []
    for column in ("frustum", "position", "normal", "direct", "color"):
        share = run.summary["discard"][column]["mean_percent"]
        assert share is not None and 0.1 < share < 50, column
    assert all(row["invalid"] == 0 for row in run.frames)
    assert max(row["behind"] for row in run.frames) == 0


def test_make_assets_writes_the_same_scene(tmp_path: Path) -> None:
    """Geometry and motion bit for bit; images decoded, because another zlib may compress them differently."""
    demo().save(tmp_path / "demo.glb")
    made, stored = load_scene(tmp_path / "demo.glb"), load_scene(DEMO)
    assert made.nodes.names == stored.nodes.names
    for mesh, stored_mesh in zip(made.meshes, stored.meshes, strict=True):
        for a, b in zip(mesh.primitives, stored_mesh.primitives, strict=True):
            np.testing.assert_array_equal(a.positions, b.positions)
            np.testing.assert_array_equal(a.triangles, b.triangles)
    for a, b in zip(made.channels, stored.channels, strict=True):
        assert (a.index, a.path, a.interpolation) == (b.index, b.path, b.interpolation)
        np.testing.assert_array_equal(a.values, b.values)
    for a, b in zip(made.images, stored.images, strict=True):
        np.testing.assert_array_equal(a.decode(), b.decode())


@pytest.mark.parametrize("which", ["geometry", pytest.param("masks", marks=pytest.mark.long)])
def test_bench_writes_ratios_and_its_clock(which: str, tmp_path: Path) -> None:
    command = [sys.executable, ROOT / "tools" / "bench", which, "--no-install", "--size", "96x54", "--repeats", "1"]
    command += ["--out", tmp_path]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert re.search(r"\d+ MiB", done.stdout)
    results = json.loads((tmp_path / "bench.json").read_text())
    assert results["provenance"]["renderer"] and results["provenance"]["clock"] in done.stdout
    assert any(re.search(r"= \d+\.\d x", note) for note in results["benches"][which]["notes"])
    for row in results["benches"][which]["rows"]:
        if row["median_ms"] is None:  # a peer that is not installed
            assert "not installed" in row["note"] and row["ratio"] is None and row["samples"] == 0
            continue
        assert 0 < row["low_ms"] <= row["median_ms"] <= row["high_ms"] and row["samples"] >= 3
        assert row["ratio"] > 0
    assert (tmp_path / "bench.md").read_text().count("|---|") == 1
