"""The paper's Figures 1 and 2, drawn of a scene of the tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import CameraTrack, View, camera_of_run, sample
from taubench_gl.animation.state import FrameState
from taubench_gl.conventions import FRUSTUM, Reason
from taubench_gl.demos.sheet import VIOLET, Sheet, checkerboard, note, overlay, painted, reason_entries, rgb
from taubench_gl.evaluation import Observers, Pair, evaluate_scene
from taubench_gl.evaluation.exact import Reasons, misregistered
from taubench_gl.features import BY_BIT, GEOMETRY
from taubench_gl.frame.passes.visibility import CHANNEL as VISIBILITY
from taubench_gl.report.labels import lighting_text
from taubench_gl.run import Run
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray

SIZE = (480, 270)
"""Largest size of a panel, pixels."""

DEGREES = 25.0
TURNS = {"pitch": ("upwards", (1.0, 0.0, 0.0)), "yaw": ("to the left", (0.0, 1.0, 0.0)), "roll": ("", (0.0, 0.0, 1.0))}
STILL_FPS = 1e3
"""Rate of Figure 1: the scene moves by a thousandth of a second while the camera rotates."""

MISREGISTERED = "misregistered"

SPP = 64
"""Most samples per pixel of path-traced light in the figures."""

COLUMNS = {feature.name: feature.details or (feature.bit,) for feature in BY_BIT if feature.rates}
"""The features of Figure 2 with the reasons in its masks."""


@dataclass(frozen=True, slots=True)
class Rotated:
    """A camera that stands as ``track`` at its start, and is rotated by DEGREES about a local axis afterwards."""

    track: CameraTrack
    axis: tuple[float, float, float]
    start: FrameState
    name: str = "rotated camera"

    def describe(self) -> str:
        """The camera in words, for the summary."""
        return f"{self.track.describe()}, rotated by {DEGREES:g} degrees"

    def view_at(self, state: FrameState) -> View:
        """The view at a frame, rotated unless it is the first."""
        view = self.track.view_at(self.start)
        if state.time <= self.start.time:
            return view
        turn = math3d.mat3_from_quat(math3d.quat_from_axis_angle(np.array(self.axis), math.radians(DEGREES)))
        return replace(view, world_from_view=view.world_from_view @ turn)


@dataclass(frozen=True, slots=True)
class _Shown:
    """The images of a pair and its mask."""

    now: Array  # (h, w, 3) in [0, 1]
    before: Array
    mask: Array  # (h, w) uint32
    wrong: Array | None = None  # (h, w) bool: misregistered in a column of geometry


def figure_1(scene: Scene, settings: Settings, path: Path) -> Path:
    """History that remains after a rotation by 25 degrees about each axis, at the first frame of the run.

    ``settings``: of the images.  Writes a PNG.  Raises TaubenchError.
    """
    begin = round((settings.sequence.frames[0] or 0) / settings.sequence.fps * STILL_FPS)
    track, start = (
        camera_of_run(scene, settings.sequence, settings.metrics.unit_scale),
        sample(scene, begin / STILL_FPS, STILL_FPS),
    )
    small = _small(settings, ("frustum", "color"), (begin, begin + 2), STILL_FPS)
    width, height = panel_size(settings)
    sheet = Sheet(2, 2, width / height)
    for place, (axis, (way, vector)) in enumerate(TURNS.items(), start=1):
        shown, _ = _pair(scene, small, Rotated(track, vector, start))
        if place == 1:
            sheet.panel(0, 0, shown.before, f"previous frame: {scene.name}")
        lost = (shown.mask & np.uint32(int(FRUSTUM))) != 0
        image = checkerboard(shown.now, lost, max(width // 60, 1))
        axes = sheet.panel(place % 2, place // 2, image, " ".join(filter(None, (f"{axis}, 25°", way))))
        note(axes, f"{100 * lost.mean():.1f} % without history")
    sheet.legend([("checkerboard: outside the previous image", (237, 237, 237))])
    return sheet.save(path)


def figure_2(scene: Scene, run: Run, settings: Settings, path: Path) -> Path:
    """The masks of position, normal, direct and indirect, each in the pair that shows most of it without a cut.

    ``run``: of the images, whose rows select the pairs.  Writes a PNG.  Raises TaubenchError.
    """
    width, height = panel_size(settings)
    sheet = Sheet(len(COLUMNS), 3, width / height)
    used: list[Reason] = []
    for place, (feature, reasons) in enumerate(COLUMNS.items()):
        frame = telling_pair(run.frames, feature)
        if frame is None:
            sheet.panel(place, 0, np.full((height, width, 3), 0.9), f"{feature}: not measured")
            continue
        columns = tuple(dict.fromkeys(("frustum", "position", feature, "color")))
        shown, run_of_pair = _pair(scene, _small(settings, columns, (frame - 1, frame + 1)), column=feature)
        percent = (run_of_pair.summary["discard"][feature] or {}).get("mean_percent")
        sheet.panel(place, 0, shown.before, f"{feature}: frame {frame - 1}")
        sheet.panel(place, 1, shown.now, f"frame {frame}")
        value = "not measured" if percent is None else f"mask: {percent:.1f} % discarded"
        panel = sheet.panel(place, 2, _mask_image(shown, reasons), value)
        if shown.wrong is not None:
            note(panel, f"{100 * shown.wrong.mean():.1f} % misregistered")
        used += reasons
    sheet.legend([*reason_entries(*used), (MISREGISTERED, rgb(VIOLET))])
    return sheet.save(path)


def _mask_image(shown: _Shown, reasons: Sequence[Reason]) -> Array:
    """The mask in the colors of ``reasons``, misregistered pixels in their own."""
    if shown.wrong is None:
        return overlay(shown.mask, shown.now, *reasons)
    image = overlay(np.where(shown.wrong, np.uint32(0), shown.mask), shown.now, *reasons)
    image[shown.wrong] = painted(shown.now, (shown.wrong, rgb(VIOLET)))[shown.wrong]
    return image


def telling_pair(rows: Sequence[Mapping[str, Any]], feature: str) -> int | None:
    """Frame of the pair with the most discards of ``feature`` among the half with the fewest of frustum, cuts left out.

    None where the feature was not measured.
    """
    usable = [row for row in rows if row.get(feature) is not None and not row.get("camera_cut")]
    calm = sorted(usable, key=lambda row: row["frustum"])[: max((len(usable) + 1) // 2, 1)]
    return max(calm, key=lambda row: (row[feature], -row["frame"]))["frame"] if calm else None


def caption_1(label: str) -> str:
    """The caption of Figure 1; ``label``: the scene."""
    return (
        f"As Figure 1 of the paper, of {label}: the first frame, and the camera rotated by 25 degrees in pitch, yaw "
        "and roll. The checkerboard shows pixels without history."
    )


def caption_2(label: str, run: Run) -> str:
    """The caption of Figure 2; ``label``: the scene; ``run``: of the images, for their light."""
    return (
        f"As Figure 2 of the paper, of {label}: two frames and the mask of each feature, in the pair that shows most "
        f"of it among the half of the pairs with the fewest frustum discards ({lighting_text(run.summary)}). "
        "Misregistered: position or normal discards the pixel although a ray finds that the previous camera saw its "
        "surface point, which did not move."
    )


def panel_size(settings: Settings) -> tuple[int, int]:
    """Width and height of a panel: the shape of the images of ``settings``, and no larger than they or SIZE."""
    width, height = settings.sequence.width, settings.sequence.height
    scale = min(1.0, SIZE[0] / width, SIZE[1] / height)
    return max(round(scale * width), 1), max(round(scale * height), 1)


def _small(settings: Settings, columns: tuple[str, ...], frames: tuple[int, int], fps: float | None = None) -> Settings:
    """The settings of a panel: its size, at most SPP samples, all pairs of ``frames``; ``fps`` None: the same rate."""
    spp = settings.lighting.spp
    width, height = panel_size(settings)
    changed = {"width": width, "height": height, "columns": columns, "pairs": "all", "frames": frames}
    changed |= {} if settings.lighting.light == "raster" else {"spp": min(spp or SPP, SPP)}
    return settings.replace(**changed, fps=fps or settings.sequence.fps)


def _pair(scene: Scene, settings: Settings, camera: CameraTrack | None = None, column: str = "") -> tuple[_Shown, Run]:
    """The first pair of ``settings``, and which pixels of it a ``column`` of geometry discards by misregistration."""
    shown: list[_Shown] = []

    def keep(pair: Pair) -> None:
        before, now = (pair.source.read("color", previous=old)[..., :3] for old in (True, False))
        wrong = None
        if column in GEOMETRY:
            reasons = Reasons(pair.source.read(VISIBILITY)[..., 0], None)
            wrong = misregistered(pair.mask, reasons, column, pair.settings, pair.source.reprojection)
        shown.append(_Shown(now, before, pair.mask, wrong))

    channels = (VISIBILITY,) if column in GEOMETRY else ()
    run = evaluate_scene(scene, settings, Observers(on_pair=keep, channels=channels), camera=camera)
    return shown[0], run


def draw_figures(
    path: str, run: Run, settings: Settings, label: str, files: tuple[Path, Path]
) -> list[tuple[Path, str]]:
    """Both figures of a scene with their captions; files that are there are kept.  Raises TaubenchError.

    ``path``: argument of ``load_scene``; ``run``, ``settings``: of the images.
    """
    resolved = {name: run.summary["settings"][name] for name in ("light_unit", "exposure", "environment", "spp")
                if run.summary["settings"].get(name) is not None}  # fmt: skip
    environment = resolved.get("environment")
    resolved |= {"environment": tuple(environment)} if isinstance(environment, list) else {}
    settings = settings.replace(**resolved)
    if not all(file.exists() for file in files):
        scene = load_scene(path, **settings.sequence.reading)
        if not files[0].exists():
            figure_1(scene, settings, files[0])
        if not files[1].exists():
            figure_2(scene, run, settings, files[1])
    return [(files[0], caption_1(label)), (files[1], caption_2(label, run))]
