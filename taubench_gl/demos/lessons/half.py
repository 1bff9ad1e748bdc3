"""Demo 5: motion vectors in half floats."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from taubench_gl.conventions import FRUSTUM
from taubench_gl.demos.demo import Expected, Figure, Finding, Result, demo
from taubench_gl.demos.props import Props, hall
from taubench_gl.demos.sheet import BLUE, ORANGE, PAPER, Sheet, heat, note
from taubench_gl.demos.stage import Stage
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.bench import pixel_grid
from taubench_gl.selftest.scenes import IDENTITY, turn

Array = np.ndarray
YFOV = np.radians(60.0)
ROLL = 50.0
WRONG, KEPT = (213, 94, 0), (52, 54, 58)


def scene() -> Scene:
    """The hall under a camera that rolls: motion grows from 0 in the middle to hundreds of pixels in the corners."""
    b = Props()
    hall(b)
    camera = b.camera(translation=(0.0, 0.0, 1.2), yfov=YFOV, znear=0.05)
    b.animate(camera, "rotation", [0.0, 1.0], [IDENTITY, turn((0, 0, 1), ROLL)])
    return b.build()


def half_step(motion: Array) -> Array:
    """Distance of neighbouring half floats at ``motion``: 2^-10 of the power of two below it (11 bits of precision)."""
    _, exponent = np.frexp(np.abs(np.asarray(motion, dtype=np.float64)))
    return np.exp2(np.maximum(exponent - 1, -14) - 10.0)


def texels(motion: Array) -> Array:
    """Pixels that ``nearest`` sampling reads, (h, w, 2) int."""
    size = motion.shape[1::-1]
    return np.floor(pixel_grid(size) + motion.astype(np.float64) + 0.5).astype(int)


@demo(
    5,
    "half",
    "Motion vectors in half floats",
    idea="Half floats save memory, and 11 bits of precision are plenty for a colour. For a motion of some hundred "
    "pixels they are not: from 256 pixels on the steps are a quarter of a pixel, so fast pixels read their "
    "history beside where it is. Store motion in full floats, or relative to the size of the screen and with "
    "enough bits.",
    look_for=(
        "Top right: terraces. The error doubles with every power of two of the motion: 32, 64, 128 pixels.",
        "Bottom left: pixels that read a different pixel of the last frame because of it.",
        "Bottom right: measured errors touch the staircase of half a step and never cross it.",
    ),
    scene=scene,
)
def run(stage: Stage, out: Path) -> Result:
    pair = stage.pair(scene(), columns=("frustum", "color"))
    kept = ~pair.has(FRUSTUM)
    half = pair.motion.astype(np.float16).astype(np.float32)
    error = np.where(kept[..., None], np.abs(half - pair.motion), np.nan)
    other = kept & (texels(half) != texels(pair.motion)).any(axis=-1)
    steps = half_step(pair.motion)
    top = float(np.nanmax(error))
    sheet = Sheet(2, 2, stage.size[0] / stage.size[1])
    axes = sheet.panel(
        0, 0, np.where(kept[..., None], pair.now["color"][..., :3], 0.86), f"the camera rolled by {ROLL:g}°"
    )
    note(axes, f"motion up to {np.abs(pair.motion[kept]).max():.0f} px")
    worst = np.max(error, axis=-1)
    axes = sheet.panel(1, 0, heat(worst, top), f"error of a half-float motion vector: 0 to {top:.3f} px")
    note(axes, "brighter: larger")
    dots = np.where(other[..., None], np.array(WRONG) / 255, np.where(kept[..., None], np.array(KEPT) / 255, 0.86))
    axes = sheet.panel(0, 1, dots, "pixels whose history is read elsewhere")
    share = 100.0 * float(other.sum() / kept.sum())
    note(axes, f"{share:.2f} % of the reusable pixels")
    _staircase(sheet, np.abs(pair.motion[kept]).ravel(), error[kept].ravel())
    sheet.legend([("reads another pixel", WRONG), ("reads the same pixel", KEPT)])
    path = sheet.save(out / "05-half.png")
    flips = steps[kept] / 2.0
    law = 100.0 * float(1.0 - np.mean(np.prod(1.0 - flips, axis=-1)))
    chance = 100.0 * 5.0 * np.sqrt(law / 100.0 / kept.sum())
    findings = (
        Finding(share, "%", "of the reusable pixels read another pixel of the last frame",
                Expected.near(law, chance, "the middle between two pixels is a half float itself: what lies up to half "
                              "a step before it is rounded onto it, a chance of step / 2 per axis; ± 5 deviations")),
        Finding(float(np.nanmax(error / (0.5 * steps))), "half steps", "is the largest error of any motion vector",
                Expected.between(0.9, 1.0, "rounding to nearest: half a step at most, and some come close", 3), 3),
    )  # fmt: skip
    caption = "Motion of a rolling camera stored as half floats: where it is wrong, by how much, and whom it hurts."
    return Result(findings, (Figure(path, caption, {"reads another pixel": WRONG}),))


def _staircase(sheet: Sheet, motion: Array, error: Array) -> None:
    """Errors against motion, with the largest possible error."""
    left, top = 720.0, sheet.grid_bottom - 292
    axes = sheet.plot(
        left, top, 525, 236, xlabel="motion along one axis, pixels", ylabel="error, pixels",
        title="never more than half a step",
    )  # fmt: skip
    pick = np.linspace(0, len(motion) - 1, min(len(motion), 12000)).astype(int)
    axes.scatter(
        motion[pick], error[pick], s=2, color=BLUE, alpha=0.35, linewidths=0, rasterized=True, label="measured"
    )
    line = np.linspace(1.0, motion.max(), 3000)
    axes.plot(line, 0.5 * half_step(line), color=ORANGE, linewidth=2, label="half a step")
    legend = axes.legend(fontsize=11, loc="upper left", facecolor=PAPER, edgecolor="none", framealpha=0.9)
    for handle in legend.legend_handles[:1]:
        handle.set(sizes=[30], alpha=1.0)
