"""Demo 6: nearest and bilinear sampling of history."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from taubench_gl.animation import View
from taubench_gl.conventions import Reason
from taubench_gl.demos import theory
from taubench_gl.demos.demo import Expected, Figure, Finding, Result, demo
from taubench_gl.demos.sheet import Sheet, enlarged, heat, note, painted, rgb
from taubench_gl.demos.stage import BRICK, CHALK, SAND, SEA, Props, Stage
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.scene.model import Camera, Scene
from taubench_gl.selftest.bench import MovingCamera, PairImages, limits
from taubench_gl.selftest.scenes import turn, turn_y

Array = np.ndarray
YFOV = np.radians(50.0)
JITTER = 0.3
SLANT = 20.0
FARTHEST = 0.10  # meters, end of the color scale


def scene() -> Scene:
    """A slanted board in front of a wall, and a side wall at a grazing angle.  Nothing moves."""
    b = Props()
    b.wall(14.0, 9.0, SEA, translation=(0, 0, -14))
    b.checkered(0.55, 6.0, (3, 30), (BRICK, SAND), translation=(-0.7, 0, -4), rotation=turn((0, 0, 1), SLANT))
    b.checkered(12.0, 9.0, (24, 18), (CHALK, SAND), translation=(2.2, 0, -12), rotation=turn_y(-90))
    b.light(translation=(-1.0, 1.5, 0.0), intensity=90.0)
    camera = b.camera(yfov=YFOV, znear=0.05)
    b.animate(camera, "translation", [0.0, 1.0], [(0, 0, 0), (0, 0, 0)])
    return b.build()


def camera() -> MovingCamera:
    """A static camera whose sub-pixel sample moves right by JITTER pixels, as for temporal antialiasing."""
    lens = Camera(yfov=YFOV, znear=0.05)
    return MovingCamera(lambda t: View(np.zeros(3), np.eye(3), lens, np.array([JITTER if t else 0.0, 0.0])))


def left_of_the_side_wall(size: tuple[int, int]) -> slice:
    """Columns that show the board and the wall but not the side wall."""
    focal = 0.5 * size[1] / np.tan(0.5 * YFOV)
    return slice(0, int(0.5 * size[0] + focal * 2.2 / 14.0) - 4)


def per_row(pair: PairImages) -> float:
    """Discarded pixels per row and edge of the board."""
    height, width = pair.mask.shape
    return float(pair.has(Reason.POSITION)[:, left_of_the_side_wall((width, height))].sum(axis=1).mean() / 2)


def distance(pair: PairImages, sampling: str) -> Array:
    """Distance between surface point and history sample, meters, (h, w), by the float64 reference of the masks."""
    return pair_masks(pair.current, pair.history, pair.pair, limits(None), sampling=sampling).distances["position"]


@demo(
    6,
    "sampling",
    "Nearest and bilinear sampling",
    idea="A reprojected position rarely coincides with a pixel center of the previous frame. The nearest pixel shows a "
    "point up to half a pixel away. The bilinear blend of four pixels is exact on planes, but at an edge it mixes "
    "foreground and background into a position where no surface is. Here nothing moves except the sub-pixel sample, so "
    "every discard is a sampling error.",
    look_for=(
        "Right, nearest: the error on the side wall grows with the grazing angle. Bilinear: no error.",
        "Left, bilinear: every edge is discarded, one pixel wide, without gaps.",
        "Left, nearest: only pixels of an edge whose nearest history pixel is on the other side.",
    ),
    scene=scene,
    see_also=(("how history is sampled", "conventions.md"),),
)
def run(stage: Stage, out: Path) -> Result:
    pairs = {s: stage.bench.pair(scene(), camera=camera(), sampling=s) for s in ("nearest", "bilinear")}
    color = stage.pair(scene(), columns=("frustum", "color")).now["color"][..., :3]
    width, height = stage.size
    part = (int(0.27 * width), int(0.35 * height), width // 7, height // 7)
    sheet = Sheet(2, 2, width / height)
    for row, (sampling, pair) in enumerate(pairs.items()):
        marked = painted(color, (pair.has(Reason.POSITION), rgb(Reason.POSITION)), strength=1.0)
        axes = sheet.panel(0, row, enlarged(marked, *part), f"{sampling}: an edge of the board, enlarged")
        note(axes, f"{per_row(pair):.2f} px discarded per edge; correct: 0")
        error = distance(pair, sampling)
        axes = sheet.panel(1, row, heat(error, FARTHEST), f"{sampling}: distance of the history sample, 0 to 10 cm")
        axes.add_patch(_frame(*part))
        wall = side_wall(pair)
        note(axes, f"side wall: {100 * np.median(error[wall]):.2f} cm (median)", at=(0.98, 0.03), ha="right")
    end = tuple(round(255 * c) for c in heat(np.array([[1.0]]), 1.0)[0, 0])
    sheet.legend([("discarded by position", rgb(Reason.POSITION)), ("10 cm or more", end)])
    path = sheet.save(out / "06-sampling.png")
    chance = 4.0 * np.sqrt(JITTER * (1 - JITTER) / (2.0 * height))
    where = "an edge crosses a row at a uniformly distributed position between two pixel centers"
    wall = side_wall(pairs["nearest"])
    predicted = 100.0 * float(np.median(sample_distance(stage.size)[wall]))
    findings = (
        Finding(per_row(pairs["bilinear"]), "px", "per edge are discarded with bilinear sampling",
                Expected.near(1.0, 2.0 / height + 0.02, f"{where}, always between two of the four pixels")),
        Finding(per_row(pairs["nearest"]), "px", "per edge are discarded with nearest sampling",
                Expected.near(JITTER, chance, f"{where}: in {JITTER} of all rows between point and nearest pixel")),
        Finding(100.0 * float(np.median(distance(pairs["nearest"], "nearest")[wall])), "cm",
                "is the distance of the nearest history sample on the side wall (median)",
                Expected.near(predicted, 0.02 * predicted, f"two rays {JITTER} pixels apart against the wall; ± 2 %")),
    )  # fmt: skip
    caption = f"A static scene with samples {JITTER} pixels apart in the two frames. Every discard is a sampling error."
    return Result(findings, (Figure(path, caption, {"position": rgb(Reason.POSITION), "10 cm": end}),))


def side_wall(pair: PairImages) -> Array:
    """Pixels of the side wall whose neighbors also show it.  (h, w) bool."""
    wall = pair.surface & (np.abs(pair.current["normal"][..., 0]) > 0.9)
    inner = wall.copy()
    inner[:, 2:-2] &= wall[:, :-4] & wall[:, 4:]
    inner[:, :2] = inner[:, -2:] = False
    return inner


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


def _frame(left: int, top: int, width: int, height: int) -> object:
    from matplotlib.patches import Rectangle

    return Rectangle((left, top), width, height, fill=False, edgecolor="white", linewidth=1.6)
