"""The path tracer in float64, sample by sample with the same numbers: reference for shaders/pathtracing/.

Rays are tested against every triangle, so scenes are small.  Surfaces are flat, without textures.  Sources: Kajiya, The
Rendering Equation, 1986; Veach, Robust Monte Carlo Methods for Light Transport Simulation, 1997 (multiple importance
sampling); Talbot et al., Importance Resampling for Global Illumination, 2005.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from references.brdf_sampling import basis_around, brdf_pdf, sample_brdf
from taubench_gl.metrics.environment import lookup
from taubench_gl.metrics.lighting import SurfaceMaterial, evaluate_brdf
from taubench_gl.metrics.path_samples import BLOCKS_PER_VERTEX, SUBPATH_VERTEX, sample_table
from taubench_gl.metrics.stochastic import LightCells
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray

SCATTER, EMITTER, ENVIRONMENT_PUNCTUAL = 0, 1, 2
"""Blocks of the numbers of a vertex."""

ROULETTE_FROM, LEAST_SURVIVAL = 3, 0.05
"""First vertex at which paths may end by chance, and the least probability with which they go on."""

_GAP = 1e-5  # rays start and end this share of the coordinates, which came from float32, away from surfaces


@dataclass(frozen=True)
class LightSegments:
    """Where light subpaths of one segment start: a row for each light."""

    position: Array  # (L, 3) relative to the camera
    axis: Array  # (L, 3) unit, where the light shines
    least_cosine: Array  # (L,) to the axis; -1: in all directions
    choice: Array  # (L, 2) metrics.stochastic.light_choice; probability 0: no light at a place

    def pdf(self, row: int | Array, p: Array, n: Array) -> Array:
        """Per square meter, choice included, of a subpath of light ``row``, one or (n,), that ends at ``p``, which it
        sees.  (n,)."""
        to_light = self.position[row] - p
        d2 = np.sum(to_light**2, axis=1)
        cosine = np.abs(np.sum(to_light * n, axis=1)) / np.sqrt(d2)
        return self.choice[row, 1].astype(np.float64) * cosine / (2.0 * np.pi * (1.0 - self.least_cosine[row]) * d2)


@dataclass(frozen=True)
class TraceScene:
    """Triangles and sources.  Positions in meters, relative to the camera."""

    triangles: Array  # (T, 3, 3)
    base_color: Array  # (T, 3)
    metallic: Array  # (T,)
    roughness: Array  # (T,)
    specular: Array  # (T,)
    emission: Array  # (T, 3) radiance, both sides
    lights: tuple[Callable[[Array], tuple[Array, Array, Array]], ...] = ()
    """Punctual lights: points (n, 3) -> unit directions (n, 3), irradiance (n, 3), distance (n,) to the light."""
    grid: LightCells | None = None  # of ``lights`` and emitters, its corner relative to the camera
    cells: tuple[Array, Array] = (np.zeros(2, int), np.zeros((0, 2)))  # metrics.stochastic.cell_choice of ``lights``
    candidates: int = 8  # most lights that compete for a light sample
    emitter_triangles: Array = field(default_factory=lambda: np.zeros(0, int))  # (E,) rows of ``triangles``
    emitter_cdf: Array = field(default_factory=lambda: np.zeros(0))  # (E,) cumulative probability by power
    emitter_cells: tuple[Array, Array] = (np.zeros(2, int), np.zeros((0, 2)))  # cell_choice of groups of emitters
    group: int = 1  # emitters in a group
    sky: Array = field(default_factory=lambda: np.zeros(3))  # radiance of a uniform environment
    environment: Array | None = None  # equirectangular radiance (h, 2 h, 3)
    choice: Array | None = None  # metrics.environment.direction_choice of it
    segments: LightSegments | None = None  # of ``lights``, for bidirectional paths

    def material(self, rows: Array) -> SurfaceMaterial:
        """Material of the triangles ``rows`` (n,)."""
        return SurfaceMaterial(self.base_color[rows], self.metallic[rows], self.roughness[rows], self.specular[rows])

    def cell_of(self, p: Array) -> Array:
        """Cells of the grid that points (n, 3) lie in, (n,); 0: outside."""
        inside = np.floor((p - self.grid.low) / self.grid.side).astype(int)
        known = ((inside >= 0) & (inside < self.grid.counts)).all(axis=1)
        cell = np.zeros(len(p), int)
        cell[known] = 1 + np.ravel_multi_index(tuple(inside[known].T), self.grid.counts)
        return cell

    def emitters_around(self, cell: int) -> Array:
        """Probability (E,) with which each emitter is sampled from points in ``cell``."""
        first, entries = self.emitter_cells
        around = entries[first[cell] : first[cell + 1]].astype(np.float64)
        of_group = np.zeros(-(-len(self.emitter_cdf) // self.group))
        of_group[around[:, 1].astype(int)] = np.diff(around[:, 0], prepend=0.0)
        power = np.diff(self.emitter_cdf, prepend=0.0)
        groups = np.arange(len(power)) // self.group
        return of_group[groups] * power / np.bincount(groups, power)[groups]

    @property
    def sources(self) -> int:
        return bool(self.lights) + bool(len(self.emitter_triangles)) + (self.environment is not None)


@dataclass(frozen=True)
class PathLight:
    """Sums over samples, per pixel (n, 3), and the hits of the first bounce (n,)."""

    direct_diffuse: Array
    direct_glossy: Array
    indirect_diffuse: Array
    indirect_glossy: Array
    hit_distance: Array  # (n,) sum, meters
    hits: Array  # (n,)


def closest_hit(triangles: Array, origin: Array, direction: Array, t_max: Array) -> tuple[Array, Array]:
    """Nearest triangle (n,), -1 without one, and distance (n,), of rays (n, 3): Moeller and Trumbore 1997."""
    best, row = np.array(np.broadcast_to(t_max, len(origin)), dtype=np.float64), np.full(len(origin), -1)
    for i, (a, b, c) in enumerate(triangles):
        e1, e2 = b - a, c - a
        p = np.cross(direction, e2)
        det = p @ e1
        with np.errstate(divide="ignore", invalid="ignore"):
            s = origin - a
            u = np.sum(s * p, axis=1) / det
            q = np.cross(s, e1)
            v = np.sum(direction * q, axis=1) / det
            t = q @ e2 / det
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < best)
        best, row = np.where(hit, t, best), np.where(hit, i, row)
    return row, best


def trace(
    scene: TraceScene,
    points: Array,
    normals: Array,
    to_viewer: Array,
    material: SurfaceMaterial,
    *,
    samples: int,
    bounces: int,
    first_sample: int = 0,
    seed: int = 0,
    first_source: int = 0,
) -> PathLight:
    """Sums of ``samples`` samples, pattern ``fixed``, of paths with up to ``bounces`` bounces.

    ``points``, ``normals`` and ``to_viewer`` (n, 3): visible surface points, their unit normals and unit directions to
    the viewer; ``material``: of the points.  ``first_source`` 1 leaves punctual lights out at the first vertex, where
    each has a shadow ray.
    """
    n = len(points)
    table = sample_table(first_sample, samples, seed)
    sums = {f"{bounce}_{lobe}": np.zeros((n, 3)) for bounce in ("direct", "indirect") for lobe in ("diffuse", "glossy")}
    hit_distance, hits = np.zeros(n), np.zeros(n)
    for k in range(samples):
        numbers = partial(_numbers, table[k])
        diffuse, glossy = _next_event(scene, points, normals, to_viewer, material, numbers, 0, first_source)
        _add(sums, "direct", diffuse, glossy)
        lit = _subpath(scene, numbers(SUBPATH_VERTEX, SCATTER)) if scene.segments and bounces > 1 else None
        if lit is not None:
            _add(sums, "indirect", *_connect(scene, lit, points, normals, to_viewer, material))
        direction, pdf, diffuse, glossy, alive = _scatter(material, normals, to_viewer, numbers(0, SCATTER))
        throughput, origin, cell = np.ones((n, 3)), _above(points, normals), scene.cell_of(points)
        for vertex in range(1, bounces + 1):
            end = _ray_end(scene, origin, direction)
            found = np.where(alive[:, None], _arriving(scene, end, direction, pdf, cell, throughput), 0.0)
            alive = alive & end.hit
            if vertex == 1:
                hit_distance += np.where(alive, end.distance, 0.0)
                hits += alive
            _add(sums, "direct" if vertex == 1 else "indirect", found * diffuse, found * glossy)
            if vertex == bounces or not alive.any():
                break
            here = scene.material(end.row)
            light = _vertex_light(
                scene, end, direction, pdf, here, numbers, vertex, lit if vertex < bounces - 1 else None
            )
            arrived = np.where(alive[:, None], throughput * light, 0.0)
            _add(sums, "indirect", arrived * diffuse, arrived * glossy)
            u = numbers(vertex, SCATTER)
            direction, pdf, f_diffuse, f_glossy, going = _scatter(here, end.normal, -direction, u)
            throughput = throughput * (f_diffuse + f_glossy)
            alive, origin, cell = alive & going, _above(end.point, end.normal), scene.cell_of(end.point)
            if vertex >= ROULETTE_FROM:
                survival = np.clip(throughput.max(axis=1), LEAST_SURVIVAL, 1.0)
                alive = alive & (u[3] < survival)
                throughput = throughput / survival[:, None]
    return PathLight(**sums, hit_distance=hit_distance, hits=hits)


def _add(sums: dict[str, Array], bounce: str, diffuse: Array, glossy: Array) -> None:
    sums[f"{bounce}_diffuse"] += diffuse
    sums[f"{bounce}_glossy"] += glossy


@dataclass(frozen=True)
class _RayEnd:
    """Where rays end: on a triangle, with a unit normal that faces the origin.  Undefined without a hit."""

    hit: Array  # (n,) bool
    row: Array  # (n,) of the triangle, 0 without a hit
    distance: Array  # (n,)
    corners: Array  # (n, 3, 3)
    normal: Array  # (n, 3)
    point: Array  # (n, 3)


def _ray_end(scene: TraceScene, origin: Array, direction: Array) -> _RayEnd:
    """The first surface along rays from ``origin`` (n, 3) in unit ``direction`` (n, 3)."""
    rows, distance = closest_hit(scene.triangles, origin, direction, np.full(len(origin), np.inf))
    hit = rows >= 0
    row = np.where(hit, rows, 0)
    corners = scene.triangles[row]
    normal = _unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    normal = np.where(np.sum(normal * direction, axis=1, keepdims=True) > 0, -normal, normal)
    point = origin + direction * np.where(hit, distance, 0.0)[:, None]
    return _RayEnd(hit, row, distance, corners, normal, point)


def _arriving(scene: TraceScene, end: _RayEnd, direction: Array, pdf: Array, cell: Array, throughput: Array) -> Array:
    """Light of emitters and environment along rays, times ``throughput``, weighted against next-event estimation."""
    out = throughput * _environment(scene, direction, pdf)
    out[end.hit] = 0.0
    if len(scene.emitter_triangles):
        p_light = _emitter_pdf(scene, end.row, cell, end.corners, end.normal, direction, end.distance)
        out[end.hit] = (throughput * scene.emission[end.row] * _heuristic(pdf, p_light)[:, None])[end.hit]
    return out


def _vertex_light(
    scene: TraceScene,
    end: _RayEnd,
    direction: Array,
    pdf: Array,
    material: SurfaceMaterial,
    numbers: Callable[[int, int], Array],
    vertex: int,
    lit: tuple[int, int, Array, Array] | None,
) -> Array:
    """Light that the ends of rays scatter back, both lobes, by next-event estimation and connection to ``lit``."""
    cosine = np.abs(np.sum(end.normal * direction, axis=1))
    before = pdf, np.where(end.hit, end.distance, 0.0) ** 2 / np.maximum(cosine, 1e-12)
    diffuse, glossy = _next_event(scene, end.point, end.normal, -direction, material, numbers, vertex, 0, before)
    if lit is not None:
        more = _connect(scene, lit, end.point, end.normal, -direction, material)
        diffuse, glossy = diffuse + more[0], glossy + more[1]
    return diffuse + glossy


def _numbers(words: Array, vertex: int, block: int) -> Array:
    """Four numbers in [0, 1) of a block of a vertex.  ``words``: those of a sample."""
    return (words[vertex * BLOCKS_PER_VERTEX + block] >> np.uint32(8)) / float(1 << 24)


def _scatter(material: SurfaceMaterial, n: Array, v: Array, u: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Direction, pdf, both lobes over the pdf, and which paths go on."""
    direction, pdf = sample_brdf(material, n, v, np.broadcast_to(u[:3], n.shape))
    alive = (pdf > 0) & (np.sum(n * direction, axis=1) > 0)
    diffuse, glossy = evaluate_brdf(material, n, v, direction)
    over = np.where(alive, pdf, 1.0)[:, None]
    diffuse, glossy = (np.where(alive[:, None], lobe / over, 0.0) for lobe in (diffuse, glossy))
    return direction, pdf, diffuse, glossy, alive & ((diffuse + glossy) @ LUMINANCE > 0)


def _next_event(
    scene: TraceScene,
    p: Array,
    n: Array,
    v: Array,
    material: SurfaceMaterial,
    numbers: Callable[[int, int], Array],
    vertex: int,
    first_source: int,
    before: tuple[Array, Array] | None = None,
) -> tuple[Array, Array]:
    """Diffuse and glossy light of one sample of each kind of source, (n, 3) each.

    ``before``: pdf of the direction at the vertex before (n,), and what turns a pdf per area here into one there (n,).
    """
    u = numbers(vertex, ENVIRONMENT_PUNCTUAL)
    arriving = []
    if scene.lights and first_source == 0:
        arriving.append(_punctual(scene, p, n, v, material, u[2], u[3], before))
    if len(scene.emitter_triangles):
        arriving.append(_emitter(scene, p, n, v, material, numbers(vertex, EMITTER)))
    if scene.environment is not None:
        arriving.append(_image(scene, p, n, v, material, u[:2]))
    sums = np.zeros((len(p), 3)), np.zeros((len(p), 3))
    for direction, radiance, reach in arriving:
        facing = (np.sum(n * direction, axis=1) > 0) & (radiance @ LUMINANCE > 0)
        row, _ = closest_hit(scene.triangles, _above(p, n), np.where(facing[:, None], direction, n), reach)
        lit = facing & (row < 0)
        for total, lobe in zip(sums, evaluate_brdf(material, n, v, direction), strict=True):
            total += np.where(lit[:, None], lobe * radiance, 0.0)
    return sums


def _subpath(scene: TraceScene, u: Array) -> tuple[int, int, Array, Array] | None:
    """Light, triangle, point (1, 3) and normal (1, 3) that faces the light, of the end of a light subpath."""
    segments = scene.segments
    if not segments.choice.any():
        return None
    light = int(np.searchsorted(segments.choice[:, 0].astype(np.float64), u[0], side="right"))
    cosine = 1.0 + (segments.least_cosine[light] - 1.0) * u[1]
    sine, around = np.sqrt(1.0 - cosine**2), 2.0 * np.pi * u[2]
    local = np.array([sine * np.cos(around), sine * np.sin(around), cosine])
    axis = segments.axis[light]
    direction = (local @ np.stack([*basis_around(axis), axis]))[None]
    position = segments.position[light][None]
    origin = position + _GAP * np.abs(position).max() * direction
    (row,), (distance,) = closest_hit(scene.triangles, origin, direction, np.full(1, np.inf))
    if row < 0:
        return None
    a, b, c = scene.triangles[row]
    normal = _unit(np.cross(b - a, c - a))
    return light, row, origin + distance * direction, np.where(direction @ normal > 0, -normal, normal)[None]


def _connect(
    scene: TraceScene, lit: tuple[int, int, Array, Array], p: Array, n: Array, v: Array, material: SurfaceMaterial
) -> tuple[Array, Array]:
    """Diffuse and glossy light (n, 3) that the end of a light subpath sends to the viewer over surfaces at ``p``."""
    light, row, end, normal = lit
    origin = _above(p, n)
    towards = end - origin
    d2 = np.sum(towards**2, axis=1)
    direction = _unit(towards)
    to_light, radiance, _ = scene.lights[light](end)
    reflected = evaluate_brdf(scene.material(np.full(len(p), row)), normal, -direction, to_light)
    cosine = -np.sum(normal * direction, axis=1)
    facing = (np.sum(n * direction, axis=1) > 0) & (cosine > 0) & (np.sum(normal * to_light, axis=1) > 0)
    area = scene.segments.pdf(light, end, normal)
    total = brdf_pdf(material, n, v, direction) + area * d2 / np.where(facing, cosine, 1.0)
    span = _above(end, normal) - origin
    hit, _ = closest_hit(scene.triangles, origin, _unit(span), np.linalg.norm(span, axis=1) * (1.0 - 1e-6))
    with np.errstate(divide="ignore", invalid="ignore"):
        sent = (reflected[0] + reflected[1]) * radiance / total[:, None]
    sent = np.where((facing & (hit < 0))[:, None], sent, 0.0)
    diffuse, glossy = (lobe * sent for lobe in evaluate_brdf(material, n, v, direction))
    return diffuse, glossy


def _punctual(
    scene: TraceScene,
    p: Array,
    n: Array,
    v: Array,
    material: SurfaceMaterial,
    pick: float,
    keep: float,
    before: tuple[Array, Array] | None,
) -> tuple[Array, Array, Array]:
    """Direction, radiance over the probability, distance: resampled importance sampling."""
    direction_of, radiance_of, distance_of = (np.stack(each) for each in zip(*(light(p) for light in scene.lights)))
    first, entries = scene.cells
    cell = scene.cell_of(p)
    keep = np.full(len(p), keep)
    total, target = np.zeros(len(p)), np.ones(len(p))
    out = [np.zeros((len(p), 3)), np.zeros((len(p), 3)), np.full(len(p), np.inf)]
    for i in range(scene.candidates):
        row, pdf = np.zeros(len(p), int), np.full(len(p), np.inf)
        for c in np.unique(cell):
            around = entries[first[c] : first[c + 1]].astype(np.float64)
            at, probability = i, 1.0
            if len(around) > scene.candidates:
                at = int(np.searchsorted(around[:, 0], (i + pick) / scene.candidates, side="right"))
                probability = float(np.diff(around[:, 0], prepend=0.0)[at]) * scene.candidates
            if at < len(around):
                row[cell == c], pdf[cell == c] = around[at, 1], probability
        k = np.arange(len(p))
        direction, radiance, distance = direction_of[row, k], radiance_of[row, k], distance_of[row, k]
        if scene.segments and before is not None:  # balance heuristic against connections with light subpaths
            total_pdf = before[0] + scene.segments.pdf(row, p, n) * before[1]
            radiance = radiance * (before[0] / np.where(total_pdf > 0, total_pdf, 1.0))[:, None]
        lobes = evaluate_brdf(material, n, v, direction)
        reflected = (lobes[0] + lobes[1]) * radiance @ LUMINANCE
        weight = np.where(reflected > 0, reflected / pdf, 0.0)
        so_far, total = total, total + weight
        take = (weight > 0) & (keep * total < weight)
        with np.errstate(divide="ignore", invalid="ignore"):
            scaled = np.where(take, keep * total / weight, (keep * total - weight) / so_far)
        keep = np.where(weight > 0, scaled, keep)
        target = np.where(take, reflected, target)
        for slot, value in zip(out, (direction, radiance, distance), strict=True):
            slot[take] = value[take]
    out[1] *= (total / target)[:, None]
    return out[0], out[1], out[2] * (1.0 - _GAP)


def _emitter(
    scene: TraceScene, p: Array, n: Array, v: Array, material: SurfaceMaterial, u: Array
) -> tuple[Array, Array, Array]:
    cell = scene.cell_of(p)
    row = np.zeros(len(p), int)
    for c in np.unique(cell):
        cumulative = np.cumsum(scene.emitters_around(c))
        row[cell == c] = scene.emitter_triangles[np.searchsorted(cumulative, u[0] * cumulative[-1], side="right")]
    corners = scene.triangles[row]
    a, b, c = corners.swapaxes(0, 1)
    root = np.sqrt(u[1])
    point = a + (b - a) * root * (1.0 - u[2]) + (c - a) * root * u[2]
    towards = point - p
    distance = np.linalg.norm(towards, axis=1)
    direction = towards / distance[:, None]
    normal = _unit(np.cross(b - a, c - a))
    pdf = _emitter_pdf(scene, row, cell, corners, normal, direction, distance)
    weight = _heuristic(pdf, brdf_pdf(material, n, v, direction))
    # The ray ends above the emitter, on this side of it.
    side = np.where(np.sum(normal * direction, axis=1, keepdims=True) > 0, -normal, normal)
    span = _above(point, side) - _above(p, n)
    return _unit(span), scene.emission[row] * (weight / pdf)[:, None], np.linalg.norm(span, axis=1) * (1.0 - 1e-6)


def _emitter_pdf(
    scene: TraceScene, rows: Array, cell: Array, corners: Array, normal: Array, direction: Array, distance: Array
) -> Array:
    """Probability per solid angle of the emitter sample that lies on triangles ``rows`` (n,); 0 for other triangles.

    ``cell`` (n,): of the points from which emitters are sampled.
    """
    share = np.zeros(len(rows))
    for c in np.unique(cell):
        of_triangle = np.zeros(len(scene.triangles))
        of_triangle[scene.emitter_triangles] = scene.emitters_around(c)
        share[cell == c] = of_triangle[rows[cell == c]]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    cosine = np.abs(np.sum(normal * direction, axis=1))
    far = np.where(np.isfinite(distance), distance, 0.0)  # a ray without a hit has no use for it
    return share / area * far**2 / np.maximum(cosine, 1e-12)


def _image(
    scene: TraceScene, p: Array, n: Array, v: Array, material: SurfaceMaterial, u: Array
) -> tuple[Array, Array, Array]:
    height = len(scene.choice)
    width, rows = 2 * height, scene.choice[:, -1, 0].astype(np.float64)
    row = int(np.searchsorted(rows, u[0], side="right"))
    columns = scene.choice[row, :width, 0].astype(np.float64)
    column = int(np.searchsorted(columns, u[1], side="right"))
    down = _within(u[0], rows, row)
    right = _within(u[1], columns, column)
    top, bottom = np.cos(np.pi * np.array([row, row + 1]) / height)
    y = top + (bottom - top) * down
    phi = ((column + right) / width - 0.5) * 2.0 * np.pi
    sine = np.sqrt(1.0 - y * y)
    direction = np.broadcast_to([sine * np.cos(phi), y, sine * np.sin(phi)], p.shape)
    pdf = float(scene.choice[row, column, 1])
    weight = _heuristic(np.full(len(p), pdf), brdf_pdf(material, n, v, direction))
    return direction, lookup(scene.environment, direction) * (weight / pdf)[:, None], np.full(len(p), np.inf)


def _within(u: float, cumulative: Array, i: int) -> float:
    low = cumulative[i - 1] if i else 0.0
    return (u - low) / (cumulative[i] - low)


def _environment(scene: TraceScene, direction: Array, pdf: Array) -> Array:
    """Radiance that a ray without a hit brings, weighted against light samples.  (n, 3)."""
    if scene.environment is None:
        return np.broadcast_to(scene.sky, direction.shape)
    height = len(scene.choice)
    x, y, z = direction.T
    column = np.clip(((np.arctan2(z, x) / (2 * np.pi) + 0.5) * 2 * height).astype(int), 0, 2 * height - 1)
    row = np.clip((np.arctan2(np.hypot(x, z), y) / np.pi * height).astype(int), 0, height - 1)
    p_light = scene.choice[row, column, 1].astype(np.float64)
    return lookup(scene.environment, direction) * _heuristic(pdf, p_light)[:, None]


def _heuristic(a: Array, b: Array) -> Array:
    """Power heuristic, exponent 2."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(a > 0, 1.0 / (1.0 + (b / a) ** 2), 0.0)


def _unit(v: Array) -> Array:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return v / np.where(length > 0, length, 1.0)


def _above(point: Array, normal: Array) -> Array:
    """Origins of rays that leave surfaces on the side of their normals (n, 3)."""
    return point + normal * (_GAP * np.abs(point).max(axis=1, keepdims=True))
