"""Surfaces at hits that float64 ray casts found, evaluated on the GPU, and the same pixels of the rasterizer."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from shader_tools import rows_glsl, with_main

from taubench_gl.animation import CameraTrack, pose_vertices
from taubench_gl.frame.raytracing.atlas import ATLAS_BYTES
from taubench_gl.frame.raytracing.attributes import HitAttributes
from taubench_gl.frame.raytracing.hit_tables import HitOptions
from taubench_gl.frame.raytracing.structure import SceneStructure
from taubench_gl.frame.renderer import Renderer
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.declare import BUFFER, IMAGE, ComputePass
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.scene.model import Scene

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "frame"))
from ray_caster import cast_pixels, gather, pixel_rays, states

Array = np.ndarray
CHANNELS = (
    "position", "normal", "geometric_normal", "base_color", "material", "emission", "ids",
)  # fmt: skip
TAPS = 64
"""Numbers u over which base color and emission are averaged: their mean is the bilinear value within 1/TAPS."""

HEAD = rows_glsl("", first=6)

WRITE = """
void write(uint i, Ray ray, Hit hit) {
    HitSurface s;
    vec3 base = vec3(0.0), emission = vec3(0.0);
    for (int k = 0; k < TAPS; ++k) {
        s = surface_at(ray, hit, (float(k) + 0.5) / float(TAPS));
        base += s.base_color;
        emission += s.emission;
    }
    results[7u * i] = vec4(s.position, s.area);
    results[7u * i + 1u] = vec4(s.geometric_normal, float(s.emitter));
    results[7u * i + 2u] = vec4(s.normal, float(s.unlit));
    results[7u * i + 3u] = vec4(base / float(TAPS), float(alpha_passes(hit.instance, hit.triangle, hit.barycentrics)));
    results[7u * i + 4u] = vec4(s.metallic, s.roughness, s.specular, 0.0);
    results[7u * i + 5u] = vec4(emission / float(TAPS), 0.0);
    results[7u * i + 6u] = vec4(hit.t, float(hit.instance), float(hit.triangle), 0.0);
}
"""

SURFACES = (
    HEAD
    + WRITE
    + """
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    vec4 d = rows[2u * i], h = rows[2u * i + 1u];
    write(i, Ray(vec3(0.0), d.xyz, 1e30), Hit(0.0, int(h.x), int(h.y), h.zw));
}
"""
)

TRACED = (
    HEAD
    + WRITE
    + """
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    Ray ray = Ray(rows[2u * i + 1u].xyz, rows[2u * i].xyz, 1e30);
    Hit hit = closest_hit(ray);
    for (uint k = 0u; k < 6u; ++k) results[7u * i + k] = vec4(0.0);
    results[7u * i + 6u] = vec4(hit.t, -1.0, -1.0, 0.0);
    if (hit.instance >= 0) write(i, ray, hit);
}
"""
)


class Hits:
    """Attributes of the hits of one scene's renderer, and programs that use them."""

    def __init__(self, renderer: Renderer, attributes: HitAttributes, structure: SceneStructure | None):
        self.renderer, self.attributes, self.structure = renderer, attributes, structure

    def at(self, time: float) -> None:
        """Draw the frame at ``time`` seconds, and renew what hits find there."""
        self.renderer.draw(time, time)
        self.attributes.update(self.renderer.frame)
        if self.structure is not None:
            self.structure.update(self.renderer.frame)

    def trace(self, origins: Array, directions: Array) -> tuple[Array, Array, Array, Surfaces]:
        """Closest hits of camera-relative rays (N, 3), unit: distance, draw (-1: none), triangle and surface."""
        rows = np.zeros((len(origins), 2, 4))
        rows[:, 0, :3], rows[:, 1, :3] = directions, origins
        v = self.run("raytracing/trace.glsl raytracing/surface.glsl", TRACED, rows, 7)
        return v[:, 6, 0], v[:, 6, 1].astype(int), v[:, 6, 2].astype(int), _surfaces(v)

    def run(self, includes: str, main: str, rows: Array, width: int, **uniforms: object) -> Array:
        """``main`` after ``includes`` over ``rows`` (N, k, 4): (N, width, 4) float64."""
        gpu: Gpu = self.renderer.context.gpu
        p = self.attributes.declare(ComputePass("test", ("",)))
        resources = dict(self.attributes.resources)
        if self.structure is not None:
            p = self.structure.declare(p)
            resources |= self.structure.resources
        text = "\n".join([*p.text, *(use.glsl(binding) for use, binding in p.bindings())])
        program = with_main(gpu, includes, main, p.defines, f"{text}\nconst int TAPS = {TAPS};")
        for use, binding in p.bindings():
            resource = resources[use.key]
            if use.form == BUFFER:
                resource.bind_to_storage_buffer(binding)
            elif use.form == IMAGE:
                resource.bind_to_image(binding, read=True, write=False)
            else:
                resource.use(binding)
        source = gpu.ctx.buffer(np.ascontiguousarray(rows, dtype=np.float32).tobytes())
        out = gpu.ctx.buffer(reserve=16 * width * len(rows))
        source.bind_to_storage_buffer(6)
        out.bind_to_storage_buffer(7)
        for name, value in {**uniforms, "count": len(rows)}.items():
            program[name] = value
        gpu.ctx.memory_barrier()
        program.run(-(-len(rows) // 64))
        gpu.ctx.finish()
        values = np.frombuffer(out.read(), dtype=np.float32).reshape(len(rows), width, 4).astype(np.float64)
        for item in (source, out, program):
            item.release()
        return values

    def surfaces(self, draws: Array, triangles: Array, weights: Array, directions: Array) -> Surfaces:
        """Rows (N,), triangles (N,), weights of the second and third corner (N, 2), ray directions (N, 3)."""
        rows = np.zeros((len(draws), 2, 4))
        rows[:, 0, :3], rows[:, 1, 0], rows[:, 1, 1], rows[:, 1, 2:] = directions, draws, triangles, weights
        return _surfaces(self.run("raytracing/surface.glsl", SURFACES, rows, 7))


@dataclass(frozen=True)
class Surfaces:
    position: Array
    area: Array
    geometric_normal: Array
    emitter: Array
    normal: Array
    unlit: Array
    base_color: Array
    alpha_passes: Array
    material: Array  # metallic, roughness, specular
    emission: Array

    def at(self, rows: Array) -> Surfaces:
        return Surfaces(*(getattr(self, f.name)[rows] for f in fields(self)))


def _surfaces(v: Array) -> Surfaces:
    return Surfaces(
        v[:, 0, :3], v[:, 0, 3], v[:, 1, :3], v[:, 1, 3].astype(int), v[:, 2, :3], v[:, 2, 3] > 0.5, v[:, 3, :3],
        v[:, 3, 3] > 0.5, v[:, 4, :3], v[:, 5, :3],
    )  # fmt: skip


@contextmanager
def opened(
    gpu: Gpu,
    scene: Scene,
    camera: CameraTrack,
    size: tuple[int, int],
    options: HitOptions | None = None,
    *,
    traced: bool = False,
    textures: str = "finest",
    atlas_bytes: int = ATLAS_BYTES,
) -> Iterator[Hits]:
    """A renderer and its hits; no frame is drawn.  ``textures``: as in Settings.

    ``traced``: with the acceleration structure, and without culling, as rays see both sides.
    """
    culling = "none" if traced else "gltf"
    with Owner() as owner:
        context = owner.own(GpuContext(gpu))
        renderer = Renderer(context, scene, camera, size, set(CHANNELS), culling=culling, textures=textures)
        owner.own(renderer)
        attributes = owner.own(HitAttributes(renderer, options or HitOptions(), atlas_bytes=atlas_bytes))
        yield Hits(renderer, attributes, owner.own(SceneStructure(renderer) if traced else None))
    gpu.collect()


@dataclass(frozen=True)
class Seen:
    """Pixels whose ray meets the surface that the rasterizer drew there, and that surface by both ways."""

    pixels: Array  # (N, 2) column, row
    channels: dict[str, Array]  # (N, n) float64
    hits: Surfaces
    draws: Array  # (N,)
    triangles: Array  # (N,)
    covered: int  # pixels that the rasterizer drew


def look(hits: Hits, time: float = 0.0) -> Seen:
    """Draw the frame at ``time`` and find the surfaces at the rays through its pixels.

    Left out: pixels whose ray meets another draw or another depth, at edges and where alpha cuts the first surface out.
    """
    renderer = hits.renderer
    w, h = renderer.size
    hits.at(time)
    channels = {name: renderer.read(name) for name in CHANNELS}
    _, view = renderer.view(time)
    x, y = np.meshgrid(np.arange(w), np.arange(h))
    at = np.stack([x.ravel(), y.ravel()], axis=-1)
    now, _ = states(renderer.scene, (time, time))
    triangles = gather(renderer.scene, now, now)
    found = cast_pixels(triangles, view, (w, h), at.astype(np.float64))
    flat = {name: c.reshape(w * h, -1).astype(np.float64) for name, c in channels.items()}
    depth = flat["position"][:, 3]
    same = (found.triangle >= 0) & (depth > 0)
    same &= np.where(found.triangle >= 0, triangles.record[found.triangle], 0) == flat["ids"][:, 0]
    same &= np.abs(found.depth - depth) < 1e-3 * depth
    rows = np.flatnonzero(same)
    picked = found.triangle[rows]
    draws = triangles.record[picked] - 1
    first = np.searchsorted(triangles.record, np.arange(1, len(renderer.draws) + 1), side="left")
    local = picked - first[draws]
    weights = found.weights[rows][:, 1:].copy()
    swap = _swapped(renderer, now, triangles, first)[picked]
    weights[swap] = weights[swap][:, ::-1]
    _, directions = pixel_rays(view, (w, h), at[rows].astype(np.float64))
    directions = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    surfaces = hits.surfaces(draws, local, weights, directions)
    return Seen(at[rows], {n: c[rows] for n, c in flat.items()}, surfaces, draws, local, int((depth > 0).sum()))


def look_by_tracing(hits: Hits, time: float = 0.0) -> Seen:
    """``look`` with the hits of the acceleration structure, alpha tests included; every pixel with the same draw."""
    renderer = hits.renderer
    w, h = renderer.size
    hits.at(time)
    channels = {n: renderer.read(n).reshape(w * h, -1).astype(np.float64) for n in CHANNELS}
    _, view = renderer.view(time)
    x, y = np.meshgrid(np.arange(w), np.arange(h))
    at = np.stack([x.ravel(), y.ravel()], axis=-1)
    origins, directions = pixel_rays(view, (w, h), at.astype(np.float64))
    directions = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    _, draws, triangles, surfaces = hits.trace(origins - view.position, directions)
    rows = np.flatnonzero(draws + 1 == channels["ids"][:, 0] * (channels["position"][:, 3] > 0))
    rows = rows[draws[rows] >= 0]
    covered = int((channels["position"][:, 3] > 0).sum())
    return Seen(
        at[rows], {n: c[rows] for n, c in channels.items()}, surfaces.at(rows), draws[rows], triangles[rows], covered
    )


def _swapped(renderer: Renderer, state, triangles, first: Array) -> Array:
    """Triangles whose second and third corner the ray caster has exchanged.  (T,) bool."""
    out = np.zeros(len(triangles.record), dtype=bool)
    counters: dict[tuple[int, int], int] = {}
    for i, d in enumerate(renderer.draws):
        instance = None
        if d.local is not None:
            instance = counters.get((d.node, d.primitive), 0)
            counters[d.node, d.primitive] = instance + 1
        if not state.visible[d.node]:
            continue
        primitive = renderer.scene.meshes[d.mesh].primitives[d.primitive]
        corners = pose_vertices(renderer.scene, state, d.node, primitive, instance)[primitive.triangles]
        rows = slice(first[i], first[i] + len(corners))
        out[rows] = (triangles.corners[rows, 1] != corners[:, 1]).any(axis=-1)
    return out
