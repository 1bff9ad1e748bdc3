"""``demo N --view``: the viewer opens at the pair, the masks and the text of a lesson, with the numbers of its page."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.animation import OrbitCamera, Poser, camera_of_run, choose_camera
from taubench_gl.apps.demo_command import write_session
from taubench_gl.datasets.gltf_from_scene import write_scene
from taubench_gl.demos.lessons import DEMOS, find_demo
from taubench_gl.demos.stage import Stage
from taubench_gl.glossary import key_of
from taubench_gl.scene import load_scene
from taubench_gl.viewer.session_file import load

SIZE = (160, 90)
QUICK = ("occlusion", "thresholds", "sampling", "jitter")
"""Moving cameras, and one scene in which nothing moves."""
STILL = ("noise", "samples", "jitter", "lock")
"""Lessons in which nothing moves; an evaluation without a named camera would orbit them."""


def session(name, folder):
    """The session file of a lesson beside its scene."""
    demo, file = find_demo(name), folder / "lesson.glb"
    write_scene(demo.scene(), file)
    return demo, write_session(demo, file, SIZE)


def check(name, gpu, drive, tmp_path) -> None:
    """The viewer shows the frame, the masks and the counts of the page, with light, and the text."""
    demo, path = session(name, tmp_path)
    stage = Stage(gpu, SIZE)
    pair = demo.open_pair(stage)
    stage.release()
    request = load(path)
    driven = drive(request.source, request.settings, window=(1280, 720), restored=request.restored,
                   given=request.given)  # fmt: skip
    driven.run(f"expect frame == {demo.text.opening.frame}\nexpect channel == color\nexpect against == history")
    state, percentages = driven.state, driven.engine.percentages()
    assert {n for n, on in state.shown.items() if on} == {key_of(mask) for mask in demo.text.opening.reasons}
    assert state.message == "restored" and state.lesson.startswith(f"{demo.number}. {demo.text.title}")
    for mask in demo.text.opening.reasons:
        # glTF stores float32, so a pixel on an edge can differ.
        assert percentages[key_of(mask)] == pytest.approx(pair.percent(mask), abs=0.1)
    left, top, width, height = driven.viewer.panels.widgets["section.lesson"]
    assert left >= 0 and top >= 0 and left + width <= 300 and top + height <= 720
    driven.run("key Y\nkey Y\nexpect comparison == flicker\nclick @section.lesson\nexpect section.lesson == 0")


def test_question_and_numbers_of_a_lesson(gpu, drive, tmp_path):
    """Beside the figure: the question, and each number with its closed form."""
    demo, file = find_demo("occlusion"), tmp_path / "lesson.glb"
    write_scene(demo.scene(), file)
    stage = Stage(gpu, SIZE)
    findings = demo.run(stage).findings
    stage.release()
    request = load(write_session(demo, file, SIZE, findings))
    driven = drive(request.source, request.settings, window=(1280, 720), restored=request.restored,
                   given=request.given)  # fmt: skip
    text = driven.state.lesson
    assert demo.text.question in text and findings
    for f in findings:
        assert f"- {f.text} {f.about.meaning}: expected {f.expected_text}" in text


@pytest.mark.parametrize("name", QUICK)
def test_lesson(name, gpu, drive, tmp_path):
    check(name, gpu, drive, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("name", [name for name in DEMOS if name not in QUICK])
def test_every_lesson(name, gpu, drive, tmp_path):
    check(name, gpu, drive, tmp_path)


@pytest.mark.parametrize("name", STILL)
def test_a_still_lesson_keeps_its_camera(name, tmp_path):
    """The session asks for the camera of the page, also where an evaluation would orbit the scene."""
    demo, path = session(name, tmp_path)
    given, file = load(path).settings, load_scene(tmp_path / "lesson.glb")
    settings = given.sequence
    assert isinstance(camera_of_run(file, given.replace(camera=None).sequence), OrbitCamera)
    made = demo.scene()
    for frame in (demo.text.opening.frame - 1, demo.text.opening.frame):
        views = [
            camera.view_at(Poser(scene).sample(frame / settings.fps))
            for scene, camera in ((made, choose_camera(made)), (file, camera_of_run(file, settings)))
        ]
        np.testing.assert_allclose(views[1].position, views[0].position, atol=1e-6)
        np.testing.assert_allclose(views[1].world_from_view, views[0].world_from_view, atol=1e-6)


def test_noise_opens_with_noise(gpu):
    """Nothing moves, so that every discarded pixel is noise."""
    stage = Stage(gpu, SIZE)
    demo = find_demo("noise")
    pair = demo.open_pair(stage)
    stage.release()
    assert sum(pair.percent(mask) for mask in demo.text.opening.reasons) > 10.0
