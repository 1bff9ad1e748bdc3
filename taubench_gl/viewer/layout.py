"""Layout of image and panels in the window, without overlap.  Screen points, y down."""

from __future__ import annotations

from dataclasses import dataclass

SIDE, BAR = 300, 64
"""Width of the side panel, height of the bar below the image."""
MIN_SIDE_WIDTH = 480
"""Narrower windows have no side panel."""

START = (1600, 960)
"""Largest size of a new window that enlarges a small image."""
MIN_START_HEIGHT = 640
"""Smallest height of a new window: most of the side panel is visible."""

Rect = tuple[float, float, float, float]  # x, y, width, height


@dataclass(frozen=True, slots=True)
class Layout:
    """``image`` has the aspect ratio of the image, centered in the area beside the panels."""

    image: Rect
    side: Rect | None
    bar: Rect | None

    def pixel(self, x: float, y: float, size: tuple[int, int]) -> tuple[int, int] | None:
        """The image pixel (x, row from the top) at a window position; None outside the image."""
        left, top, width, height = self.image
        if not (width > 0 and height > 0 and left <= x < left + width and top <= y < top + height):
            return None
        return min(int((x - left) * size[0] / width), size[0] - 1), min(int((y - top) * size[1] / height), size[1] - 1)


def start_size(size: tuple[int, int]) -> tuple[int, int]:
    """Size of a new window for an image of ``size`` pixels: one point per pixel, a whole multiple for small images."""
    times = max(1, min((START[0] - SIDE) // size[0], (START[1] - BAR) // size[1]))
    return size[0] * times + SIDE, max(size[1] * times + BAR, MIN_START_HEIGHT)


def arrange(window: tuple[int, int], size: tuple[int, int], panels: bool) -> Layout:
    """Layout of a window for an image of ``size`` pixels.  In a window without area the image is empty."""
    width, height = window
    if width <= 0 or height <= 0:
        return Layout((0, 0, 0, 0), None, None)
    with_side = panels and width >= MIN_SIDE_WIDTH
    with_bar = panels and height >= 3 * BAR
    free_w = width - (SIDE if with_side else 0)
    free_h = height - (BAR if with_bar else 0)
    scale = min(free_w / size[0], free_h / size[1])
    if 1.0 < scale < 1.1:
        scale = 1.0  # exact pixels look better than a slight enlargement
    shown_w, shown_h = max(round(size[0] * scale), 1), max(round(size[1] * scale), 1)
    image = ((free_w - shown_w) // 2, (free_h - shown_h) // 2, shown_w, shown_h)
    side = (free_w, 0, SIDE, height) if with_side else None
    bar = (0, free_h, free_w, BAR) if with_bar else None
    return Layout(image, side, bar)
