"""Owners: what is opened on a GPU context together and freed together.  Sources and evaluators are made here only."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from functools import cached_property
from typing import Any, TypeVar

from taubench_gl.evaluation.pairs import PairEvaluator
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import Gpu, open_gpu
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.settings import Settings

Part = TypeVar("Part")


class GpuOwner:
    """Frees what it opened or was given, the last first, with ``release`` or at the end of its with block."""

    def __init__(self, gpu: Gpu, timer: PassTimer | None = None, shaders: ShaderCache | None = None):
        """``timer``: of the passes of ``context``, None measures nothing; ``shaders``: another owner's, or None."""
        self.gpu, self._owned = gpu, contextlib.ExitStack()
        self._pass_timer, self._shaders = timer, shaders

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *exc: Any) -> None:
        self.release()

    def own(self, part: Part) -> Part:
        """``part``, which has ``release``."""
        self._owned.callback(part.release)
        return part

    @cached_property
    def context(self) -> GpuContext:
        """Compiles passes and evaluators."""
        return self.own(GpuContext(self.gpu, self._shaders, self._pass_timer))

    @cached_property
    def untimed(self) -> GpuContext:
        """Has the shaders of ``context`` and measures nothing."""
        return GpuContext(self.gpu, self.context.shaders)

    def open_source(self, animated: AnimatedScene, settings: Settings, **how: Any) -> RasterSource:
        """A source with the programs that this owner has compiled.  ``how``: as of ``RasterSource``."""
        return self.own(RasterSource(self.gpu, animated, settings, shaders=self.context.shaders, **how))

    def open_evaluator(self, source: Any, settings: Settings, *, timed: bool = True, **how: Any) -> PairEvaluator:
        """``how``: as of ``PairEvaluator``."""
        context = self.context if timed else self.untimed
        return self.own(PairEvaluator(context, source, settings, **how))

    def release(self) -> None:
        """Free everything, and what else has lost its references.  The owner can be used again."""
        with self.gpu:
            self._owned.close()
            self.gpu.collect()
        for name in ("context", "untimed"):
            self.__dict__.pop(name, None)


@contextlib.contextmanager
def opened_gpu(settings: Settings) -> Iterator[GpuOwner]:
    """An owner on the GPU context of ``settings``, which is current meanwhile.  Raises GraphicsError."""
    with open_gpu(settings.device.backend, settings.device.device) as gpu, GpuOwner(gpu) as owner:
        yield owner
