"""Evaluations end to end: published orderings come out, faults stay with their method, every output is there."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from reuse_scenes import SIZE, drifting_checks, looking_around, passing_box, settings, still

import taubench_gl.reuse
from taubench_gl.errors import GraphicsError, MethodError, OutputError, SettingsError
from taubench_gl.report.reuse_tables import reuse_tables
from taubench_gl.reuse.classes import CLASSES
from taubench_gl.reuse.evaluate import MethodSpec, evaluate_methods, method_settings
from taubench_gl.reuse.evaluate_output import ReuseFolder
from taubench_gl.reuse.evaluate_records import ROW_COLUMNS
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.pictures import detail_window, side_by_side
from taubench_gl.reuse.quality import MEASURES

CHEAP = ("psnr", "relmse", "flicker")


def judge(scene, methods, frames, **more):
    more = {"metrics": CHEAP, "reference_samples": 1} | more
    return evaluate_methods(scene, methods, settings(frames=frames, **more.pop("settings", {})), **more)


def class_mse(evaluation, label, name):
    return evaluation.summary["methods"][label]["classes"][name]["mse"]


# --------------------------------------------------------------------------------------------------- published findings
@pytest.mark.parametrize("kind", ["full", "jittered"])
def test_variance_clip_ghosts_less_than_clamp_and_clamp_less_than_none(kind):
    """Karis 2014 and Salvi 2016: what a passing object uncovers, and what is left behind it."""
    none, clamp, variance = "taa_clamp@clamping=false", "taa_clamp", "taa_variance"
    done = judge(passing_box(), [none, clamp, variance], (0, 14), input=kind)
    hidden = [class_mse(done, label, "disoccluded") for label in (none, clamp, variance)]
    assert hidden[0] > 2 * hidden[1] > 2 * hidden[2] > 0
    whole = [done.summary["methods"][label]["mean"]["psnr_db"] for label in (none, clamp, variance)]
    assert whole[0] < whole[1] < whole[2]


def test_naive_accumulation_ghosts_and_the_oracle_does_not():
    done = judge(passing_box(), ["accumulate", "oracle", "none"], (0, 14))
    assert class_mse(done, "accumulate", "disoccluded") > 0.02
    assert class_mse(done, "oracle", "disoccluded") == 0.0
    reuse = done.summary["methods"]["oracle"]["reuse"]
    assert reuse["wrongly_reused_percent"] == reuse["wrongly_rejected_percent"] == 0.0
    assert reuse["reused_percent"] > 90
    assert done.summary["methods"]["accumulate"]["reuse"]["wrongly_reused_percent"] > 1
    assert done.summary["methods"]["none"]["reuse"]["wrongly_rejected_percent"] == pytest.approx(
        reuse["reused_percent"], abs=1e-9
    )


def test_bilinear_history_blurs_more_than_nearest():
    """Yang et al. 2020: repeated bilinear resampling is a low-pass; nearest keeps contrast, Catmull-Rom most of it."""
    labels = [f"accumulate@filtering={f}" for f in ("bilinear", "nearest", "catmull_rom")]
    last = {}

    def keep(judged):
        last.update(judged.pictures, reference=judged.reference)

    judge(drifting_checks(), labels, (0, 12), on_frame=keep)
    energy = {name: np.mean(np.diff(p[..., 0], axis=1) ** 2) for name, p in last.items()}
    assert 1.3 * energy[labels[0]] < energy[labels[1]] < energy["reference"]
    assert energy[labels[1]] < energy[labels[2]] < energy["reference"]


def test_time_warp_is_right_for_rotation_and_wrong_for_translation():
    """Where history exists.  Under rotation only resampling is left; under translation parallax is missing."""
    rest = {}
    for kind in ("turn", "slide"):
        done = judge(looking_around(kind), ["timewarp"], (0, 6), settings={"width": 96, "height": 72})
        rest[kind] = class_mse(done, "timewarp", "rest")
    assert rest["turn"] < 3e-4 and rest["slide"] > 20 * rest["turn"]


def test_accumulation_over_a_still_scene_falls_as_one_over_n():
    """The variance of a mean of n independent estimates; also: the estimate has no bias that would stay."""
    done = judge(still(), ["accumulate@cap=1000000"], (0, 33), input="noisy")
    scaled = np.array([row["relmse"] * (i + 1) for i, row in enumerate(done.rows)])
    assert len(scaled) == 33
    np.testing.assert_allclose(scaled, scaled.mean(), rtol=0.2)


def test_shading_fewer_pixels_leaves_more_error():
    errors = []
    for kind in ("full", "checkerboard", "quarter"):
        done = judge(drifting_checks(), ["none"], (0, 4), input=kind)
        errors.append(done.summary["methods"]["none"]["mean"]["relmse"])
    assert errors[0] == 0.0 < errors[1] < errors[2]


# ----------------------------------------------------------------------------------------------------------- exactness
def test_the_reference_itself_is_perfect_and_says_why_values_are_missing():
    done = judge(passing_box(), ["none"], (0, 4), metrics=("ssim", "flip", "tpsnr", "flicker"))
    told = done.summary["methods"]["none"]
    assert told["mean"] == {
        "psnr_db": None, "ssim": 1.0, "flip": 0.0, "relmse": 0.0, "tpsnr_db": None, "flicker": 0.0,
    }  # fmt: skip
    assert "infinite" in told["reasons"]["psnr_db"] and "infinite" in told["reasons"]["tpsnr_db"]
    assert sum(c["pixels"] for c in told["classes"].values()) == 3 * SIZE[0] * SIZE[1]


def test_means_are_over_frames_with_history():
    done = judge(passing_box(), ["accumulate"], (0, 5))
    rows, mean = done.rows, done.summary["methods"]["accumulate"]["mean"]
    assert [row["frame"] for row in rows] == [0, 1, 2, 3, 4] and rows[0]["flicker"] is None
    assert mean["relmse"] == pytest.approx(np.mean([row["relmse"] for row in rows[1:]]))
    assert done.summary["judged_frames"] == 4 and mean["ssim"] is None
    assert done.summary["methods"]["accumulate"]["reasons"]["ssim"] == "not asked for"


def test_order_and_company_change_nothing():
    alone = judge(passing_box(), ["taa_clamp"], (0, 6), input="noisy")
    among = judge(passing_box(), ["accumulate", "taa_clamp", "oracle"], (0, 6), input="noisy")
    untimed = [
        [{k: v for k, v in row.items() if k != "time_ms"} for row in e.rows if row["method"] == "taa_clamp"]
        for e in (alone, among)
    ]
    assert untimed[0] == untimed[1]


# -------------------------------------------------------------------------------------------------------------- faults
class NanFromThree:
    reads = ("radiance",)

    def __init__(self, size, settings):
        pass

    def step(self, frame):
        return frame["radiance"][..., :3] * (np.nan if frame["index"] >= 3 else 1.0)


def test_a_failing_method_harms_no_other(tmp_path):
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "method.toml").write_text(
        'title = "b"\ncite = ["x"]\nreads = ["radiance"]\n[[pass]]\nshader = "b.glsl"\nwrites = ["result"]\n'
    )
    (broken / "b.glsl").write_text("void reuse(ivec2 p) { write_result(p, nonsense); }\n")
    specs = ["nosuch", str(broken), "none@gamma=3", MethodSpec("nan", NanFromThree), "accumulate"]
    done = judge(passing_box(), specs, (0, 5))
    assert set(done.failed) == {"nosuch", str(broken), "none@gamma=3", "nan"}
    assert all("\n" not in line for line in done.failed.values())
    assert "frame 3" in done.failed["nan"] and "gamma" in done.failed["none@gamma=3"]
    alone = judge(passing_box(), ["accumulate"], (0, 5))
    assert done.summary["methods"]["accumulate"]["mean"] == alone.summary["methods"]["accumulate"]["mean"]
    assert [row["method"] for row in done.rows] == ["accumulate"] * 5
    text = [row.reasons for row in reuse_tables(done.summary)[0].rows]
    assert sum(bool(reasons) for reasons in text) >= 4


@pytest.mark.parametrize(
    ("request_", "says"),
    [
        ({"methods": []}, "no method"),
        ({"methods": ["none", "none"]}, "named twice"),
        ({"methods": ["none@alpha"]}, "names no method"),
        ({"metrics": ["vmaf"]}, "no metric is named 'vmaf'"),
        ({"reference": "best"}, "reference is 'best'"),
        ({"reference_samples": 0}, "reference samples is 0"),
        ({"input": "exr:nowhere"}, "no 'max' reference"),
        ({"frames": (0, 1)}, "one frame has no history"),
        ({"cuts": (1, 7)}, "cut 7 is not among the frames"),
    ],
)
def test_requests_that_cannot_be_meant(request_, says):
    given = {"methods": ["none"], "frames": (0, 3)} | request_
    with pytest.raises(SettingsError, match=says):
        judge(passing_box(), given.pop("methods"), given.pop("frames"), **given)


@pytest.mark.parametrize("methods", [["nosuch"], ["nosuch", "none@gamma=3"]])
def test_without_any_method_nothing_is_drawn_or_written(methods, tmp_path):
    says = "nosuch" if len(methods) == 1 else "nosuch.*gamma"
    with pytest.raises(MethodError, match=says), ReuseFolder(tmp_path / "run", 24.0) as folder:
        judge(passing_box(), methods, (0, 5), on_frame=folder.on_frame)
    assert list(tmp_path.iterdir()) == []


def test_settings_are_read_as_the_method_says():
    method = load_method("taa_clamp")
    got = method_settings(method, {"alpha": "0.25", "clamping": "false", "filtering": "nearest"})
    assert got["alpha"] == 0.25 and got["clamping"] is False and got["filtering"] == "nearest"
    with pytest.raises(MethodError, match="alpha"):
        method_settings(method, {"alpha": "much"})


# ------------------------------------------------------------------------------------------------------------- outputs
@pytest.fixture(scope="module")
def written(tmp_path_factory):
    out = tmp_path_factory.mktemp("results") / "run"
    frames = []
    with ReuseFolder(out, 24.0, "webm") as folder:

        def seen(judged):
            frames.append(judged)
            folder.on_frame(judged)

        done = judge(passing_box(), ["accumulate", "oracle", "nosuch"], (8, 13), metrics=("flip",), on_frame=seen)
        files = folder.finish(done)
    return out, done, files, frames


def test_the_folder_is_whole(written):
    out, done, files, _ = written
    assert {f.name for f in files} == {f.name for f in out.iterdir()} and not list(out.glob(".*"))
    stored = json.loads((out / "reuse.json").read_text())
    assert stored == done.summary and stored["schema"] == "taubench-gl/reuse/1"
    assert set(stored["measures"]) == set(MEASURES) and set(stored["classes"]) == set(CLASSES)
    assert stored["provenance"]["clock"] == stored["clock"] and stored["methods"]["nosuch"]["failed"]
    with open(out / "frames.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == ROW_COLUMNS and len(rows) == 2 * 5
    assert [float(row["relmse"]) for row in rows] == [row["relmse"] for row in done.rows]
    assert rows[0]["flicker"] == ""
    table = (out / "tables.txt").read_text()
    assert "accumulate" in table and "no method, folder or file 'nosuch'" in " ".join(table.split())


@pytest.mark.parametrize("error", [OutputError("cannot be written: No space left on device"), KeyboardInterrupt()])
def test_numbers_are_written_before_pictures(written, tmp_path, monkeypatch, error):
    def full(*_):
        raise error

    monkeypatch.setattr("taubench_gl.reuse.evaluate_output.plot_reuse", full)
    with pytest.raises(type(error)), ReuseFolder(tmp_path / "run", 24.0, "none") as folder:
        folder.on_frame(written[3][0])
        folder.finish(written[1])
    assert json.loads((tmp_path / "run" / "reuse.json").read_text()) == written[1].summary
    assert (tmp_path / "run" / "frames.csv").read_bytes() == (written[0] / "frames.csv").read_bytes()


def test_the_video_holds_every_frame_at_its_size(written):
    import imageio_ffmpeg

    out, _, _, frames = written
    count, _ = imageio_ffmpeg.count_frames_and_secs(str(out / "side_by_side.webm"))
    assert count == len(frames) == 5
    shape = side_by_side(frames[0]).shape
    reader = imageio_ffmpeg.read_frames(str(out / "side_by_side.webm"))
    assert tuple(next(reader)["source_size"]) == (shape[1] + shape[1] % 2, shape[0] + shape[0] % 2)
    reader.close()


def test_the_detail_is_where_methods_differ(written):
    frames = written[3]
    top, left, h, w = detail_window(frames[-1])
    spread = np.abs(frames[-1].errors["accumulate"] - frames[-1].errors["oracle"])
    assert spread[top : top + h, left : left + w].sum() == pytest.approx(
        max(spread[y : y + h, x : x + w].sum() for y in range(SIZE[1] - h + 1) for x in range(SIZE[0] - w + 1))
    )


def test_an_error_on_the_way_leaves_no_half_video(tmp_path):
    with pytest.raises(ZeroDivisionError), ReuseFolder(tmp_path / "run", 24.0) as folder:

        def seen(judged):
            folder.on_frame(judged)
            if judged.frame == 1:
                raise ZeroDivisionError

        judge(passing_box(), ["none"], (0, 4), on_frame=seen)
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_keeps_the_rows_of_judged_frames(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "reuse.json").write_text("of an earlier evaluation")
    seen = []
    with pytest.raises(KeyboardInterrupt), ReuseFolder(tmp_path / "run", 24.0) as folder:

        def interrupted(judged):
            folder.on_frame(judged)
            seen.append(judged)
            if judged.frame == 2:
                raise KeyboardInterrupt

        judge(passing_box(), ["none", "accumulate"], (0, 9), on_frame=interrupted)
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["frames.csv"]
    with open(tmp_path / "run" / "frames.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(int(r["frame"]), r["method"]) for r in rows] == [(f, m) for f in range(3) for m in ("none", "accumulate")]
    assert [float(r["relmse"]) for r in rows] == [row["relmse"] for j in seen for row in j.rows.values()]


def test_the_command_line_names_what_an_interrupt_kept(tmp_path, monkeypatch, capsys):
    from taubench_gl.apps import cli

    def interrupted(scene, methods, settings, *, progress=None, on_frame=None, **request):
        def seen(judged):
            if on_frame is not None:
                on_frame(judged)
            if judged.frame == 2:
                raise KeyboardInterrupt

        judge(passing_box(), ["none", "accumulate"], (0, 9), on_frame=seen)

    monkeypatch.setattr("taubench_gl.reuse.evaluate.evaluate_methods", interrupted)
    for more, says in (
        (
            ["--out", str(tmp_path / "run"), "--video", "none"],
            f"the rows of 3 frames are in {tmp_path / 'run' / 'frames.csv'}",
        ),
        ([], "nothing was written (--out DIR keeps judged frames)"),
    ):
        with pytest.raises(SystemExit) as ended:
            cli.main(["reuse", "evaluate", "s.glb", "--methods", "none", *more])
        assert ended.value.code == 130
        assert capsys.readouterr().err == f"taubench-gl: interrupted; {says}\n"


def test_memory_that_does_not_suffice_ends_one_method_alone(monkeypatch):
    def poor(gpu, needed, what, hint):
        if "svgf" in what:
            raise GraphicsError(f"{what} needs 9.0 GB, 1.0 GB are free", hint=hint)

    monkeypatch.setattr("taubench_gl.reuse.runner.require_memory", poor)
    done = judge(passing_box(), ["svgf", "none"], (0, 3))
    assert list(done.failed) == ["svgf"] and "9.0 GB" in done.failed["svgf"]
    assert [row["method"] for row in done.rows] == ["none"] * 3


@pytest.mark.parametrize(("module", "options"), [("skimage", ["--metrics", "psnr,ssim"]), ("flip_evaluator", []),
                                                 ("imageio_ffmpeg", ["--metrics", "psnr"])])  # fmt: skip
def test_a_package_that_is_not_installed_is_one_line(tmp_path, monkeypatch, capsys, module, options):
    from taubench_gl.apps import cli

    for name in ("evaluate", "evaluate_output"):
        monkeypatch.setattr(f"taubench_gl.reuse.{name}.find_spec", lambda name: None if name == module else True)
    with pytest.raises(SystemExit) as ended:
        cli.main(["reuse", "evaluate", "s.glb", "--methods", "none", "--out", str(tmp_path / "out"), *options])
    err = capsys.readouterr().err
    assert ended.value.code == 2 and "taubench-gl[reuse]" in err and err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_python_names_are_there():
    assert taubench_gl.reuse.evaluate_methods is evaluate_methods
    assert {"fit_setting", "MethodSpec", "parse_input"} <= set(taubench_gl.reuse.__all__)


def test_the_command_line(tmp_path, capsys):
    from taubench_gl.apps import cli
    from taubench_gl.paths import PACKAGE

    demo = PACKAGE.parent / "assets" / "demo.glb"
    with pytest.raises(SystemExit) as ended:
        cli.main(
            ["reuse", "evaluate", str(demo), "--methods", "none,nosuch", "--size", "48x32", "--frames", "0:3",
             "--indirect", "none", "--shadow-size", "64", "--reference-samples", "1", "--metrics", "flip", "--video",
             "none", "--input", "noisy", "--out", str(tmp_path / "out")]
        )  # fmt: skip
    out, err = capsys.readouterr()
    assert ended.value.code == 2 and "no method, folder or file 'nosuch'" in err and "Traceback" not in err
    assert "Quality against the reference" in out and (tmp_path / "out" / "reuse.json").is_file()
