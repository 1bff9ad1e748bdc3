"""Lights, samples of them, shadow and reflected light in float64: reference for shaders/reuse/light.glsl.

Lights are rows of ``frame.lights.LIGHT``; surfaces are records of ``reuse.scene_light.SURFACE``.
"""

from __future__ import annotations

import numpy as np

from references.path_tracing import closest_hit
from taubench_gl.metrics.lighting import MIN_LIGHT_DISTANCE, SurfaceMaterial, evaluate_brdf

Array = np.ndarray


def sample_light(u: Array, choice: Array) -> tuple[Array, Array]:
    """Number and density of the lights that ``u`` (..., 4) choose; ``choice``: of ``light_choice``; -1, 0: none."""
    row = np.minimum(np.searchsorted(choice[:, 0], u[..., 0], side="right"), len(choice) - 1)
    density = choice[row, 1].astype(np.float64)
    return np.where(density > 0, row, -1), density


def emitter_point(corners: Array, uv: Array) -> Array:
    """The point of a triangle (3, 3) that ``uv`` (..., 2) names, uniform in area for uniform ``uv``."""
    root = np.sqrt(uv[..., :1])
    weights = np.concatenate([1.0 - root, root * (1.0 - uv[..., 1:]), root * uv[..., 1:]], axis=-1)
    return weights @ corners


def area_incident(corners: Array, radiance: Array, uv: Array, points: Array) -> tuple[Array, Array]:
    """Directions to points of one triangle and what arrives at ``points`` (..., 3), divided by the density 1 of uv."""
    across = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    area, normal = 0.5 * np.linalg.norm(across), across / np.linalg.norm(across)
    towards = emitter_point(corners, uv) - points
    d2 = np.sum(towards**2, axis=-1, keepdims=True)
    to_light = towards / np.sqrt(d2)
    return to_light, radiance * area * np.abs(to_light @ normal)[..., None] / d2


def incident(row: Array, points: Array) -> tuple[Array, Array]:
    """Unit directions (..., 3) to a point or directional light, and the irradiance of a surface that faces it."""
    color, position = row["color"][:3].astype(np.float64), row["position"].astype(np.float64)
    if row["direction"][3] == 2:
        return np.broadcast_to(-row["direction"][:3].astype(np.float64), points.shape), color * np.ones(points.shape)
    towards = position[:3] - points
    d2 = np.maximum(np.sum(towards**2, axis=-1, keepdims=True), MIN_LIGHT_DISTANCE**2)
    return towards / np.sqrt(d2), color / d2


def brdf(surfaces: Array, to_light: Array) -> Array:
    """BRDF times cosine of both lobes (..., 3) for a perspective camera; 0 from behind the triangle, and unlit."""
    color, normal = surfaces["color"].astype(np.float64), surfaces["normal"].astype(np.float64)
    g, p = surfaces["geometric_normal"].astype(np.float64), surfaces["position"].astype(np.float64)
    v = -p[..., :3] / np.maximum(np.linalg.norm(p[..., :3], axis=-1, keepdims=True), 1e-30)
    material = SurfaceMaterial(color[..., :3], g[..., 3], np.sqrt(normal[..., 3]), color[..., 3])
    diffuse, glossy = evaluate_brdf(material, normal[..., :3], v, to_light)
    front = (np.sum(g[..., :3] * to_light, axis=-1) > 0) & (p[..., 3] > 0)
    return np.where(front[..., None], diffuse + glossy, 0.0)


def reflected(surfaces: Array, row: Array) -> Array:
    """Radiance (..., 3) of one light without shadow."""
    to_light, radiance = incident(row, surfaces["position"][..., :3].astype(np.float64))
    return brdf(surfaces, to_light) * radiance


def blocked(triangles: Array, start: Array, end: Array) -> Array:
    """Whether a triangle of (T, 3, 3) lies between points (..., 3), ends excluded by 1e-4 of the segment."""
    d = (end - start).reshape(-1, 3)
    row, _ = closest_hit(triangles, start.reshape(-1, 3) + 1e-4 * d, d, np.array(1.0 - 2e-4))
    return (row >= 0).reshape(start.shape[:-1])


def shadowed(surfaces: Array, row: Array, triangles: Array) -> Array:
    """Whether a light does not reach surfaces.  ``triangles``: relative to the same camera."""
    points = surfaces["position"][..., :3].astype(np.float64)
    far = points - 1e3 * row["direction"][:3].astype(np.float64)
    return blocked(triangles, points, far if row["direction"][3] == 2 else row["position"][:3].astype(np.float64))


def direct_light(surfaces: Array, rows: Array, triangles: Array) -> Array:
    """Radiance (..., 3) of all punctual lights with shadows: the closed form that estimates converge to."""
    total = np.zeros((*surfaces.shape, 3))
    for row in rows:
        total += np.where(shadowed(surfaces, row, triangles)[..., None], 0.0, reflected(surfaces, row))
    return total
