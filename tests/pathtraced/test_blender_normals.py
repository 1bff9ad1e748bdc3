"""Normals of skinned meshes differ from Cycles' by a degree or two because of Blender, before Cycles (long).

Blender keeps custom normals relative to the faces around each vertex and rebuilds them from the deformed faces; glTF
transforms the file's normals by each vertex's blended joint matrices.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

import taubench_gl.pathtraced.blender
from taubench_gl.animation import Poser, pose_normals, pose_vertices
from taubench_gl.pathtraced.blender.job import write_resampled
from taubench_gl.scene import load_scene

pytestmark = pytest.mark.long
FRAME = 11

LOOK = """
import sys
sys.path.insert(0, sys.argv[1])
import bpy, render_script, numpy as np
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.context.scene.render.fps = 24
bpy.ops.import_scene.gltf(filepath=sys.argv[2], import_shading="NORMALS")
render_script.activate_animations(int(sys.argv[4]))
(mesh,) = [o for o in bpy.context.scene.objects if o.type == "MESH" and o.modifiers]
(armature,) = [o for o in bpy.context.scene.objects if o.type == "ARMATURE"]
out = {}
for pose in ("REST", "POSE"):
    armature.data.pose_position = pose
    bpy.context.scene.frame_set(int(sys.argv[5]))
    posed = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
    data = posed.to_mesh()
    out[pose + "_vertices"] = np.array([v.co[:] for v in data.vertices])
    out[pose + "_normals"] = np.array([n.vector[:] for n in data.corner_normals])
    out[pose + "_corners"] = np.array([l.vertex_index for l in data.loops])
    out[pose + "_world"] = np.array(posed.matrix_world)
np.savez(sys.argv[3], **out)
import os
os._exit(0)
"""


def test_blender_rebuilds_custom_normals_after_the_armature(data, tmp_path, blender):
    """In Blender's mesh: positions agree to a micrometer in the pose, normals agree only at rest."""
    scene = load_scene(data / "khronos" / "CesiumMan" / "CesiumMan.glb")
    path = write_resampled(scene, range(FRAME - 1, FRAME + 2), 24.0, tmp_path)
    code = Path(taubench_gl.pathtraced.blender.__file__).parent
    command = [blender, "-c", LOOK, str(code), str(path), str(tmp_path / "mesh.npz"), str(FRAME - 1), str(FRAME)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    with np.load(tmp_path / "mesh.npz") as mesh:
        rest_world, pose_world = mesh["REST_world"], mesh["POSE_world"]
        node = int(scene.mesh_nodes[0])
        (primitive,) = scene.meshes[scene.nodes.mesh[node]].primitives
        y_up = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        state = Poser(scene).sample(FRAME / 24.0)
        expected_arrays = pose_vertices(scene, state, node, primitive), pose_normals(scene, state, node, primitive)
        posed = (mesh["POSE_vertices"] @ pose_world[:3, :3].T + pose_world[:3, 3]) @ y_up.T
        assert np.abs(posed - expected_arrays[0]).max() < 1e-5
        blender_normals = unit(mesh["POSE_normals"] @ np.linalg.inv(pose_world[:3, :3])) @ y_up.T
        assert np.percentile(degrees(blender_normals, expected_arrays[1][mesh["POSE_corners"]]), 95) > 5.0
        # At rest the mesh is an affine image of the file's; normals transform by the inverse transpose.
        homogeneous = np.c_[primitive.positions, np.ones(len(primitive.positions))]
        rest = mesh["REST_vertices"] @ rest_world[:3, :3].T + rest_world[:3, 3]
        affine, *_ = np.linalg.lstsq(homogeneous, rest, rcond=None)
        expected = unit(primitive.normals @ np.linalg.inv(affine[:3].T))
        blender_normals = unit(mesh["REST_normals"] @ np.linalg.inv(rest_world[:3, :3]))
        assert degrees(blender_normals, expected[mesh["REST_corners"]]).max() < 0.05


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def degrees(a, b):
    return np.degrees(2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(a - b, axis=-1), 0.0, 1.0)))
