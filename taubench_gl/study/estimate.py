"""Time that units will take, from the time of some of them; announced before a study runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from taubench_gl.outputs import duration_text


@dataclass(frozen=True, slots=True)
class Estimate:
    """``weight`` of a job or unit that is left, seconds of weight 1, and ``begin``: seconds before the first."""

    label: str
    weight: int
    seconds: float
    reason: str = ""
    begin: float = 0.0

    @property
    def total(self) -> float:
        """Seconds of one worker."""
        return self.begin + self.weight * self.seconds


def announce(estimates: Sequence[Estimate], of: str, workers: int | None, say: Callable[[str], None]) -> None:
    """Say one line per estimate, and their sum.  ``of``: what a weight counts; ``workers`` None: this process."""
    for each in estimates:
        reason = f" ({each.reason})" if each.reason else ""
        say(f"{each.label}: {each.weight} {of} of about {each.seconds:.2g} s, {duration_text(each.total)}{reason}")
    if estimates:
        total = sum(each.total for each in estimates)
        spread = max(total / (workers or 1), max(each.begin + each.seconds for each in estimates))
        several = f" in one process; with {workers} workers about {duration_text(spread)}" if workers else ""
        say(f"estimated time: {duration_text(total)}{several}")
