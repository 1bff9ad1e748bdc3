"""Demo 12: float32 sums and coarse histograms change the numbers of a table."""

from __future__ import annotations

import numpy as np

from taubench_gl.conventions import HISTOGRAM_MANTISSA_BITS, Reason
from taubench_gl.demos import theory
from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, percent
from taubench_gl.demos.lessons.thresholds import STEPS_CM, distances
from taubench_gl.demos.sheet import BLACK, BLUE, RED, Sheet, gray_image, heat, overlay, painted, rgb
from taubench_gl.demos.stage import Stage
from taubench_gl.demos.texts import lesson_text
from taubench_gl.metrics.counts import bin_of, discarded_above, edges

PAIRS = 24 * 3600
"""An hour at 24 frames per second."""

LOW, HIGH = 0.125, 0.25
"""Meters: edges with 1 bin per octave.  Only the key that moves by 16 cm lies between them."""
THRESHOLD = lesson_text("counting").parameter.start  # meters; between LOW and HIGH
COARSE, FINE = 0, HISTOGRAM_MANTISSA_BITS  # 2^bits bins per octave; FINE: those of every run


def plain_sums(terms: Array) -> Array:
    """Running float32 sums of (n,) counts, added one after another: (n,) float32.

    Relative error up to (n - 1) 2^-24 (Higham 2002, Eq. 4.4).
    """
    return np.cumsum(np.asarray(terms, dtype=np.float32), dtype=np.float32)


def compensated_sum(terms: Array) -> float:
    """Float32 sum of (n,) counts with the running compensation of Neumaier (1974): error about 2^-24 for any n."""
    running = lost = np.float32(0)
    for term in np.asarray(terms, dtype=np.float32):
        after = np.float32(running + term)
        larger, smaller = (running, term) if abs(running) >= abs(term) else (term, running)
        lost = np.float32(lost + np.float32(np.float32(larger - after) + smaller))
        running = after
    return float(np.float32(running + lost))


def rounded_sum(term: int, times: int) -> int:
    """``times`` x ``term``, after every addition rounded to 24 significant bits, half to even.  Integers only."""
    total = 0
    for _ in range(times):
        total += term
        shift = max(total.bit_length() - 24, 0)
        quotient, remainder = total >> shift, total & ((1 << shift) - 1)
        half = (1 << shift) >> 1
        quotient += remainder > half or (shift > 0 and remainder == half and quotient & 1)
        total = quotient << shift
    return total


def curve_at(distance: Array, threshold: float, bits: int) -> float:
    """Pixels at or above ``threshold``, read from a histogram of 2^``bits`` bins per octave (linear between edges)."""
    counts = np.bincount(bin_of(distance.ravel(), bits), minlength=len(edges(bits)) + 1)
    return float(np.interp(threshold, edges(bits), discarded_above(counts)))


def run(stage: Stage, lesson: Lesson) -> Measured:
    """An hour of one pair summed in float32, and one curve from histograms of three widths."""
    pair, sheet = lesson.pair, lesson.sheet
    moved = pair.change("position")
    discarded = int(pair.has(Reason.POSITION).sum())
    text = f"{discarded} of {stage.pixels} pixels discarded: {100.0 * discarded / stage.pixels:.4f} %"
    sheet.panel(0, 0, overlay(pair.mask, pair.now["color"], Reason.POSITION), f"one pair, {THRESHOLD:g} m", text)
    sheet.panel(1, 0, heat(np.log2(moved.clip(0.01)) - np.log2(0.01), 8.0), "distance between the frames")
    _plot_sums(sheet, discarded)
    _plot_curves(sheet, moved)
    numbers = _sum_numbers(discarded, stage.pixels) | _curve_numbers(stage, moved, discarded)
    gray = gray_image(pair) / 255.0

    def at(value: float) -> tuple[Array, float, float, float]:
        """At a threshold ``value``: the pixels above it by the coarse curve, and by their own count."""
        low = edges(COARSE)[np.searchsorted(edges(COARSE), value, side="right") - 1]
        image = painted(gray, (moved > value, rgb(Reason.POSITION)))
        inside = percent((moved >= low) & (moved < 2.0 * low))
        return image, 100.0 * curve_at(moved, value, COARSE) / moved.size, percent(moved > value), inside + 1e-9

    return Measured(numbers, lesson.swept(at))


def _sum_numbers(discarded: int, pixels: int) -> dict[str, tuple[float, Expected]]:
    """What float32 sums of an hour make of a pair in which ``discarded`` of ``pixels`` are discarded."""
    limit = int(plain_sums(np.ones((1 << 24) + 1000))[-1])
    plain = 100.0 * float(plain_sums(np.full(PAIRS, discarded))[-1]) / float(plain_sums(np.full(PAIRS, pixels))[-1])
    rounded = 100.0 * rounded_sum(discarded, PAIRS) / rounded_sum(pixels, PAIRS)
    compensated = abs(compensated_sum(np.full(PAIRS, discarded)) / (discarded * PAIRS) - 1.0) * 2.0**24
    return {
        "counter": (limit / 1e6, Expected.near(2.0**24 / 1e6, 0.0, 6)),
        "plain": (plain, Expected.near(rounded, 1e-9, 4)),
        "compensated": (compensated, Expected.between(0.0, 1.0)),
    }


def _curve_numbers(stage: Stage, moved: Array, discarded: int) -> dict[str, tuple[float, Expected]]:
    """The errors of curves at THRESHOLD, from ``moved`` (h, w), against the count ``discarded`` of the mask."""
    expected = distances(stage.size)
    inside = (expected >= LOW) & (expected < HIGH)
    weight = (HIGH - THRESHOLD) / (HIGH - LOW)
    slack = 50.0 * weight * theory.edge_pixels(inside) / inside.size
    errors = [curve_at(moved, THRESHOLD, bits) - discarded for bits in (COARSE, FINE)]
    return {
        "coarse": (100.0 * errors[0] / stage.pixels, Expected.near(100.0 * weight * float(inside.mean()), slack)),
        "fine": (abs(errors[1]), Expected.near(0.0, 0.0, 0)),
    }


def _plot_sums(sheet: Sheet, term: int) -> None:
    """Plot the relative errors of sums of 1 to PAIRS times ``term``."""
    axes = sheet.plot("sums")
    pairs = np.arange(1, PAIRS + 1)
    exact = term * pairs.astype(np.float64)
    error = np.abs(plain_sums(np.full(PAIRS, term)) / exact - 1.0)
    axes.plot(pairs, np.maximum(error, 1e-10), color=RED, linewidth=2, label="plain float32")
    at = np.unique(np.geomspace(1, PAIRS, 12).astype(int))
    errors = [abs(compensated_sum(np.full(n, term)) / (term * n) - 1.0) for n in at]
    axes.plot(at, np.maximum(errors, 1e-10), color=BLUE, linewidth=1.6, marker="o", label="compensated float32")
    axes.axhline(1e-10, color=BLACK, linewidth=3, label="integers: exact")
    axes.axhline(2.0**-24, color="#777777", linewidth=1, linestyle="--", label="2^-24")


def _plot_curves(sheet: Sheet, moved: Array) -> None:
    """Plot the share above each threshold, from histograms of ``moved`` (h, w) with three widths of bins."""
    axes = sheet.plot("curves")
    axes.set_ylim(0, 108.0 * np.mean(moved >= STEPS_CM[0] / 200.0))
    line = np.geomspace(0.02, 2.0, 600)
    for bits, color, width in ((COARSE, RED, 2.0), (1, BLUE, 1.6), (FINE, BLACK, 1.6)):
        shares = [100.0 * curve_at(moved, threshold, bits) / moved.size for threshold in line]
        axes.plot(line, shares, color=color, linewidth=width, label=f"{1 << bits} bin{'s' * (bits > 0)} per octave")
    axes.axvline(THRESHOLD, color="#777777", linewidth=1, linestyle="--")
