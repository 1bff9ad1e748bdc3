"""Finishes a .glb file that Blender wrote: times, visibility, and what this package knows about its origin."""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np

from taubench_gl.scene.gltf.blender import intensity_factor
from taubench_gl.scene.gltf.container import add_channels, add_facts, container_bytes, read_container

_VISIBILITY, _POINTER = "KHR_node_visibility", "KHR_animation_pointer"
_FLOAT = 5126
_INTENSITY = re.compile(r"/extensions/KHR_lights_punctual/lights/(\d+)/intensity")
_WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


class Glb:
    """The JSON and the binary chunk of one file in memory."""

    def __init__(self, data: bytes):
        """Raises SceneError for data that is no binary glTF file."""
        text, binary, _ = read_container(data, "Blender's file")
        self.root: dict[str, Any] = json.loads(bytes(text))
        self.binary = bytearray(binary or b"")

    def data(self) -> bytes:
        """The bytes of the file, with the length of its buffer."""
        if self.binary:
            self.root.setdefault("buffers", [{}])[0]["byteLength"] = len(self.binary)
        return container_bytes(json.dumps(self.root, separators=(",", ":")).encode(), bytes(self.binary) or None)

    def describe(self, facts: dict[str, Any]) -> None:
        """Write ``asset.extras.taubench_gl``, which the scene reader reads."""
        add_facts(self.root, facts)

    def scale_times(self, factor: float) -> None:
        """Multiply the times of all keys."""
        inputs = {s["input"] for a in self.root.get("animations", ()) for s in a["samplers"]}
        for index in inputs:
            accessor, values = self.root["accessors"][index], self._floats(index)
            values *= np.float32(factor)
            accessor["min"], accessor["max"] = [float(values.min())], [float(values.max())]

    def drop_still_channels(self) -> None:
        """Remove the channels whose values never change: the node has the same value.  Raises nothing."""
        animations = []
        for animation in self.root.get("animations", ()):
            samplers = animation["samplers"]
            animation["channels"] = [c for c in animation["channels"] if self._moves(samplers[c["sampler"]], c)]
            if not animation["channels"]:
                continue
            used = sorted({c["sampler"] for c in animation["channels"]})
            animation["samplers"] = [samplers[k] for k in used]
            for channel in animation["channels"]:
                channel["sampler"] = used.index(channel["sampler"])
            animations.append(animation)
        if "animations" in self.root:
            self.root["animations"] = animations
            if not animations:
                del self.root["animations"]

    def match_intensities(self) -> None:
        """Scale animated light intensities to the value of the light, which is that of the first key.

        Blender's exporter leaves out the factors of ``scene.gltf.blender`` and the exposure of the light.
        """
        lights = self.root.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights", ())
        for animation in self.root.get("animations", ()):
            for channel in animation["channels"]:
                pointer = channel["target"].get("extensions", {}).get(_POINTER, {}).get("pointer", "")
                match = _INTENSITY.fullmatch(pointer)
                if not match:
                    continue
                light = lights[int(match[1])]
                values = self._floats(animation["samplers"][channel["sampler"]]["output"])
                usual = intensity_factor(light["type"])
                values *= np.float32(light["intensity"] / values[0] if values[0] > 0 else usual)

    def hide(self, visible: dict[str, list[bool]], fps: float) -> None:
        """Show and hide nodes by name: states at frames from time 0, ``fps`` of them in a second."""
        nodes = {node.get("name"): i for i, node in enumerate(self.root.get("nodes", ()))}
        tracks = []
        for name, states in visible.items():
            if name not in nodes:
                continue
            changes = {k for k in range(1, len(states)) if states[k] != states[k - 1]}
            keys = sorted({0, *changes, len(states) - 1})  # the last keeps the duration
            node = self.root["nodes"][nodes[name]]
            node.setdefault("extensions", {})[_VISIBILITY] = {"visible": bool(states[0])}
            path = f"/nodes/{nodes[name]}/extensions/{_VISIBILITY}/visible"
            target = {"path": "pointer", "extensions": {_POINTER: {"pointer": path}}}
            tracks.append((target, np.array(keys) / fps, np.array([states[k] for k in keys], np.uint8), "STEP"))
        if not tracks:
            return
        if not self.root.get("animations"):
            self.root["animations"] = [{"name": "Scene"}]
        add_channels(self.root, self.binary, self.root["animations"][0], tracks)
        used = self.root.setdefault("extensionsUsed", [])
        used += [name for name in (_VISIBILITY, _POINTER) if name not in used]

    def _moves(self, sampler: dict[str, Any], channel: dict[str, Any]) -> bool:
        accessor = self.root["accessors"][sampler["output"]]
        if accessor.get("componentType") != _FLOAT or accessor.get("type") not in _WIDTH or "sparse" in accessor:
            return True
        keys = self.root["accessors"][sampler["input"]]["count"]
        values = self._floats(sampler["output"]).reshape(keys, -1)
        if np.any(values != values[0]):
            return True
        # A node at another value than its animation: the exporter wrote it at another moment.
        path, node = channel["target"].get("path"), channel["target"].get("node")
        default = {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}.get(path)
        if default is None or node is None:
            return path != "pointer" and np.any(values[0] != 0)
        node_value = np.array(self.root["nodes"][node].get(path, default), dtype=np.float32)
        return bool(np.any(node_value != values[0]))

    def _floats(self, index: int) -> np.ndarray:
        """A view of the values of a float accessor that is tightly packed."""
        accessor = self.root["accessors"][index]
        view = self.root["bufferViews"][accessor["bufferView"]]
        at = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return np.frombuffer(self.binary, "<f4", accessor["count"] * _WIDTH[accessor["type"]], at)
