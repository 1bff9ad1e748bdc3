"""Textures of compute passes: as samplers by name, and as images at bindings that the shaders name.

Mesa's llvmpipe reads an image in half the time of a sampler's texelFetch, and gives the same bits.  Every image of
a program needs a unit of its own: where two share one GL says nothing, and both read what was bound last.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import moderngl

from taubench_gl.channels import stored_dtype
from taubench_gl.gpu.context import Gpu
from taubench_gl.settings import Settings

IMAGE_UNITS = {"out": 0, "virtual_lights": 2, "probes": 3, "bricks": 4, "flux": 5, "rows": 6}
"""Bindings in the shaders of indirect light (moderngl cannot set an image's by name); ``out``: what a pass is for."""

_FORMATS = {"f4": "rgba32f", "f2": "rgba16f"}


def float_texture(gpu: Gpu, size: tuple[int, int]) -> moderngl.Texture:
    """Four floats a texel."""
    return gpu.ctx.texture(size, 4, dtype="f4")


def texture_bytes(texture: moderngl.Texture) -> int:
    """Of a texture of four floats a texel."""
    return 16 * texture.width * texture.height


def bind(program: moderngl.ComputeShader, textures: Mapping[str, moderngl.Texture]) -> None:
    """Give each texture a unit, and the samplers that ``program`` has by their names."""
    for unit, (name, texture) in enumerate(textures.items()):
        texture.use(unit)
        if name in program:
            program[name] = unit


def bind_images(**textures: moderngl.Texture) -> None:
    """Bind images by the names of IMAGE_UNITS."""
    for name, texture in textures.items():
        texture.bind_to_image(IMAGE_UNITS[name], read=True, write=True)


def channel_images(names: Iterable[str], first: int, settings: Settings) -> str:
    """GLSL that declares channels of four components as images to read, from binding ``first`` on."""
    storage = settings.device.storage
    return "\n".join(
        f"layout({_FORMATS[stored_dtype(name, storage)]}, binding = {unit}) readonly uniform image2D {name};"
        for unit, name in enumerate(names, first)
    )


def order_drawing(gpu: Gpu) -> None:
    """Let image loads see what was drawn: samplers do by themselves, images only behind a barrier."""
    gpu.ctx.memory_barrier(moderngl.SHADER_IMAGE_ACCESS_BARRIER_BIT)


def bind_channels(gpu: Gpu, names: Iterable[str], first: int, textures: Mapping[str, moderngl.Texture]) -> None:
    """What ``channel_images`` declares."""
    order_drawing(gpu)
    for unit, name in enumerate(names, first):
        textures[name].bind_to_image(unit, read=True, write=False)
