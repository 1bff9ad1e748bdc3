"""Scenes, nodes, cameras, lights, instances, skins and morph targets, one tiny file per feature."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from gltf_builders import (
    lights,
    morphing,
    notes_about,
    primitive_of,
    skinned,
)
from gltf_files import TRIANGLE, Gltf, triangle_scene

from taubench_gl.scene import load_scene

# Nodes, scenes, cameras, lights


def test_scene_selection(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.node(name="b")
    gltf.node(name="c", children=[1])
    gltf.json["scenes"] = [{"name": "first", "nodes": [0]}, {"nodes": [2]}, {}]
    gltf.json["scene"] = 1
    path = gltf.save(tmp_path)
    assert load_scene(path).nodes.in_scene.tolist() == [False, True, True]
    assert load_scene(path, scene="first").nodes.in_scene.tolist() == [True, False, False]
    assert load_scene(path, scene="0").nodes.in_scene.tolist() == [True, False, False]
    assert load_scene(path, scene=2).nodes.in_scene.tolist() == [False] * 3
    assert load_scene(path).scene_names == ("first", "scene 1", "scene 2")
    assert load_scene(path).nodes.parent.tolist() == [-1, 2, -1]


def test_file_without_scenes_shows_all_roots(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.node(children=[0])
    scene = load_scene(gltf.save(tmp_path))
    assert scene.nodes.in_scene.all() and scene.scene_names == ()


def test_matrix_is_stored_by_columns(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.node(matrix=[0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 5, 6, 7, 1])
    gltf.node(translation=[1, 2, 3], rotation=[0, 0, 0.6, 0.8], scale=[1, -1, 0])
    nodes = load_scene(gltf.save(tmp_path)).nodes
    assert nodes.has_matrix.tolist() == [True, False]
    np.testing.assert_array_equal(nodes.matrix[0], [[0, -2, 0, 5], [2, 0, 0, 6], [0, 0, 2, 7], [0, 0, 0, 1]])
    assert nodes.rotation[1].tolist() == [0, 0, 0.6, 0.8] and nodes.scale[1].tolist() == [1, -1, 0]


def test_cameras(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}})
    gltf.add("cameras", {"type": "perspective",
                         "perspective": {"yfov": 0.5, "znear": 1, "zfar": 9, "aspectRatio": 2}})  # fmt: skip
    gltf.add("cameras", {"type": "orthographic", "orthographic": {"xmag": 2, "ymag": 3, "znear": 0, "zfar": 4}})
    for camera in range(3):
        gltf.node(camera=camera)
    scene = load_scene(gltf.save(tmp_path))
    infinite, finite, flat = scene.cameras
    assert math.isinf(infinite.zfar) and infinite.aspect is None
    assert (finite.zfar, finite.aspect, finite.yfov) == (9, 2, 0.5)
    assert (flat.kind, flat.xmag, flat.ymag, flat.znear, flat.zfar) == ("orthographic", 2, 3, 0, 4)
    assert scene.camera_nodes.tolist() == [0, 1, 2]


def test_a_spot_with_equal_angles_is_read(tmp_path: Path) -> None:
    """Blender's exporter writes them for a spot light with blend 0."""
    gltf = lights()
    gltf.json["extensions"]["KHR_lights_punctual"]["lights"][1]["spot"] = {"innerConeAngle": 0.2, "outerConeAngle": 0.2}
    spot = load_scene(gltf.save(tmp_path)).lights[1]
    assert spot.inner_cone == spot.outer_cone == 0.2


def test_lights(tmp_path: Path) -> None:
    scene = load_scene(lights().save(tmp_path))
    point, spot, sun = scene.lights
    assert (point.kind, point.color, point.intensity, point.range) == ("point", (1, 0.5, 0), 20, 5)
    assert (spot.inner_cone, spot.outer_cone) == (0.1, 0.2) and math.isinf(spot.range)
    assert (sun.kind, sun.name, sun.intensity) == ("directional", "sun", 1.0)
    assert scene.light_nodes.tolist() == [0, 1, 2]


def test_visibility(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.extension("KHR_node_visibility")
    gltf.node(extensions={"KHR_node_visibility": {"visible": False}})
    gltf.node(extensions={"KHR_node_visibility": {}})
    assert load_scene(gltf.save(tmp_path)).nodes.visible.tolist() == [False, True]


def test_instancing(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.extension("EXT_mesh_gpu_instancing")
    half = math.sqrt(0.5)
    attributes = {
        "TRANSLATION": gltf.accessor([[1, 2, 3], [4, 5, 6]]),
        "ROTATION": gltf.accessor([[0, 0, 0, 1], [0, 0, half, half]]),
        "SCALE": gltf.accessor([[1, 1, 1], [2, 2, 2]]),
        "_COLOR": gltf.accessor([1, 2]),
    }
    gltf.json["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    instances = load_scene(gltf.save(tmp_path)).nodes.instances[0]
    assert instances.shape == (2, 4, 4)
    np.testing.assert_allclose(instances[0] @ [1, 0, 0, 1], [2, 2, 3, 1], atol=1e-6)
    np.testing.assert_allclose(instances[1] @ [1, 0, 0, 1], [4, 7, 6, 1], atol=1e-6)


def test_instances_of_a_skinned_node_are_noted(tmp_path: Path) -> None:
    gltf = skinned([[1, 0, 0, 0]] * 3)
    gltf.extension("EXT_mesh_gpu_instancing")
    attributes = {"TRANSLATION": gltf.accessor([[1, 2, 3], [4, 5, 6]])}
    gltf.json["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    assert notes_about(load_scene(gltf.save(tmp_path)), "EXT_mesh_gpu_instancing") == ["/nodes/0"]


def test_skin_without_inverse_bind_matrices(tmp_path: Path) -> None:
    scene = load_scene(skinned([[1, 0, 0, 0]] * 3, skeleton=1).save(tmp_path))
    np.testing.assert_array_equal(scene.skins[0].inverse_bind, np.tile(np.eye(4), (2, 1, 1)))
    assert scene.skins[0].joints.tolist() == [1, 2] and scene.nodes.skin.tolist() == [0, -1, -1]
    assert not scene.notes


def test_inverse_bind_matrices_are_stored_by_columns(tmp_path: Path) -> None:
    gltf = skinned([[1, 0, 0, 0]] * 3)
    matrix = np.eye(4)
    matrix[:3, 3] = [1, 2, 3]
    gltf.json["skins"][0]["inverseBindMatrices"] = gltf.accessor(np.stack([matrix.T.ravel(), np.eye(4).ravel()]))
    inverse_bind = load_scene(gltf.save(tmp_path)).skins[0].inverse_bind
    np.testing.assert_array_equal(inverse_bind[0], matrix)


def test_weights_are_normalized_and_noted(tmp_path: Path) -> None:
    scene = load_scene(skinned([[0.5, 0.25, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0]], [[1, 0, 0, 0]] * 3).save(tmp_path))
    primitive = scene.meshes[0].primitives[0]
    np.testing.assert_allclose(primitive.weights, [[2 / 3, 1 / 3, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]], atol=1e-7)
    assert primitive.joints[1, 0] == 1
    assert len(notes_about(scene, "1 vertices")) == 2


def test_two_sets_of_weights(tmp_path: Path) -> None:
    gltf = skinned([[0.5, 0, 0, 0]] * 3)
    attributes = gltf.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["JOINTS_1"] = gltf.accessor([[1, 0, 0, 0]] * 3, "u2")
    attributes["WEIGHTS_1"] = gltf.accessor([[0.5, 0, 0, 0]] * 3)
    primitive = primitive_of(gltf, tmp_path)
    assert primitive.joints.shape == primitive.weights.shape == (3, 8)
    assert primitive.joints[0].tolist() == [0, 0, 0, 0, 1, 0, 0, 0]
    np.testing.assert_allclose(primitive.weights[:, [0, 4]], 0.5)


FORMATS_OF_TARGETS = {
    "NORMAL": (3, {("f4", False)}),
    "TANGENT": (3, {("f4", False)}),
    "TEXCOORD_0": (2, {("f4", False), ("u1", True), ("u2", True), ("i1", True), ("i2", True)}),
    "COLOR_0": (4, {("f4", False), ("u1", True), ("u2", True), ("i1", True), ("i2", True)}),
}
"""Attribute -> components, and the component types (dtype, normalized) that glTF 2.0, section 3.7.2.2, allows."""


@pytest.mark.parametrize("name", FORMATS_OF_TARGETS)
@pytest.mark.parametrize("dtype", ["f4", "u1", "u2", "i1", "i2"])
@pytest.mark.parametrize("normalized", [False, True])
def test_formats_of_morph_targets(tmp_path: Path, name: str, dtype: str, normalized: bool) -> None:
    """A format that is not allowed has a note, and the attribute is left out; POSITION stays."""
    count, allowed = FORMATS_OF_TARGETS[name]
    gltf = morphing(1)
    primitive = gltf.json["meshes"][0]["primitives"][0]
    width = 4 if name == "TANGENT" else count
    primitive["attributes"][name] = gltf.accessor(np.eye(3, width))
    primitive["targets"][0][name] = gltf.accessor(np.zeros((3, count)), dtype, normalized)
    scene = load_scene(gltf.save(tmp_path))
    refused = {"attribute-ignored", "quantization"} & {note.kind for note in scene.notes}
    assert bool(refused) == ((dtype, normalized) not in allowed)
    assert len(scene.meshes[0].primitives[0].targets) == 1


def test_morph_targets_and_weights(tmp_path: Path) -> None:
    gltf = morphing(9)
    gltf.json["meshes"][0]["weights"] = [0.125 * i for i in range(9)]
    gltf.json["nodes"][0]["weights"] = [1.0] * 9
    gltf.node(mesh=0)
    scene = load_scene(gltf.save(tmp_path))
    targets = scene.meshes[0].primitives[0].targets
    assert len(targets) == 9 and targets[0].normals is None
    np.testing.assert_array_equal(targets[8].positions, TRIANGLE * 9)
    np.testing.assert_array_equal(scene.meshes[0].weights, np.arange(9) / 8)
    assert list(scene.nodes.weights) == [0] and scene.nodes.weights[0].tolist() == [1.0] * 9
