"""Patterns of the pixels that a frame shades, of which shaders/common/shading_rate.glsl has the pixels."""

from __future__ import annotations

RATES = ("full", "half", "checkerboard", "quarter")
"""full: every pixel; half: every second row; checkerboard: every second pixel; quarter: one pixel of each 2x2 block."""

_QUARTER_ORDER = (0, 3, 1, 2)
"""Corners x + 2 y of the block, diagonals first: two frames cover both rows and both columns."""


def cycle(rate: str) -> int:
    """Number of frames in which every pixel is shaded once."""
    return {"full": 1, "quarter": 4}.get(rate, 2)


def phase(rate: str, frame: int) -> int:
    """Phase of the pattern at frame ``frame``: 0 or 1, for ``quarter`` a corner x + 2 y of the 2x2 block."""
    turn = frame % cycle(rate)
    return _QUARTER_ORDER[turn] if rate == "quarter" else turn


def invocations(rate: str, size: tuple[int, int]) -> tuple[int, int]:
    """Columns and rows of invocations that cover the shaded pixels of ``size`` (w, h) in every phase."""
    w, h = size
    columns = -(-w // 2) if rate in ("checkerboard", "quarter") else w
    return columns, -(-h // 2) if rate in ("half", "quarter") else h
