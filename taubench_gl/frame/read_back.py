"""Images of frames on the way to the CPU: read at once, or copied to a buffer first and read when the copy is done."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from taubench_gl.frame.targets import from_gl, raw_image, read_channel
from taubench_gl.gpu.context import Gpu

if TYPE_CHECKING:
    import moderngl


class PendingImage:
    """A channel whose copy was submitted; ``get`` waits for it.  One that nobody gets holds its buffer."""

    def __init__(self, image: np.ndarray, name: str, buffer: moderngl.Buffer, free: list[moderngl.Buffer]):
        """``image``: where it goes, not filled; ``free``: where the buffer goes then."""
        self._image, self._name, self._buffer, self._free = image, name, buffer, free

    def get(self) -> np.ndarray:
        """As ``read_channel``, of what the texture held when the copy was submitted.  Once."""
        self._buffer.read_into(self._image)
        self._free.append(self._buffer)
        return from_gl(self._image, self._name)


class ReadImage:
    """A channel that was read at once."""

    def __init__(self, values: np.ndarray):
        self._values = values

    def get(self) -> np.ndarray:
        return self._values


Image = PendingImage | ReadImage


class ChannelReader:
    """Reads channels; buffers are kept and used again.

    On a GPU a texture is copied to a pixel buffer by the GPU itself, in the order of its work, so that whoever gets
    it one frame later waits for nothing.  On llvmpipe, whose textures are in the CPU's memory already, that copy is
    slower than reading at once (tools/bench readback), and nothing would run beside it.
    """

    def __init__(self, gpu: Gpu, *, buffered: bool | None = None):
        """``buffered``: whether to go through pixel buffers; None: as it is best on this device."""
        self._gpu = gpu
        self.buffered = not gpu.software if buffered is None else buffered
        self._free: dict[int, list[moderngl.Buffer]] = defaultdict(list)
        self._made: list[moderngl.Buffer] = []

    def start(self, texture: moderngl.Texture, name: str) -> Image:
        """Begin to read a channel as it is now; the texture may be drawn over afterwards."""
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
