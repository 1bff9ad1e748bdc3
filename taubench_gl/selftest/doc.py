"""Writes docs/hard-cases.md from the registry: ``python -m taubench_gl.selftest.doc``."""

from __future__ import annotations

from taubench_gl.paths import PACKAGE
from taubench_gl.selftest.case import GROUPS
from taubench_gl.selftest.guards import GUARDS
from taubench_gl.selftest.runner import cases

PATH = PACKAGE.parent / "docs" / "hard-cases.md"

TITLES = {
    "projection": "Reprojection and the edge of the screen",
    "depth": "Depth and grazing angles",
    "camera": "How far the camera moved",
    "offsets": "Far from the origin, very large, very small",
    "animation": "Keys and times",
    "geometry": "Scales and triangles",
    "skinning": "Surfaces that deform",
    "lighting": "Lights",
    "radiance": "Radiance and thresholds",
    "statistics": "Sums and bookkeeping",
    "storage": "Half, float, double",
    "files": "Files that break a rule",
}

HEAD = """# Hard cases

Where temporal reprojection, animation and counting go wrong, and what is done here.  Each row is a case with a known
answer that anyone can run on their own GPU or CPU driver:

```
taubench-gl selftest
taubench-gl selftest --only offsets --backend osmesa
taubench-gl selftest --json > selftest.json
```

A case passes when its error is at most its tolerance; a tolerance of 0 means equal to the last bit or pixel.  Where an
obvious formula fails the case, the case runs that formula too and prints what it gives.

This page is written by `python -m taubench_gl.selftest.doc` from the cases themselves.
"""

GUARDS_HEAD = """
## Guards

What keeps these cases right.  Tests switch each one off and demand that a case notices
(`taubench_gl.selftest.guards`).

| Guard | What it does | Noticed by |
| --- | --- | --- |
"""


def page() -> str:
    """The whole page, Markdown."""
    out = [HEAD]
    every = cases()
    for group in GROUPS:
        out.append(f"\n## {TITLES[group]}\n\n")
        out.append("| Case | What is tried | What goes wrong elsewhere | What is done here | Tolerance |\n")
        out.append("| --- | --- | --- | --- | --- |\n")
        for one in every:
            if one.group == group:
                cells = (f"`{one.name}`", one.what, one.elsewhere, one.here, f"{one.tolerance:g}: {one.source}")
                out.append(f"| {' | '.join(_cell(c) for c in cells)} |\n")
    out.append(GUARDS_HEAD)
    for guard in GUARDS:
        noticed = ", ".join(f"`{name}`" for name in guard.noticed_by)
        out.append(f"| `{guard.name}` | {_cell(guard.what)} | {noticed} |\n")
    return "".join(out)


def _cell(text: str) -> str:
    """Bars would end the cell; asterisks would set it in italics."""
    return text.replace("|", "\\|").replace("*", "\\*")


if __name__ == "__main__":
    PATH.parent.mkdir(parents=True, exist_ok=True)
    PATH.write_text(page(), encoding="utf-8")
