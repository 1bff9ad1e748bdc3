#!/usr/bin/env python3
"""Records what the renderer's arithmetic avoids: tools/make_numerics.py writes tests/selftest/numerics.json.

Each row is one safeguard that the tests disable (tests/selftest/guards.py), a hard case that then fails, and the error
of that case with and without the safeguard.  docs/hard-cases.md shows them (tools/record hard-cases).
"""

from __future__ import annotations

import json
import sys
from datetime import date
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "selftest")]
from guards import GUARDS, Guard  # noqa: E402

from taubench_gl.gpu.context import open_gpu  # noqa: E402
from taubench_gl.selftest.runner import DEFAULT_SIZE, run_selftest  # noqa: E402

NUMERICS = ROOT / "tests" / "selftest" / "numerics.json"

NUMERIC = (
    "camera-relative", "camera-relative-skins", "integer-counts", "stable-variance", "float-depth", "chord-angle",
    "screen-guard", "near-guard", "exact-hermite", "scaled-cofactors", "unit-scale", "frame-tolerance", "non-finite",
)  # fmt: skip
"""Guards that concern precision and rounding; the others are rules of another kind."""


def row(guard: Guard, gpu: Any) -> dict[str, Any]:
    """Errors of the first case that fails without ``guard``, with and without it; cases are in order of difficulty."""
    cases = list(guard.detected_by)
    sound = {r.name: r for r in run_selftest(gpu, only=cases)}
    with guard.disabled():
        broken = {r.name: r for r in run_selftest(gpu, only=cases)}
    name = next(n for n in cases if broken[n].failure is None and broken[n].error > broken[n].case.tolerance)
    errors = {"error": sound[name].error, "error_without": broken[name].error}
    return {"guard": guard.name, "case": name} | errors


def main() -> int:
    gpu = open_gpu()
    rows = [row(guard, gpu) for guard in GUARDS if guard.name in NUMERIC]
    rows.sort(key=lambda r: NUMERIC.index(r["guard"]))
    about = {
        "schema": "taubench-gl/numerics/1",
        "renderer": gpu.renderer,
        "driver": gpu.version,
        "date": date.today().isoformat(),
    }
    text = json.dumps(about | {"size": DEFAULT_SIZE, "rows": rows}, indent=1, allow_nan=False)
    NUMERICS.write_text(text + "\n", encoding="utf-8")
    for r in rows:
        print(f"{r['guard']:<22} {r['case']:<24} {r['error']:.3g} -> {r['error_without']:.3g}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
