"""Owners of sources and evaluators, which are made here only."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from functools import cached_property
from typing import Any

from taubench_gl.evaluation.pairs import PairEvaluator
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import Gpu, open_gpu
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.settings import Settings

log = logging.getLogger(__name__)


class GpuOwner(Owner):
    """An owner of what is opened on a GPU context, whose sources and evaluators share compiled programs."""

    def __init__(self, gpu: Gpu, timer: PassTimer | None = None, shaders: ShaderCache | None = None):
        """``timer``: of the passes of ``context``, None measures nothing; ``shaders``: another owner's, or None."""
        super().__init__()
        self.gpu, self._pass_timer, self._shaders = gpu, timer, shaders

    @cached_property
    def context(self) -> GpuContext:
        """Compiles passes and evaluators."""
        return self.own(GpuContext(self.gpu, self._shaders, self._pass_timer))

    @cached_property
    def untimed(self) -> GpuContext:
        """Has the shaders of ``context`` and measures nothing."""
        return GpuContext(self.gpu, self.context.shaders)

    def open_source(
        self, animated: AnimatedScene, settings: Settings, *, instead_of: RasterSource | None = None, **how: Any
    ) -> RasterSource:
        """A source with the programs that this owner has compiled.  ``how``: as of ``RasterSource``.

        ``instead_of``: the source that it replaces, which is freed once the new one is open.
        """
        log.info("preparing frames of %dx%d pixels", settings.sequence.width, settings.sequence.height)
        source = RasterSource(self.gpu, animated, settings, shaders=self.context.shaders, **how)
        return self.own(source, instead_of=instead_of)

    def open_evaluator(
        self,
        source: Any,
        settings: Settings,
        *,
        timed: bool = True,
        instead_of: PairEvaluator | None = None,
        **how: Any,
    ) -> PairEvaluator:
        """``how``: as of ``PairEvaluator``; ``instead_of``: the evaluator that it replaces."""
        context = self.context if timed else self.untimed
        return self.own(PairEvaluator(context, source, settings, **how), instead_of=instead_of)

    def release(self) -> None:
        """Free everything, and what else has lost its references.  The owner can be used again."""
        with self.gpu:
            super().release()
            for name in ("context", "untimed"):
                self.__dict__.pop(name, None)
            self.gpu.collect()


@contextlib.contextmanager
def opened_gpu(settings: Settings, beside: GpuOwner | None = None) -> Iterator[GpuOwner]:
    """An owner on the GPU context of ``settings``, which is current meanwhile.  Raises GraphicsError.

    ``beside``: an owner on that context whose programs it shares.
    """
    shaders = None if beside is None else beside.context.shaders
    with open_gpu(settings.device.backend, settings.device.device) as gpu, GpuOwner(gpu, shaders=shaders) as owner:
        yield owner
