"""Batch specs: scenes, sweeps, labels and ids; all errors of a file are reported together."""

from __future__ import annotations

from pathlib import Path

import pytest
from batch_tools import spec_of, write_spec

from taubench_gl.batch.spec import read_spec
from taubench_gl.batch.study import about_batch, batch_store, stored_spec
from taubench_gl.errors import SettingsError
from taubench_gl.settings import Settings


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("a.glb", "b.glb", "more/c.glb", "more/d.glb"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


def test_jobs_are_scenes_times_settings(folder):
    spec = spec_of(
        folder,
        """
        name = "night"
        scenes = ["a.glb", "more/*.glb"]
        size = ["640x360", "320x180"]
        fps = 60
        frames = "0:48"
        reprojection = ["camera", "motion"]
        columns = ["frustum", "position"]
        environment = [0.1, 0.2, 0.3]
        thresholds = { normal = [0.05, 0.1], color = 0.2 }
        """,
    )
    assert spec.name == "night"
    assert len(spec.jobs) == 3 * 2 * 2 * 2 == len({job.id for job in spec.jobs})
    first = spec.jobs[0]
    assert first.scene == str(folder / "a.glb")
    assert first.settings == Settings(
        width=640, height=360, fps=60.0, frames=(0, 48), reprojection="camera", columns=("frustum", "position"),
        environment=(0.1, 0.2, 0.3), thresholds={"normal": 0.05, "color": 0.2},
    )  # fmt: skip
    assert first.sweep == {"size": "640x360", "reprojection": "camera", "thresholds": "normal=0.05 color=0.2"}
    assert {Path(job.scene).name for job in spec.jobs} == {"a.glb", "c.glb", "d.glb"}


def test_a_list_of_lists_sweeps_settings_that_are_lists(folder):
    spec = spec_of(folder, 'scenes = ["a.glb"]\ncolumns = [["frustum"], ["frustum", "color"]]')
    assert [job.settings.metrics.columns for job in spec.jobs] == [("frustum",), ("frustum", "color")]


def test_a_scene_may_have_its_own_settings(folder):
    spec = spec_of(folder, 'camera = "Main"\nscenes = ["a.glb", { path = "b.glb", camera = "Top", fps = [24, 60] }]')
    found = [(Path(job.scene).name, job.settings.sequence.camera, job.settings.sequence.fps) for job in spec.jobs]
    assert found == [("a.glb", "Main", 24.0), ("b.glb", "Top", 24.0), ("b.glb", "Top", 60.0)]


def test_entries_of_one_scene_are_labelled_by_what_differs(folder):
    """Labels are stored with the batch.  A difference is no sweep, which is a column of the table of all pairs."""
    spec = spec_of(
        folder,
        """
        scenes = ["a.glb", "b.glb", { path = "b.glb", camera = "Top", thresholds = { normal = 0.05 } }]
        size = ["640x360", "320x180"]
        """,
    )
    labels = [
        "a.glb (size 640x360)", "a.glb (size 320x180)",
        "b.glb (size 640x360, normal threshold 0.12549, camera default)",
        "b.glb (size 320x180, normal threshold 0.12549, camera default)",
        "b.glb (size 640x360, normal threshold 0.05, camera Top)",
        "b.glb (size 320x180, normal threshold 0.05, camera Top)",
    ]  # fmt: skip
    assert [job.label for job in spec.jobs] == labels
    assert all(set(job.sweep) == {"size"} for job in spec.jobs)
    store = batch_store(folder / "out")
    store.write_about(about_batch(spec))
    assert stored_spec(store) == spec


def test_swept_settings_appear_once_in_labels(folder):
    spec = spec_of(folder, 'scenes = ["a.glb", { path = "a.glb", camera = ["Top", "Side"] }]')
    assert [job.label for job in spec.jobs] == ["a.glb (camera default)", "a.glb (camera Top)", "a.glb (camera Side)"]
    assert [dict(job.sweep) for job in spec.jobs] == [{}, {"camera": "Top"}, {"camera": "Side"}]


def test_a_scene_named_twice_is_one_job(folder):
    assert len(spec_of(folder, 'scenes = ["a.glb", "*.glb"]').jobs) == 2


def test_ids_do_not_depend_on_the_folder(folder, tmp_path_factory):
    text = 'scenes = ["a.glb"]\nfps = 30'
    other = tmp_path_factory.mktemp("elsewhere")
    (other / "a.glb").touch()
    here, there = spec_of(folder, text).jobs[0], spec_of(other, text).jobs[0]
    assert here.id == there.id and here.scene != there.scene
    assert spec_of(folder, text.replace("30", "31")).jobs[0].id != here.id


def test_registry_entries_bring_their_settings(folder):
    """Settings of the spec have precedence; a frame range applies only at its own rate."""
    row = {"fps": 30.0, "frames": (2, 9), "camera": "eye", "unit_scale": 0.01}
    path = write_spec(folder, 'scenes = ["known"]\nfps = 60')
    (job,) = read_spec(path, lambda text: ("/cache/known.glb", row)).jobs
    assert job.scene == "/cache/known.glb"
    assert (job.settings.sequence.fps, job.settings.sequence.frames) == (60.0, (None, None))
    assert (job.settings.sequence.camera, job.settings.metrics.unit_scale) == ("eye", 0.01)


def test_obj_sequences_are_one_scene(folder):
    (job,) = spec_of(folder, 'scenes = ["walk/frame*.obj@30"]').jobs
    assert job.scene == str(folder / "walk" / "frame*.obj@30")


def test_all_errors_are_reported_together(folder):
    text = """
        scenes = ["a.glb", "gone.glb", "none*.glb", { path = 7 }, "exr:renders"]
        widht = 100
        size = ["640x360", "large"]
        fps = "fast"
        sampling = ["nearest", "cubic"]
        thresholds = { normal = -1 }
        frames = 12
        environment = []
        tone_map = []
    """
    with pytest.raises(SettingsError) as caught:
        spec_of(folder, text)
    message = str(caught.value)
    assert caught.value.where == str(folder / "spec.toml") and "\n" not in message
    for part in (
        "widht", "width?", "size[1]", "'large'", "fps", "'fast'", "sampling[1]", "nearest, bilinear",
        "thresholds", "-1", "frames", "12", "environment", "tone_map",
        "scenes[1]", "'gone.glb'", "scenes[2]", "none*.glb", "scenes[3]", "exr:",
    ):  # fmt: skip
        assert part in message, part
    assert caught.value.what.startswith("12 ")


@pytest.mark.parametrize("text", ["fps = 24", "scenes = []", "scenes = 3", "scenes = [7]", "scenes = [", None])
def test_specs_without_scenes_are_refused(folder, text):
    with pytest.raises(SettingsError) as caught:
        spec_of(folder, text) if text else read_spec(folder / "spec.toml")
    assert caught.value.where == str(folder / "spec.toml")
