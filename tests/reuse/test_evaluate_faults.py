"""Failures of evaluations: a failing method does not affect others, and invalid requests fail before rendering."""

from __future__ import annotations

import numpy as np
import pytest
from reuse_scenes import passing_box
from reuse_tools import PLAIN_TOML, evaluate, run_cli, write_method

from taubench_gl.errors import GraphicsError, MethodError, SettingsError
from taubench_gl.report.reuse import reuse_tables
from taubench_gl.reuse.evaluate_output import ReuseFolder
from taubench_gl.reuse.loading import MethodSpec, load_method, method_settings

pytestmark = pytest.mark.usefixtures("fixed_light")


class NanFromThree:
    reads = ("radiance",)

    def __init__(self, size, settings):
        pass

    def step(self, frame):
        return frame["radiance"][..., :3] * (np.nan if frame["index"] >= 3 else 1.0)


class Odd(BaseException):
    """An error that no ``except Exception`` catches."""


class RaisesOdd(NanFromThree):
    def step(self, frame):
        raise Odd("why")


class Interrupts(NanFromThree):
    def step(self, frame):
        raise KeyboardInterrupt


def test_a_method_that_raises_anything_fails_alone_and_an_interrupt_ends_all():
    done = evaluate(passing_box(), [MethodSpec("odd", RaisesOdd), "none"], (0, 3))
    assert set(done.failed) == {"odd"} and "Odd: why" in done.failed["odd"]
    with pytest.raises(KeyboardInterrupt):
        evaluate(passing_box(), [MethodSpec("interrupts", Interrupts), "none"], (0, 3))


def test_failing_method_does_not_affect_others(tmp_path):
    glsl = "void reuse(ivec2 p) { write_result(p, nonsense); }\n"
    broken = write_method(tmp_path / "broken", PLAIN_TOML, a=glsl)
    specs = ["nosuch", str(broken), "none@gamma=3", MethodSpec("nan", NanFromThree), "accumulate"]
    done = evaluate(passing_box(), specs, (0, 5))
    assert set(done.failed) == {"nosuch", "broken", "none@gamma=3", "nan"}
    assert all("\n" not in line for line in done.failed.values())
    assert "frame 3" in done.failed["nan"] and "gamma" in done.failed["none@gamma=3"]
    alone = evaluate(passing_box(), ["accumulate"], (0, 5))
    assert done.summary["methods"]["accumulate"]["mean"] == alone.summary["methods"]["accumulate"]["mean"]
    assert [row["method"] for row in done.rows] == ["accumulate"] * 5
    text = [row.reasons for row in reuse_tables(done.summary)[0].rows]
    assert sum(bool(reasons) for reasons in text) >= 4


@pytest.mark.parametrize(
    ("request_", "value"),
    [
        ({"methods": []}, ""),
        ({"methods": ["none", "none"]}, "'none'"),
        ({"methods": ["none@alpha"]}, "'none@alpha'"),
        ({"metrics": ["vmaf"]}, "'vmaf'"),
        ({"reference": "best"}, "'best'"),
        ({"reference_samples": 0}, "0"),
        ({"input": "exr:nowhere"}, "'max'"),
        ({"input": "path-traced@1", "reference": "max"}, ""),
        ({"input": "path-traced@1", "reference": "exr:folder"}, ""),
        ({"input": "exr:folder", "reference": "path-traced@4"}, ""),
        ({"input": "full", "reference": "path-traced@0"}, ""),
        ({"frames": (0, 1)}, ""),
        ({"cuts": (1, 7)}, "7"),
    ],
)
def test_invalid_requests(request_, value):
    given = {"methods": ["none"], "frames": (0, 3)} | request_
    with pytest.raises(SettingsError, match=value or None):
        evaluate(passing_box(), given.pop("methods"), given.pop("frames"), **given)


@pytest.mark.parametrize("methods", [["nosuch"], ["nosuch", "none@gamma=3"]])
def test_nothing_is_written_if_no_method_loads(methods, tmp_path):
    names = "nosuch" if len(methods) == 1 else "nosuch.*gamma"
    with pytest.raises(MethodError, match=names), ReuseFolder(tmp_path / "run", 24.0) as folder:
        evaluate(passing_box(), methods, (0, 5), on_frame=folder.on_frame)
    assert list(tmp_path.iterdir()) == []


def test_settings_are_parsed_by_the_method():
    method = load_method("taa_clamp")
    got = method_settings(method, {"alpha": "0.25", "clamping": "false", "filtering": "nearest"})
    assert got["alpha"] == 0.25 and got["clamping"] is False and got["filtering"] == "nearest"
    with pytest.raises(MethodError, match="alpha"):
        method_settings(method, {"alpha": "much"})


def test_lack_of_memory_ends_one_method_only(monkeypatch):
    def poor(gpu, needed, what, hint):
        if "svgf" in what:
            raise GraphicsError(f"{what} needs 9.0 GB, 1.0 GB are free", hint=hint)

    monkeypatch.setattr("taubench_gl.reuse.runner.require_memory", poor)
    done = evaluate(passing_box(), ["svgf", "none"], (0, 3))
    assert list(done.failed) == ["svgf"] and "9.0 GB" in done.failed["svgf"]
    assert [row["method"] for row in done.rows] == ["none"] * 3


@pytest.mark.parametrize(("module", "options"), [("skimage", ["--metrics", "psnr,ssim"]), ("flip_evaluator", []),
                                                 ("imageio_ffmpeg", ["--metrics", "psnr"])])  # fmt: skip
def test_missing_package_is_one_line(tmp_path, monkeypatch, capsys, module, options):
    for name in ("evaluate", "evaluate_output"):
        monkeypatch.setattr(f"taubench_gl.reuse.{name}.find_spec", lambda name: None if name == module else True)
    code = run_cli("reuse", "evaluate", "s.glb", "--methods", "none", "--out", tmp_path / "out", *options)
    err = capsys.readouterr().err
    assert code == 2 and "taubench-gl[reuse]" in err and err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
