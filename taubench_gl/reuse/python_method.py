"""Reuse methods as Python classes: NumPy (or torch, numba, ...) on arrays, no GL.

class MyMethod:
    reads = ("radiance", "motion")                     # names of INPUTS
    settings = {"alpha": {"default": 0.1, "min": 0.0, "max": 1.0, "doc": "share of the new frame"}}

    def __init__(self, size, settings): ...            # (width, height), {name: value}; created again after a cut
    def step(self, frame): ...                         # dict (frame.frame_arrays) -> (h, w, 3) or (h, w, 4)

``frame["helpers"]`` has the functions of GLSL methods (``helpers.Helpers``).  A class with ``arrays = "torch"`` gets
tensors that share the memory of the arrays.  A class that declares ``reports``, names of contract.REPORTS, returns a
dict from ``step``: ``result`` and these names.
"""

from __future__ import annotations

import importlib
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import moderngl
import numpy as np

from taubench_gl.errors import MethodError
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.reuse.contract import RESULT, Method, Value
from taubench_gl.reuse.frame import FrameInputs, frame_arrays
from taubench_gl.reuse.helpers import Helpers


def _library(method: Method) -> Any:
    """The module whose arrays the class gets.  Raises MethodError."""
    if getattr(method.factory, "arrays", "numpy") == "numpy":
        return np
    try:
        return importlib.import_module("torch")
    except ImportError:
        hint = "pip install 'taubench-gl[torch]'"
        raise MethodError('arrays = "torch" needs torch', where=method.label, hint=hint) from None


def _tensor(value: Any, torch: Any) -> Any:
    """An array as a tensor that shares its memory; unsigned integers as int32: torch has few functions for them."""
    if not isinstance(value, np.ndarray):
        return value
    return torch.from_numpy(value.view(np.int32) if value.dtype == np.uint32 else value)


class PythonSteps(GpuOwner):
    """One instance of the class: reads inputs back from the GPU and uploads its results."""

    def __init__(self, gpu: Gpu, method: Method, size: tuple[int, int], input_size: tuple[int, int], timer: PassTimer):
        """Prepare to run the class.  Raises MethodError without its library.  ``size``: (width, height) of the result;
        ``input_size``: of the inputs, another only for a method that upscales.
        """
        super().__init__(gpu)
        self._sizes = {"output_size": size, "input_size": input_size}
        self._library = _library(method)
        self._method, self._size, self._timer = method, size, timer
        self._instance = None
        self._reported: dict[str, np.ndarray] = {}
        self._result = self.own(gpu.texture(size))

    def clear(self) -> None:
        """The next frame starts with a new instance."""
        self._instance = None

    def run(self, frame: FrameInputs, values: Mapping[str, Value], has_history: bool) -> moderngl.Texture:
        name = self._method.name
        with self._timer.measure(f"{name}: read inputs"):
            arrays = frame_arrays(frame, self._method.reads, has_history) | self._sizes
            if self._library is not np:
                arrays = {name: _tensor(value, self._library) for name, value in arrays.items()}
            arrays["helpers"] = Helpers(arrays, self._size, self._sizes["input_size"], self._library)
        with self._timer.measure(name):
            if self._instance is None:
                self._instance = self._call("__init__", lambda: self._method.factory(self._size, dict(values)))
            image = self._call("step", lambda: self._instance.step(arrays))
        image = self._checked(self._split(image))
        with self._timer.measure(f"{name}: upload"):
            self._result.write(np.ascontiguousarray(image[::-1]))  # GL's row 0 is at the bottom
        return self._result

    def _split(self, returned: object) -> object:
        """The result; keeps the reports of a class that declares some."""
        declared = self._method.reports
        if not declared:
            return returned
        missing = [n for n in (RESULT, *declared) if not isinstance(returned, Mapping) or n not in returned]
        if missing:
            message = f"step returned no {', '.join(missing)}"
            raise MethodError(message, where=self._method.label, hint="return a dict with result and the reports")
        self._reported = {name: self._checked(returned[name], alpha=1.0) for name in declared}
        return returned[RESULT]

    def reported(self, frame: FrameInputs, values: Mapping[str, Value]) -> dict[str, np.ndarray]:
        """The declared reports of the last frame, (h, w, 4) float32, row 0 at the top."""
        return dict(self._reported)

    def _call(self, name: str, function):
        try:
            return function()
        except (MethodError, KeyboardInterrupt):
            raise
        except BaseException as error:  # user code can raise anything and exit; other methods continue
            frames = traceback.extract_tb(error.__traceback__)
            at = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
            why = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
            raise MethodError(f"{name} raised {why}{at}", where=self._method.label) from error

    def _checked(self, image: object, alpha: float = -1.0) -> np.ndarray:
        """``image`` that the class returned as (h, w, 4) float32; ``alpha`` where it has three components: -1, no
        reported weight.  Raises MethodError.
        """
        width, height = self._size
        if hasattr(image, "detach"):  # a tensor, of any device; memory of the CPU is shared
            image = image.detach().cpu()
        try:
            image = np.asarray(image, dtype=np.float32)
        except (TypeError, ValueError, RuntimeError) as error:
            raise MethodError(f"step did not return an array: {error}", where=self._method.label) from None
        if image.shape not in ((height, width, 3), (height, width, 4)):
            raise MethodError(
                f"step returned shape {image.shape}, expected ({height}, {width}, 3) or ({height}, {width}, 4)",
                where=self._method.label,
            )
        if image.shape[2] == 4:
            return image
        return np.concatenate([image, np.full((height, width, 1), alpha, dtype=np.float32)], axis=2)
