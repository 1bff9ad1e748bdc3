"""Writes glTF 2.0 files with pygltflib from arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pygltflib as gl

from taubench_gl.outputs import image_bytes, replacing

_COMPONENT = {"f4": gl.FLOAT, "u4": gl.UNSIGNED_INT, "u2": gl.UNSIGNED_SHORT, "u1": gl.UNSIGNED_BYTE}
_TYPE = {1: gl.SCALAR, 2: gl.VEC2, 3: gl.VEC3, 4: gl.VEC4, 16: gl.MAT4}


class Writer:
    """A glTF document under construction.  Methods return the index of the added element unless stated otherwise.

    ``share``: equal arrays become one accessor, so that a clip used several times is stored once.
    """

    def __init__(self, copyright_: str, generator: str, share: bool = False):
        self.gltf = gl.GLTF2(asset=gl.Asset(version="2.0", generator=generator, copyright=copyright_))
        self.gltf.scenes = [gl.Scene(nodes=[])]
        self.gltf.scene = 0
        self._blob = bytearray()
        self._shared: dict[tuple, int] | None = {} if share else None

    def add(self, collection: list, item: Any) -> int:
        """Add an item to one of the lists of ``gltf``."""
        collection.append(item)
        return len(collection) - 1

    def view(self, payload: bytes, target: int | None = None) -> int:
        self._blob += bytes(-len(self._blob) % 4)
        view = gl.BufferView(buffer=0, byteOffset=len(self._blob), byteLength=len(payload), target=target)
        self._blob += payload
        return self.add(self.gltf.bufferViews, view)

    def accessor(self, values: Any, dtype: str = "f4", target: int | None = None, bounds: bool = False) -> int:
        array = np.ascontiguousarray(values, dtype=f"<{dtype}")
        array = array.reshape(len(array), -1)
        key = (array.tobytes(), array.shape, dtype, target, bounds)
        if self._shared is not None and key in self._shared:
            return self._shared[key]
        accessor = gl.Accessor(
            bufferView=self.view(array.tobytes(), target),
            componentType=_COMPONENT[dtype],
            count=len(array),
            type=_TYPE[array.shape[1]],
        )
        if bounds:
            accessor.min, accessor.max = array.min(axis=0).tolist(), array.max(axis=0).tolist()
        index = self.add(self.gltf.accessors, accessor)
        if self._shared is not None:
            self._shared[key] = index
        return index

    def texture(self, pixels: np.ndarray, lossy: bool = False) -> int:
        """Add a texture of ``pixels``, as ``image`` takes them, sampled with repeat and mipmaps."""
        image = self.image(pixels, lossy)
        if not self.gltf.samplers:
            self.gltf.samplers.append(gl.Sampler(magFilter=gl.LINEAR, minFilter=gl.LINEAR_MIPMAP_LINEAR))
        return self.add(self.gltf.textures, gl.Texture(source=image, sampler=0))

    def image(self, pixels: np.ndarray, lossy: bool = False) -> int:
        """Add ``pixels``, (h, w, 3 or 4) uint8, as an embedded PNG; ``lossy``: as a JPEG, if there is no alpha."""
        lossy = lossy and pixels.shape[2] == 3
        file = image_bytes(pixels, "jpeg", quality=90) if lossy else image_bytes(pixels, optimize=True)
        mime = "image/jpeg" if lossy else "image/png"
        return self.add(self.gltf.images, gl.Image(mimeType=mime, bufferView=self.view(file)))

    def material(
        self,
        name: str,
        color: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0),
        metallic: float = 0.0,
        roughness: float = 0.8,
        texture: int | None = None,
        normal: int | None = None,
        **properties: Any,
    ) -> int:
        surface = gl.PbrMetallicRoughness(
            baseColorFactor=[*color, 1.0][:4], metallicFactor=metallic, roughnessFactor=roughness
        )
        if texture is not None:
            surface.baseColorTexture = gl.TextureInfo(index=texture)
        material = gl.Material(name=name, pbrMetallicRoughness=surface, alphaCutoff=None, **properties)
        if normal is not None:
            material.normalTexture = gl.NormalMaterialTexture(index=normal)
        return self.add(self.gltf.materials, material)

    def primitive(self, shape: dict[str, np.ndarray], material: int, targets: list[dict] | None = None) -> gl.Primitive:
        """A primitive for ``mesh``.

        ``shape``: any of POSITION, NORMAL (n, 3), TEXCOORD_0 (n, 2), JOINTS_0, WEIGHTS_0 (n, 4), and
        indices, three per triangle.  ``targets``: offsets of POSITION and NORMAL, (n, 3) each.
        """
        attributes = gl.Attributes()
        for name, values in shape.items():
            if name != "indices":
                dtype = "u1" if name == "JOINTS_0" else "f4"
                index = self.accessor(values, dtype, gl.ARRAY_BUFFER, bounds=name == "POSITION")
                setattr(attributes, name, index)
        kind = "u2" if shape["indices"].max() < 65535 else "u4"
        indices = self.accessor(shape["indices"].reshape(-1), kind, gl.ELEMENT_ARRAY_BUFFER)
        primitive = gl.Primitive(attributes=attributes, indices=indices, material=material, mode=gl.TRIANGLES)
        primitive.targets = [
            {name: self.accessor(v, "f4", gl.ARRAY_BUFFER, bounds=name == "POSITION") for name, v in t.items()}
            for t in targets or []
        ]
        return primitive

    def mesh(self, name: str, *primitives: gl.Primitive, weights: list[float] | None = None) -> int:
        return self.add(self.gltf.meshes, gl.Mesh(name=name, primitives=list(primitives), weights=weights or []))

    def node(self, name: str, parent: int | None = None, **properties: Any) -> int:
        index = self.add(self.gltf.nodes, gl.Node(name=name, **properties))
        (self.gltf.scenes[0].nodes if parent is None else self.gltf.nodes[parent].children).append(index)
        return index

    def light(self, **properties: Any) -> dict:
        """Add a KHR_lights_punctual light; returns the ``extensions`` of the node that carries it."""
        name = self.uses("KHR_lights_punctual")
        lights = self.gltf.extensions.setdefault(name, {"lights": []})["lights"]
        lights.append(properties)
        return {name: {"light": len(lights) - 1}}

    def uses(self, extension: str) -> str:
        """Declare an extension, and return its name."""
        if extension not in self.gltf.extensionsUsed:
            self.gltf.extensionsUsed.append(extension)
        return extension

    def skin(self, name: str, joints: list[int], inverse_bind: np.ndarray) -> int:
        columns = np.swapaxes(inverse_bind, -1, -2).reshape(-1, 16)
        skin = gl.Skin(name=name, joints=joints, inverseBindMatrices=self.accessor(columns), skeleton=joints[0])
        return self.add(self.gltf.skins, skin)

    def camera(self, name: str, yfov: float, znear: float, zfar: float) -> int:
        lens = gl.Perspective(yfov=yfov, znear=znear, zfar=zfar, aspectRatio=16 / 9)
        return self.add(self.gltf.cameras, gl.Camera(name=name, type="perspective", perspective=lens))

    def animation(self, name: str, *tracks: tuple[int | str, str, Any, Any, str]) -> int:
        """Add an animation of tracks (node, path, times, values, interpolation).

        With the path "pointer", a JSON pointer stands for the node; its values are numbers, vectors or flags.
        """
        animation = gl.Animation(name=name)
        for node, path, times, values, interpolation in tracks:
            flat = np.reshape(values, (-1, 1)) if path == "weights" else np.asarray(values)
            keys = self.accessor(times, bounds=True)
            output = self.accessor(flat, "u1" if flat.dtype == bool else "f4")
            sampler = gl.AnimationSampler(input=keys, output=output, interpolation=interpolation)
            animation.samplers.append(sampler)
            target = gl.AnimationChannelTarget(path=path)
            if path == "pointer":
                target.extensions = {self.uses("KHR_animation_pointer"): {"pointer": node}}
            else:
                target.node = node
            animation.channels.append(gl.AnimationChannel(sampler=len(animation.samplers) - 1, target=target))
        return self.add(self.gltf.animations, animation)

    def save(self, path: Path) -> None:
        self.gltf.buffers = [gl.Buffer(byteLength=len(self._blob))]
        self.gltf.set_binary_blob(bytes(self._blob))
        save_document(self.gltf, path)


def save_document(gltf: gl.GLTF2, path: Path) -> None:
    """Write a document with its binary chunk as .glb; the file is replaced atomically.

    Raises OutputError.
    """
    with replacing(path, parents=True) as partial:
        gltf.save_binary(str(partial))
