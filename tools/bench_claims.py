"""What the project says of its speed, beside what was measured: one table at the end, so that one sees what holds."""

from __future__ import annotations

import operator
from dataclasses import dataclass

TESTS = {">=": operator.ge, "<=": operator.le}
HEADS = ("claim", "target", "measured", "spread", "holds")


@dataclass(frozen=True)
class Claim:
    """``measured`` None: not measured, ``note`` says why.  ``low`` and ``high``: of the single samples or rounds."""

    what: str
    test: str  # of TESTS
    target: float
    measured: float | None
    low: float | None = None
    high: float | None = None
    unit: str = "x"
    note: str = ""

    @property
    def holds(self) -> bool | None:
        return None if self.measured is None else bool(TESTS[self.test](self.measured, self.target))


def unmeasured(what: str, test: str, target: float, why: str, unit: str = "x") -> Claim:
    """A claim that this run says nothing of."""
    return Claim(what, test, target, None, unit=unit, note=why)


def claim_cells(claim: Claim) -> list[str]:
    """A claim as text, in the order of HEADS."""
    what = f"{claim.what} ({claim.note})" if claim.note else claim.what
    target = f"{claim.test} {claim.target:g} {claim.unit}"
    if claim.measured is None:
        return [what, target, "–", "–", "not measured"]
    spread = "–" if claim.low is None else f"{claim.low:.3g} to {claim.high:.3g}"
    return [what, target, f"{claim.measured:.3g} {claim.unit}", spread, "yes" if claim.holds else "NO"]


def claim_lines(claims: list[Claim]) -> list[str]:
    """The table as Markdown lines."""
    rows = [HEADS, ["---", "---:", "---:", "---:", "---"], *map(claim_cells, claims)]
    return [f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |" for cells in rows]
