"""Reads one glTF file into a Scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from taubench_gl.scene.gltf.accessors import Accessors
from taubench_gl.scene.gltf.animations import AnimationReader, choose_animations
from taubench_gl.scene.gltf.document import Document, check_extensions, open_document
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

IMAGE_BASED_LIGHTS = frozenset({"EXT_lights_image_based", "KHR_lights_image_based"})
"""Extensions of image-based light; it is not simulated."""


def read_gltf(path: Path, scene: str | int | None, animation: Sequence[str | int] | None) -> Scene:
    """``load_scene`` for .gltf and .glb.  Raises SceneError.

    Objects are read in the order of their references, so that every reference is checked before it is used.
    """
    document = open_document(path)
    check_extensions(document)
    accessors = Accessors(document)
    accessors.check_all()
    material_reader = MaterialReader(document, accessors)
    materials = material_reader.materials()
    images = material_reader.images()
    meshes = MeshReader(document, accessors, materials).read()
    parent = parents(document)
    in_scene, scene_names = choose_scene(document, scene, parent)
    skins = read_skins(document, accessors, parent)
    cameras, lights = read_cameras(document), read_lights(document)
    nodes = read_nodes(document, accessors, parent, in_scene, NodeTargets(meshes, skins, lights))
    animations = AnimationReader(document, accessors, meshes).read()
    channels, playing = choose_animations(document, animations, animation)
    own = _own_extras(document)
    if "note" in own:
        document.note(own["note"], "/asset/extras/taubench_gl")
    return Scene(
        name=own.get("name", path.stem),
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
        notes=tuple(document.notes),
        path=path,
        sha256=document.identity.hexdigest(),
        files=document.identity.files,
        scene_names=scene_names,
        generator=document.root.asset.generator,
        image_based_light=bool(IMAGE_BASED_LIGHTS & set(document.root.extensions_used or ())),
        stand_in=own.get("stand_in"),
        default_camera=own.get("camera"),
    )


def _own_extras(document: Document) -> dict[str, str]:
    """The values that ``taubench_gl.datasets`` writes into ``asset.extras``, as one-line strings."""
    extras = document.root.asset.extras
    own = extras.get("taubench_gl") if isinstance(extras, dict) else None
    if not isinstance(own, dict):
        return {}
    texts = {key: " ".join(text.split())[:300] for key, text in own.items() if isinstance(text, str)}
    return {key: text for key, text in texts.items() if text}
