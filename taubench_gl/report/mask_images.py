"""Mask images: the discarded pixels in the colors of their reasons over a gray image of the frame, with a legend."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.glossary import label_of
from taubench_gl.outputs import plain_text, write_png
from taubench_gl.report.palette import DEFAULT_REASONS, color_of
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray

STRIPE_PX = 4
_ONLY_WHERE_PRESENT = {label_of(reason) for reason in (Reason.FIRST, Reason.CUT, Reason.INVALID)}
_BACKGROUND = (24, 24, 24)
_NO_BASE = 0.45  # gray level without a base image
_TINT = 0.78  # weight of the reason's color on a discarded pixel; the rest is the base


def mask_overlay(mask: Array, base: Array | None = None, reasons: Sequence[Reason] = DEFAULT_REASONS) -> Array:
    """Color every pixel by its reasons.  (h, w) uint32, (h, w, 3) float or None -> (h, w, 3) uint8, row 0 = top.

    ``base`` is display-referred in [0, 1] (clipped, NaN as black) and shown in gray.  A pixel with several of
    ``reasons`` shows diagonal stripes, STRIPE_PX wide, in the color of each.  Raises ValueError if shapes differ.
    """
    mask = np.asarray(mask)
    if mask.ndim != 2:
        raise ValueError(f"mask has shape {mask.shape}, expected (h, w)")
    image = np.repeat(_gray(base, mask.shape)[..., None], 3, axis=-1)
    hits = np.stack([(mask & np.uint32(int(reason))) != 0 for reason in reasons]) if reasons else None
    if hits is None:
        return np.round(255.0 * image).astype(np.uint8)
    count = hits.sum(axis=0)
    rows, columns = np.indices(mask.shape)
    turn = ((rows + columns) // STRIPE_PX) % np.maximum(count, 1)
    order = np.cumsum(hits, axis=0) - 1  # index of each reason among those of the pixel
    for reason, hit, place in zip(reasons, hits, order, strict=True):
        pixels = hit & (place == turn)
        color = np.array(color_of(reason)) / 255.0
        image[pixels] = (1.0 - _TINT) * image[pixels] + _TINT * color
    return np.round(255.0 * image).astype(np.uint8)


def legend(mask: Array, reasons: Sequence[Reason] = DEFAULT_REASONS) -> list[tuple[str, tuple[int, int, int], float]]:
    """Label, color (r, g, b in 0 .. 255) and percentage of all pixels of each reason in ``mask``, (h, w) uint32.

    Reasons overlap, so the percentages need not add up to the discard rate.
    """
    mask = np.asarray(mask)
    pixels = max(mask.size, 1)
    return [
        (label_of(reason), color_of(reason), 100.0 * np.count_nonzero(mask & np.uint32(int(reason))) / pixels)
        for reason in reasons
    ]


def save_mask_image(
    path: str | Path,
    mask: Array,
    base: Array | None = None,
    reasons: Sequence[Reason] = DEFAULT_REASONS,
    title: str = "",
) -> Path:
    """Write ``mask_overlay`` with a legend below it as PNG.  Small masks are enlarged by an integer factor.

    ``reasons`` should hold measured ones only: the legend lists 0 % for a reason that no pixel has, except for first,
    cut and invalid, which it omits then.  Raises OutputError.
    """
    image = mask_overlay(mask, base, reasons)
    enlarge = max(1, -(-480 // max(image.shape[1], 1)))
    image = np.repeat(np.repeat(image, enlarge, axis=0), enlarge, axis=1)
    entries = [entry for entry in legend(mask, reasons) if entry[2] > 0 or entry[0] not in _ONLY_WHERE_PRESENT]
    striped = sum(((mask & np.uint32(int(reason))) != 0).astype(np.uint8) for reason in reasons) > 1
    if np.any(striped):
        title = f"{title}; stripes: several reasons" if title else "stripes: several reasons"
    path = Path(path)
    write_png(path, np.concatenate([image, legend_strip(entries, image.shape[1], title)]))
    return path


def legend_strip(entries: Sequence[tuple[str, tuple[int, int, int], float]], width: int, title: str = "") -> Array:
    """Swatches with labels and percentages, wrapped to ``width`` pixels.  -> (rows, width, 3) uint8."""
    from PIL import Image, ImageDraw, ImageFont

    size = int(np.clip(width / 64, 12, 26))
    font = ImageFont.load_default(size=size)
    pad, gap, line = size // 2, int(1.6 * size), int(1.7 * size)
    items = [(f"{name} {percent:.2f} %", color) for name, color, percent in entries]
    places, x, y = [], pad, pad
    title = plain_text(title)  # may hold a file name that is not UTF-8
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


def _gray(base: Array | None, shape: tuple[int, int]) -> Array:
    """Luma of ``base`` in 0.12 .. 0.8, so that the colors on top stand out everywhere.  -> (h, w) float64."""
    if base is None:
        return np.full(shape, _NO_BASE)
    base = np.asarray(base, dtype=np.float64)
    if base.shape[:2] != shape or base.ndim != 3 or base.shape[2] < 3:
        raise ValueError(f"base has shape {base.shape}, expected {(*shape, 3)}")
    luma = np.clip(np.nan_to_num(base[..., :3], nan=0.0), 0.0, 1.0) @ LUMINANCE
    return 0.12 + 0.68 * luma


def as_bytes(image: Array) -> Array:
    """``image`` (h, w, 3) as uint8: floats in [0, 1], NaN as black; uint8 as it is."""
    image = np.asarray(image)
    if image.dtype == np.uint8:
        return image
    return np.round(255.0 * np.clip(np.nan_to_num(image), 0.0, 1.0)).astype(np.uint8)
