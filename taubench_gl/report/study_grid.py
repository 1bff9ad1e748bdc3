"""What the tables of a cost study are made of: a grid of text, and how numbers are written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

NONE = "–"


@dataclass(frozen=True, slots=True)
class Grid:
    """A heading, column heads (the first is that of the row labels), rows of text, notes below."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()


def ms_text(point: Mapping[str, Any]) -> str:
    """``18.2 ± 0.4``, with as many digits as say something."""
    ms = point["ms"]
    if ms is None:
        return NONE
    spread = "" if ms["spread"] is None else f" ± {ms['spread']:.2g}"
    return f"{three(ms['median'])}{spread}"


def ratio_text(point: Mapping[str, Any], base: str = "as asked") -> str:
    """Time against that of the point labelled ``base``, in words where it is no difference."""
    told = point["against_base"]
    if told is None:
        return NONE
    if point["label"].startswith(base):
        return "1x"
    return f"{told['ratio']:.3g}x" if told["different"] else "no difference"


def three(value: float) -> str:
    """Three significant digits, never in exponents a reader must decode."""
    if value == 0:
        return "0"
    if abs(value) < 1e-4:
        return "<0.0001" if value > 0 else ">-0.0001"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
