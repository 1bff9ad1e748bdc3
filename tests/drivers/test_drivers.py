"""The driver of this process against llvmpipe: hard cases, counts bit for bit, the report for issues.

``tools/test --driver zink`` runs these tests on another driver; on llvmpipe itself they compare two processes.
"""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from taubench_gl.gpu.context import Gpu
from taubench_gl.paths import PACKAGE
from taubench_gl.selftest import run_selftest
from taubench_gl.selftest.driver_report import CHANNELS, FRAMES, SCHEMA

ROOT = PACKAGE.parent

COUNT = """
import json, sys
from taubench_gl import evaluate
from taubench_gl.gpu.context import open_gpu
options = {"frames": range(3), "light": "preview", "light_unit": "candela", "exposure": 1, "environment": "none"}
rows = {}
for columns in ("frustum,position,normal", "frustum,position,normal,direct,color"):
    for more in ({}, {"reprojection": "motion"}, {"reprojection": "motion", "sampling": "bilinear"}):
        run = evaluate(sys.argv[1], size="96x54", columns=columns, indirect="none", **more, **options)
        rows[f"{columns} {more}"] = run.frames
print(json.dumps({"renderer": open_gpu().renderer, "rows": rows}))
"""


def tool(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"tools_{name}", ROOT / "tools" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def other_driver(session_gpu: Gpu) -> None:
    """For what compares the driver of the run with llvmpipe."""
    if session_gpu.backend == "egl" and session_gpu.renderer.startswith("llvmpipe"):
        pytest.skip("it is that driver: tools/test --driver runs this on others")


def counted(environment: dict[str, str] | None = None) -> dict:
    command = [sys.executable, "-c", COUNT, str(ROOT / "assets" / "demo.glb")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, env=environment)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_counts_equal_those_of_llvmpipe(other_driver: None) -> None:
    """Every count of every pair, bit for bit: geometry and light, both reprojections, both samplings."""
    here, reference = counted(), counted(tool("drivers").environ("llvmpipe"))
    assert reference["renderer"].startswith("llvmpipe")
    assert here["rows"] == reference["rows"]


LIGHT = """
import sys
import numpy as np
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import open_gpu
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings
scene = load_scene(sys.argv[1])
lighting = {"light": "path-traced", "spp": 4, "bounces": 4, "light_unit": "candela", "exposure": 1, "environment": 0.5}
settings = Settings(width=96, height=54, columns=("direct", "indirect"), **lighting)
with open_gpu() as gpu:
    source = RasterSource(gpu, AnimatedScene(scene), settings)
    source.advance(0)
    np.savez(sys.argv[2], **{n: source.read(n)[..., :3] for n in ("direct", "indirect")})
"""


def path_traced(file: Path, environment: dict[str, str] | None = None) -> dict[str, np.ndarray]:
    command = [sys.executable, "-c", LIGHT, str(ROOT / "assets" / "demo.glb"), str(file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, env=environment)
    assert done.returncode == 0, done.stderr
    with np.load(file) as arrays:
        return {name: arrays[name].astype(np.float64) for name in arrays}


def test_path_traced_light_equals_that_of_llvmpipe(tmp_path: Path, other_driver: None) -> None:
    """99.9 % of pixels to float tolerance, which grows at every bounce of a narrow lobe; the others without bias."""
    here = path_traced(tmp_path / "here.npz")
    reference = path_traced(tmp_path / "reference.npz", tool("drivers").environ("llvmpipe"))
    for name, expected in reference.items():
        assert expected.any()
        tolerance = 1e-3 * np.maximum(np.abs(expected), expected.mean())
        assert np.mean((np.abs(here[name] - expected) <= tolerance).all(axis=-1)) >= 0.999, name
        assert here[name].mean() == pytest.approx(expected.mean(), rel=1e-3), name


QUICK = ("offsets", "projection", "camera", "depth", "statistics")
"""Groups of hard cases whose shaders compile fast; ``tools/test --driver`` also runs tests/selftest, which has all."""


def test_hard_cases(session_gpu: Gpu, other_driver: None) -> None:
    results = run_selftest(session_gpu, only=QUICK)
    failed = [f"{r.name}: error {r.error:g} of {r.case.tolerance:g} {r.failure or ''}" for r in results if not r.passed]
    assert len(results) > 40 and not failed, "\n".join(failed)


@pytest.mark.long
def test_driver_report(tmp_path: Path) -> None:
    file = tmp_path / "driver.json"
    command = [sys.executable, "-m", "taubench_gl", "doctor", "--report", file]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1200)
    assert done.returncode == 0, done.stderr
    report = json.loads(file.read_text())
    assert report["schema"] == SCHEMA and report["limits"] and report["backends"]
    assert report["selftest"]["passed"] > 100 and report["selftest"]["failed"] == []
    assert len(report["frames"]) == FRAMES
    for entry in report["frames"]:
        assert entry["ms"] > 0 and set(entry["sha256"]) == {"mask", "motion", *CHANNELS}
        assert all(len(checksum) == 64 for checksum in entry["sha256"].values()) and entry["counts"]["pixels"] > 0
