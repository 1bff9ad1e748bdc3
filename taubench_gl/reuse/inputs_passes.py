"""The two small passes that turn channels into inputs of a method: radiance put together, motion made whole."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl

from taubench_gl.conventions import Reason
from taubench_gl.evaluation import PairEvaluator
from taubench_gl.frame.sources import Source
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.metrics.reprojection import Reprojection
from taubench_gl.metrics.shading_rate import RATES, phase
from taubench_gl.reuse.synthetic import FAR_AWAY_PX
from taubench_gl.settings import Settings

LIGHT_CHANNELS = ("direct", "indirect", "emission")


def picture_texture(gpu: Gpu, size: tuple[int, int]) -> moderngl.Texture:
    """An rgba32f picture that is read texel by texel."""
    texture = gpu.ctx.texture(size, 4, dtype="f4")
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture


class ComposePass:
    """direct + indirect + emission, or the sky, times exposure -> ``radiance``; what was not shaded is filled."""

    def __init__(
        self,
        gpu: Gpu,
        shaders: ShaderCache,
        size: tuple[int, int],
        settings: Settings,
        channels: tuple[str, ...],
        *,
        rate: str = "full",
        accumulate: bool = False,
    ):
        """``channels``: those of LIGHT_CHANNELS that frames have; ``accumulate``: sum up shares of several samples."""
        self._gpu, self._size, self._settings, self._rate = gpu, size, settings, rate
        self._group = (32, 1) if gpu.software else (8, 8)
        self._reads = ("position", *(c for c in LIGHT_CHANNELS if c in channels))
        defines = {f"HAS_{c.upper()}": c in channels for c in LIGHT_CHANNELS}
        defines |= {"SHADING_RATE": RATES.index(rate), "ACCUMULATE": accumulate}
        defines |= {"GROUP_X": self._group[0], "GROUP_Y": self._group[1]}
        self._program = shaders.compute("reuse/compose.comp.glsl", defines)
        self._accumulate = accumulate
        self.radiance = picture_texture(gpu, size)

    @property
    def bytes(self) -> int:
        return 16 * self._size[0] * self._size[1]

    def run(self, textures: Mapping[str, moderngl.Texture], frame: int = 0, share: float = 1.0) -> None:
        """Write ``radiance``.  ``share``: of this sample where samples add up, negative for the first of a frame."""
        for unit, name in enumerate(self._reads):
            textures[name].use(unit)
            self._program[name] = unit
        self._program["size"] = self._size
        self._program["sky"], self._program["exposure"] = (
            tuple(self._settings.lighting.sky),
            self._settings.lighting.exposure,
        )
        if self._rate != "full":
            self._program["phase"] = phase(self._rate, frame)
        if self._accumulate:
            self._program["share"] = share
        self.radiance.bind_to_image(0, read=self._accumulate, write=True)
        self._program.run(-(-self._size[0] // self._group[0]), -(-self._size[1] // self._group[1]))
        self._gpu.ctx.memory_barrier()

    def release(self) -> None:
        self.radiance.release()


class MaskInputs:
    """``mask`` and ``motion`` of the frame that a source holds, without jitter in either."""

    def __init__(self, context: GpuContext, source: Source, settings: Settings, radiance: tuple[str, ...]):
        """``radiance``: of direct, indirect, color, those to compare; empty: what is known before shading."""
        gpu, shaders = context.gpu, context.shaders
        self._gpu = gpu
        self._evaluator = PairEvaluator(context, source, settings, images=True, radiance=radiance)
        self._group = (32, 1) if gpu.software else (8, 8)
        constants = "\n".join(
            (
                *(f"const uint {bit.name} = {bit.value}u;" for bit in (Reason.BEHIND, Reason.INVALID)),
                f"const float FAR_AWAY_PX = {FAR_AWAY_PX};",
            )
        )
        defines = {"GROUP_X": self._group[0], "GROUP_Y": self._group[1]}
        self._behind = shaders.compute("reuse/behind.comp.glsl", defines, constants)
        for texture in (self.mask, self.motion):
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)

    @property
    def mask(self) -> moderngl.Texture:
        return self._evaluator.mask_texture

    @property
    def motion(self) -> moderngl.Texture:
        return self._evaluator.motion_texture

    @property
    def bytes(self) -> int:
        return 12 * self.mask.width * self.mask.height

    def run(self, pair: Reprojection, declared: int) -> None:
        """``pair``: without jitter; ``declared``: Reason.FIRST or CUT for the whole frame, else 0."""
        self._evaluator.submit(pair, declared=declared)
        self.mask.use(0)
        self._behind["mask"] = 0
        self._behind["size"] = self.mask.size
        self.motion.bind_to_image(0, read=False, write=True)
        self._behind.run(-(-self.mask.width // self._group[0]), -(-self.mask.height // self._group[1]))
        self._gpu.ctx.memory_barrier()

    def release(self) -> None:
        self._evaluator.release()
