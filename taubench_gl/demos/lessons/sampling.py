"""Demo 6: nearest and bilinear sampling of history."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from taubench_gl.animation import View
from taubench_gl.conventions import Reason
from taubench_gl.demos import theory
from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, Screens
from taubench_gl.demos.sheet import BLUE, RED, Sheet, enlarged, enlarged_frames, painted, rgb
from taubench_gl.demos.stage import BRICK, CHALK, LEAF, SAND, Props, Stage, built, focal_px
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.scene.builder import turn, turn_y
from taubench_gl.scene.model import Camera
from taubench_gl.selftest.bench import MovingCamera, PairImages, limits

YFOV = np.radians(50.0)
JITTER = 0.3
PAGE_HEIGHT = 270
SLANT = 20.0


@built
def scene(b: Props) -> None:
    """A slanted board in front of a wall, and a side wall at a grazing angle.  Nothing moves.

    The camera of the file turns by what is JITTER pixels in an image of PAGE_HEIGHT rows, for page and viewer.
    """
    b.wall(14.0, 9.0, LEAF, translation=(0, 0, -14))
    b.checkered(0.55, 6.0, (3, 30), (BRICK, SAND), translation=(-0.7, 0, -4), rotation=turn((0, 0, 1), SLANT))
    b.checkered(12.0, 9.0, (24, 18), (CHALK, SAND), translation=(2.2, 0, -12), rotation=turn_y(-90))
    b.light(translation=(-1.0, 1.5, 0.0), intensity=90.0)
    camera = b.camera(yfov=YFOV, znear=0.05)
    b.animate(camera, "rotation", [0.0, 1.0], [turn_y(0.0), turn_y(-np.degrees(JITTER / focal_px(YFOV, PAGE_HEIGHT)))])


def camera(jitter: float = JITTER) -> MovingCamera:
    """A static camera whose sub-pixel sample moves right by ``jitter`` pixels, as for temporal antialiasing."""
    lens = Camera(yfov=YFOV, znear=0.05)
    return MovingCamera(lambda t: View(np.zeros(3), np.eye(3), lens, np.array([jitter if t else 0.0, 0.0])))


def left_of_the_side_wall(size: tuple[int, int]) -> slice:
    """The columns of an image that show the board and the wall but not the side wall."""
    return slice(0, int(0.5 * size[0] + focal_px(YFOV, size[1]) * 2.2 / 14.0) - 4)


def per_row(pair: PairImages) -> float:
    """The mean number of discarded pixels per row and edge of the board."""
    height, width = pair.mask.shape
    return float(pair.has(Reason.POSITION)[:, left_of_the_side_wall((width, height))].sum(axis=1).mean() / 2)


def distance(pair: PairImages, sampling: str) -> Array:
    """Distance between surface point and history sample, meters, (h, w), by the float64 reference of the masks."""
    return pair_masks(pair.current, pair.history, pair.pair, limits(None), sampling=sampling).distances["position"]


def run(stage: Stage, lesson: Lesson) -> Measured:
    """The discards of nearest and of bilinear sampling, and the distance of the history sample on the side wall."""
    pairs = {s: stage.bench.pair(scene(), camera=camera(), sampling=s) for s in ("nearest", "bilinear")}
    color, sheet = lesson.pair.now["color"][..., :3], lesson.sheet
    width, height = stage.size
    part = (int(0.27 * width), int(0.35 * height), width // 7, height // 7)
    details = {}
    for place, (sampling, pair) in enumerate(pairs.items()):
        title = f"{sampling}: an edge of the board, {part[2]} x {part[3]} pixels"
        details[sampling] = enlarged(discarded(color, pair), *part)
        sheet.panel(place, 0, details[sampling], title, f"{per_row(pair):.2f} px discarded per edge; correct: 0")
    _plot(sheet, pairs, height // 2)
    wall = side_wall(pairs["nearest"])
    predicted = 100.0 * float(np.median(sample_distance(stage.size)[wall]))
    numbers = {
        "bilinear": (per_row(pairs["bilinear"]), Expected.near(1.0, 2.0 / height + 0.02)),
        "nearest": (
            per_row(pairs["nearest"]),
            Expected.near(JITTER, 4.0 * theory.share_deviation(JITTER, 2.0 * height)),
        ),
        "side_wall": (
            100.0 * float(np.median(distance(pairs["nearest"], "nearest")[wall])),
            Expected.near(predicted, 0.02 * predicted),
        ),
    }

    def at(jitter: float) -> tuple[Array, float, float, float]:
        """With an offset of ``jitter`` pixels: the discards of nearest sampling."""
        pair = stage.bench.pair(scene(), camera=camera(jitter), sampling="nearest")
        slack = 4.0 * theory.share_deviation(jitter, 2.0 * height)
        return enlarged(discarded(color, pair), *part), per_row(pair), jitter, slack

    screens = Screens(details["bilinear"], enlarged_frames(lesson.pair, *part))
    return Measured(numbers, lesson.swept(at), screens)


def _plot(sheet: Sheet, pairs: Mapping[str, PairImages], row: int) -> None:
    """Plot the distance of the history sample on the side wall along a row of pixels."""
    wall = side_wall(pairs["nearest"])[row]
    columns = np.nonzero(wall)[0]
    axes = sheet.plot("distance")
    size = pairs["nearest"].mask.shape[::-1]
    axes.plot(columns, 100.0 * sample_distance(size)[row, columns], color="#777777", linewidth=5, alpha=0.5,
              label="theory, nearest: two rays")  # fmt: skip
    for sampling, color in (("nearest", RED), ("bilinear", BLUE)):
        axes.plot(columns, 100.0 * distance(pairs[sampling], sampling)[row, columns], color=color, linewidth=2,
                  label=sampling)  # fmt: skip


def discarded(color: Array, pair: PairImages) -> Array:
    """The pixels that position discards, in color over the gray image ``color`` (h, w, 3).  (h, w, 3) uint8."""
    return painted(color, (pair.has(Reason.POSITION), rgb(Reason.POSITION)), strength=1.0)


def side_wall(pair: PairImages) -> Array:
    """Pixels of the side wall whose neighbors also show it.  (h, w) bool."""
    wall = pair.surface & (np.abs(pair.current["normal"][..., 0]) > 0.9)
    from scipy.ndimage import binary_erosion

    return binary_erosion(wall, [[True, False, True, False, True]])


def sample_distance(size: tuple[int, int]) -> Array:
    """Distance between the points of the side wall, x = 2.2, at two samples JITTER pixels apart.  (h, w) meters.

    The jittered sample of column i lies at i + JITTER; the history's at i.
    """
    rays = theory.pixel_rays(size, YFOV)
    shifted = rays.copy()
    shifted[..., 0] += JITTER * (rays[0, 1, 0] - rays[0, 0, 0])
    with np.errstate(divide="ignore"):
        a, b = (2.2 * r / r[..., :1] for r in (rays, shifted))
    return np.linalg.norm(a - b, axis=-1)
