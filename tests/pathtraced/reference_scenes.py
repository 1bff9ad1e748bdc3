"""Real scenes and the comparison of rasterizer and Cycles on them: columns, positions, normals, motion."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fixed import fixed_settings
from fixed_orbit import FixedOrbit

from taubench_gl.animation import CameraTrack, FrameState, Poser, View, choose_camera
from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.pathtraced.evaluation import PathTracedOptions, evaluate_path_traced
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene

Array = np.ndarray
COLUMNS = ("frustum", "position", "normal")
LIMITS = {"frustum": 0.02, "position": 0.15, "normal": 0.2}
"""Percentage points by which a column may differ from Cycles'."""

POSITION_M = 1e-4  # median
MOTION_PX = 0.05  # median


@dataclass(frozen=True)
class Case:
    """One scene.  ``camera``: ``file``, ``orbit``, or ``pan`` (the file's first camera, rotated and moved)."""

    path: str  # below the folder of real scenes
    frames: tuple[int, int]
    camera: str = "orbit"
    stored: bool = True  # has a small stored reference for the short tests


CASES = {
    "rigid": Case("khronos/BoxAnimated/BoxAnimated.glb", (20, 23)),
    "skinned": Case("blender_io/03_skinned_cylinder/03_skinned_cylinder.gltf", (10, 13)),
    "skinned_enormous": Case("khronos/Fox/Fox.gltf", (6, 9)),
    "skinned_man": Case("khronos/CesiumMan/CesiumMan.glb", (10, 13), stored=False),
    "morphed": Case("khronos/AnimatedMorphCube/AnimatedMorphCube.glb", (10, 13)),
    "morphed_stress": Case("khronos/MorphStressTest/MorphStressTest.glb", (10, 13)),
    "many_lights": Case("playcanvas/Lights/Lights.glb", (0, 3), "pan"),
    "lights_of_all_kinds": Case("blender_io/04_lights/04_lights.gltf", (0, 3), stored=False),
    "textured": Case("playcanvas/house/house.glb", (0, 3)),
    "textured_truck": Case("khronos/CesiumMilkTruck/CesiumMilkTruck.glb", (5, 8), stored=False),
    "alpha_masked": Case("blender_io/01_alpha_mask/01_alpha_mask.gltf", (0, 3)),
    "alpha_modes": Case("khronos/AlphaBlendModeTest/AlphaBlendModeTest.glb", (0, 3), stored=False),
    "closed_room": Case("babylon/cornellBox/cornellBox.glb", (0, 3), "pan"),
    "room_of_tauray": Case("tauray_test/test.glb", (0, 3), "pan", stored=False),
    "open_sky": Case("khronos/InterpolationTest/InterpolationTest.glb", (7, 10)),
}


REFERENCES = Path(__file__).parent / "references"
REFERENCE_SIZE = (96, 54)


def reference_frames(case: Case) -> tuple[int, int]:
    """Frames of a stored reference: the first pair of the case."""
    return case.frames[0], case.frames[0] + 2


class PanCamera:
    """The file's first camera at 0 s, rotating by 2 degrees per frame (24 fps) and moving to its right."""

    name = "pan"

    def __init__(self, scene: Scene, degrees: float = 48.0, meters: float = 0.5):
        self._start = choose_camera(scene).view_at(Poser(scene).sample(0.0))
        self._rate, self._speed = math.radians(degrees), meters

    def describe(self) -> str:
        return "the file's first camera, panned"

    def view_at(self, state: FrameState) -> View:
        angle = self._rate * state.time
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        right = self._start.world_from_view[:, 0]
        moved = self._start.position + right * (self._speed * state.time)
        return View(moved, turn @ self._start.world_from_view, self._start.camera)


def open_case(case: Case, data: Path) -> tuple[Scene, CameraTrack]:
    scene = load_scene(data / case.path)
    cameras = {"file": choose_camera, "orbit": FixedOrbit, "pan": PanCamera}
    return scene, cameras[case.camera](scene)


def compare(
    scene: Scene, camera: CameraTrack, folder: Path, frames: tuple[int, int], textures: str = "finest"
) -> dict[str, float]:
    """Rasterize the frames in ``folder`` and compare them.

    Returns per column the difference in percentage points (rasterizer - Cycles) and Cycles' percentage; median errors
    of position (m), normal (degrees) and motion (px); the percentage of pixels where both show a surface.
    """
    sequence = PathTracedSequence.open(folder)
    width, height = sequence.size
    settings = {"width": width, "height": height, "frames": frames, "columns": COLUMNS,
                "textures": textures}  # fmt: skip
    kept: dict[str, list] = {"path_traced": [], "raster": [], "motion": []}

    def keep(name: str):
        def observe(pair):
            kept[name].append((pair.frame, pair.source.read("position").copy(), pair.source.read("normal").copy(),
                               pair.motion))  # fmt: skip

        return Observers(on_pair=observe)

    options = PathTracedOptions(camera_file=folder / "camera.json")
    path_traced = evaluate_path_traced(
        f"exr:{folder}", fixed_settings(frames=frames, columns=COLUMNS), options, keep("path_traced")
    )
    raster = evaluate_scene(scene, fixed_settings(**settings), keep("raster"), camera=camera)
    evaluate_scene(scene, fixed_settings(**settings, reprojection="motion"), keep("motion"), camera=camera)
    out = {}
    for column in COLUMNS:
        own, traced = (run.summary["discard"][column]["mean_percent"] for run in (raster, path_traced))
        out |= {column: own - traced, f"{column}_percent": traced}
    errors: dict[str, list[Array]] = {"position": [], "normal": [], "motion": []}
    seen = []
    for traced, raster_pair, motion_pair in zip(kept["path_traced"], kept["raster"], kept["motion"], strict=True):
        (frame, p_traced, n_traced, _), (_, p, n, _), motion = traced, raster_pair, motion_pair[-1]
        both = (p[..., 3] > 0) & (p_traced[..., 3] > 0)
        errors["position"].append(np.linalg.norm((p - p_traced)[both][:, :3], axis=-1))
        chord = np.linalg.norm((n - n_traced)[both][:, :3].astype(np.float64), axis=-1)
        errors["normal"].append(np.degrees(2.0 * np.arcsin(np.clip(0.5 * chord, 0.0, 1.0))))
        vector = sequence.read(frame).motion
        errors["motion"].append(np.linalg.norm((vector - motion)[both], axis=-1))
        seen.append(100.0 * both.mean())
    medians = {name: float(np.median(np.concatenate(parts))) for name, parts in errors.items()}
    return out | {
        "position_m": medians["position"],
        "normal_deg": medians["normal"],
        "motion_px": medians["motion"],
        "seen_percent": float(np.mean(seen)),
    }


def faults(result: dict[str, float]) -> Iterator[str]:
    """One phrase per limit that the result of ``compare`` exceeds."""
    for column, limit in LIMITS.items():
        if not abs(result[column]) <= limit:
            yield f"{column} differs by {result[column]:+.3f} pp"
    if not result["position_m"] < POSITION_M:
        yield f"positions are off by {result['position_m']:.3g} m"
    if not result["motion_px"] < MOTION_PX:
        yield f"motion is off by {result['motion_px']:.3g} px"
    if not result["seen_percent"] > 1.0:
        yield "too few pixels show a surface in both"
