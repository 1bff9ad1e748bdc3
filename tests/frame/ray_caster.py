"""A second, independent answer for what a pixel shows: float64 rays against the posed triangles of a scene.

Möller and Trumbore's test on every triangle that the pixel's row can touch; no rasterization rule, nothing shared with
the GPU path but the scene, the animation's float64 pose and the camera.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from taubench_gl.animation import FrameState, Poser, View, pose_normals, pose_vertices
from taubench_gl.scene.model import Scene

Array = np.ndarray
CHUNK = 4_000_000  # ray-triangle pairs at once


@dataclass(frozen=True)
class Triangles:
    """All triangles drawn at one instant, in world space."""

    corners: Array  # (T, 3, 3) float64
    prev_corners: Array  # (T, 3, 3) float64
    normals: Array  # (T, 3, 3) unit vertex normals; the face's own where the file has none
    record: Array  # (T,) 1 + number of the draw, in the order nodes and primitives have in the file
    material: Array  # (T,) 1 + material index, 0 for the default
    culled_back: Array  # (T,) bool
    swapped: Array  # (T,) bool: the second and third corner are exchanged, so that all wind as seen from outside


@dataclass(frozen=True)
class Hits:
    triangle: Array  # (P,) index, -1 where nothing is hit
    depth: Array  # (P,) planar depth, inf where nothing
    weights: Array  # (P, 3) barycentric
    back: Array  # (P,) bool: the far side is seen


def gather(scene: Scene, state: FrameState, before: FrameState) -> Triangles:
    parts, record = [], 0
    for node in scene.mesh_nodes.tolist():
        instances = scene.nodes.instances.get(node)
        for primitive in scene.meshes[scene.nodes.mesh[node]].primitives:
            for instance in [None] if instances is None else range(len(instances)):
                if not len(primitive.triangles):
                    continue
                record += 1
                if not state.visible[node]:
                    continue
                corners = pose_vertices(scene, state, node, primitive, instance)[primitive.triangles]
                then = pose_vertices(scene, before, node, primitive, instance)[primitive.triangles]
                world = state.world[node]
                if instance is not None:
                    world = world @ instances[instance]
                face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
                length = np.linalg.norm(face, axis=-1, keepdims=True)
                face = face / np.where(length > 0, length, 1)
                if np.linalg.det(world[:3, :3]) < 0 and scene.nodes.skin[node] < 0:
                    face = -face  # the outside stays outside under a mirror
                vertex = pose_normals(scene, state, node, primitive, instance)
                flat = np.repeat(face[:, None], 3, axis=1)
                normals = flat if vertex is None else vertex[primitive.triangles]
                material = scene.materials[primitive.material] if primitive.material >= 0 else None
                double = material is not None and material.double_sided
                count = len(corners)
                parts.append(
                    (corners, then, normals, face, np.full(count, record), np.full(count, primitive.material + 1),
                     np.full(count, not double))
                )  # fmt: skip
    corners, then, normals, face, record_of, material_of, culled = (np.concatenate(x) for x in zip(*parts))
    # Winding that agrees with the outside, so that "back" below means the inside whatever mirrors there are.
    swap = np.sum(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) * face, axis=-1) < 0
    order = np.where(swap[:, None], [0, 2, 1], [0, 1, 2])
    pick = np.arange(len(corners))[:, None]
    return Triangles(
        corners[pick, order], then[pick, order], normals[pick, order], record_of, material_of, culled, swap
    )


def pixel_rays(view: View, size: tuple[int, int], at: Array) -> tuple[Array, Array]:
    """Origins and directions of the rays through pixel-index coordinates ``at`` (P, 2), row 0 at the top.

    Directions have planar length 1, so a ray's parameter is planar depth.
    """
    w, h = size
    x, y = (at[:, 0] - (w - 1) / 2) * 2 / h, ((h - 1) / 2 - at[:, 1]) * 2 / h
    if view.camera.kind == "perspective":
        scale = np.tan(view.camera.yfov / 2)
        local = np.stack([x * scale, y * scale, -np.ones_like(x)], axis=-1)
        return np.tile(view.position, (len(at), 1)), local @ view.world_from_view.T
    local = np.stack([x * view.camera.ymag, y * view.camera.ymag, np.zeros_like(x)], axis=-1)
    forward = -view.world_from_view[:, 2]
    return view.position + local @ view.world_from_view.T, np.tile(forward, (len(at), 1))


def project(view: View, size: tuple[int, int], points: Array) -> Array:
    """World points to pixel-index coordinates, row 0 at the top.  (P, 3) -> (P, 2)."""
    w, h = size
    p = (points - view.position) @ view.world_from_view
    if view.camera.kind == "perspective":
        p = p[:, :2] / (-p[:, 2:] * np.tan(view.camera.yfov / 2))
    else:
        p = p[:, :2] / view.camera.ymag
    return np.stack([p[:, 0] * h / 2 + (w - 1) / 2, (h - 1) / 2 - p[:, 1] * h / 2], axis=-1)


def cast(triangles: Triangles, origins: Array, directions: Array, near: float, far: float, cull: bool = True) -> Hits:
    """Nearest hit of every ray between the clipping planes."""
    a = triangles.corners[:, 0]
    e1, e2 = triangles.corners[:, 1] - a, triangles.corners[:, 2] - a
    count = len(origins)
    best = Hits(np.full(count, -1), np.full(count, np.inf), np.zeros((count, 3)), np.zeros(count, bool))
    step = max(CHUNK // max(len(a), 1), 1)
    for first in range(0, count, step):
        rows = slice(first, first + step)
        d, o = directions[rows, None], origins[rows, None]
        p = np.cross(d, e2)
        det = np.sum(p * e1, axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / det
            s = o - a
            u = np.sum(s * p, axis=-1) * inverse
            q = np.cross(s, e1)
            v = np.sum(q * d, axis=-1) * inverse
            t = np.sum(q * e2, axis=-1) * inverse
            hit = (det != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= near) & (t <= far)
        if cull:
            hit &= (det > 0) | ~triangles.culled_back
        t = np.where(hit, t, np.inf)
        nearest = np.argmin(t, axis=1)
        pick = np.arange(len(nearest)), nearest
        found = np.isfinite(t[pick])
        best.triangle[rows] = np.where(found, nearest, -1)
        best.depth[rows] = t[pick]
        uu, vv = np.where(found, u[pick], 0), np.where(found, v[pick], 0)
        best.weights[rows] = np.stack([1 - uu - vv, uu, vv], axis=-1)
        best.back[rows] = found & (det[pick] < 0)
    return best


def cast_pixels(triangles: Triangles, view: View, size: tuple[int, int], at: Array) -> Hits:
    """Nearest hit through every pixel-index coordinate of ``at`` (P, 2), row by row."""
    origins, directions = pixel_rays(view, size, at)
    corners = triangles.corners.reshape(-1, 3)
    lens = view.camera
    ahead = ((corners - view.position) @ -view.world_from_view[:, 2] > max(lens.znear, 1e-9)).reshape(-1, 3).all(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        rows = project(view, size, corners)[:, 1].reshape(-1, 3)
    low = np.where(ahead, rows.min(axis=1), -np.inf)  # what crosses the near plane may be anywhere
    high = np.where(ahead, rows.max(axis=1), np.inf)
    count = len(at)
    out = Hits(np.full(count, -1), np.full(count, np.inf), np.zeros((count, 3)), np.zeros(count, bool))
    for row in np.unique(at[:, 1]):
        here = np.flatnonzero(at[:, 1] == row)
        near_row = np.flatnonzero((low <= row + 0.5) & (high >= row - 0.5))
        if not len(near_row):
            continue
        part = Triangles(*(getattr(triangles, f.name)[near_row] for f in fields(Triangles)))
        hits = cast(part, origins[here], directions[here], lens.znear, lens.zfar)
        out.triangle[here] = np.where(hits.triangle >= 0, near_row[hits.triangle], -1)
        out.depth[here], out.weights[here], out.back[here] = hits.depth, hits.weights, hits.back
    return out


def states(scene: Scene, times: tuple[float, float]) -> tuple[FrameState, FrameState]:
    """The scene now and one frame ago: ``times`` = (previous, current)."""
    poser = Poser(scene)
    return poser.sample(times[1]), poser.sample(times[0])
