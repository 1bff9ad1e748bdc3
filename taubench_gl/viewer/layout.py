"""Layout of image and panels in the window, without overlap.  Screen points, y down."""

from __future__ import annotations

from dataclasses import dataclass

SIDE, BAR = 300, 132
"""Width of a side panel and height of the bar below the image, screen points."""
MIN_SIDE_WIDTH = 480
"""Width below which a window has no side panel, screen points."""
MIN_BOTH_WIDTH = 960
"""Width below which a window has one side panel, which shows the sections of both, screen points."""
GAP = 4
"""Distance between images side by side, screen points."""

START = (1900, 1010)
"""Largest size of a new window that enlarges a small image."""
LEAST_START = (1280, 720)
"""Smallest size of a new window: all controls can be reached."""

Rect = tuple[float, float, float, float]  # x, y, width, height


@dataclass(frozen=True, slots=True)
class Layout:
    """Rectangles in a window.  ``images`` have the aspect ratio of the image, centered in the area beside the panels;
    the first is the main one.

    ``merged``: one side panel shows the sections of both.
    """

    images: tuple[Rect, ...]
    left: Rect | None = None
    right: Rect | None = None
    bar: Rect | None = None
    merged: bool = False

    @property
    def image(self) -> Rect:
        """The rectangle of the main image."""
        return self.images[0]

    def pixel(self, x: float, y: float, size: tuple[int, int]) -> tuple[int, int] | None:
        """The image pixel (x, row from the top) at a window position, in any of the images; None outside."""
        for left, top, width, height in self.images:
            if width > 0 and height > 0 and left <= x < left + width and top <= y < top + height:
                column, row = int((x - left) * size[0] / width), int((y - top) * size[1] / height)
                return min(column, size[0] - 1), min(row, size[1] - 1)
        return None

    def place(self, x: float, row: float, size: tuple[int, int], tile: int = 0) -> tuple[float, float]:
        """Window position of the center of a pixel (x, row from the top) in an image."""
        left, top, width, height = self.images[tile]
        return left + (x + 0.5) * width / size[0], top + (row + 0.5) * height / size[1]


def start_size(size: tuple[int, int]) -> tuple[int, int]:
    """Size of a new window for an image of ``size`` pixels: one point per pixel, a whole multiple for small images."""
    times = max(1, min((START[0] - 2 * SIDE) // size[0], (START[1] - BAR) // size[1]))
    return _at_least(size[0] * times + 2 * SIDE, size[1] * times + BAR)


def script_size(size: tuple[int, int]) -> tuple[int, int]:
    """Size of a new window that a script drives: a side panel, the image at a point per pixel, at least LEAST_START."""
    return _at_least(size[0] + SIDE, size[1] + BAR)


def _at_least(width: int, height: int) -> tuple[int, int]:
    return max(width, LEAST_START[0]), max(height, LEAST_START[1])


def arrange(
    window: tuple[int, int], size: tuple[int, int], panels: bool, *, bar: bool = True, tiles: int = 1
) -> Layout:
    """Layout of a window for ``tiles`` images side by side, each of ``size`` pixels.

    ``panels``: whether any are shown; ``bar``: whether the one below the image is.  In a window without area the images
    are empty.
    """
    width, height = window
    if width <= 0 or height <= 0:
        return Layout(((0, 0, 0, 0),) * tiles)
    merged = width < MIN_BOTH_WIDTH
    with_right = panels and width >= MIN_SIDE_WIDTH
    with_left = with_right and not merged
    with_bar = panels and bar and height >= 3 * BAR
    start = SIDE if with_left else 0
    free_w = width - start - (SIDE if with_right else 0)
    free_h = height - (BAR if with_bar else 0)
    return Layout(
        _tiles((start, 0, free_w, free_h), size, tiles),
        (0, 0, SIDE, height) if with_left else None,
        (width - SIDE, 0, SIDE, height) if with_right else None,
        (start, free_h, free_w, BAR) if with_bar else None,
        merged,
    )


def around(area: Rect, images: tuple[Rect, ...]) -> list[Rect]:
    """Rectangles (left, top, right, bottom) of ``area``, given likewise, that cover what the images do not.

    Several images: the whole area.
    """
    left, top, right, bottom = area
    if len(images) > 1:
        return [area]
    x, y, width, height = images[0]
    parts = [(left, top, right, y), (left, y + height, right, bottom)]
    parts += [(left, y, x, y + height), (x + width, y, right, y + height)]
    return [part for part in parts if part[0] < part[2] and part[1] < part[3]]


def _tiles(area: Rect, size: tuple[int, int], count: int) -> tuple[Rect, ...]:
    """``count`` images of equal size in ``area``, in the grid in which they are largest."""
    left, top, width, height = area

    def scale_of(columns: int) -> float:
        rows = -(-count // columns)
        return min((width - GAP * (columns - 1)) / columns / size[0], (height - GAP * (rows - 1)) / rows / size[1])

    columns = max(range(1, count + 1), key=scale_of)
    scale = scale_of(columns)
    if scale > 1.0 and scale / int(scale) < 1.1:
        scale = int(scale)  # exact pixels look better than a slight enlargement
    w, h = max(round(size[0] * scale), 1), max(round(size[1] * scale), 1)
    rows = -(-count // columns)
    x = left + (width - columns * w - GAP * (columns - 1)) // 2
    y = top + (height - rows * h - GAP * (rows - 1)) // 2
    return tuple((x + (i % columns) * (w + GAP), y + (i // columns) * (h + GAP), w, h) for i in range(count))
