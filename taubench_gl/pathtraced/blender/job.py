"""Input of the render script: the job (cameras, lights, quality) and the scene with one resampled animation.

Blender's importer reads every glTF file, but interpolates rotations by component, drops cubic tangents, and mutes all
but one of several animations.  The scene therefore gets one animation with a key on every frame, sampled by this
project, so that nothing is left to interpolate.  Cameras and lights are removed from the scene and set from the job:
extensions that the importer does not know may animate them.
"""

from __future__ import annotations

import copy
import hashlib
import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import CameraTrack, FrameState, Poser, View
from taubench_gl.animation.curves import sample_channel
from taubench_gl.effects.lighting import Sun, unit_divisor
from taubench_gl.errors import SceneError
from taubench_gl.memory_budget import limit
from taubench_gl.option_groups import RenderOptions
from taubench_gl.outputs import write_atomically
from taubench_gl.pathtraced.cameras import camera_entry
from taubench_gl.scene.files import read_file
from taubench_gl.scene.gltf.container import GLB_MAGIC, add_channels, read_container
from taubench_gl.scene.model import Channel, Scene

FRAME_NAME = "frame_%04d.exr"
KEY_FPS = 24.0
"""Frame rate of the written keys: frame f is at (f - first) / KEY_FPS s, at any frame rate of the sequence."""

NODE_NAME = "taubench node {}"
"""Name of a mesh node, by its index: names in files need not be unique.  ``render_script.py`` repeats this."""

_SET_BY_JOB = ("KHR_lights_punctual", "KHR_animation_pointer", "KHR_node_visibility")
_PATHS = ("translation", "rotation", "scale", "weights")


@dataclass(frozen=True, slots=True)
class Quality(RenderOptions):
    """How Cycles renders.  Raises SettingsError."""

    cull_back_faces: bool = True  # of single-sided materials, as glTF requires
    single_scatter: bool = True  # GGX without the energy that multiple scattering adds, as glTF defines it
    sky: tuple[float, float, float] = (0.0, 0.0, 0.0)  # uniform sky radiance, linear RGB
    sun: Sun | None = None  # of the environment
    image: str | None = None  # environment image, replaces the sky
    image_sha256: str | None = None  # of its file
    light_unit: str = "candela"  # watt: intensities divided by 683


def make_job(
    scene: Scene, camera: CameraTrack, frames: range, fps: float, size: tuple[int, int], quality: Quality
) -> tuple[dict[str, Any], dict[int, View], list[str]]:
    """The job without paths, the view of every rendered frame, and notes.  Frame f is at f / fps seconds.

    Cameras and lights cover the neighbors of the rendered frames too: Cycles' Vector pass needs both.
    """
    poser = Poser(scene, fps)
    keyed = range(frames[0] - 1, frames[-1] + 2)
    states = {frame: poser.sample(frame / fps) for frame in keyed}
    views = {frame: camera.view_at(state) for frame, state in states.items()}
    lights, notes = _lights(scene, states, unit_divisor(quality.light_unit))
    if quality.sun is not None:
        lights.append(_sun(quality.sun, keyed[0]))
    job = {
        "frames": list(frames),
        "first_key": keyed[0],
        "fps": fps,
        "size": list(size),
        "name": FRAME_NAME,
        "view": camera.describe(),
        "playing": list(scene.playing),
        **asdict(quality),
        "sky": list(quality.sky),
        "camera": {str(frame): camera_entry(view) for frame, view in views.items()},
        "lights": lights,
        "hidden": {str(frame): nodes for frame in frames if (nodes := _hidden(scene, states[frame]))},
    }
    return job, {frame: views[frame] for frame in frames}, notes


def identity(job: dict[str, Any], sha256: str | None) -> str:
    """Hash of everything that the pixels of a frame depend on.  Renders of different identity are never mixed."""
    # These differ between the frames of one render, or do not change pixels; of an image, the content counts.
    left_out = ("frames", "first_key", "camera", "lights", "hidden", "threads", "name", "image")
    pixels = {k: v for k, v in job.items() if k not in left_out}
    return hashlib.sha256(json.dumps([pixels, sha256], sort_keys=True).encode()).hexdigest()[:16]


def _hidden(scene: Scene, state: FrameState) -> list[int]:
    """Mesh nodes of the chosen scene that their own or an ancestor's KHR_node_visibility hides."""
    return [node for node in scene.mesh_nodes.tolist() if scene.nodes.in_scene[node] and not state.visible[node]]


def _shines(state: FrameState, node: int) -> bool:
    """Whether the light of ``node`` is on: its node is neither hidden nor of scale 0, as in the rasterizer."""
    return bool(state.visible[node] and np.any(state.world[node, :3, :3] != 0.0))


def _sun(sun: Sun, frame: int) -> dict[str, Any]:
    """The sun of the environment as the job has a light that stands still."""
    z = -np.array(sun.direction)
    x = math3d.normalize(np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z))
    strongest = max(sun.irradiance)
    entry = {
        "position": [0.0, 0.0, 0.0],
        "rotation": np.stack([x, np.cross(z, x), z], axis=-1).tolist(),
        "color": [c / strongest for c in sun.irradiance],
        "intensity": strongest,
        "inner_cone": 0.0,
        "outer_cone": 0.0,
    }
    return {"kind": "directional", "name": "sun of the environment", "constant": False, "frames": {str(frame): entry}}


def _lights(scene: Scene, states: dict[int, FrameState], divisor: float) -> tuple[list[dict[str, Any]], list[str]]:
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
                "intensity": float(light.intensity) / divisor if _shines(state, node) else 0.0,
                "inner_cone": float(light.inner_cone),
                "outer_cone": float(light.outer_cone),
            }
        first = next(iter(entries.values()))
        if all(entry == first for entry in entries.values()):
            entries = {next(iter(entries)): first}
        light = scene.lights[index]
        out.append({"kind": light.kind, "name": light.name, "constant": light.constant, "frames": entries})
        if np.isfinite(light.range):
            notes.append(f"light '{light.name}': Cycles ignores its range of {light.range:g} m")
        if light.kind == "spot" and divisor == 1.0:
            notes.append(f"light '{light.name}': Cycles and glTF use different formulas for the cone of a spot light")
    return out, notes


def write_resampled(scene: Scene, frames: range, fps: float, folder: Path) -> Path:
    """Write ``scene.gltf`` and its buffers to ``folder``; returns its path.

    ``frames``: the frames to key, with the neighbors of the rendered ones; frame f is sampled at f / fps seconds.
    Raises SceneError for files other than glTF.
    """
    if scene.path is None or scene.path.suffix.lower() not in (".gltf", ".glb", ".vrm"):
        raise SceneError("only glTF files can be rendered with Blender", where=str(scene.path or scene.name))
    root, chunk = _read(scene.path)
    _strip(root, scene)
    for buffer in root.get("buffers", ()):
        if "uri" not in buffer and chunk is not None:
            write_atomically(folder / "scene.bin", chunk)
            buffer["uri"], chunk = "scene.bin", None
    for item in (*root.get("buffers", ()), *root.get("images", ())):
        uri = item.get("uri", "data:")
        if uri != "scene.bin" and uri[:5].lower() != "data:":
            item["uri"] = quote(os.path.relpath(scene.path.parent / unquote(uri), folder).replace(os.sep, "/"))
    channels = [c for c in scene.channels if c.target == "node" and c.path in _PATHS]
    root.pop("animations", None)
    if channels:
        write_atomically(folder / "keys.bin", _add_animation(root, channels, frames, fps))
    path = folder / "scene.gltf"
    write_atomically(path, json.dumps(root))
    return path


def _read(path: Path) -> tuple[dict[str, Any], bytes | None]:
    data = read_file(path, max_bytes=limit())  # the scene reader has checked it
    if data[:4] != GLB_MAGIC:
        return json.loads(data), None
    text, binary, _ = read_container(data, path.name)
    return json.loads(bytes(text)), None if binary is None else bytes(binary)


def _strip(root: dict[str, Any], scene: Scene) -> None:
    """Keep the chosen scene only, without cameras and lights; rename mesh nodes, so that the job can hide them."""
    shown = set(np.flatnonzero(scene.nodes.in_scene).tolist())
    scenes = [s for s in root.get("scenes", ()) if s.get("nodes") and set(s["nodes"]) <= shown]
    if scenes:
        root["scenes"], root["scene"] = [copy.deepcopy(max(scenes, key=lambda s: len(s["nodes"])))], 0
    for number, node in enumerate(root.get("nodes", ())):
        if "mesh" in node:
            node["name"] = NODE_NAME.format(number)
        node.pop("camera", None)
        for name in _SET_BY_JOB:
            node.get("extensions", {}).pop(name, None)
    root.pop("cameras", None)
    for name in _SET_BY_JOB:
        root.get("extensions", {}).pop(name, None)
    for key in ("extensionsUsed", "extensionsRequired"):
        names = [name for name in root.get(key, ()) if name not in _SET_BY_JOB]
        root.pop(key, None)
        if names:
            root[key] = names


def _add_animation(root: dict[str, Any], channels: list[Channel], frames: range, fps: float) -> bytes:
    """Append one animation to ``root``; returns the bytes of its buffer."""
    data = bytearray()
    buffer = len(root.setdefault("buffers", []))
    times = np.arange(len(frames), dtype=np.float64) / KEY_FPS
    tracks = []
    for channel in channels:
        values = np.stack([sample_channel(channel, frame / fps, fps) for frame in frames]).astype(np.float32)
        target = {"node": channel.index, "path": channel.path}
        tracks.append((target, times, values.ravel() if channel.path == "weights" else values, "LINEAR"))
    root["animations"] = [{"name": "taubench"}]
    add_channels(root, data, root["animations"][0], tracks, buffer=buffer)
    root["buffers"].append({"uri": "keys.bin", "byteLength": len(data)})
    return bytes(data)
