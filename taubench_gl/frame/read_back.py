"""Read-back of channels: at once, or through a pixel buffer that is read when its copy is done."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from taubench_gl.frame.targets import from_gl, raw_image, read_channel
from taubench_gl.gpu.context import Gpu

if TYPE_CHECKING:
    import moderngl


class PendingImage:
    """A channel whose copy was submitted; ``get`` waits for it.  Without ``get`` its buffer stays in use."""

    def __init__(self, image: np.ndarray, name: str, buffer: moderngl.Buffer, free: list[moderngl.Buffer]):
        """``image``: destination, not filled; ``free``: receives the buffer after ``get``."""
        self._image, self._name, self._buffer, self._free = image, name, buffer, free

    def get(self) -> np.ndarray:
        """The image as ``read_channel`` gives it, as it was when the copy was submitted.  Waits; call once."""
        self._buffer.read_into(self._image)
        self._free.append(self._buffer)
        return from_gl(self._image, self._name)


class ReadImage:
    """A channel that was read immediately."""

    def __init__(self, values: np.ndarray):
        self._values = values

    def get(self) -> np.ndarray:
        return self._values


Image = PendingImage | ReadImage


class ChannelReader:
    """Reads channels; buffers are reused.

    A GPU copies a texture to a pixel buffer in the order of its work, so a read one frame later does not wait.  On
    llvmpipe textures are in the CPU's memory already: the copy is slower than reading at once (tools/bench readback),
    and nothing would run in parallel with it.
    """

    def __init__(self, gpu: Gpu, *, buffered: bool | None = None):
        """``buffered``: use pixel buffers; None: where that is faster."""
        self._gpu = gpu
        self.buffered = not gpu.software if buffered is None else buffered
        self._free: dict[int, list[moderngl.Buffer]] = defaultdict(list)
        self._made: list[moderngl.Buffer] = []

    def start(self, texture: moderngl.Texture, name: str) -> Image:
        """Start reading a channel; later rendering to the texture does not change the result."""
        if not self.buffered:
            return ReadImage(read_channel(texture, name))
        image = raw_image(texture)
        free = self._free[image.nbytes]
        buffer = free.pop() if free else self._buffer(image.nbytes)
        texture.read_into(buffer)
        return PendingImage(image, name, buffer, free)

    def _buffer(self, size: int) -> moderngl.Buffer:
        self._made.append(self._gpu.ctx.buffer(reserve=size))
        return self._made[-1]

    def release(self) -> None:
        for buffer in self._made:
            buffer.release()
        self._made.clear()
        self._free.clear()
