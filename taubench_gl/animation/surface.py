"""One surface point between two poses, on the CPU."""

from __future__ import annotations

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation.pose import is_skinned, pose_vertices
from taubench_gl.animation.state import FrameState
from taubench_gl.scene.model import Primitive, Scene

Array = np.ndarray


def previous_point(scene: Scene, state: FrameState, before: FrameState, point: Array) -> Array | None:
    """Where the surface point at ``point`` in ``state`` is in ``before``.  (3,) -> (3,) float64, world, scene units.

    The point of the nearest triangle that is drawn in ``state``; None if nothing is drawn.
    """
    best, previous = np.inf, None
    for node in scene.mesh_nodes[state.visible[scene.mesh_nodes]].tolist():
        copies = scene.nodes.instances.get(node)
        for primitive in scene.primitives(node):
            for instance in [None] if copies is None else range(len(copies)):
                if _box_distance(scene, state, node, primitive, instance, point) > best:
                    continue
                posed = pose_vertices(scene, state, node, primitive, instance)
                distances, weights = nearest_points(posed[primitive.triangles] - point)
                nearest = int(np.argmin(distances))
                if distances[nearest] < best:
                    corners = primitive.triangles[nearest]
                    then = pose_vertices(scene, before, node, primitive, instance)[corners]
                    # The difference of the two poses: a triangle that does not move gives exactly ``point``.
                    moved = weights[nearest] @ (then - posed[corners])
                    best, previous = float(distances[nearest]), point + moved
    return previous


def _box_distance(
    scene: Scene, state: FrameState, node: int, primitive: Primitive, instance: int | None, point: Array
) -> float:
    """A lower bound of the distance between ``point`` and the primitive; 0 where its vertices are deformed."""
    if primitive.targets or is_skinned(scene, node, primitive):
        return 0.0
    world = state.world[node] if instance is None else state.world[node] @ scene.nodes.instances[node][instance]
    corners = math3d.transform_points(world, math3d.box_corners(primitive.positions))
    outside = np.maximum(np.maximum(corners.min(axis=0) - point, point - corners.max(axis=0)), 0.0)
    return float(np.linalg.norm(outside))


def nearest_points(corners: Array) -> tuple[Array, Array]:
    """The point of each triangle nearest to the origin: distances (T,) and barycentric weights (T, 3).

    ``corners``: (T, 3, 3).  Source: Ericson, Real-Time Collision Detection, section 5.1.5: inside the triangle, the
    projection to its plane; else the nearest point of its edges.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, ac = b - a, c - a
    normal = np.cross(ab, ac)
    area = np.einsum("ti,ti->t", normal, normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        v = np.einsum("ti,ti->t", np.cross(-a, ac), normal) / area
        w = np.einsum("ti,ti->t", np.cross(ab, -a), normal) / area
    weights = np.stack([1.0 - v - w, v, w], axis=1)
    inside = (weights >= 0.0).all(axis=1)  # False where the area is 0
    weights[~inside] = 0.0
    distances = np.where(inside, np.linalg.norm(np.einsum("tk,tki->ti", weights, corners), axis=1), np.inf)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        start, along = corners[:, i], corners[:, j] - corners[:, i]
        length = np.einsum("ti,ti->t", along, along)
        share = np.clip(-np.einsum("ti,ti->t", start, along) / np.where(length > 0, length, 1.0), 0.0, 1.0)
        distance = np.linalg.norm(start + share[:, None] * along, axis=1)
        closer = distance < distances
        distances[closer] = distance[closer]
        weights[closer] = 0.0
        weights[closer, i], weights[closer, j] = 1.0 - share[closer], share[closer]
    return distances, weights
