"""Mask pictures: which pixels are discarded and why, over a grey image of the frame, with a legend."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.glossary import label_of
from taubench_gl.outputs import cannot_write, plain_text
from taubench_gl.report.palette import DEFAULT_REASONS, color_of

Array = np.ndarray

STRIPE_PX = 4
_BACKGROUND = (24, 24, 24)
_NO_BASE = 0.45  # grey where no base image is given
_TINT = 0.78  # how much of a discarded pixel is its reason's colour; the rest is the shaded base


def mask_overlay(mask: Array, base: Array | None = None, reasons: Sequence[Reason] = DEFAULT_REASONS) -> Array:
    """Colour every pixel by its reasons.  (h, w) uint32, (h, w, 3) float or None -> (h, w, 3) uint8, row 0 = top.

    ``base`` is display-referred in [0, 1] (clipped, NaN as black) and shown in grey.  A pixel with several of
    ``reasons`` is striped diagonally in all their colours, STRIPE_PX wide, so that none hides another.  Raises
    ValueError if the shapes do not fit.
    """
    mask = np.asarray(mask)
    if mask.ndim != 2:
        raise ValueError(f"mask has shape {mask.shape}, expected (h, w)")
    picture = np.repeat(_grey(base, mask.shape)[..., None], 3, axis=-1)
    hits = np.stack([(mask & np.uint32(int(reason))) != 0 for reason in reasons]) if reasons else None
    if hits is None:
        return np.round(255.0 * picture).astype(np.uint8)
    count = hits.sum(axis=0)
    rows, columns = np.indices(mask.shape)
    turn = ((rows + columns) // STRIPE_PX) % np.maximum(count, 1)
    order = np.cumsum(hits, axis=0) - 1  # of a pixel's reasons, the how-manieth this one is
    for reason, hit, place in zip(reasons, hits, order, strict=True):
        chosen = hit & (place == turn)
        color = np.array(color_of(reason)) / 255.0
        picture[chosen] = (1.0 - _TINT) * picture[chosen] + _TINT * color
    return np.round(255.0 * picture).astype(np.uint8)


def legend(mask: Array, reasons: Sequence[Reason] = DEFAULT_REASONS) -> list[tuple[str, tuple[int, int, int], float]]:
    """Name, colour (r, g, b in 0 .. 255) and percentage of w·h of each reason in ``mask``, (h, w) uint32.

    Reasons overlap, so percentages need not add up to the discarded.
    """
    mask = np.asarray(mask)
    pixels = max(mask.size, 1)
    return [
        (label_of(reason), color_of(reason), 100.0 * np.count_nonzero(mask & np.uint32(int(reason))) / pixels)
        for reason in reasons
    ]


def save_mask_picture(
    path: str | Path,
    mask: Array,
    base: Array | None = None,
    reasons: Sequence[Reason] = DEFAULT_REASONS,
    title: str = "",
) -> Path:
    """Write ``mask_overlay`` with a legend strip beneath it as PNG.  Small masks are enlarged by whole pixels.

    Give only ``reasons`` that were measured: the legend says 0 % for a feature that no pixel has.  First, cut and
    invalid stay out of it where there are none.  Raises OutputError.
    """
    import imageio.v3 as iio

    picture = mask_overlay(mask, base, reasons)
    enlarge = max(1, -(-480 // max(picture.shape[1], 1)))
    picture = np.repeat(np.repeat(picture, enlarge, axis=0), enlarge, axis=1)
    entries = [entry for entry in legend(mask, reasons) if entry[2] > 0 or entry[0] not in ("first", "cut", "invalid")]
    path = Path(path)
    try:
        iio.imwrite(path, np.concatenate([picture, legend_strip(entries, picture.shape[1], title)]), extension=".png")
    except OSError as error:
        raise cannot_write(path, error) from None
    return path


def legend_strip(entries: Sequence[tuple[str, tuple[int, int, int], float]], width: int, title: str = "") -> Array:
    """Swatches with names and percentages, wrapped to ``width`` pixels.  -> (rows, width, 3) uint8."""
    from PIL import Image, ImageDraw, ImageFont

    size = int(np.clip(width / 64, 12, 26))
    font = ImageFont.load_default(size=size)
    pad, gap, line = size // 2, int(1.6 * size), int(1.7 * size)
    items = [(f"{name} {percent:.2f} %", color) for name, color, percent in entries]
    places, x, y = [], pad, pad
    title = plain_text(title)  # it names a file
    if title:
        y += line
    for text, _ in items:
        needed = int(1.4 * size + font.getlength(text))
        if x > pad and x + needed > width - pad:
            x, y = pad, y + line
        places.append((x, y))
        x += needed + gap
    strip = Image.new("RGB", (width, y + line + pad // 2), _BACKGROUND)
    draw = ImageDraw.Draw(strip)
    if title:
        draw.text((pad, pad), title, font=font, fill=(255, 255, 255))
    for (text, color), (left, top) in zip(items, places, strict=True):
        draw.rectangle((left, top + 1, left + size, top + 1 + size), fill=color, outline=(120, 120, 120))
        draw.text((left + int(1.4 * size), top), text, font=font, fill=(230, 230, 230))
    return np.asarray(strip)


def _grey(base: Array | None, shape: tuple[int, int]) -> Array:
    """Luma of ``base``, compressed so that neither black nor white drowns the colours on top.  -> (h, w) float64."""
    if base is None:
        return np.full(shape, _NO_BASE)
    base = np.asarray(base, dtype=np.float64)
    if base.shape[:2] != shape or base.ndim != 3 or base.shape[2] < 3:
        raise ValueError(f"base has shape {base.shape}, expected {(*shape, 3)}")
    luma = np.clip(np.nan_to_num(base[..., :3], nan=0.0), 0.0, 1.0) @ np.array([0.2126, 0.7152, 0.0722])
    return 0.12 + 0.68 * luma
