"""Frames made elsewhere as a method, and saved results: what is written can be evaluated again."""

from __future__ import annotations

import json

import numpy as np
import OpenEXR
import pytest
from reuse_scenes import SIZE, passing_box
from reuse_tools import evaluate, run_cli

from taubench_gl.errors import MethodError, SettingsError
from taubench_gl.pathtraced.exr import read_exr, write_exr
from taubench_gl.reuse.evaluate_output import ReuseFolder
from taubench_gl.reuse.loading import MethodSpec
from taubench_gl.reuse.recorded import RecordedFrames, ResultWriter

pytestmark = pytest.mark.usefixtures("fixed_light")

FRAMES = (8, 11)


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Results of ``accumulate`` over three frames, and the evaluation."""
    out = tmp_path_factory.mktemp("saved") / "run"
    seen = []
    with ReuseFolder(out, 24.0, "none", save=("results",)) as folder:

        def on_frame(frame):
            seen.append(frame)
            folder.on_frame(frame)

        done = evaluate(
            passing_box(), ["accumulate"], FRAMES, input="jittered", settings={"exposure": 0.75}, on_frame=on_frame
        )
        folder.finish(done)
    return out / "results", done, seen


def test_saved_results_are_the_radiance_that_was_scored(saved):
    results, _, seen = saved
    index = json.loads((results / "index.json").read_text())
    assert set(index["folders"]) == {"input", "accumulate", "reference"}
    for frame in seen:
        for label, folder in index["folders"].items():
            image = read_exr(results / folder / "seed0" / f"frame_{frame.frame:05d}.exr")
            stored = np.stack([image.plane(c) for c in "RGB"], axis=-1)
            np.testing.assert_allclose(0.75 * stored, frame.radiance[label], rtol=1e-6, atol=1e-9)
    file = OpenEXR.File(str(results / "accumulate" / "seed0" / "frame_00008.exr"))
    header = file.parts[0].header
    assert header["taubench.exposure"] == 0.75 and header["taubench.frame"] == 8


def test_recorded_frames_score_as_the_method_that_made_them(saved):
    results, done, _ = saved
    again = evaluate(
        passing_box(), ["accumulate", f"exr:{results / 'accumulate'}@label=files"], FRAMES,
        input="jittered", settings={"exposure": 0.75},
    )  # fmt: skip
    methods = again.summary["methods"]
    for name in ("psnr_db", "relmse", "flicker"):
        assert methods["files"]["mean"][name] == pytest.approx(
            done.summary["methods"]["accumulate"]["mean"][name], rel=1e-5
        )
    # Another program ran: neither its time nor its memory nor the weight of history is known.
    assert methods["files"]["time_ms"] is None and methods["files"]["memory_bytes"] is None
    assert methods["files"]["reuse"]["mean_weight"] is None and "mean_weight" in methods["files"]["reasons"]
    assert methods["accumulate"]["time_ms"] > 0


def write(folder, frames, size=SIZE, names="RGB", value=0.25):
    for frame in frames:
        planes = {name: np.full(size[::-1], value, dtype=np.float32) for name in names}
        write_exr(folder / f"engine.{frame:04d}.exr", planes)
    return folder


def test_offset_and_scale(tmp_path):
    folder = write(tmp_path / "engine", range(101, 105))
    folder_2 = write(tmp_path / "double", range(8, 12), value=0.5)
    seen = []
    done = evaluate(
        passing_box(), [f"exr:{folder}@offset=93@scale=2", f"exr:{folder_2}"], FRAMES, on_frame=seen.append,
        settings={"exposure": 1.0},
    )  # fmt: skip
    assert not done.failed
    assert np.unique(seen[0].radiance["exr:engine"]) == np.unique(seen[0].radiance["exr:double"]) == 0.5


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda f: write(f, range(8, 10)), ("10",)),  # the last frame is missing
        (lambda f: write(f, range(8, 12), size=(32, 24)), ("32x24", "64x48")),
        (lambda f: write(f, range(8, 12), names=("depth.V",)), ("combined",)),
        (lambda f: write(f, range(8, 12), value=np.nan), ("NaN",)),
        (lambda f: f, ("folder",)),
    ],
)
def test_a_faulty_folder_is_one_line_and_others_continue(tmp_path, make, words):
    folder = make(tmp_path / "engine")
    done = evaluate(passing_box(), ["none", f"exr:{folder}"], FRAMES)
    assert set(done.failed) == {"exr:engine"} and done.summary["methods"]["none"]["failed"] is None
    line = done.failed["exr:engine"]
    assert "\n" not in line and all(word in line for word in words)


def test_a_folder_per_seed(tmp_path):
    for seed in (0, 3):
        write(tmp_path / "engine" / f"seed{seed}", range(8, 12), value=1.0 + seed)
    recorded = RecordedFrames(str(tmp_path / "engine"))
    for seed in (0, 3):
        assert recorded.open(SIZE, range(8, 12), None, seed).radiance(8).max() == 1.0 + seed
    with pytest.raises(MethodError, match="seed1"):
        recorded.open(SIZE, range(8, 12), None, 1)


@pytest.mark.parametrize("given", [{"offset": "1.5"}, {"scale": "0"}, {"scale": "nan"}, {"scale": "x"}, {"gamma": "2"}])
def test_wrong_settings(given):
    with pytest.raises(MethodError) as error:
        RecordedFrames.parse("exr:engine", given)
    assert next(iter(given)) in error.value.what


def test_labels():
    assert MethodSpec.parse("exr:some/where/engine@mapping=unreal").label == "exr:engine"
    spec = MethodSpec.parse("exr:some/where/engine@label=TSR@offset=1")
    assert spec.label == "TSR" and spec.settings == {"offset": "1"}
    with pytest.raises(SettingsError):
        MethodSpec.parse("exr:engine@label=reference")


def test_result_folders_are_distinct_and_former_files_are_removed(tmp_path):
    image = np.ones((2, 3, 3))
    writer = ResultWriter(tmp_path)
    writer.add(1, 0, 2.0, {"a/b": image, "a:b": image, "../x": image})
    assert len(set(writer.folders.values())) == 3
    files = [p.relative_to(tmp_path).parts for p in tmp_path.rglob("*.exr")]
    assert len(files) == 3 and all(len(parts) == 4 and parts[0] == "results" for parts in files)
    again = ResultWriter(tmp_path)
    again.add(5, 1, 2.0, {"c": image})
    assert [p.relative_to(tmp_path / "results").as_posix() for p in tmp_path.rglob("*.exr")] == [
        "c/seed1/frame_00005.exr"
    ]


def test_spp_of_raster_light_is_refused(capsys):
    for command in (
        ["evaluate", "s.glb"],
        ["reuse", "evaluate", "s.glb", "--methods", "none", "--input", "full"],
        ["export", "s.glb", "--out", "x"],
    ):
        code = run_cli(*command, "--light", "raster", "--spp", "4")
        err = capsys.readouterr().err
        assert code == 2 and err.count("\n") == 1 and "spp" in err
