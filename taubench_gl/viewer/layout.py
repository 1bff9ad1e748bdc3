"""Where picture and panels go in the window: beside each other, never over each other.  Window points, y down."""

from __future__ import annotations

from dataclasses import dataclass

SIDE, BAR = 300, 64
"""Width of the side panel, height of the bar under the picture."""
LEAST_SIDE_WINDOW = 480
"""Narrower windows have no room for a side panel."""

START = (1600, 960)
"""A new window is not made larger than this to show small pictures larger."""
LEAST_START = 640
"""Height at which a new window shows most of its side panel."""

Rect = tuple[float, float, float, float]  # x, y, width, height


@dataclass(frozen=True, slots=True)
class Layout:
    """``picture`` has the picture's own aspect, in the middle of what the panels leave."""

    picture: Rect
    side: Rect | None
    bar: Rect | None

    def pixel(self, x: float, y: float, size: tuple[int, int]) -> tuple[int, int] | None:
        """The picture's pixel (x, row from the top) at a place of the window; None outside the picture."""
        left, top, width, height = self.picture
        if not (width > 0 and height > 0 and left <= x < left + width and top <= y < top + height):
            return None
        return min(int((x - left) * size[0] / width), size[0] - 1), min(int((y - top) * size[1] / height), size[1] - 1)


def start_size(size: tuple[int, int]) -> tuple[int, int]:
    """The window a picture of ``size`` pixels is first shown in: pixel for pixel, small pictures two or more times."""
    times = max(1, min((START[0] - SIDE) // size[0], (START[1] - BAR) // size[1]))
    return size[0] * times + SIDE, max(size[1] * times + BAR, LEAST_START)


def arrange(window: tuple[int, int], size: tuple[int, int], panels: bool) -> Layout:
    """The layout of a window for a picture of ``size`` pixels.  A window without area has an empty picture."""
    width, height = window
    if width <= 0 or height <= 0:
        return Layout((0, 0, 0, 0), None, None)
    with_side = panels and width >= LEAST_SIDE_WINDOW
    with_bar = panels and height >= 3 * BAR
    room_w = width - (SIDE if with_side else 0)
    room_h = height - (BAR if with_bar else 0)
    scale = min(room_w / size[0], room_h / size[1])
    if 1.0 < scale < 1.1:
        scale = 1.0  # pixel for pixel looks better than a little larger
    shown_w, shown_h = max(round(size[0] * scale), 1), max(round(size[1] * scale), 1)
    picture = ((room_w - shown_w) // 2, (room_h - shown_h) // 2, shown_w, shown_h)
    side = (room_w, 0, SIDE, height) if with_side else None
    bar = (0, room_h, room_w, BAR) if with_bar else None
    return Layout(picture, side, bar)
