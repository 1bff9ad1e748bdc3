"""Direct light: per-tile light lists and the lighting pass."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.errors import GraphicsError
from taubench_gl.frame.flow import SURFACE
from taubench_gl.frame.lights import LIGHT, LIGHT_ROW, LightTexture
from taubench_gl.frame.listed_lights import LightBlocks, Listing
from taubench_gl.frame.passes.shadows import ShadowPass
from taubench_gl.frame.plan import TILE
from taubench_gl.frame.shadow_faces import FACE
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.metrics.lighting import ALBEDO_TABLE, MIN_ALPHA, MIN_LIGHT_DISTANCE, albedo_table
from taubench_gl.metrics.shading_rate import RATES, invocations, phase
from taubench_gl.settings import Settings

LIGHTING = Struct(
    "LightingRecord",
    Field("sky", "vec4", "xyz: uniform sky radiance, linear"),
    Field("parallel_view", "vec4", "xyz: unit, towards a parallel camera; w: 1 if the camera is parallel"),
    Field("size", "ivec4", "xy: pixels, z: tiles in a row, w: lights"),
    Field("tiles", "int", "tiles in all"),
    Field("light_error", "float", "largest radiance that culling may leave out of a tile, linear, before exposure"),
    Field("phase", "int", "which part of the picture a shading rate other than full shades"),
)

MAX_LIGHTS = 30_000
"""Twice over all lights and once over a tile's pixels: a shader of llvmpipe stops, silently, after 65,535 turns."""

LIGHT_IMAGE = 3
"""Binding of the light table in this pass's shaders, after the images they write.

The G-buffer is read through samplers here.  As images from unit 3 on, pictures are wrong where lights are not listed:
``position`` lies where they have the table.  At units of its own (4 to 8) they are the same, for 0.95 x the CPU time.
"""

SHADOW_BIAS = 0.5
"""In texels of the map, along the light: what is left for curved and creased surfaces, planes need none."""


SHADOW_REACH = 256.0
"""In texels, along the light: how far a receiver's plane may run from a pixel to the texel beside it.  1/256 rad."""


def lighting_preamble() -> str:
    return "\n".join(
        (
            LIGHTING.glsl,
            LIGHT.glsl,
            FACE.glsl,
            f"const float MIN_LIGHT_DISTANCE = {MIN_LIGHT_DISTANCE};",
            f"const float MIN_ALPHA = {MIN_ALPHA};",
            f"const float SHADOW_BIAS = {SHADOW_BIAS};",
            f"const float SHADOW_REACH = {SHADOW_REACH};",
            f"const int TILE = {TILE};",
            f"const int LIGHT_ROW = {LIGHT_ROW};",
        )
    )


def storage_defines(settings: Settings) -> dict[str, str]:
    """What a shader that writes radiance must be told where channels are stored as halves (common/storage.glsl)."""
    return {"RADIANCE_FORMAT": "rgba16f"} if settings.device.storage == "half" else {}


def lighting_record(view: View, size: tuple[int, int], settings: Settings, lights: int) -> np.ndarray:
    """A LIGHTING record with all but the tiles and the phase filled in."""
    record = LIGHTING.zeros()
    record["sky"][:3] = settings.lighting.sky
    if view.camera.kind != "perspective":
        record["parallel_view"] = (*view.world_from_view[:, 2], 1.0)
    record["size"] = (*size, 0, lights)
    record["light_error"] = settings.lighting.light_error
    return record


class LightingPass:
    """Writes ``direct`` (and its lobes, if asked) of the current frame."""

    def __init__(
        self,
        gpu: Gpu,
        shaders: ShaderCache,
        size: tuple[int, int],
        light_count: int,
        settings: Settings,
        effects: frozenset[str],
        *,
        split: bool = False,
        rate: str = "full",
        listing: Listing | None = None,
    ):
        """``effects``: names of those that are on; ``split``: write each lobe too; ``rate``: shade only part of the
        pixels (``metrics.shading_rate``), the others keep what they held; ``listing``: lights to compile one by one,
        all of the scene's or all that have shadow maps."""
        self._rate = rate
        if light_count > MAX_LIGHTS:
            raise GraphicsError(f"the scene has {light_count} lights, at most {MAX_LIGHTS} can be drawn")
        self._gpu, self._size, self._settings, self._count = gpu, size, settings, light_count
        self._tiled = "light_culling" in effects and light_count > 0
        self._group = (32, 1) if gpu.software else (8, 8)
        self._split, self._shadows = split, "shadows" in effects and light_count > 0
        listing = listing or Listing()
        preamble = f"{lighting_preamble()}\n{listing.glsl}"
        group = {"GROUP_X": self._group[0], "GROUP_Y": self._group[1]}
        defines = {"SHADOWS": self._shadows, "TILED": self._tiled, "SPLIT_LOBES": split, **group}
        defines |= listing.defines | {"UNLISTED_LIGHTS": len(listing.rows) < light_count}
        defines |= {"SHADING_RATE": RATES.index(rate), "BRANCHES": not gpu.software, "LIGHT_IMAGE": LIGHT_IMAGE}
        switches = ("sky", "glossy", "point_lights", "spot_lights", "directional_lights")
        defines |= {name.upper(): name in effects for name in switches}
        if self._shadows:
            defines["SHADOW_TAPS"] = 4 if settings.lighting.shadow_filter == "bilinear" else 1
        defines |= storage_defines(settings)
        self._program = shaders.compute("lighting/lighting.comp.glsl", defines, preamble)
        tiles_x, tiles_y = -(-size[0] // TILE), -(-size[1] // TILE)
        self._tiles = (tiles_x, tiles_x * tiles_y)
        ctx = gpu.ctx
        self._parameters = ctx.buffer(reserve=LIGHTING.dtype.itemsize, dynamic=True)
        self._lights = LightTexture(gpu, light_count)
        self._listed = LightBlocks(gpu, listing) if listing.rows else None
        self._albedos = None
        if {"sky", "glossy"} <= effects:
            self._albedos = ctx.texture((ALBEDO_TABLE, ALBEDO_TABLE), 4, albedo_table().tobytes(), dtype="f4")
        self._cull = self._tile_counts = self._tile_lists = None
        if self._tiled:
            only = {"GLOSSY": "glossy" in effects, "SHADOWED_LISTED": bool(listing.rows), "LIGHT_IMAGE": LIGHT_IMAGE}
            self._cull = shaders.compute("lighting/cull.comp.glsl", only, lighting_preamble())
            self._tile_counts = ctx.buffer(reserve=4 * self._tiles[1])
            self._tile_lists = ctx.buffer(reserve=4 * self._tiles[1] * light_count)

    @property
    def bytes(self) -> int:
        """GPU memory of the light lists and the sky's table, bytes."""
        lists = 0 if self._tile_lists is None else self._tile_lists.size + self._tile_counts.size
        return lists + (0 if self._albedos is None else 16 * ALBEDO_TABLE**2)

    def run(
        self,
        view: View,
        light_rows: np.ndarray,
        textures: Mapping[str, moderngl.Texture],
        shadow: ShadowPass | None,
        frame: int = 0,
    ) -> None:
        """Light the frame in ``textures``, whose ``direct`` (``direct_diffuse``, ``direct_glossy``) is written.

        ``frame`` counts for shading rates other than full: which part of the picture it is the turn of.
        """
        record = lighting_record(view, self._size, self._settings, self._count)
        record["size"][2], record["tiles"] = self._tiles
        record["phase"] = phase(self._rate, frame)
        self._parameters.write(record.tobytes())
        self._lights.write(light_rows)
        self._parameters.bind_to_uniform_block(0)
        self._lights.texture.bind_to_image(LIGHT_IMAGE, read=True, write=False)
        for unit, name in enumerate(SURFACE):
            textures[name].use(unit)
        if self._cull is not None:
            self._tile_counts.bind_to_storage_buffer(2)
            self._tile_lists.bind_to_storage_buffer(3)
            for name in SURFACE:
                if name in self._cull:  # without a glossy lobe no material matters
                    self._cull[name] = SURFACE.index(name)
            self._cull.run(-(-self._tiles[1] // 8))
            self._gpu.ctx.memory_barrier()
        for unit, name in enumerate(SURFACE):
            if name in self._program:
                self._program[name] = unit
        if self._shadows:
            shadow.atlas.use(5)
            shadow.faces.use(7)
            for name, unit in (("shadow_atlas", 5), ("shadow_faces", 7)):
                if name in self._program:
                    self._program[name] = unit
        if self._listed is not None:
            self._listed.bind(light_rows, shadow.rows if self._shadows else None)
        if self._albedos is not None:
            self._albedos.use(6)
            self._program["albedo_table"] = 6
        outputs = ("direct", "direct_diffuse", "direct_glossy") if self._split else ("direct",)
        for unit, name in enumerate(outputs):
            textures[name].bind_to_image(unit, read=False, write=True)
        columns, rows = invocations(self._rate, self._size)
        self._program.run(-(-columns // self._group[0]), -(-rows // self._group[1]))
        self._gpu.ctx.memory_barrier()

    def tile_counts(self) -> np.ndarray | None:
        """Lights kept per tile, (tiles_y, tiles_x) uint32, row 0 at the bottom; None without culling."""
        if self._tile_counts is None:
            return None
        return np.frombuffer(self._tile_counts.read(), np.uint32).reshape(-1, self._tiles[0])

    def tile_lists(self) -> list[np.ndarray] | None:
        """Rows of the light table that each tile keeps, tiles row by row from the bottom; None without culling.

        Listed lights that have shadow maps are in none.
        """
        if self._tile_lists is None:
            return None
        lists = np.frombuffer(self._tile_lists.read(), np.uint32).reshape(-1, self._count)
        return [row[:count] for row, count in zip(lists, self.tile_counts().ravel(), strict=True)]

    def release(self) -> None:
        lists = (self._tile_counts, self._tile_lists)
        for buffer in (self._parameters, self._lights, self._listed, self._albedos, *lists):
            if buffer is not None:
                buffer.release()
