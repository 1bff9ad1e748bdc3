"""Cases: motion of skinned and morphed surfaces, and skinning far from the origin."""

from __future__ import annotations

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import Poser, pose_vertices
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Naive, Outcome, case, field, worst
from taubench_gl.selftest.geometry import one_metre_per_pixel
from taubench_gl.selftest.scenes import SceneBuilder, morphed, quad, skinned, turn, turn_y

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


@case(
    "skinned-motion",
    what="a skinned wall whose joint moves by 5 px, camera still: motion of its pixels",
    elsewhere="the current pose is projected with the previous camera: motion 0 on every character",
    here="the previous pose is skinned at the previous time, in the same dispatch",
    tolerance=1e-3,
    source=PIXELS,
)
def skinned_motion(bench: Bench) -> Outcome:
    scene = _one_joint(quad(10, 10), "translation", [(0, 0, -50), (5, 0, -50)], bench)
    images = bench.pair(scene, reprojection="motion")
    off = (images.motion - [-5.0, 0.0])[images.surface]
    naive = Naive("current pose, previous camera", "0 px", 5.0)
    return field("-5 px", off if images.surface.sum() == 400 else np.nan, naive)


@case(
    "skinned-with-camera",
    what="a joint and the camera both move by 6 px: motion of the pixels on the skinned wall",
    elsewhere="with the current pose, the whole camera motion appears as motion of the wall",
    here="the pose of each frame is relative to the camera of that frame",
    tolerance=1e-3,
    source=PIXELS,
)
def skinned_with_camera(bench: Bench) -> Outcome:
    scene = _one_joint(
        quad(10, 10), "translation", [(0, 0, -50), (6, 0, -50)], bench, camera_keys=[(0, 0, 0), (6, 0, 0)]
    )
    images = bench.pair(scene, reprojection="motion")
    naive = Naive("current pose, previous camera", "6 px", 6.0)
    return field("0 px", images.motion[images.surface] if images.surface.any() else np.nan, naive)


@case(
    "skinned-rotation",
    what="a joint that turns by 60 degrees: previous positions, rotated, against the current positions",
    elsewhere="previous positions are interpolated in time, or taken from the bind pose",
    here="the same vertices are skinned with the previous palette",
    tolerance=2e-5,
    source="meters; float32: 4 ulps of 50 m, the distance to the camera",
)
def skinned_rotation(bench: Bench) -> Outcome:
    q = turn((0.0, 0.0, 1.0), 60.0)
    scene = _one_joint(quad(10, 10, cells=(4, 4)), "rotation", [turn_y(0.0), q], bench)
    images = bench.pair(scene, reprojection="motion")
    now = images.current["position"][images.surface][:, :3].astype(float)
    then = images.current["prev_position"][images.surface][:, :3].astype(float)
    off = then @ math3d.mat3_from_quat(q).T - now
    still = worst(then - now)
    return field("the same points", off if len(now) else np.nan, Naive("current pose", f"off by {still:.3g} m", still))


@case(
    "morph-motion",
    what="a morph target that moves a wall by 3 px as its weight goes from 0 to 1: motion of its pixels",
    elsewhere="morph weights have no history: motion 0 on animated faces",
    here="the GPU gets current and previous weights; a target with current weight 0 still moves previous positions",
    tolerance=1e-3,
    source=PIXELS,
)
def morph_motion(bench: Bench) -> Outcome:
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
    return field("3 px back and forth", off, Naive("no previous weights", "0 px", 3.0))


@case(
    "weights-of-thirds",
    what="three equal joints at 1e6 m with float32 weights of 1/3, which sum to 1 + 3e-8: shift against the origin",
    elsewhere="blending world matrices scales the world offset by that sum: an error of 3 cm",
    here="palettes are relative to the camera before they are blended",
    tolerance=1e-5,
    source="meters; float32: 2 ulps of 50 m, the distance to the camera",
)
def weights_of_thirds(bench: Bench) -> Outcome:
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
    world = 3 * np.float64(third) * 1e6 - 1e6
    naive = Naive("world matrices blended", f"off by {abs(world):.3g} m", abs(world))
    return field("no shift", positions[1] - positions[0].astype(float), naive)


@case(
    "skinned-reference",
    what="a strip of two joints at half time between keys: GPU points against the float64 pose",
    elsewhere="dual quaternions, normalized blends or half-float palettes give a different surface",
    here="linear blend skinning in float32 on the GPU, with a float64 reference",
    tolerance=2e-5,
    source="meters; float32: 32 ulps of 5 m through two matrices",
)
def skinned_reference(bench: Bench) -> Outcome:
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
