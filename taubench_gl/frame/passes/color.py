"""Colour: what light gives a pixel, exposed, tone-mapped and encoded."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl

from taubench_gl.frame.passes.images import bind_channels, channel_images
from taubench_gl.frame.passes.lighting import storage_defines
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.settings import TONE_MAPS, Settings

COLOR = Struct(
    "ColorRecord",
    Field("sky", "vec4", "xyz: uniform sky radiance, linear"),
    Field("size", "ivec4", "xy: pixels"),
    Field("exposure", "float", "factor on radiance before tone mapping"),
)


class ColorPass:
    """Writes ``color``: direct + indirect + emission (those named in ``inputs``), exposed, tone-mapped, encoded."""

    def __init__(
        self, gpu: Gpu, shaders: ShaderCache, size: tuple[int, int], settings: Settings, inputs: tuple[str, ...]
    ):
        self._gpu, self._size = gpu, size
        self._group = (64, 1) if gpu.software else (8, 8)
        self._inputs, self._settings = ("position", *inputs), settings
        self._parameters = gpu.ctx.buffer(reserve=COLOR.dtype.itemsize, dynamic=True)
        self._program = shaders.compute(
            "color/color.comp.glsl",
            {
                "HAS_DIRECT": "direct" in inputs,
                "HAS_INDIRECT": "indirect" in inputs,
                "HAS_EMISSION": "emission" in inputs,
                "TONE_MAP": TONE_MAPS.index(settings.lighting.tone_map),
                "GROUP_X": self._group[0],
                "GROUP_Y": self._group[1],
                **storage_defines(settings),
            },
            COLOR.glsl + "\n" + channel_images(self._inputs, 1, settings),
        )

    def run(self, textures: Mapping[str, moderngl.Texture]) -> None:
        record = COLOR.zeros()
        record["sky"][:3], record["size"][:2] = self._settings.lighting.sky, self._size
        record["exposure"] = self._settings.lighting.exposure
        self._parameters.write(record.tobytes())
        self._parameters.bind_to_uniform_block(0)
        bind_channels(self._gpu, self._inputs, 1, textures)
        textures["color"].bind_to_image(0, read=False, write=True)
        self._program.run(-(-self._size[0] // self._group[0]), -(-self._size[1] // self._group[1]))
        self._gpu.ctx.memory_barrier()

    def release(self) -> None:
        self._parameters.release()
