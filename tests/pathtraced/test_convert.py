"""Conversion of FBX and .blend files: errors with a stand-in for Blender, and (long) files that bpy wrote."""

from __future__ import annotations

import subprocess

import numpy as np
import pytest
from cycles_scenes import executable

from taubench_gl.animation import FileCamera, Poser, sample
from taubench_gl.errors import OutputError, PathTracedError, SceneError
from taubench_gl.pathtraced.blender.convert import convert
from taubench_gl.pathtraced.blender.process import HOW_TO_GET_BPY
from taubench_gl.scene import load_scene

STAND_IN = """
import json, sys
if sys.argv[1] == "-c":
    print("@tb 4.5.0 stand-in"); sys.exit()
job = json.load(open(sys.argv[2]))
text = open(job["source"]).read()
if text == "broken":
    print("@tb " + json.dumps({"event": "failed", "why": "not an FBX file"})); sys.exit(3)
if text == "crash":
    print("Error: out of polygons"); sys.exit(11)
open(job["target"], "w").write("glTF " + job["lights"])
counts = {"MESH": 1, "CAMERA": 0, "LIGHT": 2, "ARMATURE": 0}
print("@tb " + json.dumps({"event": "done", "blender": "4.5.0", "counts": counts, "actions": 3}))
"""

WRITE_FBX = """
import sys, bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps = 24
bpy.ops.mesh.primitive_cube_add(size=2.0)
cube = bpy.context.object
for frame, x in ((1, 0.0), (25, 3.0)):
    cube.location = (x, 0.0, 0.0)
    cube.keyframe_insert("location", frame=frame)
for curve in cube.animation_data.action.layers[0].strips[0].channelbags[0].fcurves:
    for key in curve.keyframe_points:
        key.interpolation = "LINEAR"
bpy.ops.object.camera_add(location=(0.0, -8.0, 1.0), rotation=(1.5707963, 0.0, 0.0))
scene.camera = bpy.context.object
bpy.ops.object.light_add(type="POINT", location=(0.0, 0.0, 4.0))
scene.frame_start, scene.frame_end = 1, 25
if sys.argv[1].endswith(".fbx"):
    bpy.ops.export_scene.fbx(filepath=sys.argv[1], bake_anim=True)
else:
    bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
import os
sys.stdout.flush()
os._exit(0)
"""


def test_conversion_and_its_errors(tmp_path):
    python = executable(tmp_path, STAND_IN)
    (tmp_path / "a.fbx").write_text("whole")
    made = convert(tmp_path / "a.fbx", tmp_path / "new" / "a.glb", python=python)
    assert (tmp_path / "new" / "a.glb").read_text() == "glTF SPEC"
    assert made == {"meshes": 1, "cameras": 0, "lights": 2, "armatures": 0, "actions": 3, "blender": "4.5.0"}
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
    with pytest.raises(OutputError):
        convert(tmp_path / "a.fbx", tmp_path / "a.fbx" / "x.glb", python=python)
    with pytest.raises(PathTracedError) as error:
        convert(tmp_path / "a.fbx", tmp_path / "a.glb", python="false")
    assert error.value.hint == HOW_TO_GET_BPY


@pytest.mark.long
@pytest.mark.parametrize("suffix", [".fbx", ".blend"])
def test_a_moving_cube_keeps_its_motion(tmp_path, blender, suffix):
    source, target = tmp_path / f"cube{suffix}", tmp_path / "cube.glb"
    subprocess.run([blender, "-c", WRITE_FBX, str(source)], check=True, stdout=subprocess.DEVNULL)
    made = convert(source, target, python=blender)
    assert (made["meshes"], made["cameras"], made["lights"]) == (1, 1, 1) and made["actions"] >= 1
    scene = load_scene(target)
    assert scene.duration == pytest.approx(1.0, abs=0.05)
    (node,) = scene.mesh_nodes
    start = 1.0 / 24.0 if suffix == ".blend" else 0.0  # the cube starts to move in frame 1
    for t in (0.0, 0.5, 1.0):
        world = sample(scene, start + t).world[node]
        np.testing.assert_allclose(world[:3, 3], [3.0 * t, 0.0, 0.0], atol=1e-3)
        np.testing.assert_allclose(np.linalg.norm(world[:3, :3], axis=0).prod() * _half_size(scene), 1.0, rtol=1e-3)
    view = FileCamera(scene, scene.camera_nodes[0]).view_at(Poser(scene).sample(0.0))
    np.testing.assert_allclose(view.position, [0.0, 1.0, 8.0], atol=1e-3)
    np.testing.assert_allclose(view.world_from_view[:, 2], [0.0, 0.0, 1.0], atol=1e-3)


@pytest.mark.long
def test_broken_files_raise_one_line(tmp_path, blender):
    for name, content in (("noise.fbx", np.random.default_rng(1).bytes(4096)), ("empty.fbx", b""),
                          ("ascii.fbx", b"; FBX 7.3.0 project file\n"), ("noise.blend", b"BLENDER-v405" + b"\0" * 99),
                          ("cut.fbx", b"Kaydara FBX Binary  \0\x1a\0\xe8\x1c\0\0" + b"\xff" * 40)):  # fmt: skip
        (tmp_path / name).write_bytes(content)
        with pytest.raises(SceneError) as caught:
            convert(tmp_path / name, tmp_path / "out.glb", python=blender)
        assert name in str(caught.value) and "\n" not in str(caught.value), str(caught.value)


@pytest.mark.long
def test_real_blend_files(data, tmp_path, blender):
    """A robot with an armature and fourteen actions; a lamp."""
    made = convert(data / "blender_io" / "blend" / "RobotExpressive.blend", tmp_path / "robot.glb", python=blender)
    scene = load_scene(tmp_path / "robot.glb")
    assert made["armatures"] == 1 and len(scene.animations) >= 10 and len(scene.skins) >= 1
    convert(data / "blender_io" / "blend" / "37_lamp_Cycles.blend", tmp_path / "lamp.glb", python=blender)
    assert len(load_scene(tmp_path / "lamp.glb").lights) >= 1


def _half_size(scene) -> float:
    """Volume of the mesh's box over 8, before its node's scale."""
    positions = np.concatenate([p.positions for p in scene.meshes[0].primitives])
    return float(np.ptp(positions, axis=0).prod() / 8.0)
