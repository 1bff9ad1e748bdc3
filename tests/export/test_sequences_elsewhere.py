"""Exports of the formats nss and noisebase, read by the programs they are for (long).

TAUBENCH_NSS_PYTHON and TAUBENCH_NOISEBASE_PYTHON name interpreters that have ng-model-gym==0.4.0, and noisebase==1.1.1
with zarr<3; no environment holds both, or this package beside ng-model-gym.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from export_tools import DEMO
from learning_scenes import STEPS, moving, previous_pixels
from test_sequences import LIGHT, SIZES, export, exports, zipped

pytestmark = pytest.mark.long
__all__ = ["exports"]
HERE = Path(__file__).parent


def run_elsewhere(variable, script, *arguments):
    """What ``script`` prints, run by the interpreter that ``variable`` names; skips where there is none."""
    python = os.environ.get(variable)
    if not python:
        pytest.skip(f"{variable} names no interpreter")
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [python, HERE / script, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def test_ng_model_gym_reads_and_warps(exports, tmp_path):
    export(tmp_path / "cut", "nss", moving("pan", cut_at=5), (32, 18), LIGHT["nss"], frames=(0, 9))
    folders = [*(exports("nss", kind) for kind in STEPS), tmp_path / "cut"]
    *read, cut = json.loads(run_elsewhere("TAUBENCH_NSS_PYTHON", "read_nss.py", *folders).splitlines()[-1])
    assert cut["windows"] == [[0, 3], [1, 4], [2, 5], [5, 8], [6, 9]]  # none crosses the cut
    for kind, found in zip(STEPS, read, strict=True):
        assert found["health"] is None and found["windows"] == [[0, 3], [1, 4], [2, 5]]
        width, height = SIZES["nss"][kind]
        assert found["shapes"]["colour_linear"] == [3, 3, height // 2, width // 2]
        assert found["shapes"]["truth"] == [3, 3, height, width]
        assert found["exposure"] == 1.0 and found["light"] == pytest.approx(1.0, abs=0.1)
        for warped, unwarped, swapped in zip(found["warped"], found["unwarped"], found["swapped"], strict=True):
            assert warped > unwarped + 3 and warped > swapped + 3


def test_noisebase_reads_and_warps(exports):
    rows = [(exports("noisebase", kind), *SIZES["noisebase"][kind], 5, 2) for kind in STEPS]
    text = run_elsewhere("TAUBENCH_NOISEBASE_PYTHON", "read_noisebase.py", *(word for row in rows for word in row))
    for kind, found in zip(STEPS, json.loads(text.splitlines()[-1]), strict=True):
        (width, height), (stored, _) = SIZES["noisebase"][kind], zipped(exports("noisebase", kind) / "scene0000.zip")
        position = np.moveaxis(stored["position"][4, ..., 0], 0, -1)
        distance = np.linalg.norm(position - stored["camera_position"][4], axis=-1)
        np.testing.assert_allclose(found["depth"], np.log1p(1 / distance), atol=1e-6)
        forward = stored["camera_target"][4] - stored["camera_position"][4]
        planar = (position - stored["camera_position"][4]) @ forward / np.linalg.norm(forward)
        expected = previous_pixels(kind, 4, (width, height), np.where(distance > 1e4, 0.0, planar))
        np.testing.assert_allclose(found["motion"], np.moveaxis(expected, -1, 0)[::-1], atol=2e-3)
        assert found["colors"] == [1, 3, height, width, 2] and found["normal"] == pytest.approx(1.0, abs=1e-3)
        assert found["light"] == pytest.approx(found["reference"], rel=0.1)
        for moved, unmoved, swapped in zip(found["moved"], found["unmoved"], found["swapped"], strict=True):
            assert moved > unmoved + 1 and moved > swapped + 1


def test_the_walk_trains_a_denoiser(tmp_path, monkeypatch, taubench, fixed_light):
    """docs/train-a-denoiser.md at a smaller size.  The interpreter also has OpenEXR."""
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "assets").symlink_to(DEMO.parent)
    page = (HERE.parents[1] / "docs" / "train-a-denoiser.md").read_text()
    (program,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    (tmp_path / "denoise.py").write_text(program.replace("= 64, 10, 4, 1", "= 32, 5, 4, 1"))
    commands = re.findall(r"^taubench-gl (.*)$", page, re.MULTILINE)
    (tmp_path / "denoised").mkdir()
    for command in commands:
        if "exr:denoised" in command:
            assert "epoch 0" in run_elsewhere("TAUBENCH_NOISEBASE_PYTHON", tmp_path / "denoise.py")
        small = command.replace("64x64", "32x32").replace("@64", "@16")
        small = re.sub(r"--frames (\d+):\d+", lambda m: f"--frames {m[1]}:{int(m[1]) + 5}", small)
        code, _, err = taubench(*small.split())
        assert code == 0, err
    methods = json.loads((tmp_path / "scores" / "reuse.json").read_text())["methods"]
    assert methods["exr:denoised"]["mean"]["psnr_db"] > methods["none"]["mean"]["psnr_db"]
