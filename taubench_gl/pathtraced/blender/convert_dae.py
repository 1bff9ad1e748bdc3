"""Reads a Collada file with what Blender's importer gets wrong: opacity, ambient lights, missing images.

Runs in Blender's Python.
"""

import os
from urllib.parse import unquote
from xml.etree import ElementTree

import bpy

LUMINANCE = (0.212671, 0.715160, 0.072169)
"""Weights of linear RGB in luminance, by the specification of Collada 1.4.1."""


def import_dae(source, losses):
    """Import ``source``.  Raises RuntimeError for Blender 5, which reads no Collada, and for broken XML."""
    if "collada_import" not in dir(bpy.ops.wm):
        raise RuntimeError("Blender 5 does not read Collada; use bpy 4.5")
    bpy.ops.wm.collada_import(filepath=source)
    root = ElementTree.parse(source).getroot()
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    effects = {"#" + e.get("id", ""): opacity_of(e) for e in root.iter("effect")}
    for material in root.iter("material"):
        instance = material.find("instance_effect")
        opacity = effects.get(instance.get("url")) if instance is not None else None
        set_opacity(bpy.data.materials.get(material.get("name") or material.get("id", "")), opacity)
    for item in [o for o in bpy.data.objects if o.type == "LIGHT"]:
        sources = [e for e in root.iter("light") if item.data.name in (e.get("name"), e.get("id"))]
        ambient = any(e.find("technique_common/ambient") is not None for e in sources)
        if ambient or item.data.type not in ("POINT", "SUN", "SPOT", "AREA"):
            losses.add("ambient and hemispherical lights, which glTF has no form for", [item.name])
            bpy.data.objects.remove(item)
    folder = os.path.dirname(source)
    for image in root.iter("image"):
        name = unquote("".join(image.itertext()).strip().removeprefix("file://"))
        if name and not os.path.isfile(os.path.join(folder, name)):
            losses.add("images whose files are missing", [os.path.basename(name)])


def opacity_of(effect):
    """Opacity of an effect whose transparency is a color; None without one."""
    transparent = effect.find(".//transparent")
    color = transparent.find("color") if transparent is not None else None
    if color is None or not color.text:
        return None
    factor = effect.find(".//transparency/float")
    factor = float(factor.text) if factor is not None and factor.text else 1.0
    r, g, b, a = (*map(float, color.text.split()), 1.0)[:4]
    mode = transparent.get("opaque", "A_ONE")
    amount = factor * (a if mode.startswith("A") else sum(w * c for w, c in zip(LUMINANCE, (r, g, b))))
    return 1.0 - amount if mode.endswith("ZERO") else amount


def set_opacity(material, opacity):
    if material is None or opacity is None or material.node_tree is None:
        return
    for node in material.node_tree.nodes:
        if node.type == "BSDF_PRINCIPLED" and not node.inputs["Alpha"].is_linked:
            node.inputs["Alpha"].default_value = min(max(opacity, 0.0), 1.0)
