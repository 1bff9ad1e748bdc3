"""Cases: motion of skinned and morphed surfaces, and skinning far from the origin."""

from __future__ import annotations

import dataclasses

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import Poser, pose_vertices
from taubench_gl.scene.builder import SceneBuilder, morphed, quad, skinned, turn, turn_y
from taubench_gl.scene.model import Image, MorphTarget, Scene, Texture
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Outcome, case, field, worst
from taubench_gl.selftest.geometry import one_metre_per_pixel

Array = np.ndarray
PIXELS = "px; float32 rounding of coordinates up to 100 px is 1e-5 px"


def _one_joint(primitive, joint_path: str, keys, bench: Bench, camera_keys=None) -> Scene:
    b = SceneBuilder()
    joint = b.node(translation=(0.0, 0.0, -50.0))
    influence = skinned(primitive, np.zeros((len(primitive.positions), 1)), np.ones((len(primitive.positions), 1)))
    b.node(mesh=b.mesh(influence), skin=b.skin([joint]))
    b.animate(joint, joint_path, [0.0, 1.0], keys)
    camera = one_metre_per_pixel(b, bench)
    if camera_keys is not None:
        b.animate(camera, "translation", [0.0, 1.0], camera_keys)
    return b.build()


@case("skinned-motion", tolerance=1e-3, source=PIXELS)
def skinned_motion(bench: Bench) -> Outcome:
    """A skinned wall whose joint moves by 5 px, camera still: motion of its pixels.

    The current pose is projected with the previous camera: motion 0 on every character.
    """
    scene = _one_joint(quad(10, 10), "translation", [(0, 0, -50), (5, 0, -50)], bench)
    images = bench.pair(scene, reprojection="motion")
    off = (images.motion - [-5.0, 0.0])[images.surface]
    return field("-5 px", off if images.surface.sum() == 400 else np.nan)


@case("skinned-with-camera", tolerance=1e-3, source=PIXELS)
def skinned_with_camera(bench: Bench) -> Outcome:
    """A joint and the camera both move by 6 px: motion of the pixels on the skinned wall.

    With the current pose, the whole camera motion appears as motion of the wall.
    """
    scene = _one_joint(
        quad(10, 10), "translation", [(0, 0, -50), (6, 0, -50)], bench, camera_keys=[(0, 0, 0), (6, 0, 0)]
    )
    images = bench.pair(scene, reprojection="motion")
    return field("0 px", images.motion[images.surface] if images.surface.any() else np.nan)


@case("skinned-rotation", tolerance=2e-5, source="meters; float32: 4 ulps of 50 m, the distance to the camera")
def skinned_rotation(bench: Bench) -> Outcome:
    """A joint that turns by 60 degrees: previous positions, rotated, against the current positions.

    Previous positions are interpolated in time, or taken from the bind pose.
    """
    q = turn((0.0, 0.0, 1.0), 60.0)
    scene = _one_joint(quad(10, 10, cells=(4, 4)), "rotation", [turn_y(0.0), q], bench)
    images = bench.pair(scene, reprojection="motion")
    now = images.current["position"][images.surface][:, :3].astype(float)
    then = images.current["prev_position"][images.surface][:, :3].astype(float)
    off = then @ math3d.mat3_from_quat(q).T - now
    return field("the same points", off if len(now) else np.nan)


@case("morph-motion", tolerance=1e-3, source=PIXELS)
def morph_motion(bench: Bench) -> Outcome:
    """A morph target that moves a wall by 3 px as its weight goes from 0 to 1: motion of its pixels.

    Morph weights have no history: motion 0 on animated faces.
    """
    wall = quad(10, 10)
    off = []
    for keys, expected in (([[0.0], [1.0]], -3.0), ([[1.0], [0.0]], 3.0)):
        b = SceneBuilder()
        mesh = b.mesh(morphed(wall, np.tile([3.0, 0.0, 0.0], (len(wall.positions), 1))), weights=[0.0])
        node = b.node(mesh=mesh, translation=(0.0, 0.0, -50.0))
        b.animate(node, "weights", [0.0, 1.0], keys)
        one_metre_per_pixel(b, bench)
        images = bench.pair(b.build(), reprojection="motion")
        off.append(worst((images.motion - [expected, 0.0])[images.surface]) if images.surface.any() else np.nan)
    return field("3 px back and forth", off)


@case("weights-of-thirds", tolerance=1e-5, source="meters; float32: 2 ulps of 50 m, the distance to the camera")
def weights_of_thirds(bench: Bench) -> Outcome:
    """Three equal joints at 1e6 m with float32 weights of 1/3, which sum to 1 + 3e-8: shift against the origin.

    Blending world matrices scales the world offset by that sum: an error of 3 cm.
    """
    wall = quad(10, 10)
    count, third = len(wall.positions), np.float32(1 / 3)
    influence = skinned(wall, np.tile([0, 1, 2], (count, 1)), np.full((count, 3), third))
    positions = []
    for offset in (0.0, 1e6):
        b = SceneBuilder()
        root = b.node(translation=(offset, offset, offset))
        joints = [b.node(root, translation=(0.0, 0.0, -50.0)) for _ in range(3)]
        b.node(root, mesh=b.mesh(influence), skin=b.skin(joints))
        one_metre_per_pixel(b, bench, parent=root)
        positions.append(bench.frame(b.build())[0]["position"])
    return field("no shift", positions[1] - positions[0].astype(float))


@case("skinned-reference", tolerance=2e-5, source="meters; float32: 32 ulps of 5 m through two matrices")
def skinned_reference(bench: Bench) -> Outcome:
    """A strip of two joints at half time between keys: GPU points against the float64 pose.

    Dual quaternions, normalized blends or half-float palettes give a different surface.
    """
    strip = quad(1.0, 2.0, cells=(1, 1))
    height = (strip.positions[:, 1:2] + 2.0) / 4.0
    b = SceneBuilder()
    root = b.node(translation=(0.0, 0.0, -5.0))
    joints = [b.node(root), b.node(root, translation=(0.0, 1.0, 0.0))]
    weights = np.concatenate([1 - height, height], axis=1)
    influence = skinned(strip, np.tile([0, 1], (len(height), 1)), weights)
    node = b.node(mesh=b.mesh(influence), skin=b.skin(joints))
    b.animate(joints[1], "rotation", [0.0, 1.0], [turn_y(0.0), turn((0.0, 0.0, 1.0), 50.0)])
    b.camera()
    scene = b.build()
    corners = pose_vertices(scene, Poser(scene).sample(0.5), node, influence)
    frame, _ = bench.frame(scene, 0.5)
    points = frame["position"][frame["position"][..., 3] > 0][:, :3].astype(float)
    # Every rendered point must lie inside one of the two posed triangles, in the plane z = -5.
    outside = np.full(len(points), np.inf)
    for triangle in strip.triangles:
        a, b_, c = corners[triangle][:, :2]
        matrix = np.stack([b_ - a, c - a], axis=1)
        inside = np.linalg.solve(matrix, (points[:, :2] - a).T)
        past = np.maximum(np.maximum(-inside.min(axis=0), inside.sum(axis=0) - 1.0), 0.0)
        outside = np.minimum(outside, past)
    off = np.append(outside, points[:, 2] + 5.0)
    return field("inside the posed triangles", off if len(points) else np.nan)


NORMAL_TEXEL = (200, 220, 180)
"""One texel of a normal map that leans along both tangents."""


def _normal_mapped(bench: Bench, primitive, place, *, weights=()) -> Array:
    """Normals (n, 3) of a wall with a constant normal map.

    ``place(b, mesh)`` adds its node; ``weights``: morph weights of the mesh.
    """
    b = SceneBuilder()
    material = b.material(normal_texture=Texture(0), metallic=0.0, double_sided=True)
    count = len(primitive.positions)
    uv = np.float32(primitive.positions[:, :2])
    wall = dataclasses.replace(
        primitive, material=material, texcoords=(uv, None), tangents=np.tile(np.float32([1, 0, 0, 1]), (count, 1))
    )
    place(b, b.mesh(wall, weights=weights))
    one_metre_per_pixel(b, bench)
    texels = np.full((2, 2, 4), 255, np.uint8)
    texels[..., :3] = NORMAL_TEXEL
    scene = dataclasses.replace(b.build(), images=(Image("normals", (2, 2), lambda: texels),))
    frame, _ = bench.frame(scene)
    return frame["normal"][frame["position"][..., 3] > 0.0].astype(np.float64)[:, :3]


def _leaning(tangent: tuple[float, ...], bitangent: tuple[float, ...]) -> Array:
    """The normal of NORMAL_TEXEL over a plane that faces +Z.  (3,) unit."""
    x, y, z = np.array(NORMAL_TEXEL) / 255.0 * 2.0 - 1.0
    return math3d.normalize(x * np.array(tangent) + y * np.array(bitangent) + z * np.array([0.0, 0.0, 1.0]))


@case("morphed-tangents", tolerance=1e-5, source="float32: 80 ulps of 1")
def morphed_tangents(bench: Bench) -> Outcome:
    """A morph target that turns the tangents of a normal-mapped wall by 90 degrees: its normals.

    Positions and normals are morphed, tangents stay: bumps light from the wrong side.
    """
    wall = quad(10, 10)
    turned = MorphTarget(tangents=np.tile(np.float32([-1, 1, 0]), (len(wall.positions), 1)))

    def place(b: SceneBuilder, mesh: int) -> None:
        b.node(mesh=mesh, translation=(0.0, 0.0, -50.0))

    normals = _normal_mapped(bench, dataclasses.replace(wall, targets=(turned,)), place, weights=[1.0])
    expected = _leaning((0, 1, 0), (-1, 0, 0))
    return field("turned with the tangents", normals - expected if len(normals) else np.nan)


@case(
    "mirrored-{0}",
    tolerance=1e-5,
    source="float32: 80 ulps of 1",
    each=(("joint", "whose only joint is mirrored", True), ("node", "whose node is mirrored", False)),
)
def mirrored(bench: Bench, name: str, words: str, joint: bool) -> Outcome:
    """A normal-mapped wall {1}: its normals.

    The bitangent keeps its side, so bumps turn into dents along one axis.
    """
    wall = quad(10, 10)
    count = len(wall.positions)
    if joint:
        wall = skinned(wall, np.zeros((count, 1)), np.ones((count, 1)))

    def place(b: SceneBuilder, mesh: int) -> None:
        node = b.node(translation=(0.0, 0.0, -50.0), scale=(-1.0, 1.0, 1.0), **({} if joint else {"mesh": mesh}))
        if joint:
            b.node(mesh=mesh, skin=b.skin([node]))

    normals = _normal_mapped(bench, wall, place)
    expected = _leaning((-1, 0, 0), (0, 1, 0))
    return field("mirrored with the wall", normals - expected if len(normals) else np.nan)


@case("morphed-normals", tolerance=1e-5, source="float32: 80 ulps of 1")
def morphed_normals(bench: Bench) -> Outcome:
    """A morph target that leans the normals of a wall by 45 degrees at weight 1: its normals.

    Normals are those of the bind pose, so the shape moves and its shading stays.
    """
    wall = quad(10, 10)
    leaning = MorphTarget(normals=np.tile(np.float32([1, 0, 0]), (len(wall.positions), 1)))
    b = SceneBuilder()
    mesh = b.mesh(dataclasses.replace(wall, targets=(leaning,)), weights=[1.0])
    b.node(mesh=mesh, translation=(0.0, 0.0, -50.0))
    one_metre_per_pixel(b, bench)
    frame, _ = bench.frame(b.build())
    normals = frame["normal"][frame["position"][..., 3] > 0.0][:, :3]
    off = normals - np.sqrt(0.5) * np.array([1.0, 0.0, 1.0])
    return field("45 degrees", off if len(normals) else np.nan)


@case("mirrored-flat-normals", source="exact: an axis")
def mirrored_flat_normals(bench: Bench) -> Outcome:
    """A wall without normals whose only joint is mirrored: its normals.

    The posed triangle is wound the other way, so its computed normal points away from the viewer.
    """
    b = SceneBuilder()
    wall = quad(10, 10, normals=False, material=b.material(double_sided=True))
    count = len(wall.positions)
    joint = b.node(translation=(0.0, 0.0, -50.0), scale=(-1.0, 1.0, 1.0))
    b.node(mesh=b.mesh(skinned(wall, np.zeros((count, 1)), np.ones((count, 1)))), skin=b.skin([joint]))
    one_metre_per_pixel(b, bench)
    frame, _ = bench.frame(b.build())
    normals = frame["normal"][frame["position"][..., 3] > 0.0][:, :3]
    off = normals - [0.0, 0.0, 1.0] if len(normals) else np.nan
    return field("towards the viewer", off)
