"""Chains of methods, ``restir-di>svgf``: the image of one method is the input of the next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import moderngl

from taubench_gl.errors import MethodError
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.declare import WRITE, ComputePass
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.reuse.contract import SAMPLE_REPORTS, Method, Value
from taubench_gl.reuse.derived import COMPOSED, NEEDS
from taubench_gl.reuse.frame import FrameInputs, input_texture, read_result
from taubench_gl.reuse.glsl_method import GlslPasses
from taubench_gl.reuse.python_method import PythonSteps
from taubench_gl.reuse.reshade import RESHADED

LINK = ">"
"""Text between the names of the methods of a chain."""

SHADED = {*COMPOSED, *NEEDS, *RESHADED} - {"emitted"}
"""Inputs of the light of a frame, besides ``radiance``."""


def chained(first: Method, second: Method) -> Method:
    """The chain of two methods.  Its settings are ``NAME.setting`` of either.  Raises MethodError."""
    name = f"{first.name}{LINK}{second.name}"
    provided = {"radiance", "direct"} if first.own_light else {"radiance"}
    lost = [read for read in second.reads if read in SHADED - provided]
    if lost:
        raise MethodError(f"{second.name} reads {', '.join(lost)}, which {first.name} does not write", where=name)
    if first.generates or second.generates:
        raise MethodError("a method that generates frames has no place in a chain", where=name)
    if second.own_light or first.upscales or second.upscales:
        other = f"{second.name} makes its light itself" if second.own_light else "a method of it upscales"
        raise MethodError(f"{other}: it has no place in a chain", where=name)
    settings = {_key(m, key): replace(s, name=_key(m, key)) for m in (first, second) for key, s in m.settings.items()}
    if len(settings) < len(first.settings) + len(second.settings):
        raise MethodError(f"{second.name} is in it twice", where=name)
    reads = (*first.reads, *(read for read in second.reads if read not in provided), "position")
    reports = (*(r for r in first.reports if r in SAMPLE_REPORTS), *second.reports, "blend_input")
    return Method(
        name, f"{first.title}; then {second.title}", tuple(dict.fromkeys((*first.cite, *second.cite))),
        tuple(dict.fromkeys(reads)), settings, passes=(*first.passes, *second.passes), where=name,
        stages=(*first.stages, *second.stages), reports=tuple(dict.fromkeys(reports)), chain=(first, second),
    )  # fmt: skip


def _key(method: Method, setting: str) -> str:
    """Name of a setting in a chain; that of a chain in it has its method already."""
    return setting if method.chain else f"{method.name}.{setting}"


def open_backend(
    gpu: Gpu, method: Method, size: tuple[int, int], input_size: tuple[int, int], timer: PassTimer, *, count: bool
) -> Any:
    """What runs the frames of a method: ``GlslPasses``, ``PythonSteps`` or ``ChainSteps``."""
    if method.chain:
        return ChainSteps(gpu, method, size, input_size, count=count)
    if method.factory is None:
        return GlslPasses(gpu, method, size, input_size, count=count)
    return PythonSteps(gpu, method, size, input_size, timer)


class ChainSteps(GpuOwner):
    """Two methods, one after the other."""

    def __init__(self, gpu: Gpu, method: Method, size: tuple[int, int], input_size: tuple[int, int], *, count: bool):
        """Open both methods and the pass between them.  ``count``: count the light samples of the first method."""
        super().__init__(gpu)
        self._methods, self._direct = method.chain, method.own_light
        self._frame: FrameInputs | None = None  # the last inputs of the second
        untimed = PassTimer(gpu, enabled=False)  # the chain is timed as a whole
        with self.opening():
            self._first, self._second = (
                self.own(open_backend(gpu, m, size, input_size, untimed, count=count)) for m in self._methods
            )
            p = ComputePass("reuse chain", ("reuse/chain.comp.glsl",)).define(OWN_LIGHT=self._direct)
            names = ("radiance", "direct")[: 1 + self._direct]
            for name in ("result", "position", *(("light_rest",) if self._direct else ())):
                p.texture(name)
            for name in names:
                p.image(f"{name}_out", access=WRITE)
            p.dispatch(size, Tuning(gpu.software).shading_group)
            self._link, self._size = self.own(self.context.compute(p)), size
            self._textures = {name: self.own(input_texture(gpu, name, size)) for name in names}

    def clear(self) -> None:
        """Forget all history: the next frame is the first."""
        self._first.clear()
        self._second.clear()

    def run(self, frame: FrameInputs, values: Mapping[str, Value], has_history: bool) -> moderngl.Texture:
        """The result of the second method, whose input is the result of the first, for one frame."""
        first, second = self._values_by_method(values)
        resources = {"result": self._first.run(frame, first, has_history), "position": frame.textures["position"]}
        resources |= {f"{name}_out": texture for name, texture in self._textures.items()}
        if self._direct:
            resources["light_rest"] = frame.light.rest
        self._link.run(None, resources, size=self._size)
        self.gpu.hazards.publish()
        self._frame = replace(frame, textures={**frame.textures, **self._textures})
        return self._second.run(self._frame, second, has_history)

    def _values_by_method(self, values: Mapping[str, Value]) -> tuple[dict[str, Value], ...]:
        return tuple({name: values[_key(m, name)] for name in m.settings} for m in self._methods)

    def reported(self, frame: FrameInputs, values: Mapping[str, Value]) -> dict[str, Any]:
        """The samples that the first reports, and what the second blended: with the image of the first."""
        first, second = self._values_by_method(values)
        samples = self._first.reported(frame, first).items()
        out = {name: image for name, image in samples if name in SAMPLE_REPORTS}
        return (
            out | {"blend_input": read_result(self._textures["radiance"])} | self._second.reported(self._frame, second)
        )

    def light_counts(self) -> Any:
        """What the first method sampled in the last step, as ``MethodRunner.light_counts``."""
        return self._first.light_counts()
