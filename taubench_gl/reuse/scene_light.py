"""What methods with ``light = "own"`` have of a scene: lights and surfaces of two frames, and rays.

The GLSL side is ``shaders/reuse/light.glsl``.  ``SceneLight`` declares what it reads like a pass of the renderer, so
that the acceleration structure and the tables of hits have one way into a shader.
"""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.effects.lighting import environment_of
from taubench_gl.effects.path_tracing import traced_sources
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.environment import declare_environment, seen_of
from taubench_gl.frame.lights import LIGHT, LIGHT_ROW, LightTexture
from taubench_gl.frame.passes.pathtracing import LIGHT_GAP
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.declare import IMAGE, TEXTURE, WRITE, ComputePass, Use
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.gpu.passes import bind_uses
from taubench_gl.gpu.shader import resolve
from taubench_gl.metrics.environment import CELLS
from taubench_gl.metrics.lighting import MIN_ALPHA, MIN_LIGHT_DISTANCE
from taubench_gl.metrics.stochastic import light_choice
from taubench_gl.reuse.frame import input_texture
from taubench_gl.settings import Settings

CHANNELS = ("geometric_normal", "base_color", "material", "prev_position")
"""Channels that the source of the input has to have."""

_SURFACE_CHANNELS = ("position", "normal", "geometric_normal", "base_color", "material")

SURFACE = Struct(
    "LightSurface",
    Field("position", "vec4", "xyz: meters, relative to the camera of its frame; w: 1 where it scatters light"),
    Field("normal", "vec4", "xyz: unit, of shading; w: perceptual roughness squared"),
    Field("geometric_normal", "vec4", "xyz: unit, of the triangle, facing the viewer; w: metallic"),
    Field("color", "vec4", "xyz: base color, linear; w: specular factor"),
)
FRAME = Struct(
    "LightFrame",
    Field("parallel_view", "vec4", "xyz: unit, towards a parallel camera; w: 1 if the camera is parallel"),
    Field("prev_parallel_view", "vec4", "the same of the previous frame"),
    Field("camera_delta", "vec4", "xyz: current - previous camera's position, meters"),
    Field("size", "ivec4", "xy: pixels"),
    Field("numbers", "uvec4", "x: frame, y: seed"),
    Field("sky", "vec4", "xyz: radiance of a uniform environment, linear"),
)


def refusal(source: RasterSource) -> str | None:
    """Why methods cannot light the frames of ``source``, or None."""
    if source.light is None or source.light.paths is None:
        return "nothing lights the scene"
    if source.effects["transmission"].enabled:
        return "a surface lets light through, which no sample of a light follows (KHR_materials_transmission)"
    draws = source.renderer.draws
    if any(draws[int(row)].posed for row in source.light.paths.attributes.emitters["draw"]):
        return "an emissive surface deforms"
    return None


class SceneLight:
    """What a pass of a method needs to light pixels itself: ``declaration`` and ``resources``.

    ``rest``: light that no method computes; ``born``, ``gone``: numbers of the punctual lights that were switched on or
    off since the previous frame.
    """

    def __init__(self, owner: GpuOwner, source: RasterSource, settings: Settings, seed: int):
        """``owner``: frees it; ``source``: path-traced in both frames (``Shading.both_frames``), with
        ``settings``, without ``refusal``."""
        gpu, self._source, self._exposure = owner.gpu, source, settings.lighting.exposure_factor
        self._hazards, self._seed = gpu.hazards, seed
        paths, software = source.light.paths, gpu.software
        self._software = software
        self._attributes, self._count = paths.attributes, len(source.light.table)
        self._structure = paths.structure
        self._environment = environment_of(settings)
        self._sky = "environment" in traced_sources(source.renderer.scene, settings)
        self.declaration = p = self.declare(ComputePass("reuse light", ("reuse/light.glsl",)))
        self.text = resolve(p.shaders[0], p.defines, super(ComputePass, p).interface())
        """GLSL before the text of a method's pass, without the size of work groups."""
        width, height = source.size
        self._surfaces = [owner.own(gpu.ctx.buffer(reserve=SURFACE.dtype.itemsize * width * height)) for _ in range(2)]
        for buffer in self._surfaces:
            buffer.clear()
        self._frame = owner.own(gpu.ctx.buffer(reserve=FRAME.dtype.itemsize))
        self._choice = owner.own(gpu.ctx.buffer(reserve=8 * max(self._count, 1), dynamic=True))
        self._before = owner.own(LightTexture(gpu, self._count))
        self._rows: np.ndarray | None = None  # of the light table, in the frame before
        draws = self._attributes.resources["hit_draws"]
        self._prev_draws = owner.own(gpu.texture(draws.size, 4, "u4"))
        self._draws: bytes | None = None  # rows of draws in the frame before
        self.rest = owner.own(input_texture(gpu, "emitted", source.size))
        self.resources: dict[str, Any] = {}
        self._store = owner.own(owner.context.compute(self._surface_pass(Tuning(software))))

    def declare(self, p: ComputePass) -> ComputePass:
        """Add what ``reuse/light.glsl`` needs to a pass."""
        emitters, sky, software = len(self._attributes.emitters) > 0, self._sky, self._software
        p.define(PUNCTUAL=self._count > 0, EMITTERS=emitters, LLVMPIPE=software)
        share = 1.0 / max((self._count > 0) + emitters + sky, 1)
        p.glsl(
            f"const float MIN_LIGHT_DISTANCE = {MIN_LIGHT_DISTANCE}, MIN_ALPHA = {MIN_ALPHA}, LIGHT_GAP = {LIGHT_GAP};",
            f"const int LIGHT_ROW = {LIGHT_ROW}, LIGHT_COUNT = {self._count};",
            f"const float PUNCTUAL_SHARE = {share * (self._count > 0)}, EMITTER_SHARE = {share * emitters};",
            LIGHT,
        )
        self._attributes.declare(self._structure.declare(p))
        form, floats, words = (IMAGE, "rgba32f", "rgba32ui") if software else (TEXTURE, "sampler2D", "usampler2D")
        if self._count:
            p.use(*(Use(form, name, floats, filled=True) for name in ("light_table", "prev_light_table")))
        if emitters:
            p.use(Use(form, "prev_hit_draws", words, filled=True))
        p.define(ENVIRONMENT_LIGHT=sky)
        if sky and self._environment.kind == "image":
            declare_environment(p, self._environment, lobes=False, owned=False)
            p.use(Use(form, "environment_choice", "rg32f" if software else "sampler2D", filled=True))
            p.glsl(f"const int ENVIRONMENT_CELLS = {min(len(seen_of(self._environment)), CELLS)};")
        p.buffer("light_choice", "vec2").buffer("light_frame", FRAME)
        p.buffer("light_surfaces", SURFACE).buffer("prev_light_surfaces", SURFACE)
        return p

    def _surface_pass(self, tuning: Tuning) -> ComputePass:
        p = ComputePass("reuse light surface", ("reuse/light_surface.comp.glsl",))
        p.define(HAS_INDIRECT=self._source.effects["indirect"].enabled)
        p.glsl(f"const float MIN_ALPHA = {MIN_ALPHA};")
        for name in (*_SURFACE_CHANNELS, "emitted", *(["indirect"] if p.defines["HAS_INDIRECT"] else ())):
            p.texture(name)
        p.buffer("light_surfaces", SURFACE, access=WRITE).image("light_rest_out", access=WRITE)
        return p.dispatch(self._source.size, tuning.shading_group)

    def begin(self, seed: int) -> None:
        """The next frame is the first of a sequence; ``seed``: of its random numbers for methods."""
        self._seed, self._rows, self._draws = seed, None, None

    def run(self, number: int, view: View, before: View, emitted: moderngl.Texture) -> None:
        """Take over frame ``number`` of the source.  ``before``: view of the previous frame; ``emitted``: the input."""
        source, frame = self._source, self._source.renderer.frame
        rows, draws = frame.light_rows.copy(), self._attributes.resources["hit_draws"].read()
        before_rows = rows if self._rows is None else self._rows
        on, was_on = (table["color"][: self._count, :3].any(axis=-1) for table in (rows, before_rows))
        self.born, self.gone = np.flatnonzero(on & ~was_on), np.flatnonzero(~on & was_on)
        self._before.write(before_rows)
        self._choice.write(light_choice(rows["color"][: self._count, :3].max(axis=-1)).tobytes() or bytes(8))
        self._prev_draws.write(draws if self._draws is None else self._draws)
        self._rows, self._draws = rows, draws
        record = FRAME.zeros()
        record["parallel_view"], record["prev_parallel_view"] = (
            view.towards_parallel_camera,
            before.towards_parallel_camera,
        )
        record["camera_delta"][:3] = view.position - before.position
        record["sky"][:3] = self._environment.radiance
        record["size"][:2], record["numbers"][:2] = source.size, (number & 0xFFFFFFFF, self._seed)
        self._record = record
        self.reseed(self._seed)
        now, then = self._surfaces = self._surfaces[::-1]
        channels = {**source.current, "emitted": emitted, "light_rest_out": self.rest, "light_surfaces": now}
        values = {"exposure": self._exposure} if "exposure" in self._store.program else {}
        self._store.run(None, channels, size=source.size, **values)
        self._hazards.publish()
        self.resources = {
            **frame.tables, **self._attributes.resources, **self._structure.resources,
            "prev_light_table": self._before.texture,
            "light_choice": self._choice, "light_frame": self._frame,
            "light_surfaces": now, "prev_light_surfaces": then, "prev_hit_draws": self._prev_draws,
        }  # fmt: skip

    def reseed(self, seed: int) -> None:
        """Give methods the random numbers of ``seed``, in the current frame and later."""
        self._seed = self._record["numbers"][1] = seed
        self._frame.write(self._record.tobytes())

    def bind(self) -> None:
        """Bind everything that ``declaration`` names."""
        bind_uses(self._hazards, self.declaration.bindings(), self.resources)

    def bound(self, form: str) -> int:
        """Units or binding points that ``declaration`` takes, of textures, images or buffers."""
        return sum(use.form == form for use in self.declaration.uses)

    @property
    def channels(self) -> dict[str, moderngl.Texture]:
        """The channels of the current frame of the source, by name."""
        return dict(self._source.current)

    @property
    def lights(self) -> np.ndarray:
        """Rows of the light table of the current frame (``frame.lights.LIGHT``)."""
        return self._rows[: self._count]

    def surfaces(self) -> np.ndarray:
        """Records of SURFACE of the current frame, (h, w), row 0 at the top."""
        width, height = self._source.size
        # GL's row 0 is at the bottom
        return np.frombuffer(self._surfaces[0].read(), SURFACE.dtype).reshape(height, width)[::-1]

    @property
    def bytes(self) -> int:
        """Bytes of GPU memory of surfaces, frame record and light of the rest."""
        size = sum(buffer.size for buffer in self._surfaces) + self._frame.size
        return size + 16 * self.rest.width * self.rest.height
