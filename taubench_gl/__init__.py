"""taubench-gl: how much of the last frame can be reused, on which pixels, and what a wrong reuse costs.

>>> import taubench_gl as tb
>>> run = tb.evaluate("scene.glb")
>>> run.table()

Names are resolved on first use, so that reading scenes, files and tables never imports OpenGL.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"

_LAZY = {
    "evaluate": "taubench_gl.api:evaluate",
    "pairs": "taubench_gl.api:pairs",
    "Pair": "taubench_gl.evaluation:Pair",
    "reuse_evaluate": "taubench_gl.reuse.evaluate:evaluate_methods",
    "TrainingWindows": "taubench_gl.export.dataset:TrainingWindows",
    "ExportedFrames": "taubench_gl.export.dataset:ExportedFrames",
    "RenderedFrames": "taubench_gl.export.dataset:RenderedFrames",
    "Settings": "taubench_gl.settings:Settings",
    "Run": "taubench_gl.run:Run",
    "load_run": "taubench_gl.run:load_run",
    "load_preset": "taubench_gl.preset:load_preset",
    "load_scene": "taubench_gl.scene:load_scene",
    "sample": "taubench_gl.animation:sample",
    "Scene": "taubench_gl.scene.model:Scene",
    "Reason": "taubench_gl.conventions:Reason",
    "TaubenchError": "taubench_gl.errors:TaubenchError",
}

__all__ = ["__version__", *_LAZY]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _LAZY[name].split(":")
    value = getattr(importlib.import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
