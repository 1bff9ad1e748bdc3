"""Numbered OBJ files: vertex animation, cuts of objects whose faces change, and paths of sequences."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from bad_files import notes_about
from obj_files import QUAD, grid, write

from taubench_gl.animation import pose_normals, pose_vertices, sample
from taubench_gl.effects.census import census
from taubench_gl.errors import SceneError
from taubench_gl.scene import load_scene
from taubench_gl.stage_log import SHARE

TRIANGLE = "f 1 2 3\n"


def wave(t: float):
    return lambda x, y: np.stack([x, y, 0.3 * np.sin(2 * x + t)], axis=-1)


def shown(scene, t: float) -> dict[str, np.ndarray]:
    """World corner positions of every object visible at ``t``."""
    state, out = sample(scene, t), {}
    for n in scene.mesh_nodes.tolist():
        if state.visible[n]:
            (primitive,) = scene.meshes[scene.nodes.mesh[n]].primitives
            assert scene.nodes.names[n] not in out, "one shape of an object at a time"
            out[scene.nodes.names[n]] = pose_vertices(scene, state, n, primitive)[primitive.triangles]
    return out


@pytest.fixture
def waves(tmp_path):
    for i in range(6):
        write(tmp_path, grid(wave(0.2 * i)) + "o rest\nv 9 9 9\nv 8 9 9\nv 9 8 9\nf -3 -2 -1\n", f"wave{i:03d}.obj")
    return tmp_path


@pytest.mark.parametrize("form", ["{}", "seq:{}", "{}/wave%03d.obj", "{}/wave*.obj", "seq:{}/wave*.obj@24", "{}@24"])
def test_each_frame_has_the_vertices_and_normals_of_its_file(waves, form):
    scene = load_scene(form.format(waves))
    assert scene.name == "wave" and scene.duration == 5 / 24
    assert len(scene.meshes) == 2 and not scene.meshes[1].primitives[0].targets, (
        "an object at rest has no morph targets"
    )
    n = scene.nodes.names.index("sheet")
    primitive = scene.meshes[scene.nodes.mesh[n]].primitives[0]
    for i in range(6):
        still = load_scene(waves / f"wave{i:03d}.obj")
        state, (expected, _) = sample(scene, i / 24), (m.primitives[0] for m in still.meshes)
        assert np.count_nonzero(state.weights[n]) == (i > 0), "only one target is blended"
        np.testing.assert_allclose(pose_vertices(scene, state, n, primitive), expected.positions, atol=2e-7)
        np.testing.assert_allclose(pose_normals(scene, state, n, primitive), expected.normals, atol=2e-7)
    found = census(scene, np.arange(6) / 24)
    assert (found["morphs_dynamic"], found["dynamic_rigid_objects"]) == (1, 0)


def test_reading_says_how_far_it_is(waves, caplog):
    caplog.set_level(logging.DEBUG, "taubench_gl.scene")
    load_scene(str(waves))
    shares = [getattr(record, SHARE) for record in caplog.records if hasattr(record, SHARE)]
    assert shares == sorted(shares) and {i / 6 for i in range(6)} <= set(shares)
    inside = np.reshape(shares, (6, -1)) * 6 - np.arange(6)[:, None]  # of each file
    assert inside.shape[1] == 5 and inside.max() > 0.4


def test_frame_rate_suffix(waves):
    assert load_scene(f"{waves}@60").duration == pytest.approx(5 / 60)
    assert load_scene(f"{waves}/wave*.obj@12.5").duration == pytest.approx(5 / 12.5)


def test_changed_faces_are_a_cut_for_that_object_only(tmp_path):
    moved = "v 0 0 {0}\nv 1 0 {0}\nv 1 1 {0}\nv 0 1 {0}\n"
    rest = "o rest\nv 9 9 9\nv 8 9 9\nv 9 8 9\nf -3 -2 -1\n"
    for i in range(6):
        grown = "f 1 2 3\n" if i < 3 else "f 1 2 3 4\n"
        extra = "v 3 3 3\n" if i >= 3 else ""  # the indices of the other object shift
        write(tmp_path, "o quad\n" + moved.format(i) + extra + grown + rest, f"a{i}.obj")
    scene = load_scene(tmp_path)
    assert notes_about(scene, "quad") == ["a3.obj"] and not notes_about(scene, "rest") and len(scene.mesh_nodes) == 3
    for i in range(6):
        found = shown(scene, i / 24)
        assert len(found["quad"]) == (1 if i < 3 else 2) and np.all(found["quad"][..., 2] == i)
        assert len(found["rest"]) == 1


def test_objects_that_appear_and_disappear(tmp_path):
    for i in range(5):
        write(tmp_path, QUAD + "o always\n" + TRIANGLE + ("o now\nf 2 3 4\n" if i in (1, 2) else ""), f"a{i}.obj")
    scene = load_scene(tmp_path)
    assert ["now" in shown(scene, i / 24) for i in range(5)] == [False, True, True, False, False]
    assert census(scene, np.arange(5) / 24)["dynamic_rigid_objects"] == 1


def test_files_are_sorted_by_number(tmp_path):
    for i in (2, 10, 1):
        write(tmp_path, QUAD.replace("1 1 0", f"1 1 {i}") + TRIANGLE, f"a{i}.obj")
    scene = load_scene(tmp_path)
    assert [shown(scene, i / 24)["a"][0, 2, 2] for i in range(3)] == [1, 2, 10]
    assert len(scene.notes) == 2, "the gaps, and the frame rate"


@pytest.mark.parametrize(
    ("text", "value"),
    [("seq:none", "name%04d.obj"), ("seq:.", "name000.obj"), ("none%04d.obj", "name000.obj"), ("a*.obj@0", 0)],
)
def test_invalid_sequence_paths(tmp_path, monkeypatch, text, value):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SceneError) as caught:
        load_scene(text)
    assert caught.value.where == text and str(value) in f"{caught.value.what} {caught.value.hint}"


def test_several_sequences_in_one_folder(tmp_path):
    for name in ("a0", "a1", "b0"):
        write(tmp_path, QUAD + TRIANGLE, f"{name}.obj")
    with pytest.raises(SceneError) as caught:
        load_scene(tmp_path)
    assert "a*.obj" in caught.value.what and "b*.obj" in caught.value.what
    assert load_scene(tmp_path / "a%d.obj").duration == 1 / 24


def test_error_inside_a_sequence_names_its_file(waves):
    write(waves, "v 0 0 zero", "wave002.obj")
    with pytest.raises(SceneError, match="'zero'") as caught:
        load_scene(waves)
    assert caught.value.where == "wave002.obj:1"
