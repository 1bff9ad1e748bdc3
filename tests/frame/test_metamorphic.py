"""Two descriptions of the same scene give the same image: instances and copies, posed and rigid, any draw order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from frame_tools import draw_frame, draw_pair, looking_at, make_scene, primitive, rotation_about, still_camera

from taubench_gl.conventions import Reason
from taubench_gl.math3d import affine
from taubench_gl.scene.model import Camera, Channel, Material, MorphTarget, Skin

SIZE = (160, 90)
EYE = np.array([0.4, 0.8, 5.0])
CAMERA = still_camera(Camera(yfov=0.9, znear=0.1, zfar=100.0), EYE, looking_at(EYE, (0, 0, 0)))
CHANNELS = ("position", "normal", "prev_position", "base_color")


def blob(seed: int = 0, smooth: bool = True, **fields):
    """A small random convex-ish solid: a jittered octahedron, facing outwards."""
    rng = np.random.default_rng(seed)
    axes = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    corners = axes * rng.uniform(0.4, 0.7, (6, 1))
    triangles = [[4, 0, 2], [4, 2, 1], [4, 1, 3], [4, 3, 0], [5, 2, 0], [5, 1, 2], [5, 3, 1], [5, 0, 3]]
    normals = (corners / np.linalg.norm(corners, axis=-1, keepdims=True)).astype(np.float32) if smooth else None
    return primitive(corners, triangles, normals=normals, **fields)


def places(count: int, seed: int = 1) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    out = []
    for i in range(count):
        turn = rotation_about("y", 40 * i) @ rotation_about("x", 25 * i)
        stretch = np.diag(rng.uniform(0.5, 1.5, 3) * [1, 1, -1 if i % 2 else 1])  # every other one is mirrored
        out.append(affine(turn @ stretch, rng.uniform([-2, -1, -1], [2, 1, 1])))
    return out


def channels_of(gpu, scene, names=CHANNELS) -> dict[str, np.ndarray]:
    return draw_frame(gpu, scene, CAMERA, SIZE, names)[0]


def assert_same(a: dict, b: dict, atol: float = 0.0) -> None:
    for name in a:
        np.testing.assert_allclose(a[name].astype(float), b[name].astype(float), atol=atol, err_msg=name)


def test_instances_are_copies(gpu) -> None:
    at = places(7)
    copies = make_scene(*[blob()] * 7, matrices=at)
    one = make_scene(blob(), matrices=[np.eye(4)])
    instanced = replace(one, nodes=replace(one.nodes, instances={1: np.stack(at)}))
    assert_same(channels_of(gpu, copies), channels_of(gpu, instanced))
    # Seven copies of one mesh are seven instances of one draw, whatever else says so.
    ids = channels_of(gpu, instanced, ("position", "ids"))["ids"][..., 0]
    assert set(np.unique(ids)) - {0} <= set(range(1, 8)) and len(np.unique(ids)) > 5
    repeated = replace(one, nodes=replace(one.nodes, instances={1: np.stack([*at, at[1], at[6]])}))
    assert_same(channels_of(gpu, instanced, (*CHANNELS, "ids")), channels_of(gpu, repeated, (*CHANNELS, "ids")))


@pytest.mark.parametrize("smooth", [True, False])
def test_posed_and_rigid_are_one_surface(gpu, smooth: bool) -> None:
    """A morph of nothing, and a skin of one joint, draw what the rigid object draws."""
    at = places(4)
    rigid = channels_of(gpu, make_scene(*[blob(smooth=smooth)] * 4, matrices=at))
    still = MorphTarget(np.zeros((6, 3), np.float32), None)
    morphed = make_scene(*[blob(smooth=smooth, targets=(still,))] * 4, matrices=at)
    for node in range(1, 5):
        morphed.nodes.weights[node] = np.array([1.0])
    assert_same(rigid, channels_of(gpu, morphed), atol=2e-6)

    joints, weights = np.zeros((6, 4), np.uint32), np.tile(np.float32([1, 0, 0, 0]), (6, 1))
    bodies = [blob(smooth=smooth, joints=joints, weights=weights)] * 4
    # The joint is the node itself: its world matrix times an inverse bind of the identity is the node's own matrix.
    base = make_scene(*bodies, matrices=at)
    skins = tuple(Skin(f"skin {i}", np.array([i + 1], np.int32), np.eye(4)[None]) for i in range(4))
    skinned = replace(base, skins=skins, nodes=replace(base.nodes, skin=np.array([-1, 0, 1, 2, 3], np.int32)))
    assert_same(rigid, channels_of(gpu, skinned), atol=2e-6)


def test_hidden_nodes_are_not_drawn_and_come_back(gpu) -> None:
    """KHR_node_visibility, switched by STEP keys: what appears has no history where it was not."""
    switch = Channel("node", 2, "visible", "STEP", np.array([0.0, 1.0]), np.array([[0.0], [1.0]]))
    at = [affine(np.eye(3), np.array([x, 0.0, 0.0])) for x in (-1, 1)]
    scene = make_scene(blob(0), blob(1), matrices=at, channels=(switch,))
    alone = channels_of(gpu, make_scene(blob(0), matrices=at[:1]))
    assert_same(alone, channels_of(gpu, scene))
    both = draw_frame(gpu, scene, CAMERA, SIZE, CHANNELS, time=1.0)[0]
    assert_same(channels_of(gpu, make_scene(blob(0), blob(1), matrices=at)), both)
    result = draw_pair(gpu, scene, CAMERA, SIZE, (0.9, 1.0))
    new = (both["position"][..., 3] > 0) & (alone["position"][..., 3] == 0)
    assert new.sum() > 100
    appeared = Reason.HISTORY_SKY | Reason.POSITION | Reason.NORMAL | Reason.OCCLUDING
    assert np.all(result.mask[new] == appeared)
    assert not (result.mask[~new] & Reason.POSITION).any()


def test_a_material_decides_color_not_shape(gpu) -> None:
    """Alpha-tested, double-sided and plain materials that cut nothing draw the same positions and normals."""
    at = places(5)
    looks = [Material(), Material(alpha_mode="MASK", alpha_cutoff=0.3), Material(alpha_mode="BLEND"),
             Material(double_sided=True)]  # fmt: skip
    drawn = [
        channels_of(gpu, make_scene(*[blob(material=0)] * 5, matrices=at, materials=(look,)), ("position", "normal"))
        for look in looks
    ]
    for other in drawn[1:]:
        assert_same(drawn[0], other)


def test_more_channels_do_not_change_the_others(gpu) -> None:
    scene = make_scene(*[blob()] * 4, matrices=places(4))
    few = channels_of(gpu, scene, ("position", "normal"))
    many = channels_of(gpu, scene, (*CHANNELS, "geometric_normal", "material", "emission", "ids"))
    assert_same(few, {n: many[n] for n in few})
