"""Study files: what they may say, and every fault of one told at once."""

from __future__ import annotations

from pathlib import Path

import pytest
from batch_tools import study_of, write_study

from taubench_gl.batch.store import Store
from taubench_gl.batch.study import read_study
from taubench_gl.errors import SettingsError
from taubench_gl.settings import Settings


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("a.glb", "b.glb", "more/c.glb", "more/d.glb"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


def test_scenes_times_settings(folder):
    study = study_of(
        folder,
        """
        name = "night"
        scenes = ["a.glb", "more/*.glb"]
        size = ["640x360", "320x180"]
        fps = 60
        frames = "0:48"
        reprojection = ["camera", "motion"]
        columns = ["frustum", "position"]
        sky = [0.1, 0.2, 0.3]
        thresholds = { normal = [0.05, 0.1], color = 0.2 }
        """,
    )
    assert study.name == "night"
    assert len(study.jobs) == 3 * 2 * 2 * 2 == len({job.id for job in study.jobs})
    first = study.jobs[0]
    assert first.scene == str(folder / "a.glb")
    assert first.settings == Settings.of(
        width=640, height=360, fps=60.0, frames=(0, 48), reprojection="camera", columns=("frustum", "position"),
        sky=(0.1, 0.2, 0.3), thresholds={"normal": 0.05, "color": 0.2},
    )  # fmt: skip
    assert first.sweep == {"size": "640x360", "reprojection": "camera", "thresholds": "normal=0.05 color=0.2"}
    assert {Path(job.scene).name for job in study.jobs} == {"a.glb", "c.glb", "d.glb"}


def test_a_list_of_lists_sweeps_settings_that_are_lists(folder):
    study = study_of(folder, 'scenes = ["a.glb"]\ncolumns = [["frustum"], ["frustum", "color"]]')
    assert [job.settings.metrics.columns for job in study.jobs] == [("frustum",), ("frustum", "color")]


def test_a_scene_may_have_settings_of_its_own(folder):
    study = study_of(folder, 'camera = "Main"\nscenes = ["a.glb", { path = "b.glb", camera = "Top", fps = [24, 60] }]')
    told = [(Path(job.scene).name, job.settings.sequence.camera, job.settings.sequence.fps) for job in study.jobs]
    assert told == [("a.glb", "Main", 24.0), ("b.glb", "Top", 24.0), ("b.glb", "Top", 60.0)]


def test_entries_of_one_scene_are_told_apart_by_what_differs(folder):
    """Also once stored.  Nothing of it is a sweep: that would be a column of the study's table."""
    study = study_of(
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
    assert [job.label for job in study.jobs] == labels
    assert all(set(job.sweep) == {"size"} for job in study.jobs)
    store = Store(folder / "out")
    store.save_study(study)
    assert store.load_study() == study


def test_what_one_entry_sweeps_is_told_once(folder):
    study = study_of(folder, 'scenes = ["a.glb", { path = "a.glb", camera = ["Top", "Side"] }]')
    assert [job.label for job in study.jobs] == ["a.glb (camera default)", "a.glb (camera Top)", "a.glb (camera Side)"]
    assert [dict(job.sweep) for job in study.jobs] == [{}, {"camera": "Top"}, {"camera": "Side"}]


def test_a_scene_named_twice_is_one_job(folder):
    assert len(study_of(folder, 'scenes = ["a.glb", "*.glb"]').jobs) == 2


def test_ids_do_not_depend_on_the_machine(folder, tmp_path_factory):
    """A study copied to another folder finds its jobs again there; another setting is another job."""
    text = 'scenes = ["a.glb"]\nfps = 30'
    other = tmp_path_factory.mktemp("elsewhere")
    (other / "a.glb").touch()
    here, there = study_of(folder, text).jobs[0], study_of(other, text).jobs[0]
    assert here.id == there.id and here.scene != there.scene
    assert study_of(folder, text.replace("30", "31")).jobs[0].id != here.id


def test_names_of_known_scenes_bring_their_settings(folder):
    """What the study says itself wins; frames go with the rate they count at."""
    row = {"fps": 30.0, "frames": (2, 9), "camera": "eye", "unit_scale": 0.01}
    path = write_study(folder, 'scenes = ["known"]\nfps = 60')
    (job,) = read_study(path, lambda text: ("/cache/known.glb", row)).jobs
    assert job.scene == "/cache/known.glb"
    assert (job.settings.sequence.fps, job.settings.sequence.frames) == (60.0, (None, None))
    assert (job.settings.sequence.camera, job.settings.metrics.unit_scale) == ("eye", 0.01)


def test_obj_sequences_are_one_scene(folder):
    (job,) = study_of(folder, 'scenes = ["walk/frame*.obj@30"]').jobs
    assert job.scene == str(folder / "walk" / "frame*.obj@30")


def test_every_fault_is_told_at_once(folder):
    text = """
        scenes = ["a.glb", "gone.glb", "none*.glb", 7, "exr:renders"]
        widht = 100
        size = ["640x360", "large"]
        fps = "fast"
        sampling = ["nearest", "cubic"]
        thresholds = { normal = -1 }
        frames = 12
        sky = []
        tone_map = []
    """
    with pytest.raises(SettingsError) as caught:
        study_of(folder, text)
    told = str(caught.value)
    assert "\n" not in told and told.startswith(str(folder / "study.toml"))
    for part in (
        "widht is no setting (did you mean width?)", "size[1]: 'large' is not a size", "fps is 'fast': Expected float",
        "sampling[1]", "choose from nearest, bilinear", "thresholds", "-1", "frames: 12 is not a range", "sky",
        "tone_map is empty", "scenes[1]: ", "no file 'gone.glb'", "scenes[2]", "none*.glb", "scenes[3] is 7", "exr:",
    ):  # fmt: skip
        assert part in told, part
    assert "12 faults" in told


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("fps = 24", "scenes is missing"),
        ("scenes = []", "scenes is empty"),
        ("scenes = 3", "scenes is 3, no list"),
        ("scenes = [", "is no TOML"),
    ],
)
def test_no_study(folder, text, complaint):
    with pytest.raises(SettingsError, match=complaint):
        study_of(folder, text)


def test_a_study_that_is_not_there(tmp_path):
    with pytest.raises(SettingsError, match="cannot be read: No such file"):
        read_study(tmp_path / "gone.toml")


def test_settings_survive_being_stored():
    for settings in (
        Settings(),
        Settings.of(camera=2, animation=("Walk", 3), thresholds={"color": 0.5}, frames=(3, None)),
    ):
        assert Settings.from_dict(settings.to_dict()) == settings
