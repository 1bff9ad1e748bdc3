"""Small glTF files and checks shared by several tests."""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
from gltf_files import TRIANGLE, Gltf, triangle_scene

from taubench_gl.errors import SceneError
from taubench_gl.scene import Scene, load_scene

QUAD = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)


def notes_about(scene: Scene, *values: object) -> list[str]:
    """``where`` of every note that contains all ``values``: numbers and names of the file, not wording."""
    return [note.where for note in scene.notes if all(str(value) in note.message for value in values)]


def primitive_of(gltf: Gltf, folder: Path):
    return load_scene(gltf.save(folder)).meshes[0].primitives[0]


# Triangles


def area_sign(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    a, b, c = points[triangles].swapaxes(0, 1)
    return np.sign((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


# Materials


def png(size: tuple[int, int] = (3, 2), mode: str = "RGB", color: object = (10, 20, 30)) -> bytes:
    out = io.BytesIO()
    PIL.Image.new(mode, size, color).save(out, "PNG")
    return out.getvalue()


def textured(info: dict, **attributes: int) -> Gltf:
    gltf = Gltf()
    gltf.add("images", {"uri": "data:image/png;base64," + base64.b64encode(png()).decode()})
    gltf.add("textures", {"source": 0})
    gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **info}}})
    return gltf


def lights() -> Gltf:
    gltf = Gltf()
    gltf.extension("KHR_lights_punctual", {"lights": [
        {"type": "point", "color": [1, 0.5, 0], "intensity": 20, "range": 5},
        {"type": "spot", "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2}},
        {"type": "directional", "name": "sun"},
    ]})  # fmt: skip
    for light in range(3):
        gltf.node(extensions={"KHR_lights_punctual": {"light": light}})
    return gltf


# Skins and morph targets


def skinned(weights: object, joints: object = None, **skin: object) -> Gltf:
    gltf = Gltf()
    joints = np.zeros((3, 4)) if joints is None else joints
    mesh = gltf.mesh(JOINTS_0=gltf.accessor(joints, "u1"), WEIGHTS_0=gltf.accessor(weights))
    gltf.node(mesh=mesh, skin=0)
    gltf.node(name="root", children=[2])
    gltf.node(name="tip")
    gltf.add("skins", {"joints": [1, 2], **skin})
    return gltf


def morphing(targets: int = 2) -> Gltf:
    gltf = triangle_scene()
    primitive = gltf.json["meshes"][0]["primitives"][0]
    primitive["targets"] = [{"POSITION": gltf.accessor(TRIANGLE * (i + 1))} for i in range(targets)]
    return gltf


def pointer(text: str) -> dict:
    return {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": text}}}


LIGHT = "/extensions/KHR_lights_punctual/lights/1"


def compressed(
    gltf: Gltf, data: bytes, stride: int, count: int, mode: str, filter: str = "NONE", **view: object
) -> int:
    """A bufferView with compressed data only; its buffer is a fallback without bytes."""
    packed = {"buffer": 0, "byteOffset": len(gltf.blob) + -len(gltf.blob) % 4, "byteLength": len(data),
              "byteStride": stride, "count": count, "mode": mode, "filter": filter}  # fmt: skip
    gltf.blob += bytes(-len(gltf.blob) % 4) + data
    return gltf.add("bufferViews", {"buffer": 1, "byteLength": stride * count, **view,
                                    "extensions": {"EXT_meshopt_compression": packed}})  # fmt: skip


def finish(gltf: Gltf) -> Gltf:
    gltf.extension("EXT_meshopt_compression")
    uri = "data:application/octet-stream;base64," + base64.b64encode(gltf.blob).decode()
    fallback = {"byteLength": 1 << 16, "extensions": {"EXT_meshopt_compression": {"fallback": True}}}
    gltf.json["buffers"] = [{"byteLength": len(gltf.blob), "uri": uri}, fallback]
    return gltf


def refuse(path: Path, where: str | None = None, *values: object, **options: Any) -> SceneError:
    """The SceneError that strict loading raises: one printable line at ``where`` that contains ``values``.

    ``where``: JSON pointer; '' is the file itself, None any place.  ``values``: numbers and names of the file, not
    wording.
    """
    with pytest.raises(SceneError) as caught:
        load_scene(path, **{"strict": True, **options})
    error = caught.value
    assert "\n" not in str(error) and str(error).isprintable()
    if where is not None:
        file, _, at = str(error.where).partition("#")
        assert (Path(file).name, at) == (path.name, where), str(error)
    for value in values:
        assert str(value) in str(error), str(error)
    return error
