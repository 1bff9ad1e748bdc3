"""Rays from arrays, answered by the acceleration structure on the GPU."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import moderngl
import numpy as np

from taubench_gl.frame.raytracing.attributes import HitAttributes
from taubench_gl.frame.raytracing.structure import SceneStructure
from taubench_gl.gpu.declare import WRITE, ComputePass
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.passes import CompiledCompute, GpuContext
from taubench_gl.gpu.shader import ShaderCache, compile_compute, resolve
from taubench_gl.paths import SHADERS

Array = np.ndarray
WIDTH = 1024


@dataclass(frozen=True, slots=True)
class Hits:
    """Answers to N rays.  Of an any-hit query only ``draw`` has a meaning: -1 or not."""

    t: Array  # (N,) float32 distance, in lengths of the direction
    draw: Array  # (N,) int32 row of the draw, -1: nothing hit
    triangle: Array  # (N,) int32 triangle of the draw's primitive, -1
    weights: Array  # (N, 2) float32 barycentric weights of the second and third corner


class ShadersOfTests(ShaderCache):
    """Compute programs whose entry points may lie beside this file."""

    def compute(self, entry: str, defines=None, preamble: str = "") -> moderngl.ComputeShader:
        return compile_compute(self._ctx, resolve(entry, defines, preamble, (SHADERS, Path(__file__).parent)))


class RayQuery(Owner):
    """Answers rays against one structure."""

    def __init__(self, context: GpuContext, structure: SceneStructure, attributes: HitAttributes | None = None):
        """``attributes``: for a structure that tests alpha."""
        super().__init__()
        self._context = GpuContext(context.gpu, ShadersOfTests(context.gpu.ctx))
        self._structure, self._attributes = structure, attributes
        self._compiled: dict[tuple[bool, bool, int], CompiledCompute] = {}

    def __call__(
        self,
        origins: Array,
        directions: Array,
        t_max: float | Array = np.inf,
        *,
        any_hit: bool = False,
        before: bool = False,
        normals: Array | None = None,
    ) -> Hits:
        """``origins``, ``directions`` (N, 3): camera-relative, world axes; ``t_max``: number or (N,); ``before``: of
        the surfaces as they were in the frame before; ``normals`` (N, 3): geometric normals of surfaces that the
        origins lie on, which the rays then leave by ``offset_origin``."""
        count = len(origins)
        height = max(-(-count // WIDTH), 1)
        rays = np.zeros((3, height * WIDTH, 4), np.float32)
        rays[0, :count, :3], rays[1, :count, :3] = origins, directions
        rays[0, :count, 3] = np.minimum(t_max, np.finfo(np.float32).max)
        rays[2, :count, :3] = 0.0 if normals is None else normals
        textures = {"ray_origins": rays[0], "ray_directions": rays[1], "ray_normals": rays[2]}
        compiled = self._compile(any_hit, before, height)
        with Owner() as owner:
            texture = partial(self._context.gpu.ctx.texture, (WIDTH, height), 4)
            tables = {n: owner.own(texture(a.tobytes(), dtype="f4")) for n, a in textures.items()}
            tables["hits"] = owner.own(texture(dtype="u4"))
            tables["weights"] = owner.own(texture(dtype="f4"))
            attributes = {} if self._attributes is None else self._attributes.resources
            compiled.run(None, {**self._structure.resources, **tables, **attributes}, ray_count=count)
            self._context.gpu.hazards.publish()
            self._context.gpu.finish()
            words = np.frombuffer(tables["hits"].read(), np.uint32).reshape(-1, 4)[:count]
            weights = np.frombuffer(tables["weights"].read(), np.float32).reshape(-1, 4)[:count, :2]
        return Hits(words[:, 0].view(np.float32).copy(), words[:, 1].astype(np.int32), words[:, 2].astype(np.int32),
                    weights.copy())  # fmt: skip

    def _compile(self, any_hit: bool, before: bool, height: int) -> CompiledCompute:
        key = any_hit, before, height
        if key not in self._compiled:
            p = ComputePass("ray query", ("ray_query.comp.glsl",)).define(ANY_HIT=any_hit, BEFORE=before)
            p.image("ray_origins", filled=True).image("ray_directions", filled=True)
            p.image("ray_normals", filled=True)
            p.image("hits_out", "rgba32ui", access=WRITE, resource="hits")
            p.image("weights_out", access=WRITE, resource="weights")
            self._structure.declare(p)
            if self._attributes is not None:
                self._attributes.declare(p)
            self._compiled[key] = self.own(self._context.compute(p.dispatch((WIDTH, height), (64, 1))))
            self.own(self._compiled[key].program)
        return self._compiled[key]
