"""Ways to pose vertices that engines take by mistake, each with the signature of ``animation.pose_vertices``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import FrameState, pose_vertices, skin_matrices
from taubench_gl.scene.model import Primitive, Scene

Array = np.ndarray


def bind_pose(scene: Scene, state: FrameState, node: int, primitive: Primitive, instance: int | None) -> Array:
    """Skinned vertices as they are in the file, moved by their first joint's parent alone: without the skin."""
    return pose_vertices(scene, state, node, replace(primitive, joints=None, weights=None), instance)


def skeleton_bind_pose(scene: Scene, state: FrameState, node: int, primitive: Primitive, instance: int | None) -> Array:
    """Skinned vertices in the pose that the joints have in the file, without their animation."""
    if primitive.joints is None:
        return pose_vertices(scene, state, node, primitive, instance)
    nodes = scene.nodes
    world = math3d.trs(nodes.translation, nodes.rotation, nodes.scale)
    for level in nodes.levels()[1:]:
        world[level] = world[nodes.parent[level]] @ world[level]
    return pose_vertices(scene, replace(state, world=world), node, primitive, instance)


def base_shape(scene: Scene, state: FrameState, node: int, primitive: Primitive, instance: int | None) -> Array:
    """Vertices without their morph targets."""
    return pose_vertices(scene, state, node, replace(primitive, targets=()), instance)


def transposed_skin(scene: Scene, state: FrameState, node: int, primitive: Primitive, instance: int | None) -> Array:
    """Skinned vertices by joint matrices whose rotations are transposed."""
    if primitive.joints is None:
        return pose_vertices(scene, state, node, primitive, instance)
    skin = scene.skins[scene.nodes.skin[node]]
    palette = skin_matrices(scene, state, int(scene.nodes.skin[node]))
    palette[:, :3, :3] = np.swapaxes(palette[:, :3, :3], 1, 2)
    # world[joint] @ inverse_bind is the palette again
    world = state.world.copy()
    world[skin.joints] = palette @ np.linalg.inv(skin.inverse_bind)
    return pose_vertices(scene, replace(state, world=world), node, primitive, instance)


def unplaced(scene: Scene, state: FrameState, node: int, primitive: Primitive, instance: int | None) -> Array:
    """Vertices as they are in the file, as if the world matrix of their node were the identity."""
    world = state.world.copy()
    world[node] = np.eye(4)
    return pose_vertices(scene, replace(state, world=world), node, primitive, instance)


def unmirrored(scene: Scene, state: FrameState, node: int, primitive: Primitive, instance: int | None) -> Array:
    """Vertices of nodes with a negative scale as if it were positive."""
    world = state.world.copy()
    if np.linalg.det(world[node][:3, :3]) < 0:
        world[node] = world[node] @ np.diag([-1.0, 1.0, 1.0, 1.0])
    return pose_vertices(scene, replace(state, world=world), node, primitive, instance)
