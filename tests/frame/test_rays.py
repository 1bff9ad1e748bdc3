"""Positions, depth, ids, normals and motion vectors of the G-buffer against float64 rays through the same pixels.

The GPU places vertices on a grid of 1/256 pixel and interpolates in float32; rays do neither.  Pixels whose ray meets
another draw than the GPU drew, or the same at another depth, lie on an edge: few, and left out of the comparison.
"""

from __future__ import annotations

import numpy as np
import pytest
from frame_tools import FormulaCamera, draw_pair, find_scene, looking_at
from ray_caster import Hits, Triangles, cast_pixels, gather, pixel_rays, project, states

from taubench_gl.animation import choose_camera
from taubench_gl.conventions import Reason
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Camera

SIZE = (96, 54)
STEP = 1 / 24
EDGE_SHARE = 0.005  # of the surface pixels, at most
SUBPIXEL = 1 / 256

# name: time of the current frame.  Skinned, morphed, rigid, mirrored, flat and smooth; cameras of files and orbits.
SCENES = {
    "CesiumMan.glb": 0.7,
    "Fox.gltf": 1.3,
    "RiggedSimple.gltf": 0.9,
    "SimpleSkin.gltf": 2.1,
    "03_skinned_cylinder.gltf": 0.5,
    "Animation_Skin_08.gltf": 0.8,
    "Animation_Skin_09.gltf": 0.0,
    "AnimatedMorphCube.glb": 1.1,
    "MorphStressTest.glb": 0.6,
    "morphLoader.glb": 0.4,
    "BoxAnimated.glb": 1.6,
    "AnimatedCube.gltf": 0.9,
    "InterpolationTest.glb": 0.8,
    "NegativeScaleTest.glb": 0.2,
    "OrientationTest.glb": 0.0,
    "TwoSidedPlane.gltf": 0.0,
    "Cameras.gltf": 0.0,
    "BoxVertexColors.glb": 0.5,
    "CesiumMilkTruck.glb": 0.6,
    "Node_Attribute_08.gltf": 0.0,
}


def walk_in_sponza() -> FormulaCamera:
    eye, target = np.array([4.0, 2.0, 0.3]), np.array([-6.0, 2.5, -0.2])
    step = np.array([-0.25, 0.02, 0.1])

    def place(t):
        return eye + t * step, looking_at(eye + t * step, target + 6 * t * step)

    return FormulaCamera(Camera(yfov=0.9, znear=0.05, zfar=200.0), place)


class Seen:
    """One frame pair, and for every surface pixel of it the ray's answer."""

    def __init__(self, gpu, scene, camera, time: float, pixels=None):
        self.scene, times = scene, (time - STEP, time)
        extra = ("ids", "geometric_normal")
        self.result = draw_pair(gpu, scene, camera, SIZE, times, reprojection="motion", extra=extra)
        now, before = states(scene, times)
        self.triangles: Triangles = gather(scene, now, before)
        rows, columns = np.indices((SIZE[1], SIZE[0])).reshape(2, -1) if pixels is None else pixels
        self.rows, self.columns = rows, columns
        self.at = np.stack([columns, rows], axis=-1).astype(float)
        self.view, self.prev_view = self.result.view, self.result.prev_view
        origins, directions = pixel_rays(self.view, SIZE, self.at)
        self.hits: Hits = cast_pixels(self.triangles, self.view, SIZE, self.at)
        self.points = origins + directions * np.where(self.hits.triangle >= 0, self.hits.depth, 0)[:, None]

    def channel(self, name: str) -> np.ndarray:
        return self.result.current[name][self.rows, self.columns]

    def agreed(self) -> np.ndarray:
        """Pixels where both saw the same opaque draw at the same depth; asserts that the others are few."""
        position, ids = self.channel("position").astype(float), self.channel("ids")
        drawn, hit = position[:, 3] > 0, self.hits.triangle >= 0
        same = drawn & hit & (ids[:, 0] == self.triangles.record[self.hits.triangle])
        depth = np.where(hit, self.hits.depth, 1)
        # A pixel's width on a steep surface: the sub-pixel grid moves the depth by a share of this.
        same &= np.abs(position[:, 3] - depth) <= 0.005 * depth
        cut = np.array([False] + [m.alpha_mode != "OPAQUE" for m in self.scene.materials])
        behind = hit & cut[self.triangles.material[self.hits.triangle]]  # rays know no alpha
        same, surface = same & ~behind, (drawn | hit) & ~behind
        assert surface.any()
        wrong = surface & ~same
        assert wrong.sum() <= max(EDGE_SHARE * surface.sum(), 2), f"{wrong.sum()} of {surface.sum()} pixels differ"
        return same

    def normal_mapped(self) -> np.ndarray:
        """Pixels whose material bends the normal by a texture, which these rays know nothing of."""
        maps = [False] + [m.normal_texture is not None for m in self.scene.materials]
        return np.array(maps)[self.triangles.material[self.hits.triangle]]

    def interpolated(self, corners: np.ndarray, where: np.ndarray) -> np.ndarray:
        return np.einsum("pk,pkc->pc", self.hits.weights[where], corners[self.hits.triangle[where]])


def check_positions(seen: Seen) -> None:
    same = seen.agreed()
    position = seen.channel("position").astype(float)[same]
    depth = seen.hits.depth[same]
    np.testing.assert_allclose(
        position[:, 3], -((position[:, :3]) @ seen.view.world_from_view[:, 2]), rtol=2e-6, atol=1e-6 * depth.max()
    )
    # Where the GPU says the point is must project to the pixel it is drawn in, up to its sub-pixel grid.
    at = project(seen.view, SIZE, position[:, :3] + seen.view.position)
    assert np.abs(at - seen.at[same]).max() <= 2 * SUBPIXEL
    # And it must be the ray's point: along the surface by the grid, which a grazing view stretches into depth.
    error = np.linalg.norm(position[:, :3] - (seen.points[same] - seen.view.position), axis=-1)
    pixel = pixel_size(seen, depth)
    assert np.median(error / depth) < 2e-6
    assert np.quantile(error / pixel, 0.95) <= 2 * SUBPIXEL
    material = seen.channel("ids")[same][:, 1]
    np.testing.assert_array_equal(material, seen.triangles.material[seen.hits.triangle[same]])


def pixel_size(seen: Seen, depth: np.ndarray) -> np.ndarray:
    lens = seen.view.camera
    if lens.kind == "perspective":
        return depth * 2 * np.tan(lens.yfov / 2) / SIZE[1]
    return np.full_like(depth, 2 * lens.ymag / SIZE[1])


def check_motion(seen: Seen) -> None:
    same = seen.agreed() & ((seen.result.mask[seen.rows, seen.columns] & (Reason.BEHIND | Reason.INVALID)) == 0)
    then = seen.interpolated(seen.triangles.prev_corners, same)
    expected = project(seen.prev_view, SIZE, then) - seen.at[same]
    got = seen.result.motion[seen.rows[same], seen.columns[same]].astype(float)
    error = np.linalg.norm(got - expected, axis=-1)
    assert np.median(error) < 1e-4
    assert error.max() < 0.01
    inner = inside_triangle(seen, same)
    assert error[inner].max(initial=0) < 0.001


def inside_triangle(seen: Seen, where: np.ndarray) -> np.ndarray:
    """Pixels so far inside their triangle that the sub-pixel grid cannot give them to a neighbor."""
    corners = seen.triangles.corners[seen.hits.triangle[where]]
    flat = project(seen.view, SIZE, corners.reshape(-1, 3)).reshape(-1, 3, 2)
    distance = np.full(len(flat), np.inf)
    for i in range(3):
        a, edge = flat[:, i], flat[:, (i + 1) % 3] - flat[:, i]
        offset = seen.at[where] - a
        cross = np.abs(edge[:, 0] * offset[:, 1] - edge[:, 1] * offset[:, 0])
        distance = np.minimum(distance, cross / np.maximum(np.linalg.norm(edge, axis=-1), 1e-12))
    return distance > 4 * SUBPIXEL


def check_normals(seen: Seen) -> None:
    same = seen.agreed() & ~seen.normal_mapped()
    if not same.any():
        return
    expected = seen.interpolated(seen.triangles.normals, same)
    expected /= np.maximum(np.linalg.norm(expected, axis=-1, keepdims=True), 1e-12)
    expected[seen.hits.back[same]] *= -1
    got = seen.channel("normal").astype(float)[same, :3]
    np.testing.assert_allclose(np.linalg.norm(got, axis=-1), 1.0, atol=1e-5)
    error = np.linalg.norm(got - expected, axis=-1)
    inner = inside_triangle(seen, same)
    assert np.median(error) < 2e-3
    # On small triangles with strongly bent normals the sub-pixel grid shows; nothing may be turned over.
    assert error[inner].max(initial=0) < 0.1
    assert (error[inner] < 0.01).mean() > 0.95


def check_geometric_normals(seen: Seen) -> None:
    same = seen.agreed()
    inner = inside_triangle(seen, same)
    corners = seen.triangles.corners[seen.hits.triangle[same]][inner]
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    face /= np.linalg.norm(face, axis=-1, keepdims=True)
    face[seen.hits.back[same][inner]] *= -1
    got = seen.channel("geometric_normal").astype(float)[same, :3][inner]
    # Screen-space derivatives belong to 2x2 blocks; half floats hold three digits.
    good = np.sum(got * face, axis=-1) > 0.999
    assert good.mean() > 0.9
    position = seen.channel("position").astype(float)[same, :3][inner]
    assert (np.sum(got * position, axis=-1) <= 1e-3 * np.linalg.norm(position, axis=-1)).mean() > 0.999


@pytest.mark.parametrize("name", list(SCENES))
def test_every_channel_of_a_pair(gpu, data, name: str) -> None:
    scene = load_scene(find_scene(data, name))
    seen = Seen(gpu, scene, choose_camera(scene), SCENES[name])
    check_positions(seen)
    check_motion(seen)
    check_normals(seen)
    check_geometric_normals(seen)


def test_sponza(gpu, data) -> None:
    """262 000 triangles: a sample of pixels."""
    scene = load_scene(find_scene(data, "Sponza.gltf"))
    pixels = np.random.default_rng(5).integers(0, [[SIZE[1]], [SIZE[0]]], (2, 150))
    camera = walk_in_sponza()
    seen = Seen(gpu, scene, camera, 1.0, pixels)
    position = seen.channel("position").astype(float)
    hit = seen.hits.triangle >= 0
    error = np.linalg.norm(position[hit, :3] - (seen.points[hit] - seen.view.position), axis=-1)
    assert np.median(error) < 2e-4  # meters; a pixel is centimeters wide
    assert (error < 0.02).mean() > 0.9  # leaves are alpha-tested on the GPU and not in the rays
