"""Demo 5: motion vectors in 16-bit floats."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from taubench_gl.conventions import FRUSTUM
from taubench_gl.demos.demo import Expected, Figure, Finding, Result, demo
from taubench_gl.demos.sheet import BLUE, ORANGE, PAPER, Sheet, heat, note
from taubench_gl.demos.stage import Props, Stage, hall
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.bench import pixel_grid
from taubench_gl.selftest.scenes import IDENTITY, turn

Array = np.ndarray
YFOV = np.radians(60.0)
ROLL = 50.0
WRONG, RIGHT = (213, 94, 0), (52, 54, 58)


def scene() -> Scene:
    """The hall and a rolling camera: motion grows from 0 at the center to hundreds of pixels in the corners."""
    b = Props()
    hall(b)
    camera = b.camera(translation=(0.0, 0.0, 1.2), yfov=YFOV, znear=0.05)
    b.animate(camera, "rotation", [0.0, 1.0], [IDENTITY, turn((0, 0, 1), ROLL)])
    return b.build()


def half_step(motion: Array) -> Array:
    """Spacing of 16-bit floats at ``motion``: 2^-10 of the power of two below it (11 bits of precision)."""
    _, exponent = np.frexp(np.abs(np.asarray(motion, dtype=np.float64)))
    return np.exp2(np.maximum(exponent - 1, -14) - 10.0)


def texels(motion: Array) -> Array:
    """Pixels that nearest sampling reads, (h, w, 2) int."""
    size = motion.shape[1::-1]
    return np.floor(pixel_grid(size) + motion.astype(np.float64) + 0.5).astype(int)


@demo(
    5,
    "half",
    "Motion vectors in 16-bit floats",
    idea="16-bit floats save memory, and their 11 bits of precision are enough for a color. They are not enough for "
    "motion of several hundred pixels: above 256 pixels the spacing is a quarter of a pixel, so fast pixels read the "
    "wrong history pixel. Store motion in 32-bit floats, or normalized to the screen size with enough bits.",
    look_for=(
        "Top right: steps. The error doubles at every power of two of the motion: 32, 64, 128 pixels.",
        "Bottom left: pixels that read another pixel of the previous frame because of the error.",
        "Bottom right: measured errors reach half of the spacing and never exceed it.",
    ),
    scene=scene,
)
def run(stage: Stage, out: Path) -> Result:
    pair = stage.pair(scene(), columns=("frustum", "color"))
    reusable = ~pair.has(FRUSTUM)
    half = pair.motion.astype(np.float16).astype(np.float32)
    error = np.where(reusable[..., None], np.abs(half - pair.motion), np.nan)
    other = reusable & (texels(half) != texels(pair.motion)).any(axis=-1)
    steps = half_step(pair.motion)
    top = float(np.nanmax(error))
    sheet = Sheet(2, 2, stage.size[0] / stage.size[1])
    axes = sheet.panel(
        0, 0, np.where(reusable[..., None], pair.now["color"][..., :3], 0.86), f"the camera rolled by {ROLL:g}°"
    )
    note(axes, f"motion up to {np.abs(pair.motion[reusable]).max():.0f} px")
    worst = np.max(error, axis=-1)
    axes = sheet.panel(1, 0, heat(worst, top), f"error of a 16-bit motion vector: 0 to {top:.3f} px")
    note(axes, "brighter: larger")
    dots = np.where(other[..., None], np.array(WRONG) / 255, np.where(reusable[..., None], np.array(RIGHT) / 255, 0.86))
    axes = sheet.panel(0, 1, dots, "pixels that read another history pixel")
    share = 100.0 * float(other.sum() / reusable.sum())
    note(axes, f"{share:.2f} % of the reusable pixels")
    _staircase(sheet, np.abs(pair.motion[reusable]).ravel(), error[reusable].ravel())
    sheet.legend([("another pixel", WRONG), ("same pixel", RIGHT)])
    path = sheet.save(out / "05-half.png")
    flips = steps[reusable] / 2.0
    law = 100.0 * float(1.0 - np.mean(np.prod(1.0 - flips, axis=-1)))
    chance = 100.0 * 5.0 * np.sqrt(law / 100.0 / reusable.sum())
    findings = (
        Finding(share, "%", "of the reusable pixels read another pixel of the previous frame",
                Expected.near(law, chance, "the midpoint of two pixels is a 16-bit float: motion up to half a spacing "
                              "below it rounds to it, a probability of spacing / 2 per axis; ± 5 sigma")),
        Finding(float(np.nanmax(error / (0.5 * steps))), "half spacings", "is the largest error of any motion vector",
                Expected.between(0.9, 1.0, "rounding to nearest: at most half a spacing, nearly reached", 3), 3),
    )  # fmt: skip
    caption = "Motion vectors of a rolling camera in 16-bit floats: error, and pixels that read the wrong history."
    return Result(findings, (Figure(path, caption, {"another pixel": WRONG}),))


def _staircase(sheet: Sheet, motion: Array, error: Array) -> None:
    """Errors against motion, with the largest possible error."""
    left, top = 720.0, sheet.grid_bottom - 292
    axes = sheet.plot(
        left, top, 525, 236, xlabel="motion along one axis, pixels", ylabel="error, pixels",
        title="at most half a spacing",
    )  # fmt: skip
    pick = np.linspace(0, len(motion) - 1, min(len(motion), 12000)).astype(int)
    axes.scatter(
        motion[pick], error[pick], s=2, color=BLUE, alpha=0.35, linewidths=0, rasterized=True, label="measured"
    )
    line = np.linspace(1.0, motion.max(), 3000)
    axes.plot(line, 0.5 * half_step(line), color=ORANGE, linewidth=2, label="half a spacing")
    legend = axes.legend(fontsize=11, loc="upper left", facecolor=PAPER, edgecolor="none", framealpha=0.9)
    for handle in legend.legend_handles[:1]:
        handle.set(sizes=[30], alpha=1.0)
