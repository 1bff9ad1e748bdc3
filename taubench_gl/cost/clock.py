"""Which clock a study trusts, what a spread is, and when two times differ."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.timing import WALL_CLOCK, PassTimer, TimerVerdict, probe_timer

GPU_CLOCK = "GPU timer query, proven against the wall clock"

RULE = (
    "settings are visited in turn, so two of them are compared round by round: they differ if the median of the "
    "rounds' log ratios is further from 0 than those ratios spread (1.4826 times their median absolute deviation: "
    "the standard deviation, for normal noise) and 0 lies outside the 95 % interval of their mean (Student's t); times "
    "without common rounds differ if their medians are further apart than sqrt(s1^2 + s2^2); otherwise, or with fewer "
    "than three repeats, there is no difference to speak of"
)

MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True, slots=True)
class Time:
    """Milliseconds: median over repeats, their spread (1.4826 MAD; None below three), how many, and the repeats
    themselves by round, where they were taken in turn with others."""

    median: float
    spread: float | None
    samples: int
    rounds: tuple[float, ...] = ()


def time_of(samples: Sequence[float], *, in_turn: bool = True) -> Time:
    """Median and spread of the repeats of one setting.  At least one sample, all above 0."""
    median, spread = _middle(samples)
    return Time(median, spread, len(samples), tuple(samples) if in_turn else ())


def slower_by(a: Time, b: Time) -> int:
    """1 where ``a`` is slower than ``b``, -1 where faster, 0 where there is no difference, by RULE."""
    if a.rounds and len(a.rounds) == len(b.rounds):
        ratios = [math.log(x / y) for x, y in zip(a.rounds, b.rounds)]
        apart, spread = _middle(ratios)
        sure = abs(statistics.fmean(ratios)) > _half_width(ratios)
    else:
        apart, sure = a.median - b.median, True
        spread = None if a.spread is None or b.spread is None else math.hypot(a.spread, b.spread)
    if spread is None or not sure or abs(apart) <= spread:
        return 0
    return 1 if apart > 0 else -1


def _half_width(samples: Sequence[float]) -> float:
    """Of the 95 % interval of the mean: few rounds that happen to lie close together prove little."""
    n = len(samples)
    if n < 3:
        return math.inf
    from scipy.special import stdtrit  # imported late: 0.3 s

    return float(stdtrit(n - 1, 0.975)) * statistics.stdev(samples) / math.sqrt(n)


def _middle(samples: Sequence[float]) -> tuple[float, float | None]:
    median = statistics.median(samples)
    if len(samples) < 3:
        return median, None
    return median, MAD_TO_SIGMA * statistics.median(abs(s - median) for s in samples)


class QueryTimer(PassTimer):
    """Milliseconds of each pass by the GPU's own timer.  What the CPU does in a pass is not in them."""

    clock = GPU_CLOCK

    @contextmanager
    def measure(self, name: str) -> Iterator[None]:
        if not self.enabled:
            yield
            return
        query = self._gpu.ctx.query(time=True)
        with query:
            yield
        self._samples[name].append(query.elapsed * 1e-6)  # nanoseconds; reading it waits for the pass


def pass_timer(gpu: Gpu, verdict: TimerVerdict | None = None) -> PassTimer:
    """The GPU timer where it proves usable (``gpu.timing.probe_timer``), else finish() and the monotonic clock."""
    verdict = verdict or probe_timer(gpu)
    return QueryTimer(gpu) if verdict.usable else PassTimer(gpu)


__all__ = ["GPU_CLOCK", "RULE", "WALL_CLOCK", "QueryTimer", "Time", "pass_timer", "slower_by", "time_of"]
