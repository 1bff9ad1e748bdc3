"""Scene + seconds -> FrameState: hierarchy, visibility, parameters, skinning and morphing."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_scenes import make_channel, make_scene, triangle, triangle_mesh
from scipy.spatial.transform import Rotation

from taubench_gl import math3d
from taubench_gl.animation import pose_normals, pose_vertices, sample, skin_matrices
from taubench_gl.animation.curves import sample_channel
from taubench_gl.scene.model import Camera, Light, Mesh, MorphTarget, Primitive, Skin

HALF_Y = [0, np.sin(np.pi / 4), 0, np.cos(np.pi / 4)]  # 90 degrees about +Y


def random_tree(seed: int, n: int):
    """Nodes in random order: children can precede their parents."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(n)
    parents = np.full(n, -1)
    for place in range(1, n):
        if rng.random() < 0.9:
            parents[order[place]] = order[rng.integers(0, place)]
    fields = {
        "translation": rng.normal(size=(n, 3)),
        "rotation": math3d.normalize(rng.normal(size=(n, 4))),
        "scale": rng.uniform(-2, 2, size=(n, 3)),
        "matrix": rng.normal(size=(n, 4, 4)),
        "has_matrix": rng.random(n) < 0.2,
        "visible": rng.random(n) < 0.8,
        "in_scene": rng.random(n) < 0.9,
    }
    fields["matrix"][:, 3] = [0, 0, 0, 1]
    return parents.tolist(), fields


def local_by_scipy(scene, node):
    nodes = scene.nodes
    if nodes.has_matrix[node]:
        return nodes.matrix[node]
    out = np.eye(4)
    out[:3, :3] = Rotation.from_quat(nodes.rotation[node]).as_matrix() @ np.diag(nodes.scale[node])
    out[:3, 3] = nodes.translation[node]
    return out


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 25))
def test_world_and_visibility_compose_along_the_hierarchy(seed, n):
    parents, fields = random_tree(seed, n)
    scene = make_scene(parents, **fields)
    state = sample(scene, 0.0)
    for node in range(n):
        chain, at = np.eye(4), node
        seen = bool(fields["in_scene"][node])
        while at >= 0:
            chain = local_by_scipy(scene, at) @ chain
            seen = seen and bool(fields["visible"][at])
            at = parents[at]
        assert np.allclose(state.world[node], chain, rtol=1e-9, atol=1e-9 * np.abs(chain).max())
        assert bool(state.visible[node]) == seen


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-1, 5))
def test_animated_pose_equals_the_pose_of_the_sampled_values(seed, t):
    rng = np.random.default_rng(seed)
    n = 12
    parents, fields = random_tree(seed, n)
    fields["has_matrix"][:] = False
    channels = []
    for node in range(n):
        for path, width in (("translation", 3), ("rotation", 4), ("scale", 3)):
            if rng.random() < 0.6:
                times = np.unique(rng.uniform(0, 4, 5))
                kind = str(rng.choice(["STEP", "LINEAR", "CUBICSPLINE"]))
                shape = (len(times), 3, width) if kind == "CUBICSPLINE" else (len(times), width)
                channels.append(make_channel(node, path, times, rng.normal(size=shape), kind))
    still = {k: np.array(v) for k, v in fields.items()}
    for channel in channels:
        still[channel.path][channel.index] = sample_channel(channel, t)
    moving = sample(make_scene(parents, channels, **fields), t)
    frozen = sample(make_scene(parents, **still), 0.0)
    assert np.array_equal(moving.world, frozen.world)


def test_camera_and_light_parameters_are_animated():
    channels = [
        make_channel(0, "yfov", [0, 1], [[0.5], [1.0]], target="camera"),
        make_channel(0, "intensity", [0, 1], [[0], [10]], target="light"),
        make_channel(0, "color", [0, 1], [[1, 0, 0], [0, 0, 1]], target="light"),
        make_channel(1, "range", [0, 1], [[2], [4]], "STEP", target="light"),
    ]
    scene = make_scene([-1], channels, cameras=[Camera("a"), Camera("b")], lights=[Light("l"), Light("m")])
    state = sample(scene, 0.5)
    assert state.cameras == (dataclasses.replace(scene.cameras[0], yfov=0.75), scene.cameras[1])
    assert state.lights[0] == Light("l", color=(0.5, 0.0, 0.5), intensity=5.0)
    assert state.lights[1].range == 2.0


# --- morphing ------------------------------------------------------------------------------------------------------


def morphing_primitive(**fields) -> Primitive:
    up = MorphTarget(positions=np.tile(np.float32([0, 1, 0]), (3, 1)), normals=np.tile(np.float32([1, 0, 0]), (3, 1)))
    away = MorphTarget(positions=np.tile(np.float32([0, 0, 2]), (3, 1)))
    return triangle(targets=(up, away), **fields)


def test_precedence_of_morph_weights():
    mesh = Mesh("m", (morphing_primitive(),), weights=np.array([0.1, 0.2]))
    bare = Mesh("bare", (morphing_primitive(),))
    channels = [make_channel(2, "weights", [0, 1], [[0, 0], [1, 4]])]
    own = {1: np.array([0.5, 0.6])}
    scene = make_scene([-1] * 5, channels, meshes=[mesh, bare, triangle_mesh()], mesh=[0, 0, 0, 1, 2], weights=own)
    weights = sample(scene, 0.5).weights
    assert {node: w.tolist() for node, w in weights.items()} == {0: [0.1, 0.2], 1: [0.5, 0.6], 2: [0.5, 2], 3: [0, 0]}


def test_morphed_vertices_and_normals():
    primitive = morphing_primitive(normals=np.tile(np.float32([0, 0, 1]), (3, 1)))
    mesh = Mesh("m", (primitive,), weights=np.array([1.0, 0.5]))
    scene = make_scene([-1], meshes=[mesh], mesh=[0], translation=[[10, 0, 0]])
    state = sample(scene, 0.0)
    assert pose_vertices(scene, state, 0, primitive).tolist() == [[10, 1, 1], [11, 1, 1], [10, 2, 1]]
    assert np.allclose(pose_normals(scene, state, 0, primitive), [np.sqrt(0.5), 0, np.sqrt(0.5)])


# --- node transforms, instances, normals ---------------------------------------------------------------------------


def test_instances_are_relative_to_their_node():
    placed = np.stack([math3d.affine(np.eye(3), np.array(p, float)) for p in ([0, 0, 0], [0, 5, 0])])
    scene = make_scene(
        [-1], meshes=[triangle_mesh()], mesh=[0], instances={0: placed}, translation=[[1, 0, 0]], rotation=[HALF_Y]
    )
    state, primitive = sample(scene, 0.0), scene.meshes[0].primitives[0]
    # 90 degrees about +Y takes +X to -Z.
    expected = np.array([[1, 0, 0], [1, 0, -1], [1, 1, 0]], float)
    assert np.allclose(pose_vertices(scene, state, 0, primitive), expected)
    assert np.allclose(pose_vertices(scene, state, 0, primitive, instance=1), expected + [0, 5, 0])


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_normals_are_perpendicular_and_point_outwards(seed):
    rng = np.random.default_rng(seed)
    matrix = np.eye(4)
    matrix[:3, :3] = rng.normal(size=(3, 3))  # shear, and a mirror in half of the cases
    normal = math3d.normalize(rng.normal(size=3))
    primitive = triangle(normals=np.tile(normal, (3, 1)))
    scene = make_scene([-1], meshes=[Mesh("m", (primitive,))], mesh=[0], matrix=[matrix], has_matrix=[True])
    out = pose_normals(scene, sample(scene, 0.0), 0, primitive)[0]
    assert np.linalg.norm(out) == pytest.approx(1)
    tangents = np.linalg.svd(normal[None])[2][1:]
    assert np.allclose(out @ (matrix[:3, :3] @ tangents.T), 0, atol=1e-9 * np.abs(matrix).max())
    assert out @ (matrix[:3, :3] @ normal) > 0


def test_normals_with_a_scale_of_zero_along_one_axis():
    primitive = triangle(normals=np.tile(np.float32([0, 0, 1]), (3, 1)))
    scene = make_scene([-1], meshes=[Mesh("m", (primitive,))], mesh=[0], scale=[[2, 3, 0]])
    assert np.allclose(pose_normals(scene, sample(scene, 0.0), 0, primitive), [0, 0, 1])


def test_flat_shaded_primitives_have_no_vertex_normals():
    scene = make_scene([-1], meshes=[triangle_mesh()], mesh=[0])
    assert pose_normals(scene, sample(scene, 0.0), 0, scene.meshes[0].primitives[0]) is None


# --- skinning ------------------------------------------------------------------------------------------------------


def skinned_scene(rotation=HALF_Y, weights=((1, 0, 0, 0), (0, 1, 0, 0), (0.5, 0.5, 0, 0)), **fields):
    """Two joints at the origin and at x = 1, the second rotated; the transform of the mesh node is not used."""
    joints = np.zeros((3, 4), dtype=np.uint32)
    joints[:, 1] = 1
    primitive = triangle(joints=joints, weights=np.array(weights, np.float32), **fields)
    bind = np.stack([np.eye(4), math3d.affine(np.eye(3), np.array([-1.0, 0, 0]))])
    skin = Skin("skin", np.array([0, 1], np.int32), bind)
    scene = make_scene(
        [-1, 0, -1], meshes=[Mesh("m", (primitive,))], skins=[skin], mesh=[-1, -1, 0], skin=[-1, -1, 0],
        translation=[[0, 0, 0], [1, 0, 0], [500, 0, 0]], rotation=[[0, 0, 0, 1], rotation, HALF_Y],
    )  # fmt: skip
    return scene, primitive


def test_linear_blend_skinning_against_an_explicit_sum():
    scene, primitive = skinned_scene(normals=np.tile(np.float32([0, 0, 1]), (3, 1)))
    state = sample(scene, 0.0)
    turned = Rotation.from_quat(HALF_Y)
    first = primitive.positions.astype(float)
    second = turned.apply(first - [1, 0, 0]) + [1, 0, 0]
    expected = np.stack([first[0], second[1], 0.5 * first[2] + 0.5 * second[2]])
    assert np.allclose(pose_vertices(scene, state, 2, primitive), expected, atol=1e-15)
    normals = pose_normals(scene, state, 2, primitive)
    halfway = 0.5 * np.eye(3) + 0.5 * turned.as_matrix()
    third = np.linalg.inv(halfway).T @ [0, 0, 1]
    assert np.allclose(normals, [[0, 0, 1], [1, 0, 0], third / np.linalg.norm(third)])


def test_morphing_comes_before_skinning():
    target = MorphTarget(positions=np.tile(np.float32([1, 0, 0]), (3, 1)))
    scene, primitive = skinned_scene(weights=[[0, 1, 0, 0]] * 3, targets=(target,))
    state = dataclasses.replace(sample(scene, 0.0), weights={2: np.array([1.0])})
    # (0, 0, 0) is morphed to the second joint, about which it then turns: it stays there.
    assert np.allclose(pose_vertices(scene, state, 2, primitive)[0], [1, 0, 0], atol=1e-15)


def test_eight_influences():
    joints = np.array([[0] * 4 + [1] * 4] * 3, dtype=np.uint32)
    weights = np.full((3, 8), 0.125, np.float32)
    scene, _ = skinned_scene()
    primitive = triangle(joints=joints, weights=weights)
    scene = dataclasses.replace(scene, meshes=(Mesh("m", (primitive,)),))
    state = sample(scene, 0.0)
    palette = skin_matrices(scene, state, 0)
    expected = math3d.transform_points(palette.mean(axis=0), primitive.positions.astype(float))
    assert np.allclose(pose_vertices(scene, state, 2, primitive), expected)
