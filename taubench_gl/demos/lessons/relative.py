"""Demo 4: float32 world coordinates a thousand kilometers from the origin."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from taubench_gl.conventions import FRUSTUM
from taubench_gl.demos.demo import Expected, Figure, Finding, Result, demo
from taubench_gl.demos.sheet import BLUE, ORANGE, Sheet, heat, note
from taubench_gl.demos.stage import Props, Stage, hall
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.bench import PairImages
from taubench_gl.selftest.scenes import turn_y

Array = np.ndarray
FAR = 1e6


def scene(meters: float = FAR) -> Scene:
    """The hall ``meters`` from the origin along each axis; the camera moves and turns slightly."""
    b = Props()
    hall(b)
    camera = b.camera(yfov=np.radians(60.0), znear=0.0625)
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 0.0, 1.5), (0.125, 0.0, 1.25)])
    b.animate(camera, "rotation", [0.0, 1.0], [turn_y(0.0), turn_y(3.0)])
    return _moved(b.build(), meters)


def _moved(built: Scene, meters: float) -> Scene:
    """The scene with all roots translated; keys are dyadic, so the float64 sums are exact."""
    by = np.full(3, meters)
    roots = built.nodes.parent < 0
    nodes = dataclasses.replace(built.nodes, translation=built.nodes.translation + np.where(roots[:, None], by, 0.0))
    channels = tuple(
        dataclasses.replace(c, values=c.values + by) if c.path == "translation" and roots[c.index] else c
        for c in built.channels
    )
    return dataclasses.replace(built, nodes=nodes, channels=channels)


def step_at(meters: float) -> float:
    """Spacing of float32 numbers at ``meters``."""
    return float(np.spacing(np.float32(meters)))


def extends(pair: PairImages) -> Array:
    """Pixels and axes along which the surface extends, so that its coordinate varies.  (h, w, 3) bool."""
    return pair.surface[..., None] & (np.abs(pair.current["normal"][..., :3]) < 0.5)


def in_world_floats(pair: PairImages, eye: Array) -> Array:
    """The current positions rounded to float32 in world space.  (h, w, 4) float64."""
    position = pair.current["position"].astype(np.float64)
    rounded = (position[..., :3] + eye).astype(np.float32) - eye
    return np.concatenate([np.where(pair.surface[..., None], rounded, 0.0), position[..., 3:]], axis=-1)


def previous_px(pair: PairImages, position: Array) -> Array:
    """Eq. (3): positions relative to the current camera -> previous image.  (h, w, 4) -> (h, w, 2) pixels."""
    q = position[..., :3] + pair.pair.camera_delta
    x, y, w = (q @ pair.pair.prev_clip_from_prev[i, :3] for i in (0, 1, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack([x / w, y / w], axis=-1) * 0.5 * np.array([pair.pair.width, pair.pair.height])


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def expected_motion_error(pair: PairImages, step: float) -> Array:
    """Standard deviation of the motion error, pixels, to first order.  (h, w).

    Each axis has a uniform error within ± step / 2, so this is the derivative of Eq. (3) with respect to the position
    times step / sqrt(12), over the axes that vary.
    """
    q = pair.current["position"][..., :3] + pair.pair.camera_delta
    rows = pair.pair.prev_clip_from_prev[:, :3]
    x, y, w = (q @ rows[i] for i in (0, 1, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = [
            0.5 * side * (rows[i] - (value / w)[..., None] * rows[3])
            / w[..., None] for i, value, side in ((0, x, pair.pair.width), (1, y, pair.pair.height))
        ]  # fmt: skip
    return step / np.sqrt(12) * np.sqrt(sum(np.sum(np.square(s) * extends(pair), axis=-1) for s in slopes))


@demo(
    4,
    "relative",
    "Why positions are stored relative to the camera",
    idea="A float32 has 24 bits of precision. Near the origin its spacing is below a micrometer; a million meters away "
    "it is 6 cm, and every position is rounded to that grid. If the camera position is subtracted in float64 first, "
    "the GPU only handles small numbers, wherever the scene is.",
    look_for=(
        "Top right: steps in the error of a stored position, up to 3 cm along each axis.",
        "Bottom left: after reprojection these centimeters are pixels, most of all near the camera.",
        "Bottom right: camera-relative motion equals that of the hall at the origin, bit for bit.",
    ),
    scene=scene,
    see_also=(("the self-test cases offset-1e3, 1e6 and 1e9", "hard-cases.md"),),
)
def run(stage: Stage, out: Path) -> Result:
    here, there = (stage.bench.pair(scene(meters)) for meters in (0.0, FAR))
    image = stage.pair(scene(), columns=("frustum", "color")).now["color"][..., :3]
    moved = in_world_floats(there, there.view.position)
    position = there.current["position"].astype(np.float64)
    shift = (moved - position)[..., :3]
    seen = there.surface & ~there.has(FRUSTUM)
    false = np.where(seen[..., None], previous_px(there, moved) - previous_px(there, position), 0.0)
    ours = np.linalg.norm(there.motion - here.motion, axis=-1)
    top = 3.0 * stage.size[1] / 270  # pixels, end of the color scale
    sheet = Sheet(2, 2, stage.size[0] / stage.size[1])
    sheet.panel(0, 0, image, "the hall, a million meters from the origin")
    axes = sheet.panel(
        1, 0, heat(100 * np.linalg.norm(shift, axis=-1), 5.0), "error of float32 world positions: 0 to 5 cm"
    )
    note(axes, f"{100 * rms(shift[extends(there)]):.2f} cm along an axis (RMS)")
    for column, error, title in (
        (0, np.linalg.norm(false, axis=-1), f"error of motion from world positions: 0 to {top:.2g} px"),
        (1, ours, f"error of camera-relative motion: 0 to {top:.2g} px"),
    ):
        axes = sheet.panel(column, 1, heat(error, top), title)
        note(axes, f"{rms(error[seen]):.2f} px (RMS)")
    colors = [tuple(round(255 * c) for c in heat(np.array([[v]]), 1.0)[0, 0]) for v in (0.0, 0.5, 1.0)]
    sheet.legend(list(zip(("no error", "half of the scale", "end of the scale or more"), colors)))
    path = sheet.save(out / "04-relative.png")
    curve = _curve(there, out)
    step = step_at(FAR)
    predicted = rms(expected_motion_error(there, step)[seen])
    findings = (
        Finding(1000.0 * rms(shift[extends(there)]), "mm", "is the error (RMS) of a float32 world position per axis",
                Expected.near(1000.0 * step / np.sqrt(12), 50.0 * step / np.sqrt(12),
                              "uniform rounding to a spacing of 62.5 mm: spacing / sqrt(12); ± 5 %", 1), 1),
        Finding(float(np.count_nonzero(ours) + np.count_nonzero(there.mask != here.mask)), "pixels",
                "differ in camera-relative motion or masks from the hall at the origin",
                Expected.near(0.0, 0.0, "all keys are dyadic: every float64 difference is exact", 0), 0),
        Finding(rms(np.linalg.norm(false, axis=-1)[seen]), "px", "is the error (RMS) of motion from such positions",
                Expected.near(predicted, 0.05 * predicted, "derivative of Eq. (3) times spacing / sqrt(12); ± 5 %")),
    )  # fmt: skip
    return Result(
        findings,
        (
            Figure(path, "The hall at 1000 km: errors of float32 world positions and of the motion from them.",
                   dict(zip(("no error", "half", "end"), colors))),
            Figure(curve, "Rounding error of a stored world position as a function of the distance from the origin."),
        ),
    )  # fmt: skip


def _curve(pair: PairImages, out: Path) -> Path:
    """Plot of the RMS rounding error of world positions against the distance."""
    meters = [10.0**i for i in range(2, 8)]
    eye, position = pair.view.position - FAR, pair.current["position"][..., :3]
    found = [rms((in_world_floats(pair, eye + m)[..., :3] - position)[extends(pair)]) for m in meters]
    sheet = Sheet(1, 0, 1.0, below=400, legend=False)
    axes = sheet.plot(
        96, 40, 1140, 290, xscale="log", yscale="log", xlabel="distance from the origin, meters",
        ylabel="error along an axis, meters", title="Error of float32 world coordinates",
    )  # fmt: skip
    line = np.logspace(2, 7, 2000)
    axes.plot(line, [step_at(m) / np.sqrt(12) for m in line], color=BLUE, linewidth=2, label="theory")
    axes.plot(meters, found, "o", color=ORANGE, markersize=9, markeredgecolor="black", label="measured, RMS")
    axes.axhline(32 / 255, color="#444", linewidth=1, linestyle="--")
    axes.text(110, 32 / 255 * 1.3, "the paper's position threshold, 32/255 m", fontsize=12)
    axes.legend(frameon=False, fontsize=12, loc="lower right")
    return sheet.save(out / "04-relative-curve.png")
