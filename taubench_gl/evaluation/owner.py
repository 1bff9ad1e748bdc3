"""Owners of sources and evaluators: nobody else makes them, so that all that lies on a GPU has one who frees it."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Unpack

import numpy as np

from taubench_gl.evaluation.pairs import PairEvaluator
from taubench_gl.frame.passes.masks import ComparedSource, Comparison
from taubench_gl.frame.plan import FrameOptions
from taubench_gl.frame.sources import RasterSource, Source
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import Gpu, open_gpu
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.memory_budget import return_freed
from taubench_gl.settings import Settings

log = logging.getLogger(__name__)


class GpuOwner(Owner):
    """An owner of what is opened on a GPU context, whose sources and evaluators share compiled programs."""

    def __init__(self, gpu: Gpu, timer: PassTimer | None = None, shaders: ShaderCache | None = None):
        """``timer``: measures the passes of ``context``, None: nothing does; ``shaders``: compiled programs of another
        owner, None: it compiles its own."""
        super().__init__()
        self.gpu, self._pass_timer, self._shaders = gpu, timer, shaders

    @cached_property
    def context(self) -> GpuContext:
        """The context that compiles passes and evaluators."""
        return self.own(GpuContext(self.gpu, self._shaders, self._pass_timer))

    @cached_property
    def untimed(self) -> GpuContext:
        """A context with the shaders of ``context`` that measures nothing."""
        return GpuContext(self.gpu, self.context.shaders)

    def open_source(
        self,
        animated: AnimatedScene,
        settings: Settings,
        *,
        jitter: Callable[[int], np.ndarray] | None = None,
        timer: PassTimer | None = None,
        instead_of: RasterSource | None = None,
        **options: Unpack[FrameOptions],
    ) -> RasterSource:
        """A source with the programs that this owner has compiled, which the owner frees.

        ``jitter``, ``timer``, ``options``: as of ``RasterSource``; ``instead_of``: the source that it replaces, which
        is freed once the new one is open.  Raises TaubenchError.
        """
        log.info("preparing frames of %dx%d pixels", settings.sequence.width, settings.sequence.height)
        shaders = self.context.shaders
        source = RasterSource(self.gpu, animated, settings, jitter=jitter, timer=timer, shaders=shaders, **options)
        return_freed()  # opening takes much for a while: trees, images, compiled programs
        return self.own(source, instead_of=instead_of)

    def open_evaluator(
        self,
        source: Source | ComparedSource,
        settings: Settings,
        *,
        timed: bool = True,
        instead_of: PairEvaluator | None = None,
        **options: Unpack[Comparison],
    ) -> PairEvaluator:
        """An evaluator of the pairs of ``source``, which the owner frees.

        ``timed``: its pass is measured; ``instead_of``: the evaluator that it replaces; ``options``: as of
        ``PairEvaluator``.
        """
        context = self.context if timed else self.untimed
        return self.own(PairEvaluator(context, source, settings, **options), instead_of=instead_of)

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
    gpu = open_gpu(settings.device.backend, settings.device.device)
    with gpu, gpu.shared.kept(), GpuOwner(gpu, shaders=shaders) as owner:
        yield owner
