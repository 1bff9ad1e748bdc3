"""KHR_animation_pointer: which JSON pointers name something a Scene can animate."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple

from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.document import Document
from taubench_gl.scene.gltf.views import LIGHTS

POINTER = "KHR_animation_pointer"


class Target(NamedTuple):
    """``size`` numbers of ``path`` of the scene's ``kind`` (node, camera, light) number ``index``."""

    kind: str
    index: int
    path: str
    size: int


_NODE = {"translation": ("translation", 3), "rotation": ("rotation", 4), "scale": ("scale", 3),
         "extensions/KHR_node_visibility/visible": ("visible", 1)}  # fmt: skip
_CAMERA = {f"perspective/{p}": p for p in ("yfov", "znear", "zfar")} | {
    f"orthographic/{p}": p for p in ("xmag", "ymag", "znear", "zfar")
}
_LIGHT = {"color": ("color", 3), "intensity": ("intensity", 1), "range": ("range", 1),
          "spot/innerConeAngle": ("inner_cone", 1), "spot/outerConeAngle": ("outer_cone", 1)}  # fmt: skip
_LIGHTS = re.escape(f"/extensions/{LIGHTS}/lights/")
_POINTER = re.compile(rf"(/nodes/|/cameras/|/meshes/|{_LIGHTS})(0|[1-9]\d{{0,8}})/(.+)")


def resolve_pointer(document: Document, text: str, weight_count: Callable[[int], int], pointer: str) -> list[Target]:
    """Targets of one animated JSON pointer; none, with a note, where it names nothing a Scene can animate."""
    match = _POINTER.fullmatch(text)
    targets = _resolve(document, match[1], int(match[2]), match[3], weight_count, pointer) if match else []
    if not targets:
        document.note(f"not animated: {text}")
    return targets


def _resolve(
    document: Document, owner: str, index: int, path: str, weight_count: Callable[[int], int], pointer: str
) -> list[Target]:
    if owner == "/nodes/":
        node = document.item("nodes", index, pointer)
        if path == "weights" and weight_count(index):
            return [Target("node", index, "weights", weight_count(index))]
        if path in ("translation", "rotation", "scale") and node.matrix is not None:
            raise document.error(f"nodes[{index}] has a matrix and cannot be animated", pointer)
        return [Target("node", index, *_NODE[path])] if path in _NODE else []
    if owner == "/meshes/":
        document.item("meshes", index, pointer)
        # Nodes with weights of their own do not see their mesh's.
        users = [i for i, n in enumerate(document.root.nodes or []) if n.mesh == index and n.weights is None]
        return [Target("node", i, "weights", weight_count(i)) for i in users if path == "weights" and weight_count(i)]
    if owner == "/cameras/":
        camera = document.item("cameras", index, pointer)
        known = path in _CAMERA and path.startswith(camera.type)
        return [Target("camera", index, _CAMERA[path], 1)] if known else []
    lights = document.extension(document.root, LIGHTS, schema.PunctualLights, "")
    if lights is None or index >= len(lights.lights):
        raise document.error("refers to a light that is not there", pointer)
    return [Target("light", index, *_LIGHT[path])] if path in _LIGHT else []
