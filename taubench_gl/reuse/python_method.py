"""Reuse methods written as a Python class: NumPy (or torch, numba, ...) on arrays, no GL.

class MyMethod:
    reads = ("radiance", "motion")                     # names of INPUTS
    settings = {"alpha": {"default": 0.1, "min": 0.0, "max": 1.0, "doc": "share of the new frame"}}

    def __init__(self, size, settings): ...            # (width, height), {name: value}; made anew after a reset
    def step(self, frame): ...                         # dict (arrays.frame_arrays) -> (h, w, 3) or (h, w, 4)
"""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from pathlib import Path

import moderngl
import numpy as np

from taubench_gl.errors import MethodError
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.reuse.arrays import frame_arrays
from taubench_gl.reuse.contract import Method, Value, input_fault, name_fault, parse_setting
from taubench_gl.reuse.frame import FrameInputs


def method_from_class(cls: type, where: str = "") -> Method:
    """A Method of a class with ``reads`` and ``step``.  Raises MethodError with every fault."""
    where = where or f"{cls.__module__}:{cls.__qualname__}"
    faults, settings = [], {}
    reads = getattr(cls, "reads", None)
    if not isinstance(reads, (tuple, list)) or not reads:
        faults.append('reads: a tuple of inputs is needed, such as ("radiance", "motion")')
        reads = ()
    faults += [f"reads: {fault}" for name in reads if (fault := input_fault(name))]
    given = getattr(cls, "settings", {})
    if not isinstance(given, Mapping):
        faults.append("settings: is not a dict of name -> default or {default, min, max, doc}")
        given = {}
    for name, raw in given.items():
        if fault := name_fault(name, "setting"):
            faults.append(f"settings: {fault}")
            continue
        setting, more = parse_setting(name, raw)
        faults += [f"settings.{name}.{fault}" for fault in more]
        if setting:
            settings[name] = setting
    if not callable(getattr(cls, "step", None)):
        faults.append("step: a function step(self, frame) is needed")
    if faults:
        raise MethodError("; ".join(faults), where=where)
    cite = getattr(cls, "cite", ())
    name = str(getattr(cls, "name", cls.__name__))
    return Method(
        name=name,
        title=str(getattr(cls, "title", name)),
        cite=(cite,) if isinstance(cite, str) else tuple(map(str, cite)),
        reads=tuple(dict.fromkeys(reads)),
        settings=settings,
        history={},
        buffers={},
        passes=(),
        folder=None,
        factory=cls,
        where=where,
    )


class PythonSteps:
    """One instance of the class, fed with arrays; its pictures go back to the GPU."""

    def __init__(self, gpu: Gpu, method: Method, size: tuple[int, int], timer: PassTimer):
        self._method, self._size, self._timer = method, size, timer
        self._instance = None
        self._result = gpu.ctx.texture(size, 4, dtype="f4")
        self._result.filter = (moderngl.NEAREST, moderngl.NEAREST)

    def clear(self) -> None:
        """The next frame starts with a new instance."""
        self._instance = None

    def run(self, frame: FrameInputs, values: Mapping[str, Value], has_history: bool) -> moderngl.Texture:
        name = self._method.name
        with self._timer.measure(f"{name}: read inputs"):
            arrays = frame_arrays(frame, self._method.reads, has_history)
        with self._timer.measure(name):
            if self._instance is None:
                self._instance = self._call("__init__", lambda: self._method.factory(self._size, dict(values)))
            picture = self._call("step", lambda: self._instance.step(arrays))
        picture = self._checked(picture)
        with self._timer.measure(f"{name}: upload"):
            self._result.write(np.ascontiguousarray(picture[::-1]))
        return self._result

    def _call(self, what: str, function):
        try:
            return function()
        except MethodError:
            raise
        except Exception as error:  # a user's code may raise anything; the other methods go on
            frames = traceback.extract_tb(error.__traceback__)
            at = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
            why = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
            raise MethodError(f"{what} raised {why}{at}", where=self._method.label) from error

    def _checked(self, picture: object) -> np.ndarray:
        """-> (h, w, 4) float32; alpha -1 where the class does not say how much is history."""
        width, height = self._size
        try:
            picture = np.asarray(picture, dtype=np.float32)
        except (TypeError, ValueError, RuntimeError) as error:
            raise MethodError(f"step returned what is no array: {error}", where=self._method.label) from None
        if picture.shape not in ((height, width, 3), (height, width, 4)):
            raise MethodError(
                f"step returned shape {picture.shape}, expected ({height}, {width}, 3) or ({height}, {width}, 4)",
                where=self._method.label,
            )
        if picture.shape[2] == 4:
            return picture
        return np.concatenate([picture, np.full((height, width, 1), -1.0, dtype=np.float32)], axis=2)

    def release(self) -> None:
        self._instance = None
        self._result.release()
