"""Hard cases with known answers, run through the real pipeline on the user's own GPU or CPU driver.

Each case states what is tried, the closed-form (or float64) answer, the largest accepted error and where that comes
from.  Where an obvious formula fails, the case runs that too.  docs/hard-cases.md is the table of all of them.
"""

from __future__ import annotations

from taubench_gl.selftest.case import Case, CaseResult
from taubench_gl.selftest.runner import cases, run_selftest

__all__ = ["Case", "CaseResult", "cases", "run_selftest"]
