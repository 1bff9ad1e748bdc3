"""The track of head motion: traces with the statistics of measured heads, at 24 and 90 fps, played faster."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from taubench_gl.animation import Poser, camera_of_run
from taubench_gl.animation.recorded_camera import read_camera_path
from taubench_gl.benchmark.suite import SUITES, read_suite
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation.schedule import frame_range
from taubench_gl.paths import ASSETS
from taubench_gl.scene import load_scene
from taubench_gl.settings import SequenceSettings

MEASURED = {  # pitch, yaw, roll: mean degrees per frame at 24 and at 90 fps
    "seated": ([0.45, 1.26, 0.28], [0.13, 0.34, 0.08]),
    "walking": ([0.60, 1.12, 0.42], [0.17, 0.30, 0.12]),
    "busy": ([1.46, 4.10, 0.91], [0.42, 1.11, 0.26]),
}


def cases():
    return [case for case in read_suite("full").cases if case.track == "head motion"]


@pytest.mark.parametrize("name", MEASURED)
def test_traces_have_the_statistics_of_measured_heads(name):
    path = read_camera_path(SequenceSettings(camera_path=str(SUITES / "heads" / f"{name}.csv")))
    assert not path.notes and "0 gaps, 0 repeats" in path.taken and path.rate == pytest.approx(90, rel=1e-3)
    assert "Synthetic" in (SUITES / "heads" / f"{name}.csv").read_text().splitlines()[0]
    play = Slerp(path.times, Rotation.from_quat(path.rotation))
    for fps, means in zip((24, 90), MEASURED[name], strict=True):
        angles = play(np.arange(0, path.times[-1], 1 / fps)).as_euler("YXZ")
        change = np.degrees(np.abs(np.diff(np.unwrap(angles, axis=0), axis=0)).mean(axis=0))
        np.testing.assert_allclose(change[[1, 0, 2]], means, rtol=0.1)


def test_each_trace_at_two_rates_up_to_the_papers_turns():
    rates = {(c.id.split("+")[1].split("@")[0], c.settings.sequence.fps) for c in cases()}
    assert rates == {(name, fps) for name in MEASURED for fps in (24.0, 90.0)}
    turns = [MEASURED[c.id.split("+")[1].split("@")[0]][c.settings.sequence.fps == 90][1] * c.value for c in cases()]
    assert 8.0 < max(turns) < 8.5
    assert not any(case.track == "head motion" for case in read_suite("quick").cases)


def test_the_camera_moves_and_lasts_as_long_as_the_case():
    """In the demo scene itself; that its copy for a suite stands still is of test_benchmark_numbers."""
    case = max(cases(), key=lambda c: c.value / c.settings.sequence.fps)
    assert case.scene.source == "demo" and case.scene.still
    scene = load_scene(ASSETS / "demo.glb")
    camera = camera_of_run(scene, case.settings.sequence)
    assert len(frame_range(scene, camera, case.settings)) == case.frames
    poser = Poser(scene)
    start, *turned = (
        camera.view_at(poser.sample(frame / case.settings.sequence.fps)).world_from_view
        for frame in (0, 1, case.frames - 1)
    )
    assert all(np.abs(turn - start).max() > 1e-3 for turn in turned)


def test_identity_is_the_content_of_the_file_not_its_place(tmp_path):
    text = (SUITES / "full.toml").read_text()
    head = text[: text.index("[[cases]]")]
    table = "[[cases]]\n" + next(part for part in text.split("[[cases]]\n") if "heads/seated" in part)
    ids = []
    for folder in ("a", "b"):
        (tmp_path / folder / "heads").mkdir(parents=True)
        shutil.copy(SUITES / "heads" / "seated.csv", tmp_path / folder / "heads")
        (tmp_path / folder / "suite.toml").write_text(head + table)
        ids.append([case.identity("scene") for case in read_suite(tmp_path / folder / "suite.toml").cases])
    assert ids[0] == ids[1] and len(set(ids[0])) == 3
    file = tmp_path / "a" / "heads" / "seated.csv"
    file.write_text(file.read_text().replace("1.2", "1.3"))
    assert ids[1] != [case.identity("scene") for case in read_suite(tmp_path / "a" / "suite.toml").cases]
    file.unlink()
    with pytest.raises(SettingsError):
        read_suite(tmp_path / "a" / "suite.toml").cases[0].identity("scene")
