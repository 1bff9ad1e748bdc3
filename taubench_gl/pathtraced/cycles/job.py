"""What the renderer is told: scene, cameras, lights and quality, as plain values."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import CameraTrack, FrameState, Poser, View
from taubench_gl.errors import SettingsError
from taubench_gl.pathtraced.camera_file import CameraPose
from taubench_gl.scene.model import Scene

FRAME_NAME = "frame_%04d.exr"


@dataclass(frozen=True, slots=True)
class Quality:
    """How Cycles renders.  The paper's renders: 1024 samples, 12 bounces."""

    samples: int = 64
    bounces: int = 12
    seed: int = 0
    seed_per_frame: bool = True  # independent noise in every frame; False: the same pattern in all
    crisp: bool = False  # sample pixel centres only, as a rasterizer does
    cull_back_faces: bool = True  # of single-sided materials, as glTF asks
    sky: tuple[float, float, float] = (0.0, 0.0, 0.0)  # uniform sky radiance, linear
    threads: int = 0  # 0: all cores

    def __post_init__(self) -> None:
        for name, value, least in (("samples", self.samples, 1), ("bounces", self.bounces, 0), ("seed", self.seed, 0)):
            if not least <= value < 2**31:
                raise SettingsError(f"{name} is {value}", hint=f"give {least} or more")


def make_job(
    scene: Scene, camera: CameraTrack, frames: range, fps: float, size: tuple[int, int], quality: Quality
) -> tuple[dict[str, Any], dict[int, CameraPose], list[str]]:
    """The job without paths, the camera of every rendered frame, and notes.  Frame f is at f / fps seconds.

    Cameras and lights are given for the neighbours of the rendered frames too: Cycles' Vector pass looks at both.
    """
    poser = Poser(scene)
    keyed = range(frames[0] - 1, frames[-1] + 2)
    states = {frame: poser.sample(frame / fps) for frame in keyed}
    views = {frame: camera.view_at(state) for frame, state in states.items()}
    poses = {frame: _pose(view) for frame, view in views.items()}
    lights, notes = _lights(scene, states)
    job = {
        "frames": list(frames),
        "first_key": keyed[0],
        "fps": fps,
        "size": list(size),
        "name": FRAME_NAME,
        "view": camera.describe(),
        "playing": list(scene.playing),
        "samples": quality.samples,
        "bounces": quality.bounces,
        "seed": quality.seed,
        "seed_per_frame": quality.seed_per_frame,
        "crisp": quality.crisp,
        "cull_back_faces": quality.cull_back_faces,
        "sky": list(quality.sky),
        "threads": quality.threads,
        "camera": {str(frame): _plain(pose) for frame, pose in poses.items()},
        "lights": lights,
        "hidden": {str(frame): nodes for frame in frames if (nodes := _hidden(scene, states[frame]))},
    }
    return job, {frame: poses[frame] for frame in frames}, notes


def identity(job: dict[str, Any], sha256: str | None) -> str:
    """Hash of what a frame's pixels depend on: resuming under another one would mix two renders."""
    left_out = ("frames", "first_key", "camera", "lights", "hidden", "threads", "name")  # other frames, other values
    pixels = {k: v for k, v in job.items() if k not in left_out}
    return hashlib.sha256(json.dumps([pixels, sha256], sort_keys=True).encode()).hexdigest()[:16]


def _pose(view: View) -> CameraPose:
    c = view.camera
    return CameraPose(view.position, view.world_from_view, c.kind, c.yfov, c.ymag, c.znear, c.zfar)


def _plain(pose: CameraPose) -> dict[str, Any]:
    return {
        "world_from_view": math3d.affine(pose.world_from_view, pose.position).tolist(),
        "kind": pose.kind,
        "yfov": pose.yfov,
        "ymag": pose.ymag,
        "znear": pose.znear,
        "zfar": pose.zfar if math.isfinite(pose.zfar) else None,
    }


def _hidden(scene: Scene, state: FrameState) -> list[int]:
    """Mesh nodes of the chosen scene that KHR_node_visibility (their own or an ancestor's) hides."""
    return [node for node in scene.mesh_nodes.tolist() if scene.nodes.in_scene[node] and not state.visible[node]]


def _shines(state: FrameState, node: int) -> bool:
    """A light is off where its node is hidden or scaled to nothing, as for the rasterizer."""
    return bool(state.visible[node] and np.any(state.world[node, :3, :3] != 0.0))


def _lights(scene: Scene, states: dict[int, FrameState]) -> tuple[list[dict[str, Any]], list[str]]:
    out, notes = [], []
    for node in scene.light_nodes:
        index = int(scene.nodes.light[node])
        entries = {}
        for frame, state in states.items():
            light, world = state.lights[index], state.world[node]
            entries[str(frame)] = {
                "position": world[:3, 3].tolist(),
                "rotation": math3d.orthonormal(world[:3, :3]).tolist(),
                "color": list(map(float, light.color)),
                "intensity": float(light.intensity) if _shines(state, node) else 0.0,
                "inner_cone": float(light.inner_cone),
                "outer_cone": float(light.outer_cone),
            }
        first = next(iter(entries.values()))
        if all(entry == first for entry in entries.values()):
            entries = {next(iter(entries)): first}
        light = scene.lights[index]
        out.append({"kind": light.kind, "name": light.name, "frames": entries})
        if np.isfinite(light.range):
            notes.append(f"light '{light.name}': Cycles has no range; its light does not end at {light.range:g} m")
        if light.kind == "spot":
            notes.append(f"light '{light.name}': Cycles blends a spot's cone by another formula than glTF")
    return out, notes
