"""Extensions of a glTF file: which are simulated, what the absence of others means, and which objects carry them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from msgspec import Struct, structs

from taubench_gl.data_files import read_toml
from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.document import Document
from taubench_gl.scene.model import Material, Nodes, Note
from taubench_gl.scene.notes import listed

Array = np.ndarray


class _Known(Struct, frozen=True, forbid_unknown_fields=True):
    """The content of extensions.toml."""

    supported: dict[str, tuple[str, ...]]
    appearance: dict[str, str]


_KNOWN = read_toml(Path(__file__).with_name("extensions.toml"), _Known)

SUPPORTED = _KNOWN.supported
"""Extension -> kinds of object that may carry it ('' is the document itself)."""

APPEARANCE = _KNOWN.appearance
"""Extension that changes no more than the appearance of surfaces -> what its absence means for the image."""

_ARRAYS = ("nodes", "scenes", "materials", "textures", "images", "samplers", "meshes", "skins", "cameras", "accessors",
           "bufferViews", "buffers", "animations")  # fmt: skip
"""Arrays of a document whose items may carry extensions, in the order of notes."""

_FIELDS = {field.encode_name: field.name for field in structs.fields(schema.Root)}

METADATA_ONLY = frozenset({"KHR_xmp", "KHR_xmp_json_ld"})
"""Extensions that do not change the image: no note is recorded for them."""


def check_extensions(document: Document) -> None:
    """Check where extensions are and which are required.

    Raises SceneError for a required extension that is neither supported nor only appearance, and, strictly, for any
    required extension that is not supported and a supported one on the wrong kind of object.
    """
    root = document.root
    supported = SUPPORTED.keys() | METADATA_ONLY
    for i, name in enumerate(root.extensions_required or []):
        if name not in supported:
            fault = document.error(
                f"requires the extension {name}, which is not supported",
                f"/extensionsRequired/{i}",
                "export without it",
            )
            if name not in APPEARANCE or document.strict:
                raise fault
    used = dict.fromkeys(name for owner, _, _ in _owners(root) for name in owner.extensions)
    declared = dict.fromkeys(root.extensions_used or [])
    for name in used:
        if name not in declared:
            document.remark("extension-undeclared", detail=name)
    for owner, kind, pointer in _owners(root):
        for name in tuple(owner.extensions):
            places = SUPPORTED.get(name)
            if places is not None and kind not in places:
                document.repair(
                    "extension-misplaced",
                    f"extension {name} is not allowed on this object",
                    f"{pointer}/extensions/{name}",
                    detail=name,
                )
                del owner.extensions[name]


def unsimulated(document: Document, materials: tuple[Material, ...], nodes: Nodes) -> Iterator[Note]:
    """A note for each extension that is not simulated: the consequence, and how many objects it concerns.

    ``Note.materials`` are the materials that look different, of which an evaluation measures the share of the image.
    """
    root = document.root
    required = root.extensions_required or ()
    used = (name for owner, _, _ in _owners(root) for name in owner.extensions)
    names = dict.fromkeys((*(root.extensions_used or ()), *used, *required))
    drawn = np.flatnonzero(nodes.in_scene & (nodes.mesh >= 0))
    for name in (name for name in names if name not in SUPPORTED and name not in METADATA_ONLY):
        marked = _materials_with(root, name)
        objects = sum(_concerns(root, root.meshes[mesh], name, marked) for mesh in nodes.mesh[drawn].tolist())
        needed = ", which the file requires," if name in required else ""
        message = f"extension {name}{needed} is not simulated: {APPEARANCE.get(name, 'ignored')}"
        if objects:
            message += f"; {objects} of {len(drawn)} objects"
        if marked:
            message += (
                f", material{'s' * (len(marked) > 1)} {listed(materials[m].name or f'number {m}' for m in marked)}"
            )
        yield Note(message, "", "extension", objects, frozenset(marked))


def _materials_with(root: schema.Root, name: str) -> list[int]:
    """Materials with this extension, themselves or on one of their textures, in order."""
    textures = root.textures or []
    return [
        i
        for i, material in enumerate(root.materials or [])
        if name in material.extensions
        or any(
            name in info.extensions or (info.index < len(textures) and name in textures[info.index].extensions)
            for _, info in texture_infos(material)
        )
    ]


def _concerns(root: schema.Root, mesh: schema.Mesh, name: str, marked: list[int]) -> bool:
    return any(p.material in marked or name in p.extensions for p in mesh.primitives)


def texture_infos(material: schema.Material) -> Iterator[tuple[str, schema.TextureInfo]]:
    """(JSON path inside the material, reference) of the core textures of a material."""
    pbr = material.pbr_metallic_roughness or schema.MetallicRoughness()
    infos = {
        "pbrMetallicRoughness/baseColorTexture": pbr.base_color_texture,
        "pbrMetallicRoughness/metallicRoughnessTexture": pbr.metallic_roughness_texture,
        "normalTexture": material.normal_texture,
        "occlusionTexture": material.occlusion_texture,
        "emissiveTexture": material.emissive_texture,
    }
    yield from ((name, info) for name, info in infos.items() if info is not None)


def _owners(root: schema.Root) -> Iterator[tuple[schema.Property, str, str]]:
    """Objects that may carry extensions: (object, kind, JSON pointer)."""
    yield root, "", ""
    for kind in _ARRAYS:
        for i, item in enumerate(getattr(root, _FIELDS[kind]) or []):
            pointer = f"/{kind}/{i}"
            yield item, kind, pointer
            if kind == "materials":
                for name, info in texture_infos(item):
                    yield info, "textureInfo", f"{pointer}/{name}"
            elif kind == "meshes":
                yield from ((p, "primitives", f"{pointer}/primitives/{k}") for k, p in enumerate(item.primitives))
            elif kind == "animations":
                for k, channel in enumerate(item.channels):
                    yield channel, "channels", f"{pointer}/channels/{k}"
                    yield channel.target, "target", f"{pointer}/channels/{k}/target"
                yield from ((s, "animationSamplers", f"{pointer}/samplers/{k}") for k, s in enumerate(item.samplers))
