"""Conversion of FBX and .blend files: errors with a stand-in for Blender, and (long) files that bpy wrote."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from cycles_scenes import executable
from scipy.spatial import cKDTree

from taubench_gl.animation import choose_camera, pose_vertices, sample
from taubench_gl.effects.lighting import environment_for
from taubench_gl.errors import OutputError, PathTracedError, SceneError
from taubench_gl.pathtraced.blender.cache import converted
from taubench_gl.pathtraced.blender.convert import convert
from taubench_gl.pathtraced.blender.process import HOW_TO_GET_BPY
from taubench_gl.scene import load_scene
from taubench_gl.scene.environment import read_environment

STAND_IN = """
import json, struct, sys
if sys.argv[1] == "-c":
    print("@tb 4.5.0 stand-in"); sys.exit()
job = json.load(open(sys.argv[2]))
text = open(job["source"]).read()
if text == "broken":
    print("@tb " + json.dumps({"event": "failed", "why": "not an FBX file"})); sys.exit(3)
if text == "crash":
    print("Error: out of polygons"); sys.exit(11)
root = json.dumps({"asset": {"version": "2.0", "generator": job["lights"]}, "nodes": [{"name": "a"}]}).encode()
root += b" " * (-len(root) % 4)
head = struct.pack("<III", 2, 20 + len(root), len(root))
open(job["target"], "wb").write(b"glTF" + head + b"JSON" + root)
counts = {"MESH": 1, "CAMERA": 0, "LIGHT": 2, "ARMATURE": 0}
print("@tb " + json.dumps({
    "event": "done", "blender": "4.5.0", "counts": counts, "actions": 3, "lost": ["hair (1: b)"], "fps": 30.0,
    "time_scale": 1.0, "frames": [3, 5], "visible": {"a": [True, False, False]}, "camera": "eye",
    "environment": [0.5, 0.25, 0.0], "size": [64, 48],
}))
"""


def test_conversion_and_its_errors(tmp_path):
    python = executable(tmp_path, STAND_IN)
    (tmp_path / "a.fbx").write_text("whole")
    made = convert(tmp_path / "a.fbx", tmp_path / "new" / "a.glb", python=python)
    assert made.counts == {"meshes": 1, "cameras": 0, "lights": 2, "armatures": 0, "actions": 3}
    assert (made.blender, made.lost, made.fps, made.frames) == ("4.5.0", ("hair (1: b)",), 30.0, (3, 5))
    scene = load_scene(tmp_path / "new" / "a.glb")
    assert (scene.generator, scene.environment, scene.default_camera) == ("SPEC", (0.5, 0.25, 0.0), "eye")
    assert any("hair" in note.message for note in scene.notes) and any("--fps 30" in n.message for n in scene.notes)
    assert [sample(scene, k / 30.0).visible[0] for k in range(3)] == [True, False, False]
    assert scene.duration == pytest.approx(2 / 30)
    (tmp_path / "b.fbx").write_text("broken")
    (tmp_path / "c.blend").write_text("crash")
    for source, reason in (("b.fbx", "not an FBX file"), ("c.blend", "Error: out of polygons")):
        with pytest.raises(SceneError) as error:
            convert(tmp_path / source, tmp_path / "b.glb", python=python)
        assert error.value.where == str(tmp_path / source) and error.value.what.endswith(reason)
    assert not list(tmp_path.glob("*.glb")) and not list(tmp_path.glob(".*"))
    for source, target, where in (
        ("a.obj", "a.glb", "a.obj"),
        ("z.fbx", "a.glb", "z.fbx"),
        ("a.fbx", "a.gltf", "a.gltf"),
    ):
        with pytest.raises(SceneError) as error:
            convert(tmp_path / source, tmp_path / target, python=python)
        assert error.value.where == str(tmp_path / where)
    (tmp_path / "a.stl").write_text("solid")
    with pytest.raises(SceneError) as error:
        convert(tmp_path / "a.stl", tmp_path / "d.glb", take="Run", python=python)
    assert error.value.where == str(tmp_path / "a.stl") and error.value.hint
    with pytest.raises(OutputError):
        convert(tmp_path / "a.fbx", tmp_path / "a.fbx" / "x.glb", python=python)
    with pytest.raises(PathTracedError) as error:
        convert(tmp_path / "a.fbx", tmp_path / "a.glb", python="false")
    assert error.value.hint == HOW_TO_GET_BPY


NOISE = np.random.default_rng(1).bytes(4096)
BROKEN = {"empty.fbx": b"", "ascii.fbx": b"; FBX 7.3.0 project file\n", "noise.blend": b"BLENDER-v405" + b"\0" * 99,
          "cut.fbx": b"Kaydara FBX Binary  \0\x1a\0\xe8\x1c\0\0" + b"\xff" * 40,
          **{f"noise.{s}": NOISE for s in ("fbx", "usda", "usdc", "usdz", "abc", "ply", "stl", "dae")}}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("name", BROKEN)
def test_broken_files_raise_one_line(tmp_path, blender, name):
    (tmp_path / name).write_bytes(BROKEN[name])
    with pytest.raises(SceneError) as caught:
        convert(tmp_path / name, tmp_path / "out.glb", python=blender)
    assert name in str(caught.value) and "\n" not in str(caught.value), str(caught.value)
    assert not (tmp_path / "out.glb").exists()


@pytest.mark.long
def test_real_blend_files(data, tmp_path, blender):
    """A robot with an armature and fourteen actions, one of which is played; a lamp."""
    robot = data / "blender_io" / "blend" / "RobotExpressive.blend"
    made = convert(robot, tmp_path / "robot.glb", python=blender, take="Robot_Running")
    scene = load_scene(tmp_path / "robot.glb")
    assert made.counts["armatures"] == 1 and len(scene.animations) == 1 and len(scene.skins) >= 1
    assert scene.duration > 0 and any("actions" in line for line in made.lost)
    convert(data / "blender_io" / "blend" / "37_lamp_Cycles.blend", tmp_path / "lamp.glb", python=blender)
    assert len(load_scene(tmp_path / "lamp.glb").lights) >= 1


BRIDGE = Path(__file__).with_name("bridge_scene.py")


def run_bridge(blender, *arguments) -> None:
    subprocess.run([blender, str(BRIDGE), *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


@pytest.fixture(scope="module")
def bridge(blender, tmp_path_factory):
    """A .blend file with shape keys, modifiers, instances, animated lens and light, an area light and a world."""
    path = tmp_path_factory.mktemp("bridge") / "bridge.blend"
    run_bridge(blender, "make", path)
    return path


def assert_same_motion(scene, samples, fps: float = 24.0, light: bool = True) -> None:
    """Vertices, camera and the lamp of every frame, against what Blender's dependency graph draws."""
    frames = sorted(int(name[6:]) for name in samples if name.startswith("points"))
    track = choose_camera(scene)
    for frame in frames:
        state, expected = sample(scene, (frame - frames[0]) / fps), samples[f"points{frame}"]
        found = [
            pose_vertices(scene, state, node, primitive)[np.unique(primitive.triangles)]
            for node in scene.mesh_nodes.tolist()
            if state.visible[node] and "emitter" not in scene.nodes.names[node]
            for primitive in scene.meshes[scene.nodes.mesh[node]].primitives
        ]
        found = np.concatenate(found)
        assert cKDTree(expected).query(found)[0].max() < 1e-5 and cKDTree(found).query(expected)[0].max() < 1e-5
        eye, view = samples[f"eye{frame}"], track.view_at(state)
        np.testing.assert_allclose(view.position, eye[[0, 2, 1], 3] * [1, 1, -1], atol=1e-6)
        np.testing.assert_allclose(view.world_from_view[:, 2], eye[[0, 2, 1], 2] * [1, 1, -1], atol=1e-6)
        half = np.arctan(np.tan(0.5 * float(samples[f"angle{frame}"])) * 9 / 16)
        assert state.cameras[0].yfov == pytest.approx(2 * half, abs=1e-6)
        if light:
            watts = state.lights[0].intensity / 683.0 * 4.0 * np.pi
            assert watts == pytest.approx(float(samples[f"lamp{frame}"]), rel=1e-5)


@pytest.mark.long
def test_everything_that_blender_evaluates_moves_as_there(bridge, blender, tmp_path):
    """Shape keys behind an array and a twist, a wave, instances of geometry nodes, a constraint, visibility, lens."""
    target = tmp_path / "bridge.glb"
    made = convert(bridge, target, python=blender)
    run_bridge(blender, "sample", bridge, tmp_path / "samples.npz")
    scene = load_scene(target)
    assert_same_motion(scene, np.load(tmp_path / "samples.npz"))
    assert made.frames == (1, 13) and scene.duration == pytest.approx(0.5)
    assert len(scene.lights) == 1 and len(scene.skins) == 1
    bent = next(mesh for mesh in scene.meshes if len(mesh.weights) == 1)
    assert len(bent.primitives[0].targets) == 1, "one shape key stays one morph target behind the array"
    lost = " | ".join(made.lost)
    assert (
        "left out (3: dark, hidden, unseen)" in lost
        and "noisy: tex_noise" in lost
        and "panels" in lost
        and len(made.lost) == 3
    )

    # The world turned by 90 degrees and of strength 2, and the panel: power / (pi area) to one side.
    rng = np.random.default_rng(1)
    sky = (rng.random((32, 64, 3)) * np.linspace(0.1, 1.0, 32)[:, None, None])[::-1] * 2.0
    np.testing.assert_allclose(read_environment(made.environment).radiance, np.roll(sky, 16, axis=1), atol=1e-3)
    assert scene.environment == str(made.environment) and environment_for(scene).value == scene.environment
    front = next(m for m in scene.materials if m.name == "panel front")
    np.testing.assert_allclose(front.emissive, 90.0 / (np.pi * 2.0) * np.array([1.0, 0.5, 0.25]), rtol=1e-5)
    assert not front.double_sided and not any(next(m for m in scene.materials if m.name == "panel back").emissive)


@pytest.mark.long
def test_kinds_of_objects_and_instances(blender, tmp_path):
    """Text, a metaball, instances of a collection and of particles, a parent: once each, at the file's own rate."""
    run_bridge(blender, "kinds", tmp_path / "kinds.blend")
    run_bridge(blender, "sample", tmp_path / "kinds.blend", tmp_path / "samples.npz")
    made = convert(tmp_path / "kinds.blend", tmp_path / "kinds.glb", python=blender)
    assert made.fps == pytest.approx(30 / 1.001) and made.frames == (3, 8) and not made.lost
    scene = load_scene(tmp_path / "kinds.glb")
    assert_same_motion(scene, np.load(tmp_path / "samples.npz"), fps=made.fps, light=False)
    assert len(scene.mesh_nodes) == 6 + 3 + 20


@pytest.mark.long
@pytest.mark.parametrize("suffix", [".usdc", ".abc"])
def test_usd_and_alembic_from_end_to_end(bridge, blender, tmp_path, monkeypatch, suffix):
    """Moving and deforming meshes and the camera equal those of the scene that Blender exported, on the fly."""
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))
    source = tmp_path / f"bridge{suffix}"
    run_bridge(blender, "export", bridge, source)
    run_bridge(blender, "sample", f"{source}.blend", tmp_path / "samples.npz")
    announced: list[Path] = []
    target = converted(source, announce=announced.append)
    assert converted(source, announce=announced.append) == target and announced == [source]
    scene = load_scene(target)
    assert scene.name == "bridge" and scene.duration == pytest.approx(0.5)
    samples = dict(np.load(tmp_path / "samples.npz"))
    if suffix == ".abc":  # Blender imports the lens of the first frame
        samples |= {f"angle{frame}": samples["angle1"] for frame in range(1, 14)}
        assert any("lens" in note.message for note in scene.notes)
    assert_same_motion(scene, samples, light=False)


@pytest.mark.long
@pytest.mark.parametrize("suffix", [".ply", ".stl", ".dae"])
def test_meshes_of_other_formats(blender, tmp_path, suffix):
    source = tmp_path / f"cube{suffix}"
    operator = {".ply": "ply_export", ".stl": "stl_export", ".dae": "collada_export"}[suffix]
    script = ("import sys, os, bpy; bpy.ops.wm.read_factory_settings(use_empty=True); "
              f"bpy.ops.mesh.primitive_cube_add(size=2.0); bpy.ops.wm.{operator}(filepath=sys.argv[1]); "
              "sys.stdout.flush(); os._exit(0)")  # fmt: skip
    subprocess.run([blender, "-c", script, str(source)], check=True, stdout=subprocess.DEVNULL)
    made = convert(source, tmp_path / "cube.glb", python=blender)
    scene = load_scene(tmp_path / "cube.glb")
    (node,) = scene.mesh_nodes
    points = pose_vertices(scene, sample(scene, 0.0), int(node), scene.meshes[0].primitives[0])
    assert made.counts["meshes"] == 1 and not made.lost and scene.duration == 0.0
    np.testing.assert_allclose(np.abs(points), 1.0, atol=1e-6)
