"""The normal channel where its value is known by hand: mirrors, scales, culling, maps, morphs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from frame_tools import (
    draw_frame,
    find_scene,
    make_scene,
    picture,
    primitive,
    quad,
    rotation_about,
    still_camera,
)

from taubench_gl.frame.geometry import make_tangents
from taubench_gl.math3d import affine
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Camera, Material, Texture

SIZE = (64, 36)
LENS = Camera(yfov=1.0, znear=0.01, zfar=100.0)
WALL = {"origin": (-1, -1, 0), "u": (2, 0, 0), "v": (0, 2, 0)}  # two meters wide, facing +Z
AHEAD = affine(np.eye(3), np.array([0.0, 0.0, -3.0]))


def wall(**fields):
    return quad(**WALL, **fields)


def middle(gpu, scene, *, eye=(0, 0, 0), rotation=None, culling: str = "gltf") -> np.ndarray | None:
    """Normal at the middle of the image; None where nothing is drawn there."""
    track = still_camera(LENS, eye, rotation)
    channels, _ = draw_frame(gpu, scene, track, SIZE, ("position", "normal"), culling=culling)
    y, x = SIZE[1] // 2, SIZE[0] // 2
    if channels["position"][y, x, 3] == 0:
        return None
    return channels["normal"][y, x, :3].astype(float)


def placed(mat3, *shapes, **fields):
    return make_scene(*shapes, matrices=[AHEAD @ affine(np.array(mat3, float), np.zeros(3))] * len(shapes), **fields)


def tilted(smooth: bool, x: float = 1.0):
    """A plane through the origin with normal (x, 0, 1) / |.|."""
    n = np.array([x, 0, 1.0]) / np.hypot(x, 1)
    corners = np.array([[-1, -1, x], [1, -1, -x], [1, 1, -x], [-1, 1, x]])
    normals = np.tile(n, (4, 1)).astype(np.float32) if smooth else None
    return primitive(corners, [[0, 1, 2], [0, 2, 3]], normals=normals)


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("scale", [(3, 1, 1), (1, 5, 0.2), (-1, 1, 1), (1, 1, -1), (-2, -3, -0.5), (1e-6, 1e-6, 1e-6)])
def test_scaled_normals(gpu, smooth: bool, scale) -> None:
    """n' ~ S^-1 n, the outside stays outside, and it is turned to the viewer where the inside is seen."""
    shape = tilted(smooth)
    far = 3.0 if min(np.abs(scale)) > 1e-3 else 3e-6  # the smallest one needs a close look
    matrix = affine(np.diag(np.array(scale, float)), np.array([0, 0, -far]))
    lens = Camera(yfov=1.0, znear=far / 100, zfar=100.0)
    expected = np.array([1.0, 0, 1.0]) / np.array(scale)
    expected /= np.linalg.norm(expected)
    scene = make_scene(shape, matrices=[matrix], materials=())
    channels, _ = draw_frame(gpu, scene, still_camera(lens), SIZE, ("position", "normal"))
    seen = channels["position"][18, 32, 3] > 0
    assert seen == (expected[2] > 0)  # single-sided: drawn exactly when its outside faces us
    if seen:
        np.testing.assert_allclose(channels["normal"][18, 32, :3], expected, atol=1e-6)
    else:
        channels, _ = draw_frame(gpu, scene, still_camera(lens), SIZE, ("position", "normal"), culling="none")
        np.testing.assert_allclose(channels["normal"][18, 32, :3], -expected, atol=1e-6)


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_sides(gpu, smooth: bool, mirror: float) -> None:
    """Back faces: culled when single-sided, turned to the viewer when double-sided, mirrored or not."""
    normals = np.tile([0, 0, 1], (4, 1)).astype(np.float32) if smooth else None
    for double in (False, True):
        shape = wall(normals=normals, material=0)
        scene = placed(np.diag([mirror, 1, 1]), shape, materials=(Material(double_sided=double),))
        np.testing.assert_allclose(middle(gpu, scene), [0, 0, 1], atol=1e-7)
        back = {"eye": (0, 0, -6), "rotation": rotation_about("y", 180)}
        if double:
            np.testing.assert_allclose(middle(gpu, scene, **back), [0, 0, -1], atol=1e-7)
        else:
            assert middle(gpu, scene, **back) is None
        np.testing.assert_allclose(middle(gpu, scene, **back, culling="none"), [0, 0, -1], atol=1e-7)


TILT = np.array([0.6, 0.48, 0.64])  # a unit vector in tangent space: right, up, out


def tilt_map(scale: float = 1.0) -> tuple[Material, tuple]:
    texel = np.round((TILT * 0.5 + 0.5) * 255)
    image = picture(np.tile(np.append(texel, 255), (4, 4, 1)))
    return Material(normal_texture=Texture(0), normal_scale=scale, double_sided=True), (image,)


def upright(**fields):
    """A wall whose texture stands upright: u to the right, v downwards from the top edge, as glTF images do."""
    shape = wall(normals=np.tile([0, 0, 1], (4, 1)).astype(np.float32), material=0, **fields)
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype=np.float32)
    fields |= {"normals": shape.normals, "material": 0, "texcoords": (uv, None)}
    return primitive(shape.positions, shape.triangles, **fields)


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_normal_map_of_known_tilt(gpu, given: bool, scale: float) -> None:
    """Red is right, green is up, blue is towards us (glTF 3.9.3); with the file's tangents and with our own."""
    fields = {"tangents": np.tile([1, 0, 0, 1], (4, 1)).astype(np.float32)} if given else {}
    material, images = tilt_map(scale)
    expected = TILT * [scale, scale, 1]
    expected /= np.linalg.norm(expected)
    # The wall rotated: the tilt rotates with it.  Mirrored in x: so are the image and the tilt.
    for matrix in (np.eye(3), rotation_about("z", 90) @ rotation_about("x", -20), np.diag([-1.0, 1.0, 1.0])):
        scene = placed(matrix, upright(**fields), materials=(material,), images=images)
        np.testing.assert_allclose(middle(gpu, scene), matrix @ expected, atol=0.006)  # 8-bit texels
    # From behind: turned over as a whole.
    scene = placed(np.eye(3), upright(**fields), materials=(material,), images=images)
    seen = middle(gpu, scene, eye=(0, 0, -6), rotation=rotation_about("y", 180))
    np.testing.assert_allclose(seen, -expected, atol=0.006)


@pytest.mark.parametrize("normal", [(1, 0, 0), (0, 1, 0), (0, 0, -1), (0.95, 0.3, 0.1), (0.6, 0.64, 0.48)])
def test_made_tangents_without_texture_coordinates_are_unit_vectors_across_the_normal(normal) -> None:
    n = np.asarray(normal, float) / np.linalg.norm(normal)
    found = make_tangents(np.eye(3), np.tile(n, (3, 1)), np.zeros((3, 2)), np.array([[0, 1, 2]]))
    np.testing.assert_allclose(np.linalg.norm(found[:, :3], axis=1), 1.0, atol=1e-6)
    np.testing.assert_allclose(found[:, :3] @ n, 0.0, atol=1e-6)


def test_made_tangents_follow_the_normal_maps_own_set(gpu) -> None:
    """Set 1 rotates the image by 90 degrees: its right is the wall's up, its up the wall's left."""
    material, images = tilt_map()
    material = replace(material, normal_texture=replace(material.normal_texture, texcoord=1))
    shape = upright()
    turned = np.array([[0, 0], [0, 1], [1, 1], [1, 0]], dtype=np.float32)  # u runs up, v to the right
    shape = replace(shape, texcoords=(shape.texcoords[0], turned))
    scene = make_scene(shape, matrices=[AHEAD], materials=(material,), images=images)
    np.testing.assert_allclose(middle(gpu, scene), [-TILT[1], TILT[0], TILT[2]], atol=0.006)


@pytest.mark.parametrize("name", ["AlphaBlendModeTest.glb", "01_alpha_mask.gltf", "LightsPunctualLamp.gltf"])
def test_made_tangents_agree_with_exporters(data, name: str) -> None:
    """Files with tangents: the tangents made from their texture coordinates have the same direction."""
    for mesh in load_scene(find_scene(data, name)).meshes:
        for p in mesh.primitives:
            if p.tangents is None:
                continue
            made = make_tangents(p.positions, p.normals, p.texcoords[0], p.triangles)
            assert (made[:, 3] == p.tangents[:, 3]).mean() > 0.99
            assert np.median(np.sum(made[:, :3] * p.tangents[:, :3], axis=-1)) > 0.999
