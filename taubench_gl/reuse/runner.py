"""Runs one reuse method over the frames of a sequence.

    from taubench_gl.reuse.loading import load_method, builtin_methods
    from taubench_gl.reuse.runner import MethodRunner

    method = load_method("taa_clamp")            # built-in name, entry point, folder, file.py or module:Class
    method.reads                                 # names of INPUTS that FrameInputs.textures must contain
    method.settings["alpha"]                     # Parameter: kind, default, minimum, maximum, choices, scale, doc
    runner = MethodRunner(gpu, method, (1920, 1080), {"alpha": 0.1})
    texture = runner.step(frame)                 # rgba32f; rgb: linear radiance x exposure; valid until the next step
    read_result(texture)                         # frame.read_result: (h, w, 4), row 0 at the top

Alpha of the result is the weight of history in each pixel, 0 .. 1, or -1 where the method does not report it.  All
errors of a method raise MethodError, one line with its name.  The runner can then be released or reset; other runners
are not affected.  Frames are given in order; frame 0, a cut and the first step after ``reset`` have no history.

Inputs can be smaller than the result (``input_size``).  A method that does not upscale then runs at the size of the
inputs, and its result is resampled bilinearly: the baseline of an upscaler.
"""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np

from taubench_gl.errors import MethodError
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.declare import UPDATE, WRITE, ComputePass
from taubench_gl.gpu.memory import require_memory
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.reuse.chain import open_backend
from taubench_gl.reuse.contract import LIGHTS, Method, Value
from taubench_gl.reuse.frame import FrameInputs
from taubench_gl.reuse.loading import load_method


class MethodRunner(GpuOwner):
    """One method at one size.

    ``size``: of the result, pixels; ``input_size``: of the inputs, None: the same.  ``timer``: the entry of the method
    has its name; read-back and upload of a Python method are separate entries, ``NAME: read inputs`` and ``NAME:
    upload``.  ``check``: raise MethodError for results with non-finite pixels whose radiance is finite; this is not
    timed and costs one 12-byte read-back.  ``count``: count what a method with ``light = "own"``
    samples, for ``light_counts``.  Raises MethodError for wrong settings and shaders that do not compile.
    """

    def __init__(
        self,
        gpu: Gpu,
        method: Method | str | type,
        size: tuple[int, int],
        settings: Mapping[str, Value] | None = None,
        *,
        input_size: tuple[int, int] | None = None,
        timer: PassTimer | None = None,
        check: bool = True,
        count: bool = False,
    ):
        super().__init__(gpu)
        self.size = (int(size[0]), int(size[1]))
        self.input_size = self.size if input_size is None else (int(input_size[0]), int(input_size[1]))
        self.method = method if isinstance(method, Method) else load_method(method)
        self.values = self.method.values(settings)
        self.timer = timer or PassTimer(gpu, enabled=False)
        method_size, self._steps = self.method_size, 0
        require_memory(gpu, self.bytes, f"{self.method.label} at {self.size[0]}x{self.size[1]}", "lower --size")
        backend = open_backend(gpu, self.method, method_size, self.input_size, self.timer, count=count)
        self._backend = self.own(backend)
        self._check = _FiniteCheck(self, method_size) if check else None
        self._resample = _Resample(self, method_size, self.size) if method_size != self.size else None

    @property
    def method_size(self) -> tuple[int, int]:
        """(width, height) in pixels of what the method itself writes, before its result is resampled."""
        return self.size if self.method.upscales else self.input_size

    @property
    def bytes(self) -> int:
        """GPU memory of history, buffers and result, without the memory of a Python class."""
        return self.method.bytes(self.method_size, self.input_size)

    @property
    def time_ms(self) -> float | None:
        """Milliseconds of the last step, by the clock of the timer; None: it was not measured."""
        samples = self.timer.samples_ms().get(self.method.name)
        return None if samples is None or not len(samples) else float(samples[-1])

    def step(self, frame: FrameInputs) -> moderngl.Texture:
        """The method's result for ``frame``: rgba32f, valid until the next step.  Raises MethodError."""
        self._check_inputs(frame)
        has_history = self._steps > 0 and frame.index > 0 and not frame.cut
        if not has_history:
            self._backend.clear()
        if self.method.factory is not None:
            result = self._backend.run(frame, self.values, has_history)
        else:
            with self.timer.measure(self.method.name):
                result = self._backend.run(frame, self.values, has_history)
        self._steps += 1
        if self._check is not None:
            self._check.run(result, frame, self.method)
        return result if self._resample is None else self._resample.run(result)

    def reported(self, frame: FrameInputs) -> dict[str, np.ndarray]:
        """What the method blended in the step of ``frame``, the last one; not timed.

        -> names of contract.REPORTS that the method declares: (h, w, 4) float32, row 0 at the top.  Nothing where the
        input has another size and the result is resampled, or the method does not report what it made of the input.
        """
        if self.input_size != self.size and (self._resample is not None or "blend_input" not in self.method.reports):
            return {}
        return self._backend.reported(frame, self.values)

    def light_counts(self) -> np.ndarray:
        """Shadow rays, light samples and evaluations of reflected light in each pixel of the last step.

        (h, w, 3) uint32, row 0 at the top; only of a runner with ``count``.
        """
        return self._backend.light_counts()

    def _check_inputs(self, frame: FrameInputs) -> None:
        textures = [name for name in self.method.reads if name != LIGHTS]
        missing = [name for name in textures if name not in frame.textures]
        missing += [LIGHTS] if self.method.own_light and frame.light is None else []
        if missing:
            reasons = list(dict.fromkeys(frame.missing[name] for name in missing if name in frame.missing))
            why = f": {'; '.join(reasons)}" if reasons else ""
            raise MethodError(f"frame {frame.index} has no {', '.join(missing)}{why}", where=self.method.label)
        for name in textures:
            if frame.textures[name].size != self.input_size:
                width, height = frame.textures[name].size
                raise MethodError(
                    f"frame {frame.index}: {name} is {width}x{height}; this method runs at "
                    f"{self.input_size[0]}x{self.input_size[1]}",
                    where=self.method.label,
                    hint="open a runner for inputs of this size",
                )

    def configure(self, settings: Mapping[str, Value] | None = None) -> None:
        """Change settings, others to their defaults, and reset.  Compiles nothing."""
        self.values = self.method.values(settings)
        self.reset()

    def reset(self) -> None:
        """Clear all history: the next step is a first frame."""
        self._steps = 0


class _Resample:
    """A result at another size: bilinear between pixel centers, the weight of history from the nearest pixel."""

    def __init__(self, owner: GpuOwner, method_size: tuple[int, int], size: tuple[int, int]):
        self._hazards, self._sizes = owner.gpu.hazards, {"own_size": method_size, "size": size}
        declaration = ComputePass("reuse resample", ("reuse/resample.comp.glsl",))
        declaration.texture("result").image("resampled_out", resource="resampled", access=WRITE)
        declaration.dispatch(size, Tuning(owner.gpu.software).shading_group)
        self._pass = owner.own(owner.context.compute(declaration))
        self._texture = owner.own(owner.gpu.texture(size))

    def run(self, result: moderngl.Texture) -> moderngl.Texture:
        self._pass.run(None, {"result": result, "resampled": self._texture}, **self._sizes)
        self._hazards.publish()
        return self._texture


class _FiniteCheck:
    """Counts NaN and infinite pixels of a result where the input radiance is finite."""

    def __init__(self, owner: GpuOwner, size: tuple[int, int]):
        self.size, self._hazards = size, owner.gpu.hazards
        declaration = ComputePass("reuse finite", ("reuse/finite.comp.glsl",))
        declaration.texture("result").texture("radiance").buffer("found", "uint", access=UPDATE)
        declaration.dispatch(size, Tuning(owner.gpu.software).shading_group)
        self._pass = owner.own(owner.context.compute(declaration))
        self._counts = owner.own(owner.gpu.ctx.buffer(reserve=12))

    def run(self, result: moderngl.Texture, frame: FrameInputs, method: Method) -> None:
        self._counts.write(np.array([0, 0xFFFFFFFF, 0], dtype=np.uint32).tobytes())
        radiance = frame.textures.get("radiance")
        same = radiance is not None and radiance.size == result.size
        resources = {"result": result, "radiance": radiance if same else result, "found": self._counts}
        self._pass.run(None, resources, has_radiance=same)
        self._hazards.publish()
        count, first, _ = np.frombuffer(self._counts.read(), dtype=np.uint32)
        if count:
            width, height = self.size
            column, row = int(first) % width, height - 1 - int(first) // width
            raise MethodError(
                f"frame {frame.index}: {count} of {width * height} pixels are NaN or infinite "
                f"(one at column {column}, row {row})",
                where=method.label,
                hint="check for divisions by zero and square roots of negative numbers",
            )
