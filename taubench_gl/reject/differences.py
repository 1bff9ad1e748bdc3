"""Runs rejection tests on the GPU: the difference of every pixel, by one pass per test."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from taubench_gl.conventions import NOT_COMPARABLE
from taubench_gl.errors import GraphicsError, MethodError
from taubench_gl.frame.passes.pathtracing import pixel_footprint
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.targets import from_gl, raw_image
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.declare import WRITE, ComputePass
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.passes import CompiledCompute, GpuContext
from taubench_gl.gpu.shader import resolve
from taubench_gl.reject.contract import RejectionTest, constants

Array = np.ndarray

PARAMETERS = Struct(
    "RejectionRecord",
    Field("prev_forward", "vec4", "xyz: unit view direction of the previous camera"),
    Field("footprint", "vec4", "width of a previous pixel: x, meters of a parallel camera; y, for each meter of depth"),
    Field("size", "ivec4", "xy: pixels"),
    Field("exposure", "float", "factor on radiance"),
)
HISTORY = ("position", "normal", "geometric_normal", "ids")
CURRENT = (*HISTORY, "prev_position")
CHANNELS = ("prev_position", "geometric_normal", "ids")
"""Channels that a source must draw besides those of the columns."""

_SAMPLERS = {"ids": "usampler2D", "mask": "usampler2D"}
_PREAMBLE_LINE = re.compile(r"preamble:(\d+)")


def declaration(test: RejectionTest, size: tuple[int, int], tuning: Tuning, radiance: Sequence[str]) -> ComputePass:
    """The pass of one test.  ``radiance``: those of direct and indirect that there are."""
    color = test.kind == "color"
    p = ComputePass("rejection test", ("reject/difference.comp.glsl",)).define(COLOR=color)
    p.define(**{f"HAS_{name.upper()}": color and name in radiance for name in ("direct", "indirect")})
    p.glsl(f"const uint NOT_COMPARED = {int(NOT_COMPARABLE)}u;")
    contract = "\n".join(resolve("reject/contract.glsl").text.splitlines()[1:])
    p.constants("R", PARAMETERS, lambda record: record)
    p.glsl(contract, constants(test), test.shader)
    for name in (*CURRENT, "mask", "motion"):
        p.texture(name, _SAMPLERS.get(name, "sampler2D"), filled=True)
    for name in (*HISTORY, "motion"):
        p.texture(f"history_{name}", _SAMPLERS.get(name, "sampler2D"), filled=True)
    for name in radiance if color else ():
        p.texture(name, filled=True).texture(f"history_{name}", filled=True)
    p.image("difference_out", "r32f", access=WRITE, resource="difference")
    return p.dispatch(size, tuning.shading_group)


class Differences(Owner):
    """Compiled tests of one source.  Raises MethodError for a test that does not compile."""

    def __init__(self, context: GpuContext, source: RasterSource, tests: Sequence[RejectionTest]):
        super().__init__()
        self._context, self._source = context, source
        ctx = context.gpu.ctx
        self._radiance = tuple(name for name in ("direct", "indirect") if name in source.radiance)
        self._target = self.own(ctx.texture(source.size, 1, dtype="f4"))
        self._motion = [self.own(ctx.texture(source.size, 2, dtype="f4")) for _ in range(2)]
        self._passes: dict[str, CompiledCompute] = {}
        tuning = Tuning(context.gpu.software)
        with self.opening():
            for test in tests:
                self._passes[test.name] = self._compile(test, declaration(test, source.size, tuning, self._radiance))

    def _compile(self, test: RejectionTest, p: ComputePass) -> CompiledCompute:
        try:
            return self.own(self._context.compute(p))
        except GraphicsError as error:
            first = p.interface().split(test.shader)[0].count("\n") if test.shader in p.interface() else 0
            message = _PREAMBLE_LINE.sub(lambda m: f"line {int(m.group(1)) - first}", error.what)
            raise MethodError(message, where=test.where or test.name) from None

    def keep_motion(self, motion: Any) -> None:
        """Take over the motion texture of a pair: that of the next pair's history."""
        self._motion.reverse()
        words = raw_image(motion)
        motion.read_into(words)
        self._motion[0].write(words)

    def run(self, name: str, textures: Mapping[str, Any], prev_forward: Array, exposure: float) -> Array:
        """Differences by the test ``name`` for the source's current pair, (h, w) float32, row 0 at the top.

        ``textures``: mask and motion of the pair.
        """
        source = self._source
        before = source.renderer.frame.before[1]
        record = {
            "prev_forward": (*prev_forward, 0.0),
            "footprint": (*pixel_footprint(before, source.size), 0.0, 0.0),
            "size": (*source.size, 0, 0),
            "exposure": exposure,
        }
        resources = {**source.current, **textures, "difference": self._target, "history_motion": self._motion[0]}
        resources |= {f"history_{name}": source.previous[name] for name in (*HISTORY, *self._radiance)}
        with self._context.timer.measure(name):
            self._passes[name].run(record, resources)
            self._context.gpu.hazards.publish()
        self._context.gpu.finish()
        out = raw_image(self._target)
        self._target.read_into(out)
        return from_gl(out, "difference")[..., 0].copy()
