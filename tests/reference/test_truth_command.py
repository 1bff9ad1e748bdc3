"""``taubench-gl evaluate exr:DIR``, ``truth`` and ``agree`` as a user types them."""

from __future__ import annotations

import subprocess
import sys

import pytest
from exr_files import blender_frame, write

from taubench_gl.run import load_run


def taubench(*arguments) -> tuple[int, str, str]:
    command = [sys.executable, "-m", "taubench_gl", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    return done.returncode, done.stdout, done.stderr


@pytest.fixture
def renders(tmp_path):
    folder = tmp_path / "renders"
    folder.mkdir()
    for frame in (1, 2, 3):
        write(folder / f"f_{frame}.exr", blender_frame((0.2 * frame, 1.0, 5.0), seed=frame)[0])
    return folder


def test_evaluate_and_agree(renders, tmp_path):
    out = tmp_path / "out"
    options = ("--lobe", "glossy", "--second-seed", f"exr:{renders}", "--save", "masks,channels")
    code, text, err = taubench("evaluate", f"exr:{renders}", "--out", out, *options)
    assert code == 0, err
    assert "Table 4" in text and "estimated from the position pass" in text and "noise floor" in text
    assert load_run(out).summary["lobes"]["glossy"]["direct"]["mean_percent"] > 0
    code, text, _ = taubench("agree", out, out)
    assert code == 0 and "error of" in text and "worst pair" in text


def test_errors_are_one_line(renders, tmp_path):
    for arguments, complaint in (
        (("evaluate", f"exr:{tmp_path / 'none'}"), "is no folder of EXR files"),
        (("evaluate", f"exr:{renders}", "--mapping", "x.toml"), "is no pass mapping"),
        (("evaluate", "scene.glb", "--lobe", "glossy"), "--lobe is for path-traced files"),
        (("truth", "check", f"exr:{renders}", "--layer", "none"), "no layer 'none'"),
        (("truth", "render", tmp_path / "none.glb", "--out", tmp_path / "o"), "no such file"),
    ):
        code, _, err = taubench(*arguments)
        assert code == 2 and complaint in err and err.count("\n") == 1, err


def test_check_has_an_exit_code(renders):
    code, text, _ = taubench("truth", "check", f"exr:{renders}")
    assert code == 0 and "camera: ok" in text
