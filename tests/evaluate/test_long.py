"""Very long sequences: rejected, or fast when a few frames are requested."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fixed import fixed_settings

from taubench_gl.apps import inspect_command
from taubench_gl.apps.inspect_command import MAX_INSPECTED, describe
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.export.run import ExportOptions, export_scene
from taubench_gl.paths import ASSETS
from taubench_gl.scene import load_scene
from taubench_gl.scene.builder import SceneBuilder, box
from taubench_gl.scene.model import Channel, Scene
from taubench_gl.settings import MAX_FRAMES, Settings

DEMO = ASSETS / "demo.glb"
SMALL = Settings(width=32, height=18, columns=("frustum",))


def lasting(seconds: float) -> Scene:
    """The demo scene with its last keys at ``seconds``."""
    scene = load_scene(DEMO)
    return replace(scene, channels=tuple(replace(c, times=np.append(c.times[:-1], seconds)) for c in scene.channels))


def frame_range(seconds: float, **values) -> range:
    return fixed_settings(**values).sequence.frame_range(seconds)


def test_frame_range_is_limited_to_max_frames():
    assert len(frame_range(1e15, fps=1.0, frames=(0, MAX_FRAMES))) == MAX_FRAMES
    assert frame_range(1e15, fps=1.0, frames=(9, 12)) == range(9, 12)
    assert not frame_range(1e15, fps=1.0, frames=(5, 2))
    with pytest.raises(SettingsError) as caught:
        frame_range(1e15, fps=1.0, frames=(7, MAX_FRAMES + 8))
    assert caught.value.setting == "frames"
    with pytest.raises(SettingsError) as caught:
        frame_range(10.0, fps=1e308)
    assert caught.value.setting == "fps"


@pytest.mark.parametrize("fps", [1e8, 1e15])
def test_excessive_frame_rate_is_a_settings_error(fps: float, tmp_path: Path):
    for run in (evaluate_scene, export_scene):
        with pytest.raises(SettingsError) as caught:
            run(DEMO, settings=SMALL.replace(fps=fps), out=tmp_path / "x")
        assert caught.value.setting in ("frames", "fps")
    assert not os.listdir(tmp_path)


def test_few_frames_of_a_thirty_year_animation(tmp_path: Path):
    """No list and no census of all frames: they would not fit in memory."""
    run = evaluate_scene(lasting(1e9), SMALL.replace(frames=(2, 5)))
    assert [(row["frame"], row["time_s"]) for row in run.frames] == [(3, 3 / 24), (4, 4 / 24)]
    assert run.summary["settings"]["last_frame"] == 4
    last = evaluate_scene(lasting(1e9), SMALL.replace(frames=(-2, None)))
    assert [row["time_s"] for row in last.frames] == [pytest.approx(1e9, rel=1e-6)]


def test_export_of_few_frames_of_a_thirty_year_animation(tmp_path: Path, monkeypatch):
    monkeypatch.setattr("taubench_gl.evaluation.scene.load_scene", lambda *_, **__: lasting(1e9))
    for first in (2, 4):
        few = SMALL.replace(frames=(first, first + 2))
        export_scene("x.glb", tmp_path, few, ExportOptions(channels=("depth",)))
    assert [p.name for p in sorted(tmp_path.glob("frame*"))] == [f"frame_{i:05d}.exr" for i in range(2, 6)]
    assert len(json.loads((tmp_path / "camera.json").read_text())["frames"]) == 4


def test_inspect_samples_a_limited_number_of_frames(monkeypatch):
    assert MAX_INSPECTED >= 1000
    monkeypatch.setattr(inspect_command, "MAX_INSPECTED", 150)
    facts = describe(lasting(1e9), Settings())
    assert facts["frames"] > 2e10 and facts["frames_inspected"] == 150
    assert len(facts["census"]["lights_per_frame"]["moved"]) == 150 - 1
    short = describe(load_scene(DEMO), Settings())
    assert short["frames_inspected"] == short["frames"] == len(short["census"]["lights_per_frame"]["moved"]) + 1


def scaled(scale: float, name: str) -> Scene:
    """The demo scene with node ``name`` scaled by ``scale``."""
    scene = load_scene(DEMO)
    scales = scene.nodes.scale.copy()
    scales[scene.nodes.names.index(name)] = scale
    return replace(scene, nodes=replace(scene.nodes, scale=scales))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("scale", [1e30, 1e200, 1e308])
def test_overflow_of_a_drawn_node_is_a_scene_error(scale: float):
    scene = load_scene(DEMO)
    parent = next(int(p) for n, p in enumerate(scene.nodes.parent) if p >= 0 and n in scene.mesh_nodes)
    huge = scaled(scale, scene.nodes.names[parent])
    with pytest.raises(SceneError, match=r"node .*1e\+18.*0\.125 s"):
        evaluate_scene(huge, SMALL.replace(frames=(3, 5)))


@pytest.mark.filterwarnings("error")
def test_overflow_of_a_node_that_is_not_drawn_is_noted():
    b = SceneBuilder()
    b.node(mesh=b.mesh(box((1.0, 1.0, 1.0))))
    camera = b.camera(translation=(0.0, 0.0, 5.0))
    b.animate(camera, "translation", (0.0, 1.0), ((0.0, 0.0, 5.0), (0.1, 0.0, 5.0)))
    scene = b.build()
    above = b.node(name="above", scale=(1e200,) * 3)
    b.node(above, name="below", scale=(1e200,) * 3)
    huge = b.build()
    run = evaluate_scene(huge, SMALL.replace(frames=(0, 2)))
    plain = evaluate_scene(scene, SMALL.replace(frames=(0, 2)))
    notes = [note for note in run.summary["notes"] if "overflow" in note]
    assert len(notes) == 1 and "'above'" in notes[0]
    assert run.frames == plain.frames and run.summary["census"] == plain.summary["census"]
    # Scaled to nothing until 0.1 s and from 1 s on: only a run that begins in between has it in its first frame.
    sizes = np.repeat([[0.0], [1e200], [0.0]], 3, axis=1)
    keys = Channel("node", above, "scale", "STEP", np.array([0.0, 0.1, 1.0]), sizes)
    moving = replace(huge, channels=(*scene.channels, keys))
    for first, noted in ((0, 0), (5, 1)):
        run = evaluate_scene(moving, SMALL.replace(frames=(first, first + 2)))
        assert sum("overflow" in note for note in run.summary["notes"]) == noted
