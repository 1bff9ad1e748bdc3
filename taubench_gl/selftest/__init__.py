"""Hard cases with known answers, run through the pipeline on the user's GPU or CPU driver.

Each case states the test, how programs commonly fail it, the closed-form or float64 answer, the largest accepted error
and its source.  docs/hard-cases.md lists all cases.
"""

from __future__ import annotations

from taubench_gl.selftest.case import Case, CaseResult
from taubench_gl.selftest.runner import cases, run_selftest

__all__ = ["Case", "CaseResult", "cases", "run_selftest"]
