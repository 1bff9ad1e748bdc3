"""docs/reuse.md: its examples run unchanged and its tables are complete; and the reuse commands."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from reuse_scenes import drifting_checks
from reuse_tools import evaluate, play

from taubench_gl.apps.cli import cli
from taubench_gl.conventions import Reason
from taubench_gl.errors import OutputError
from taubench_gl.paths import PACKAGE
from taubench_gl.reuse.check import check_method, write_example
from taubench_gl.reuse.contract import FORMATS
from taubench_gl.reuse.declaration import MethodFile, PassEntry, SettingEntry, StageEntry
from taubench_gl.reuse.frame import INPUTS
from taubench_gl.reuse.glsl_method import FRAME, build_source
from taubench_gl.reuse.loading import builtin_methods, load_method
from taubench_gl.reuse.synthetic import synthetic_steps

pytestmark = pytest.mark.usefixtures("fixed_light")

KEYS = [k for table in (MethodFile, PassEntry, SettingEntry, StageEntry) for k in table.__struct_encode_fields__]
GUIDE = (Path(__file__).resolve().parents[2] / "docs" / "reuse.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"File `([\w./]+)`:\n\n```\w+\n(.*?)```", GUIDE, re.DOTALL))


@pytest.fixture
def guide_method(tmp_path):
    """The folder of the guide's example."""
    assert set(FILES) == {"ema/method.toml", "ema/ema.glsl"}
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path / "ema"


def test_guide_method_accumulates_and_rejects(gpu, guide_method):
    """Less noise than without reuse, and no ghost in the disocclusions of the ball."""
    report = check_method(gpu, guide_method)
    assert report.error < 0.8 * report.error_without_reuse and 0.3 < report.reused < 0.9
    steps = list(synthetic_steps((128, 72), 8, speed=2.0, noise=0.0))
    fresh = (steps[-1].inputs["mask"] & Reason.DISOCCLUDED) > 0
    result = play(gpu, guide_method, steps)[-1]
    assert fresh.sum() > 50
    np.testing.assert_allclose(result[fresh][:, :3], steps[-1].clean[fresh], atol=1e-5)


def test_guide_python_method(gpu, tmp_path):
    (text,) = re.findall(r"```python\n(import numpy.*?)```", GUIDE, re.DOTALL)
    (tmp_path / "accumulate.py").write_text(text)
    report = check_method(gpu, tmp_path / "accumulate.py")
    assert report.method.name == "accumulate" and report.reused is None and report.frames > 2


def test_guide_is_complete():
    for name in (*INPUTS, *FORMATS, *builtin_methods(), *KEYS):
        assert re.search(rf"`[^`]*\b{name}\b[^`]*`", GUIDE), name
    for field in FRAME.fields:
        assert f"frame.{field.name}" in GUIDE, field.name


def test_guide_functions_exist(gpu):
    """Every function of its table is defined in the generated shader."""
    section = GUIDE.split("## Functions in GLSL")[1].split("`frame` contains the numbers")[0]
    method = load_method("svgf")
    text = build_source(method, method.passes[0], (8, 8)).text
    text += "".join(
        build_source(load_method(n), load_method(n).passes[0], (8, 8)).text for n in ("ideal-masks", "checkerboard")
    )
    names = set(re.findall(r"`(?:\w+ )?(\w+)\(", section)) | {"ycocg_from_rgb", "rgb_from_ycocg"}
    for name in names:
        pattern = re.escape(name).replace("_X", "_radiance") if not name.startswith("write_") else "write_"
        assert re.search(rf"\b\w+ {pattern}\w*\(", text), name
    assert len(names) > 14


@pytest.mark.parametrize("python", [False, True])
def test_new_and_check(gpu, tmp_path, monkeypatch, python):
    monkeypatch.chdir(tmp_path)
    run = CliRunner()
    made = run.invoke(cli, ["reuse", "new", "mine", *(["--python"] if python else [])], catch_exceptions=False)
    path = "mine.py" if python else "mine"
    assert made.exit_code == 0 and f"reuse check {path}" in made.output and Path(path).exists()
    checked = run.invoke(cli, ["reuse", "check", path, "--set", "alpha=0.2"], catch_exceptions=False)
    assert checked.exit_code == 0 and "every pixel finite" in checked.output
    report = check_method(gpu, path)
    assert report.error < report.error_without_reuse and report.reused > 0.3
    assert load_method(path).reports == ("reprojected_history",), "a new method has its bound"
    again = run.invoke(cli, ["reuse", "new", "mine", *(["--python"] if python else [])])
    assert again.exit_code != 0 and isinstance(again.exception, OutputError)
    assert check_method(gpu, path).error == report.error, "the existing method is unchanged"


def test_the_guide_shows_the_example_that_samples_lights():
    for name in ("method.toml", "reuse.glsl"):
        assert (PACKAGE / "reuse" / "template" / "samples" / name).read_text(encoding="utf-8") in GUIDE


def test_glsl_and_python_examples_are_equal(gpu, tmp_path):
    """With motion of whole pixels nearest and bilinear history are the same, and so are GLSL and Python."""
    write_example(tmp_path / "a")
    write_example(tmp_path / "b", python=True)
    steps = list(synthetic_steps((48, 27), 6, speed=0.0, noise=0.3))
    for one, other in zip(play(gpu, tmp_path / "a", steps), play(gpu, tmp_path / "b.py", steps)):
        np.testing.assert_allclose(one, other, atol=1e-6)
    run = evaluate(drifting_checks(), [str(tmp_path / "a"), str(tmp_path / "b.py")], (0, 4))
    bounds = [run.summary["methods"][name]["bound"] for name in ("a", "b")]
    assert all(b["blends"] and b["linear_mse"] <= b["method_linear_mse"] for b in bounds)


def test_new_removes_incomplete_files(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError):
        write_example(tmp_path / "file" / "mine")
    assert (tmp_path / "file").read_text() == "x" and len(list(tmp_path.iterdir())) == 1


def test_list_and_show(monkeypatch, tmp_path):
    monkeypatch.setenv("TAUBENCH_BACKEND", "osmesa")  # neither opens a context
    run = CliRunner()
    listed = json.loads(run.invoke(cli, ["reuse", "list", "--json"], catch_exceptions=False).output)
    assert set(builtin_methods()) <= set(listed)
    text = run.invoke(cli, ["reuse", "list"], catch_exceptions=False).output
    assert all(name in text for name in builtin_methods())
    for name in builtin_methods():
        facts = json.loads(run.invoke(cli, ["reuse", "show", name, "--json"], catch_exceptions=False).output)
        method = load_method(name)
        assert facts["cite"] and facts["reads"] == list(method.reads) and set(facts["settings"]) == set(method.settings)
        assert facts["bytes_1080p"] >= 1920 * 1080 * 16
    shown = run.invoke(cli, ["reuse", "show", "taa_variance"], catch_exceptions=False).output
    assert all(part in shown for part in ("Salvi 2016", "gamma", "99.5 MB", "variance.glsl", "0 to 8"))
