"""Runs the cases: one row each, none stops the others."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence

from taubench_gl.gpu.context import Gpu
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import GROUPS, Case, CaseResult, judge, select

DEFAULT_SIZE = (96, 64)
"""Pixels of most cases; a few choose their own because their closed form needs it."""


def cases(only: Sequence[str] | None = None) -> list[Case]:
    """All cases in order, or those that ``only`` names (names, parts of names, groups)."""
    for group in GROUPS:
        importlib.import_module(f"taubench_gl.selftest.{group}")
    return select(only)


def run_selftest(
    gpu: Gpu,
    size: tuple[int, int] = DEFAULT_SIZE,
    only: Sequence[str] | None = None,
    *,
    device: int | None = None,
    on_result: Callable[[CaseResult], None] | None = None,
) -> list[CaseResult]:
    """Run the cases on ``gpu`` (made current here), which was opened with ``device``.

    ``on_result`` sees each row as soon as it is there.
    """
    results = []
    with gpu:
        bench = Bench(gpu, size, device)
        try:
            for one in cases(only):
                results.append(judge(one, bench))
                if on_result is not None:
                    on_result(results[-1])
        finally:
            bench.release()
    return results
