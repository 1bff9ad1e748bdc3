"""Writes a Scene read from OBJ or AFF files as glTF, for programs that do not read these formats.

Vertex animation becomes morph targets.  Visibility becomes a scale of 0 or 1 of an additional parent node, which every
viewer supports.  Key times become float32.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pygltflib as gl

from taubench_gl.datasets.gltf_writer import Writer
from taubench_gl.errors import SceneError
from taubench_gl.scene.gltf.reader import CONSTANT_LIGHTS
from taubench_gl.scene.model import Camera, Channel, Light, Material, Primitive, Scene, Texture

Array = np.ndarray

_PATHS = ("translation", "rotation", "scale", "weights", "visible")


def write_scene(scene: Scene, path: Path) -> None:
    """Write ``scene`` with its active animations as .glb.  Raises SceneError for unsupported content, OutputError."""
    _refuse(scene)
    w = Writer("", "taubench-gl", share=True)
    w.gltf.scenes[0].name = scene.name
    textures = _Textures(w, scene)
    materials = [_material(w, m, textures) for m in scene.materials]
    cameras = [_camera(w, c) for c in scene.cameras]
    lights = [_light(w, light) for light in scene.lights]
    if any(light.constant for light in scene.lights):  # all or none: AFF's, which have no form in glTF
        w.gltf.asset.extras = {"taubench_gl": {CONSTANT_LIGHTS: "they are not attenuated with distance"}}
    meshes = [_mesh(w, mesh.name, mesh.primitives, mesh.weights, materials) for mesh in scene.meshes]
    nodes = _nodes(w, scene, meshes, cameras, lights)
    tracks = [_track(channel, nodes) for channel in scene.channels]
    if tracks:
        w.animation(" + ".join(scene.playing) or "animation", *tracks)
    w.save(path)


def _refuse(scene: Scene) -> None:
    """Raise SceneError for content that only glTF files have; those are edited instead (``gltf_edit``)."""
    nodes, where = scene.nodes, str(scene.path or scene.name)
    for present, content in (
        (bool(scene.skins), "skins"),
        (bool(nodes.instances), "instances"),
        (bool(np.any(nodes.has_matrix)), "nodes with a matrix"),
        (any(c.kind != "perspective" for c in scene.cameras), "a camera without perspective"),
        (any(c.target != "node" or c.path not in _PATHS for c in scene.channels), "animated lenses or lights"),
    ):
        if present:
            raise SceneError(f"has {content}, which cannot be written from this format", where=where)


def _nodes(w: Writer, scene: Scene, meshes: list[int | None], cameras: list[int], lights: list[dict]) -> dict:
    """Write all nodes, with a parent for each node whose visibility changes.  (node, 'visible' or '') -> index."""
    nodes = scene.nodes
    switched = {c.index for c in scene.channels if c.path == "visible"} | set(np.flatnonzero(~nodes.visible).tolist())
    indices: dict[tuple[int, str], int] = {}
    for node in _parents_first(nodes.parent):
        parent = int(nodes.parent[node])
        above = None if parent < 0 else indices[parent, ""]
        if node in switched:
            shown = [float(nodes.visible[node])] * 3
            above = indices[node, "visible"] = w.node(f"{nodes.names[node]} visible", above, scale=shown)
        content: dict[str, Any] = {}
        if nodes.mesh[node] >= 0 and meshes[nodes.mesh[node]] is not None:
            content["mesh"] = meshes[nodes.mesh[node]]
        if nodes.camera[node] >= 0:
            content["camera"] = cameras[nodes.camera[node]]
        if nodes.light[node] >= 0:
            content["extensions"] = lights[nodes.light[node]]
        indices[node, ""] = w.node(
            nodes.names[node],
            above,
            translation=nodes.translation[node].tolist(),
            rotation=(nodes.rotation[node] / np.linalg.norm(nodes.rotation[node])).tolist(),
            scale=nodes.scale[node].tolist(),
            **content,
        )
    return indices


def _parents_first(parent: Array) -> list[int]:
    out: list[int] = []
    left = list(range(len(parent)))
    listed = {-1}
    while left:
        ready = [node for node in left if int(parent[node]) in listed]
        out += ready
        listed |= set(ready)
        left = [node for node in left if node not in listed]
    return out


def _track(channel: Channel, nodes: dict[tuple[int, str], int]) -> tuple:
    values = np.asarray(channel.values, dtype=np.float64)
    times = _key_times(channel.times)
    if channel.path == "visible":
        shown = np.repeat(np.where(values > 0.5, 1.0, 0.0), 3, axis=1)
        return nodes[channel.index, "visible"], "scale", times, shown, "STEP"
    if channel.path == "rotation" and channel.interpolation != "CUBICSPLINE":
        values = values / np.linalg.norm(values, axis=-1, keepdims=True)
    return nodes[channel.index, ""], channel.path, times, values.reshape(-1, values.shape[-1]), channel.interpolation


def _key_times(times: Array) -> Array:
    """The nearest float32 of key times, strictly increasing: a key at the time of a later one moves one step down."""
    out = np.asarray(times, dtype=np.float32)
    for i in range(len(out) - 2, -1, -1):
        out[i] = min(out[i], np.nextafter(out[i + 1], np.float32(-np.inf)))
    # Times below 0 are not allowed: what ends at 0 is never seen, and what follows begins a denormal later.
    return np.maximum(out, np.arange(len(out), dtype=np.float32) * np.finfo(np.float32).smallest_subnormal)


def _mesh(w: Writer, name: str, primitives: tuple[Primitive, ...], weights: Array, materials: list[int]) -> int | None:
    drawn = [p for p in primitives if len(p.triangles)]
    if not drawn:
        return None
    morphs = any(p.targets for p in drawn)
    return w.mesh(name, *(_primitive(w, p, materials) for p in drawn), weights=list(weights) if morphs else None)


def _primitive(w: Writer, p: Primitive, materials: list[int]) -> gl.Primitive:
    attributes = gl.Attributes(POSITION=w.accessor(p.positions, "f4", gl.ARRAY_BUFFER, bounds=True))
    if p.normals is not None:
        attributes.NORMAL = w.accessor(_unit(p.normals), "f4", gl.ARRAY_BUFFER)
    for i, uv in enumerate(p.texcoords):
        if uv is not None:
            setattr(attributes, f"TEXCOORD_{i}", w.accessor(uv, "f4", gl.ARRAY_BUFFER))
    if p.colors is not None:
        attributes.COLOR_0 = w.accessor(p.colors, "f4", gl.ARRAY_BUFFER)
    out = gl.Primitive(
        attributes=attributes,
        indices=w.accessor(p.triangles.reshape(-1), "u4", gl.ELEMENT_ARRAY_BUFFER),
        material=None if p.material < 0 else materials[p.material],
        mode=gl.TRIANGLES,
    )
    for target in p.targets:
        moved = np.zeros_like(p.positions) if target.positions is None else target.positions
        entry = {"POSITION": w.accessor(moved, "f4", gl.ARRAY_BUFFER, bounds=True)}
        if target.normals is not None and p.normals is not None:
            entry["NORMAL"] = w.accessor(target.normals, "f4", gl.ARRAY_BUFFER)
        out.targets.append(entry)
    return out


def _unit(normals: Array) -> Array:
    """Unit vectors, normalized in float64, so that they are unit within a validator's tolerance in float32."""
    normals = normals.astype(np.float64)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 0, normals / np.where(length > 0, length, 1.0), [0.0, 0.0, 1.0])


class _Textures:
    """Images and textures, written when a material first uses them."""

    def __init__(self, w: Writer, scene: Scene):
        self._w, self._scene, self._images, self._texture_of = w, scene, {}, {}

    def info(self, texture: Texture) -> dict[str, Any]:
        """``index`` and ``texCoord`` of a textureInfo."""
        image, sampler = texture.image, texture.sampler
        if image not in self._images:
            self._images[image] = self._w.image(self._scene.images[image].decode())
        key = (image, sampler)
        if key not in self._texture_of:
            settings = gl.Sampler(
                magFilter=sampler.mag_filter, minFilter=sampler.min_filter, wrapS=sampler.wrap_s, wrapT=sampler.wrap_t
            )
            number = self._w.add(self._w.gltf.samplers, settings)
            written = gl.Texture(source=self._images[image], sampler=number)
            self._texture_of[key] = self._w.add(self._w.gltf.textures, written)
        return {"index": self._texture_of[key], "texCoord": texture.texcoord}


def _material(w: Writer, m: Material, textures: _Textures) -> int:
    surface = gl.PbrMetallicRoughness(
        baseColorFactor=[float(c) for c in m.base_color], metallicFactor=m.metallic, roughnessFactor=m.roughness
    )
    if m.base_color_texture is not None:
        surface.baseColorTexture = gl.TextureInfo(**textures.info(m.base_color_texture))
    out = gl.Material(name=m.name, pbrMetallicRoughness=surface, alphaMode=m.alpha_mode, doubleSided=m.double_sided)
    out.alphaCutoff = m.alpha_cutoff if m.alpha_mode == "MASK" else None
    strength = max(1.0, *m.emissive)
    out.emissiveFactor = [float(c) / strength for c in m.emissive]
    if m.emissive_texture is not None:
        out.emissiveTexture = gl.TextureInfo(**textures.info(m.emissive_texture))
    if m.normal_texture is not None:
        out.normalTexture = gl.NormalMaterialTexture(scale=m.normal_scale, **textures.info(m.normal_texture))
    extensions: dict[str, Any] = {}
    if strength > 1.0:
        extensions["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}
    extensions |= _dielectric(m, textures)
    if m.unlit:
        extensions["KHR_materials_unlit"] = {}
    out.extensions = {w.uses(name): extension for name, extension in extensions.items()}
    return w.add(w.gltf.materials, out)


def _dielectric(m: Material, textures: _Textures) -> dict[str, Any]:
    """KHR_materials_specular, ior, transmission and volume of a material, where they are not the defaults."""
    specular: dict[str, Any] = {} if m.specular == 1.0 else {"specularFactor": m.specular}
    if any(c != 1.0 for c in m.specular_color):
        specular["specularColorFactor"] = list(m.specular_color)
    transmission: dict[str, Any] = {"transmissionFactor": m.transmission} if m.transmission else {}
    maps = (
        (specular, "specularTexture", m.specular_texture),
        (specular, "specularColorTexture", m.specular_color_texture),
        (transmission, "transmissionTexture", m.transmission_texture),
    )
    for owner, name, texture in maps:
        if texture is not None:
            owner[name] = textures.info(texture)
    volume: dict[str, Any] = {"thicknessFactor": 1.0, "attenuationColor": list(m.attenuation_color)} if m.thick else {}
    if m.thick and np.isfinite(m.attenuation_distance):
        volume["attenuationDistance"] = m.attenuation_distance
    ior = {} if m.ior == 1.5 else {"ior": m.ior}
    parts = {"specular": specular, "ior": ior, "transmission": transmission, "volume": volume}
    return {f"KHR_materials_{name}": part for name, part in parts.items() if part}


def _camera(w: Writer, c: Camera) -> int:
    zfar = c.zfar if np.isfinite(c.zfar) else None
    lens = gl.Perspective(yfov=c.yfov, znear=c.znear, zfar=zfar, aspectRatio=c.aspect)
    return w.add(w.gltf.cameras, gl.Camera(name=c.name, type="perspective", perspective=lens))


def _light(w: Writer, light: Light) -> dict:
    values: dict[str, Any] = {"type": light.kind, "name": light.name, "intensity": float(light.intensity)}
    # Colors of the extension are limited to 0..1; larger values are moved to the intensity.
    peak = max(1.0, *light.color)
    values["color"] = [float(c) / peak for c in light.color]
    values["intensity"] *= peak
    if np.isfinite(light.range):
        values["range"] = light.range
    if light.kind == "spot":
        values["spot"] = {"innerConeAngle": light.inner_cone, "outerConeAngle": light.outer_cone}
    return w.light(**values)
