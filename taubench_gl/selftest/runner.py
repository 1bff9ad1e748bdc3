"""Selects and runs cases: one result row each."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Sequence

from taubench_gl.gpu.context import Gpu
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import GROUPS, REGISTRY, Case, CaseResult

DEFAULT_SIZE = (96, 64)
"""Width and height of most cases, pixels.  A few cases need another size."""


def cases(only: Sequence[str] | None = None) -> list[Case]:
    """Cases in order.  ``only``: names, groups or parts of names; None: all.  Unknown words select no case."""
    for group in GROUPS:
        importlib.import_module(f"taubench_gl.selftest.{group}")
    ordered = sorted(REGISTRY.values(), key=lambda c: GROUPS.index(c.group))
    if not only:
        return ordered
    return [c for c in ordered if any(word == c.group or word in c.name for word in only)]


def run_case(case: Case, bench: Bench) -> CaseResult:
    """Run one case.  An exception gives a failed row and does not stop the other cases."""
    try:
        outcome = case.run(bench)
        bench.gpu.check(f"case {case.name}")
    except Exception as error:  # a driver may fail in any way
        return CaseResult(case, None, None, math.nan, False, failure=f"{type(error).__name__}: {error}")
    passed = bool(outcome.error <= case.tolerance)  # False for NaN
    return CaseResult(case, outcome.expected, outcome.measured, float(outcome.error), passed)


def run_selftest(
    gpu: Gpu,
    size: tuple[int, int] = DEFAULT_SIZE,
    only: Sequence[str] | None = None,
    *,
    device: int | None = None,
    on_result: Callable[[CaseResult], None] | None = None,
) -> list[CaseResult]:
    """Run the cases on ``gpu`` (made current here), which was opened with ``device``.

    ``on_result`` is called with each row when it is complete.
    """
    results = []
    with gpu, Bench(gpu, size, device) as bench:
        for case in cases(only):
            results.append(run_case(case, bench))
            if on_result is not None:
                on_result(results[-1])
    return results
