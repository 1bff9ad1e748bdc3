"""docs/hard-cases.md (``tools/record hard-cases``), from the registered cases and the guards of their tests."""

from __future__ import annotations

import json
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "selftest")]
from guards import GUARDS  # noqa: E402

from taubench_gl.selftest import cases  # noqa: E402
from taubench_gl.selftest.case import GROUPS  # noqa: E402

PATH = ROOT / "docs" / "hard-cases.md"
NUMERICS = ROOT / "tests" / "selftest" / "numerics.json"

TITLES = {
    "projection": "Reprojection and screen edges",
    "depth": "Depth and grazing angles",
    "camera": "Camera motion",
    "offsets": "Large offsets and scales",
    "animation": "Animation keys and times",
    "geometry": "Transforms and triangles",
    "skinning": "Deforming surfaces",
    "materials": "Textures and color",
    "lighting": "Lights",
    "direct": "Direct light and the BRDF",
    "shadows": "Shadows",
    "indirect": "Indirect light",
    "path_tracing": "Path-traced light",
    "radiance": "Radiance and thresholds",
    "sampling": "Pixels decided by path tracing, and estimates from them",
    "statistics": "Sums and counts",
    "storage": "Half, float and double precision",
    "files": "Invalid files",
    "encodings": "Values in every form that glTF allows",
    "arithmetic": "Rates, means, cuts and exposure",
    "formulas": "Formulas against other formulas",
    "tables": "Tables and schedules by their definition",
    "cross_checks": "One scene by two ways",
    "pictures": "The demo scene as recorded",
}

HEAD = """# Hard cases

Inputs on which temporal reprojection, animation or counting commonly fails.  Each row is a test case with a known
answer.  Run them on your own GPU or CPU driver:

```
taubench-gl selftest
taubench-gl selftest --only offsets --backend osmesa
taubench-gl selftest --json > selftest.json
```

A case passes if its error is at most its tolerance.  A tolerance of 0 means equal to the last bit or pixel.  Where a
simpler formula fails the case, the case also evaluates that formula and prints its result.

This page is generated from the cases by `tools/record hard-cases`.
"""

GUARDS_HEAD = """
## Guards

Each guard is one rule of the pipeline.  The tests disable one guard at a time and check that at least one of the
named cases fails (`tests/selftest/guards.py`).  Of guards of precision and rounding: the error of the first of these
cases without the guard, and with it (`tools/record numerics`).

| Guard | Rule | Detected by | Error without it | With it |
| --- | --- | --- | ---: | ---: |
"""


def page() -> str:
    """The whole page, Markdown."""
    out = [HEAD]
    every = cases()
    for group in GROUPS:
        out.append(f"\n## {TITLES[group]}\n\n")
        out.append("| Case | Test | Common failure | Approach here | Tolerance |\n")
        out.append("| --- | --- | --- | --- | --- |\n")
        for one in every:
            if one.group == group:
                cells = (f"`{one.name}`", one.description, one.elsewhere, one.here, f"{one.tolerance:g}: {one.source}")
                out.append(f"| {' | '.join(_cell(c) for c in cells)} |\n")
    out.append(GUARDS_HEAD)
    errors = {row["guard"]: row for row in json.loads(NUMERICS.read_text(encoding="utf-8"))["rows"]}
    for guard in GUARDS:
        detected = ", ".join(f"`{name}`" for name in guard.detected_by)
        row = errors.get(guard.name)
        measured = "| |" if row is None else f"{row['error_without']:.3g} | {row['error']:.3g} |"
        out.append(f"| `{guard.name}` | {_cell(guard.description)} | {detected} | {measured}\n")
    return "".join(out)


def _cell(text: str) -> str:
    """Bars would end the cell; asterisks would set it in italics."""
    return text.replace("|", "\\|").replace("*", "\\*")
