"""Direct and indirect light from a few random samples per pixel: unbiased, and as noisy as that."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.frame.flow import SURFACE
from taubench_gl.frame.indirect_layout import VIRTUAL, VIRTUAL_ROW
from taubench_gl.frame.lights import LightTexture
from taubench_gl.frame.passes.images import IMAGE_UNITS
from taubench_gl.frame.passes.lighting import LIGHTING, lighting_preamble, lighting_record, storage_defines
from taubench_gl.frame.passes.shadows import ShadowPass
from taubench_gl.frame.shading import Shading
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.metrics.lighting import ALBEDO_TABLE, albedo_table
from taubench_gl.metrics.shading_rate import RATES, invocations, phase
from taubench_gl.metrics.stochastic import light_choice
from taubench_gl.settings import Settings

STOCHASTIC = Struct(
    "StochasticRecord",
    Field("scene_from_relative", "vec4", "xyz: current camera - centre of the scene's bounds, metres"),
    Field("draws", "uvec4", "x: frame, y: seed, z: lights drawn per pixel, w: virtual lights drawn per pixel"),
    Field("counts", "ivec4", "x: lights, 0 if all are off, y: virtual lights, z: phase of the shading rate"),
)


class StochasticPass:
    """Writes ``direct``, and ``indirect`` if ``indirect``, of the pixels that the frame shades."""

    def __init__(
        self,
        gpu: Gpu,
        shaders: ShaderCache,
        size: tuple[int, int],
        light_count: int,
        settings: Settings,
        effects: frozenset[str],
        shading: Shading,
        *,
        indirect: bool,
    ):
        self._gpu, self._size, self._settings, self._count = gpu, size, settings, light_count
        self._shading, self._indirect = shading, indirect
        self._group = (32, 1) if gpu.software else (8, 8)
        self._shadows = "shadows" in effects and light_count > 0
        bilinear = settings.lighting.shadow_filter == "bilinear"
        defines = {
            "SHADOWS": self._shadows,
            "SHADOW_TAPS": 1,
            "SHADOW_RANDOM": bilinear,  # a hard filter has one tap, and nothing to draw
            "INDIRECT": indirect,
            "SHADING_RATE": RATES.index(shading.rate),
            "GROUP_X": self._group[0],
            "GROUP_Y": self._group[1],
        }
        switches = ("sky", "glossy", "point_lights", "spot_lights", "directional_lights")
        defines |= {name.upper(): name in effects for name in switches} | storage_defines(settings)
        preamble = "\n".join(
            (lighting_preamble(), VIRTUAL.glsl, STOCHASTIC.glsl, f"const int VIRTUAL_ROW = {VIRTUAL_ROW};")
        )
        self._program = shaders.compute("lighting/stochastic.comp.glsl", defines, preamble)
        ctx = gpu.ctx
        self._parameters = ctx.buffer(reserve=LIGHTING.dtype.itemsize, dynamic=True)
        self._draws = ctx.buffer(reserve=STOCHASTIC.dtype.itemsize, dynamic=True)
        self._lights = LightTexture(gpu, light_count)
        self._choice = ctx.buffer(reserve=8 * max(light_count, 1), dynamic=True)
        self._albedos = None
        if {"sky", "glossy"} <= effects:
            self._albedos = ctx.texture((ALBEDO_TABLE, ALBEDO_TABLE), 4, albedo_table().tobytes(), dtype="f4")

    @property
    def bytes(self) -> int:
        """GPU memory of the sky's table, bytes."""
        return 0 if self._albedos is None else 16 * ALBEDO_TABLE**2

    def run(
        self,
        frame: int,
        view: View,
        light_rows: np.ndarray,
        textures: Mapping[str, moderngl.Texture],
        shadow: ShadowPass | None,
        virtual: moderngl.Texture | None,
        virtual_count: int,
        scene_from_relative: np.ndarray,
    ) -> None:
        """Estimate the light of the frame in ``textures``; ``virtual``: VIRTUAL records of this frame, as a texture."""
        choice = light_choice(light_rows["color"][: self._count, :3].max(axis=-1))
        record = STOCHASTIC.zeros()
        record["scene_from_relative"][:3] = scene_from_relative
        shading = self._shading
        record["draws"] = frame, shading.seed, shading.light_samples, shading.indirect_samples
        lit = self._count if choice.any() else 0
        record["counts"][:3] = lit, virtual_count, phase(shading.rate, frame)
        self._draws.write(record.tobytes())
        self._parameters.write(lighting_record(view, self._size, self._settings, self._count).tobytes())
        self._choice.write(choice.tobytes() or bytes(8))
        self._lights.write(light_rows)
        self._parameters.bind_to_uniform_block(0)
        self._draws.bind_to_uniform_block(1)
        self._choice.bind_to_storage_buffer(4)
        self._lights.texture.use(8)
        if "light_table" in self._program:
            self._program["light_table"] = 8
        for unit, name in enumerate(SURFACE):
            textures[name].use(unit)
            if name in self._program:
                self._program[name] = unit
        if self._shadows:
            shadow.atlas.use(5)
            shadow.faces.use(9)
            self._program["shadow_atlas"], self._program["shadow_faces"] = 5, 9
        if self._albedos is not None:
            self._albedos.use(6)
            self._program["albedo_table"] = 6
        textures["direct"].bind_to_image(0, read=False, write=True)
        if self._indirect:
            virtual.bind_to_image(IMAGE_UNITS["virtual_lights"], read=True, write=False)
            textures["indirect"].bind_to_image(1, read=False, write=True)
        columns, rows = invocations(shading.rate, self._size)
        self._program.run(-(-columns // self._group[0]), -(-rows // self._group[1]))
        self._gpu.ctx.memory_barrier()

    def release(self) -> None:
        for buffer in (self._parameters, self._draws, self._lights, self._choice, self._albedos):
            if buffer is not None:
                buffer.release()
