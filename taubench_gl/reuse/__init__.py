"""Temporal reuse methods: their contract, built-in methods, inputs, and evaluation."""

from __future__ import annotations

import importlib
from typing import Any

_LAZY = {
    "Evaluation": "taubench_gl.reuse.evaluate",
    "EvaluationRequest": "taubench_gl.reuse.evaluate",
    "Fit": "taubench_gl.reuse.fit",
    "InputKind": "taubench_gl.reuse.input_kind",
    "MethodSpec": "taubench_gl.reuse.evaluate",
    "evaluate_methods": "taubench_gl.reuse.evaluate",
    "fit_setting": "taubench_gl.reuse.fit",
    "load_evaluation": "taubench_gl.reuse.stored",
    "parse_input": "taubench_gl.reuse.input_kind",
}
"""Resolved on first use: listing methods needs neither OpenGL nor image libraries."""

__all__ = sorted(_LAZY)


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_LAZY[name]), name)
