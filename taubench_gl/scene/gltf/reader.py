"""Reads one glTF file into a Scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from taubench_gl.scene.files import find_referenced
from taubench_gl.scene.gltf.accessors import Accessors
from taubench_gl.scene.gltf.animations import AnimationReader, choose_animations
from taubench_gl.scene.gltf.blender import light_keys
from taubench_gl.scene.gltf.document import Document, open_document
from taubench_gl.scene.gltf.extensions import check_extensions, unsimulated
from taubench_gl.scene.gltf.materials import MaterialReader
from taubench_gl.scene.gltf.meshes import MeshReader
from taubench_gl.scene.gltf.nodes import (
    NodeTargets,
    choose_scene,
    parents,
    read_cameras,
    read_lights,
    read_nodes,
    read_skins,
)
from taubench_gl.scene.model import Scene
from taubench_gl.setting_values import ENVIRONMENT_FILES, MAX_EXPOSURE, parse_environment

IMAGE_BASED_LIGHTS = frozenset({"EXT_lights_image_based", "KHR_lights_image_based"})
"""Extensions of image-based light; it is not simulated."""


def read_gltf(
    path: Path, scene: str | int | None, animation: Sequence[str | int] | None, strict: bool = False
) -> Scene:
    """``load_scene`` for .gltf and .glb.  Raises SceneError.

    Objects are read in the order of their references, so that every reference is checked before it is used.
    """
    document = open_document(path, strict)
    check_extensions(document)
    accessors = Accessors(document)
    accessors.check_all()
    material_reader = MaterialReader(document, accessors)
    materials = material_reader.materials()
    images = material_reader.images()
    materials, images = material_reader.finished(materials, images)
    meshes = MeshReader(document, accessors, materials).read()
    parent = parents(document)
    in_scene, scene_names = choose_scene(document, scene, parent)
    skins = read_skins(document, accessors, parent)
    cameras, lights = read_cameras(document), read_lights(document)
    nodes = read_nodes(document, accessors, parent, in_scene, NodeTargets(meshes, skins, lights))
    if cameras and not (nodes.in_scene & (nodes.camera >= 0)).any():
        document.remark("camera-unused", "/cameras", len(cameras))
    animations_of_file = AnimationReader(document, accessors, meshes, len(lights)).read()
    animations = tuple(replace(a, channels=light_keys(document, a.channels, lights)) for a in animations_of_file)
    channels, playing = choose_animations(document, animations, animation)
    own_extras = _own_extras(document)
    file_notes = _texts(own_extras)
    if CONSTANT_LIGHTS in file_notes:
        lights = tuple(replace(light, constant=light.kind != "directional") for light in lights)
    if "note" in file_notes:
        document.note(file_notes["note"], "/asset/extras/taubench_gl")
    _note_losses(document, own_extras.get("lost"))
    return Scene(
        name=file_notes.get("name", path.stem),
        nodes=nodes,
        meshes=meshes,
        materials=materials,
        images=images,
        skins=skins,
        cameras=cameras,
        lights=lights,
        animations=animations,
        channels=channels,
        playing=playing,
        notes=(*unsimulated(document, materials, nodes), *document.notes.all()),
        path=path,
        sha256=document.identity.hexdigest(),
        files=document.identity.files,
        scene_names=scene_names,
        generator=document.root.asset.generator,
        image_based_light=bool(IMAGE_BASED_LIGHTS & set(document.root.extensions_used or ())),
        stand_in=file_notes.get("stand_in"),
        default_camera=file_notes.get("camera"),
        environment=_environment(document, file_notes),
        exposure=_exposure(file_notes),
    )


MAX_LOSSES = 40
"""Most losses of a conversion that are noted."""

CONSTANT_LIGHTS = "constant_lights"
"""Entry of ``asset.extras.taubench_gl`` of files whose point and spot lights are not attenuated with distance."""


def _own_extras(document: Document) -> dict[str, Any]:
    """``asset.extras.taubench_gl``, which ``container.add_facts`` writes; empty where there is none."""
    extras = document.root.asset.extras
    own_extras = extras.get("taubench_gl") if isinstance(extras, dict) else None
    return own_extras if isinstance(own_extras, dict) else {}


def _texts(own_extras: dict[str, Any]) -> dict[str, str]:
    """Texts of ``own_extras`` by name, each as one line."""
    texts = {key: _one_line(text) for key, text in own_extras.items() if isinstance(text, str)}
    return {key: text for key, text in texts.items() if text}


def _one_line(text: str) -> str:
    return " ".join(text.split())[:300]


def _note_losses(document: Document, losses: Any) -> None:
    """Note what a conversion lost, as ``pathtraced.blender.convert`` lists it."""
    for line in losses[:MAX_LOSSES] if isinstance(losses, list) else ():
        if isinstance(line, str):
            document.note(f"lost in the conversion: {_one_line(line)}", "/asset/extras/taubench_gl/lost")


def _exposure(file_notes: dict[str, str]) -> float | None:
    """The exposure that the file names; None if it is no positive number that Settings allows."""
    try:
        value = float(file_notes.get("exposure", "nan"))
    except ValueError:
        return None
    return value if 1.0 / MAX_EXPOSURE <= value <= MAX_EXPOSURE else None


def _environment(document: Document, file_notes: dict[str, str]) -> str | tuple[float, float, float] | None:
    """The environment that the file names: a radiance R,G,B or an image in its folder."""
    text = file_notes.get("environment")
    if text is None:
        return None
    value = parse_environment(text)
    if isinstance(value, tuple):
        usable = len(value) == 3 and all(0.0 <= c < math.inf for c in value)
        return value if usable else None
    target = find_referenced(document.path.parent, text)
    if isinstance(target, str) or not text.lower().endswith(ENVIRONMENT_FILES):
        reason = target if isinstance(target, str) else "is no .hdr or .exr file"
        document.note(f"the file's environment image is left out: {reason}", "/asset/extras/taubench_gl")
        return None
    return str(target)
