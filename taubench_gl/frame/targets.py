"""Render targets: one texture per channel, double-buffered where the next frame reads them as history."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from taubench_gl.channels import CHANNELS, stored_dtype
from taubench_gl.errors import GraphicsError
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.memory import require_memory
from taubench_gl.gpu.owner import Owner

if TYPE_CHECKING:
    import moderngl

_NUMPY = {"f4": np.float32, "f2": np.float16, "u4": np.uint32, "f1": np.uint8}
_BYTES = {"f4": 4, "f2": 2, "u4": 4, "f1": 1}


class Targets(Owner):
    """Attachments of one frame: ``textures[name]`` and a framebuffer with a float depth buffer."""

    def __init__(
        self, gpu: Gpu, size: tuple[int, int], channels: Sequence[str], depth: moderngl.Texture, storage: str = "float"
    ):
        super().__init__()
        limit = min(gpu.ctx.info["GL_MAX_TEXTURE_SIZE"], gpu.ctx.info["GL_MAX_FRAMEBUFFER_WIDTH"])
        if max(size) > limit:
            raise GraphicsError(f"{size[0]}x{size[1]} is more than this device's {limit} pixels", hint="lower --size")
        self._gpu, self.size, self.channels = gpu, size, tuple(channels)
        self.textures: dict[str, moderngl.Texture] = {}
        for name in self.channels:
            info = CHANNELS[name]
            texture = self.own(gpu.ctx.texture(size, info.components, dtype=stored_dtype(name, storage)))
            texture.filter = (gpu.ctx.NEAREST, gpu.ctx.NEAREST)
            self.textures[name] = texture
        drawn = [texture for name, texture in self.textures.items() if CHANNELS[name].attachment]
        self.framebuffer = self.own(gpu.ctx.framebuffer(drawn, depth))

    def clear(self) -> None:
        """All channels 0 (no surface), depth 0 (infinitely far, reversed Z)."""
        self.framebuffer.clear(0.0, 0.0, 0.0, 0.0, depth=0.0)  # float and integer zeros have the same bits

    def release(self) -> None:
        self._gpu.unbind_framebuffer()
        super().release()


def history_bytes(size: tuple[int, int], channels: Sequence[str], storage: str = "float") -> dict[str, int]:
    """GPU memory of a History by name: two frames of every channel, and the depth buffer that both use."""
    pixels = size[0] * size[1]
    texel = {name: CHANNELS[name].components * _BYTES[stored_dtype(name, storage)] for name in channels}
    return {name: 2 * pixels * each for name, each in texel.items()} | {"depth": 4 * pixels}


class History(Owner):
    """This frame's targets and the last frame's, swapped by ``advance``."""

    def __init__(self, gpu: Gpu, size: tuple[int, int], channels: Sequence[str], storage: str = "float"):
        super().__init__()
        self.bytes = sum(history_bytes(size, channels, storage).values())
        require_memory(gpu, self.bytes, f"an image of {size[0]}x{size[1]} pixels", "lower --size")
        self.depth = self.own(gpu.depth_texture(size))
        self._frames = [self.own(Targets(gpu, size, channels, self.depth, storage)) for _ in range(2)]

    @property
    def current(self) -> Targets:
        return self._frames[0]

    @property
    def previous(self) -> Targets:
        return self._frames[1]

    def advance(self) -> None:
        """The current frame becomes the previous one; call before drawing."""
        self._frames.reverse()


def read_channel(texture: moderngl.Texture, name: str) -> np.ndarray:
    """A channel as (h, w, components), row 0 at the top."""
    out = raw_image(texture)
    texture.read_into(out)
    return from_gl(out, name)


def read_texel(gpu: Gpu, texture: moderngl.Texture, x: int, y: int) -> np.ndarray:
    """One texel, y up.  (components,) in the type of the texture."""
    return read_texels(gpu, texture, x, y, 1, 1)[0, 0]


def read_texels(gpu: Gpu, texture: moderngl.Texture, x: int, y: int, width: int, height: int) -> np.ndarray:
    """Texels from (x, y) on, y up.  (height, width, components) in the type of the texture, row 0 at the bottom."""
    with Owner() as owner:
        framebuffer = owner.own(gpu.ctx.framebuffer([texture]))
        area = (x, y, width, height)
        data = framebuffer.read(area, components=texture.components, dtype=texture.dtype, alignment=1)
        gpu.unbind_framebuffer()
    return np.frombuffer(data, dtype=_NUMPY[texture.dtype]).reshape(height, width, texture.components)


def raw_image(texture: moderngl.Texture) -> np.ndarray:
    """An array to read a texture into, (h, w, components) of the texture's type; not filled."""
    width, height = texture.size
    return np.empty((height, width, texture.components), dtype=_NUMPY[texture.dtype])


def from_gl(raw: np.ndarray, name: str) -> np.ndarray:
    """A channel as read from GL, row 0 at the top: the one flip of the package; motion becomes +y down."""
    out = raw[::-1]
    if name == "motion":
        out = out * np.float32([1, -1])
        out[out == 0] = 0.0  # no negative zeros
    return out


def write_channel(texture: moderngl.Texture, name: str, values: np.ndarray) -> None:
    """The inverse of ``read_channel``: (h, w) or (h, w, <= components), row 0 at the top; missing components are 0."""
    values = np.asarray(values)
    values = values[..., None] if values.ndim == 2 else values
    full = np.zeros_like(raw_image(texture))
    full[..., : values.shape[-1]] = values[::-1]  # row 0 is the top in arrays and the bottom in GL memory
    if name == "motion":
        full[..., 1] *= -1
    texture.write(full)
