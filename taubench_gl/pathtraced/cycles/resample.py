"""A glTF file as Blender should see it: one animation with a key on every frame, no cameras and no lights.

Blender's importer reads every glTF, but interpolates rotations by component, drops cubic tangents, and mutes all but
one of several animations.  With our own sampler's values as keys on whole frames nothing is left to interpolate, and
what plays is exactly what our reader plays.  Cameras and lights are set from the job instead (their values may be
animated by extensions that the importer does not know).
"""

from __future__ import annotations

import copy
import json
import os
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import numpy as np

from taubench_gl.animation.curves import sample_channel
from taubench_gl.errors import SceneError
from taubench_gl.scene.model import Channel, Scene

KEY_FPS = 24.0
"""Rate of the written keys: frame f lies at (f - first) / KEY_FPS, whatever the rate it was sampled at."""

NODE_NAME = "taubench node {}"
"""Name of mesh nodes by their number in the file: names of files need not be unique (``inside.py`` has its copy)."""

_SET_BY_JOB = ("KHR_lights_punctual", "KHR_animation_pointer", "KHR_node_visibility")
_PATHS = ("translation", "rotation", "scale", "weights")
_JSON_CHUNK = 0x4E4F534A


def write_resampled(scene: Scene, frames: range, fps: float, folder: Path) -> Path:
    """Write ``scene.gltf`` and its buffers into ``folder``.  -> its path.

    ``frames`` are the frames to key (neighbours of the rendered ones included); frame f is sampled at f / fps seconds.
    """
    if scene.path is None or scene.path.suffix.lower() not in (".gltf", ".glb"):
        raise SceneError("only glTF files can be handed to Blender", where=str(scene.path or scene.name))
    root, chunk = _read(scene.path)
    _strip(root, scene)
    for buffer in root.get("buffers", ()):
        if "uri" not in buffer and chunk is not None:
            (folder / "scene.bin").write_bytes(chunk)
            buffer["uri"], chunk = "scene.bin", None
    for item in (*root.get("buffers", ()), *root.get("images", ())):
        uri = item.get("uri", "data:")
        if uri != "scene.bin" and uri[:5].lower() != "data:":
            item["uri"] = quote(os.path.relpath(scene.path.parent / unquote(uri), folder).replace(os.sep, "/"))
    channels = [c for c in scene.channels if c.target == "node" and c.path in _PATHS]
    root.pop("animations", None)
    if channels:
        (folder / "keys.bin").write_bytes(_add_animation(root, channels, frames, fps))
    path = folder / "scene.gltf"
    path.write_text(json.dumps(root), encoding="utf-8")
    return path


def _read(path: Path) -> tuple[dict[str, Any], bytes | None]:
    data = path.read_bytes()  # already read and checked by our reader
    if data[:4] != b"glTF":
        return json.loads(data), None
    offset, chunks = 12, []
    while offset + 8 <= len(data):
        size = int.from_bytes(data[offset : offset + 4], "little")
        kind = int.from_bytes(data[offset + 4 : offset + 8], "little")
        chunks.append((kind, data[offset + 8 : offset + 8 + size]))
        offset += 8 + size
    rest = [body for kind, body in chunks if kind != _JSON_CHUNK]
    return json.loads(chunks[0][1]), rest[0] if rest else None


def _strip(root: dict[str, Any], scene: Scene) -> None:
    """Only the chosen scene, without cameras and lights; mesh nodes get the names by which the job hides them."""
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
        kept = [name for name in root.get(key, ()) if name not in _SET_BY_JOB]
        root.pop(key, None)
        if kept:
            root[key] = kept


def _add_animation(root: dict[str, Any], channels: list[Channel], frames: range, fps: float) -> bytes:
    """Append one animation to ``root``; the bytes of its buffer."""
    blob = bytearray()
    buffer = len(root.setdefault("buffers", []))
    views, accessors = root.setdefault("bufferViews", []), root.setdefault("accessors", [])

    def accessor(values: np.ndarray, kind: str, **bounds: Any) -> int:
        data = np.ascontiguousarray(values, dtype="<f4").tobytes()
        views.append({"buffer": buffer, "byteOffset": len(blob), "byteLength": len(data)})
        count = values.size if kind == "SCALAR" else len(values)
        accessors.append({"bufferView": len(views) - 1, "componentType": 5126, "count": count, "type": kind, **bounds})
        blob.extend(data)
        return len(accessors) - 1

    times = np.arange(len(frames)) / KEY_FPS
    last = float(np.float32(times[-1]))
    input_ = accessor(times, "SCALAR", min=[0.0], max=[last])
    kinds = {"translation": "VEC3", "rotation": "VEC4", "scale": "VEC3", "weights": "SCALAR"}
    animation: dict[str, Any] = {"name": "taubench", "channels": [], "samplers": []}
    for channel in channels:
        values = np.stack([sample_channel(channel, frame / fps) for frame in frames])
        sampler = {"input": input_, "output": accessor(values, kinds[channel.path]), "interpolation": "LINEAR"}
        target = {"node": channel.index, "path": channel.path}
        animation["channels"].append({"sampler": len(animation["samplers"]), "target": target})
        animation["samplers"].append(sampler)
    root["animations"] = [animation]
    root["buffers"].append({"uri": "keys.bin", "byteLength": len(blob)})
    return bytes(blob)
