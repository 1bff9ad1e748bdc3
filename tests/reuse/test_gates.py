"""Rejection tests as gates of restir-di: which history reservoirs are kept, and that nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner
from references.reuse_methods import inside, previous_px, sample_history
from sample_tools import lamps, opened

from taubench_gl.apps.cli import cli
from taubench_gl.errors import MethodError
from taubench_gl.frame.targets import read_channel
from taubench_gl.reject.as_method import write_methods
from taubench_gl.reject.contract import builtin_tests, load_test, load_tests
from taubench_gl.reuse.frame import read_result
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.runner import MethodRunner

pytestmark = pytest.mark.usefixtures("fixed_light")

SETTINGS = {"candidates": 2, "neighbors": 0}


def played(gpu, method, frames: int = 3):
    """The result and reports of the last frame of a method, and its inputs as arrays; camera and a lamp move."""
    scene = lamps(moving=(20.0, 0.0, 0.0), camera_speed=12.0, occluder=True)
    with (
        opened(
            gpu, scene, (*method.reads, "motion", "prev_position", "history_position", "history_ids", "ids")
        ) as inputs,
        MethodRunner(gpu, method, inputs.size, SETTINGS) as runner,
    ):
        for number in range(frames):
            frame = inputs.advance(number)
            result = read_result(runner.step(frame))
        names = ("motion", "position", "prev_position", "history_position", "ids", "history_ids")
        arrays = {n: read_channel(frame.textures[n], n) for n in names if n in frame.textures}
        return result, runner.reported(frame)["history_sample"], arrays


def history(arrays, name):
    """A channel of the pixel nearest to the previous position, and where that is inside the image."""
    at = previous_px(arrays["motion"])
    return sample_history(arrays[name], at, "nearest"), inside(at, at.shape[1::-1])


@pytest.mark.parametrize("name", ["position=0.05", "object_id"])
def test_a_gate_keeps_what_its_test_does_not_reject(gpu, tmp_path, name):
    (folder,) = write_methods(load_tests([name]), tmp_path, "reservoirs")
    _, reported, arrays = played(gpu, load_method(folder))
    if name == "object_id":
        then, seen = history(arrays, "history_ids")
        same = then[..., 0] == arrays["ids"][..., 0]
    else:
        then, seen = history(arrays, "history_position")
        same = np.linalg.norm((arrays["prev_position"] - then)[..., :3], axis=-1) <= 0.05
    held = (reported[..., 0] >= 0) & (arrays["position"][..., 3] > 0)
    kept = reported[..., 3] > 0.5
    np.testing.assert_array_equal(kept[held], (same & seen)[held])
    assert 10 < np.count_nonzero(kept[held]) < np.count_nonzero(held) - 5


def test_a_gate_that_rejects_everything_has_no_history(gpu, tmp_path):
    (folder,) = write_methods([load_test("position=0")], tmp_path, "reservoirs")
    alone = load_method("restir-di")
    gated, reported, _ = played(gpu, load_method(folder))
    kept = reported[..., 3] > 0.5
    np.testing.assert_array_equal(gated[..., 3][~kept], 0.0)
    assert not kept.any() and alone.settings.keys() | {"threshold"} == load_method(folder).settings.keys()


def test_every_geometric_test_is_a_gate(tmp_path):
    tests = [test for test in map(load_test, builtin_tests()) if test.kind == "geometry"]
    for folder, test in zip(write_methods(tests, tmp_path, "reservoirs"), tests, strict=True):
        method = load_method(folder)
        assert method.own_light and method.settings["threshold"].default == test.threshold
        assert {"history_sample", "kept_sample"} == set(method.reports)


def test_colors_are_no_gate(tmp_path):
    with pytest.raises(MethodError):
        write_methods(load_tests(["position+color_clamp"]), tmp_path, "reservoirs")
    words = ["reject", "method", "--tests", "color_clamp", "--history", "reservoirs", "--out", str(tmp_path / "out")]
    assert isinstance(CliRunner().invoke(cli, words).exception, MethodError)
    assert not (tmp_path / "out").exists()
