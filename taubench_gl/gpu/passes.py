"""What every GPU pass is made from: the context, its compiled shaders and its clock."""

from __future__ import annotations

from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.gpu.timing import PassTimer


class GpuContext:
    """An OpenGL context, the programs compiled for it and the timer of its passes.

    Owns ``shaders`` unless it was given: ``release`` frees it.
    """

    def __init__(self, gpu: Gpu, shaders: ShaderCache | None = None, timer: PassTimer | None = None):
        """``timer``: None measures nothing and never waits."""
        self.gpu = gpu
        self.shaders = shaders or ShaderCache(gpu.ctx)
        self.timer = timer or PassTimer(gpu, enabled=False)
        self._owned = shaders is None

    def release(self) -> None:
        """Free the programs that this context compiled."""
        if self._owned:
            self.shaders.release()
