"""Which extensions are read, which are drawn without, and which make a file unusable."""

from __future__ import annotations

from collections.abc import Iterator

from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.document import Document

SUPPORTED: dict[str, tuple[str, ...]] = {
    "KHR_lights_punctual": ("", "nodes"),
    "KHR_texture_transform": ("textureInfo",),
    "KHR_mesh_quantization": (),
    "KHR_materials_unlit": ("materials",),
    "KHR_materials_emissive_strength": ("materials",),
    "KHR_materials_specular": ("materials",),
    "KHR_node_visibility": ("nodes",),
    "KHR_animation_pointer": ("target",),
    "EXT_mesh_gpu_instancing": ("nodes",),
    "KHR_draco_mesh_compression": ("primitives",),
    "EXT_meshopt_compression": ("bufferViews", "buffers"),
    "KHR_meshopt_compression": ("bufferViews", "buffers"),
    "EXT_texture_webp": ("textures",),
}
"""Extension -> the kinds of object that may carry it ('' is the document itself)."""

HARMLESS = frozenset({"KHR_xmp", "KHR_xmp_json_ld"})
"""Change nothing that is drawn, so nobody needs to be told."""


def check_extensions(document: Document) -> None:
    """Refuse required extensions that are not supported, note used ones, refuse known ones in the wrong place."""
    root = document.root
    for i, name in enumerate(root.extensions_required or []):
        if name not in SUPPORTED and name not in HARMLESS:
            raise document.error(
                f"requires the extension {name}, which is not supported",
                f"/extensionsRequired/{i}",
                "export without it",
            )
    for name in dict.fromkeys(root.extensions_used or []):
        if name not in SUPPORTED and name not in HARMLESS:
            document.note(f"extension {name} is used but not simulated")
    for owner, kind, pointer in _owners(root):
        for name in owner.extensions:
            places = SUPPORTED.get(name)
            if places is not None and kind not in places:
                raise document.error(f"extension {name} does not belong here", f"{pointer}/extensions/{name}")


def _owners(root: schema.Root) -> Iterator[tuple[schema.Property, str, str]]:
    """Objects that carry extensions, the kind of place they are, and their JSON pointer."""
    yield root, "", ""
    for kind, items in (
        ("nodes", root.nodes),
        ("scenes", root.scenes),
        ("materials", root.materials),
        ("textures", root.textures),
        ("images", root.images),
        ("samplers", root.samplers),
        ("meshes", root.meshes),
        ("skins", root.skins),
        ("cameras", root.cameras),
        ("accessors", root.accessors),
        ("bufferViews", root.buffer_views),
        ("buffers", root.buffers),
        ("animations", root.animations),
    ):
        for i, item in enumerate(items or []):
            pointer = f"/{kind}/{i}"
            if item.extensions:
                yield item, kind, pointer
            if kind == "meshes":
                yield from ((p, "primitives", f"{pointer}/primitives/{k}") for k, p in enumerate(item.primitives))
            elif kind == "animations":
                for k, channel in enumerate(item.channels):
                    yield channel, "channels", f"{pointer}/channels/{k}"
                    yield channel.target, "target", f"{pointer}/channels/{k}/target"
                yield from ((s, "animationSamplers", f"{pointer}/samplers/{k}") for k, s in enumerate(item.samplers))
