"""Materials, textures and images.  Image headers are read with the scene, pixels on demand."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from taubench_gl.errors import SceneError
from taubench_gl.memory_budget import require
from taubench_gl.scene.files import ImageSource, check_image, decode_image, open_image, shortened
from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.accessors import Accessors
from taubench_gl.scene.gltf.document import Document, OverMemory, is_data_uri, read_uri, resolve_uri
from taubench_gl.scene.gltf.ktx2 import decode_ktx2, is_ktx2, ktx2_size
from taubench_gl.scene.gltf.specular_glossiness import NAME as GLOSSINESS
from taubench_gl.scene.gltf.specular_glossiness import SpecularGlossiness
from taubench_gl.scene.memory import DECODING_BYTES
from taubench_gl.scene.model import Image, Material, Sampler, Texture

Array = np.ndarray
T = TypeVar("T", Material, SpecularGlossiness)

IMAGE_MEDIA_TYPES = ("image/png", "image/jpeg", "image/webp", "image/ktx2")
IMAGE_FORMATS = ("PNG", "JPEG", "WEBP")


def read_image(document: Document, accessors: Accessors, index: int) -> Image:
    """One image of the file, its size from the header.  Raises SceneError."""
    image, pointer = document.root.images[index], f"/images/{index}"
    if image.uri is None and image.buffer_view is None:
        raise document.error("must have either a uri or a bufferView", pointer)
    if image.uri is not None and image.buffer_view is not None:
        document.repair("image-source", "must have either a uri or a bufferView", pointer)
    if image.mime_type is not None and image.mime_type not in IMAGE_MEDIA_TYPES:
        message = f"image of type {image.mime_type} is not supported"
        document.repair("image-source", message, pointer, "use PNG, JPEG, WebP or KTX 2")
    if image.buffer_view is not None:
        source: ImageSource = accessors.view_bytes(image.buffer_view, f"{pointer}/bufferView")
    elif is_data_uri(image.uri):
        source = read_uri(document, image.uri, f"{pointer}/uri", IMAGE_MEDIA_TYPES)
    else:
        source = resolve_uri(document, image.uri, f"{pointer}/uri")
        document.identity.add_file(source)
    where = f"{document.path.name}#{pointer}"  # not the document, which the decoder would keep in memory

    def error(message: str, hint: str | None) -> SceneError:
        return SceneError(message, where=where, hint=hint)

    name = image.name or (source.stem if isinstance(source, Path) else "")
    if is_ktx2(source, error):
        size = ktx2_size(source, error)
        require(size[0] * size[1] * DECODING_BYTES, "the image", OverMemory, where)
        if not document.strict:  # as below; transcoding is fast
            decode_ktx2(source, error)
        return Image(name, size, partial(decode_ktx2, source, error))
    with open_image(source, IMAGE_FORMATS, error) as opened:
        size = opened.size
    require(size[0] * size[1] * DECODING_BYTES, "the image", OverMemory, where)  # ``within_memory`` has all of them
    if not document.strict:  # a truncated image becomes a flat color, instead of an error when it is decoded
        check_image(source, IMAGE_FORMATS, error)
    return Image(name, size, partial(decode_image, source, IMAGE_FORMATS, error))


def unused_image(document: Document, index: int) -> Image:
    """Placeholder for an image that no material samples: its file is never opened."""
    error = document.error("is not sampled by any material and was not read", f"/images/{index}")

    def decode() -> Array:
        raise error

    return Image(document.root.images[index].name, (0, 0), decode)


MAX_MATERIALS = 1 << 16
"""Most materials of a file: each takes a tenth of a millisecond and a record on the GPU."""


class MaterialReader:
    """Reads the materials of one document, then the images that they sample."""

    def __init__(self, document: Document, accessors: Accessors):
        self.document, self.accessors = document, accessors
        self._needed: set[int] = set()
        self._unreadable: set[int] = set()  # images
        self._glossy: dict[int, SpecularGlossiness] = {}  # by material

    def materials(self) -> tuple[Material, ...]:
        """All materials.  Also checks the textures and samplers that no material uses."""
        root = self.document.root
        if len(root.materials or ()) > MAX_MATERIALS:
            message, hint = f"{len(root.materials)} materials, the limit is {MAX_MATERIALS}", "merge equal materials"
            raise self.document.error(message, f"/materials/{MAX_MATERIALS}", hint)
        for i, texture in enumerate(root.textures or []):
            self._resolved("samplers", texture.sampler, f"/textures/{i}/sampler")
            self._resolved("images", texture.source, f"/textures/{i}/source")
        return tuple(self._material(m, i) for i, m in enumerate(root.materials or []))

    def images(self) -> tuple[Image, ...]:
        """All images of the file; images that no material samples are not opened.  Call after ``materials``."""
        return tuple(
            self._image(i) if i in self._needed else unused_image(self.document, i)
            for i in range(len(self.document.root.images or []))
        )

    def _image(self, index: int) -> Image:
        document = self.document
        try:
            return read_image(document, self.accessors, index)
        except OverMemory:
            raise
        except SceneError as error:
            label = self._label(index)
            document.notes.repair("texture-unreadable", error, detail=label, where=f"/images/{index}")
            self._unreadable.add(index)
            return unused_image(document, index)

    def _label(self, index: int) -> str:
        image = self.document.root.images[index]
        uri = "" if image.uri is None or is_data_uri(image.uri) else image.uri
        return shortened(image.name or uri or f"image {index}", 40)

    def finished(
        self, materials: tuple[Material, ...], images: tuple[Image, ...]
    ) -> tuple[tuple[Material, ...], tuple[Image, ...]]:
        """``materials`` without textures whose image cannot be read, and with specular-glossiness converted.

        The images of the conversion follow those of the file.
        """
        extended = list(images)
        out = []
        for i, material in enumerate(materials):
            material = self._readable(material)
            if i in self._glossy:
                material = self._readable(self._glossy[i]).textured(material, extended)
            out.append(material)
        return tuple(out), tuple(extended)

    def _readable(self, owner: T) -> T:
        """``owner``, which has fields named ``..._texture``, without textures whose image cannot be read."""
        slots = [field.name for field in fields(owner) if field.name.endswith("_texture")]
        lost = [s for s in slots if (t := getattr(owner, s)) is not None and t.image in self._unreadable]
        return replace(owner, **dict.fromkeys(lost)) if lost else owner

    def _material(self, material: schema.Material, index: int) -> Material:
        document, pointer = self.document, f"/materials/{index}"
        pbr = material.pbr_metallic_roughness or schema.MetallicRoughness()
        strength = document.extension(material, "KHR_materials_emissive_strength", schema.EmissiveStrength, pointer)
        scale = 1.0 if strength is None else strength.emissive_strength
        normal, occlusion = material.normal_texture, material.occlusion_texture
        read = Material(
            name=material.name,
            base_color=pbr.base_color_factor,
            base_color_texture=self._texture(
                pbr.base_color_texture, f"{pointer}/pbrMetallicRoughness/baseColorTexture"
            ),
            metallic=pbr.metallic_factor,
            roughness=pbr.roughness_factor,
            metallic_roughness_texture=self._texture(
                pbr.metallic_roughness_texture, f"{pointer}/pbrMetallicRoughness/metallicRoughnessTexture"
            ),
            normal_texture=self._texture(normal, f"{pointer}/normalTexture"),
            normal_scale=1.0 if normal is None else normal.scale,
            occlusion_texture=self._texture(occlusion, f"{pointer}/occlusionTexture"),
            occlusion_strength=1.0 if occlusion is None else occlusion.strength,
            emissive=tuple(c * scale for c in material.emissive_factor),
            emissive_strength=scale,
            emissive_texture=self._texture(material.emissive_texture, f"{pointer}/emissiveTexture"),
            alpha_mode=material.alpha_mode,
            alpha_cutoff=material.alpha_cutoff,
            double_sided=material.double_sided,
            unlit="KHR_materials_unlit" in material.extensions,
            **self._dielectric(material, pointer),
        )
        glossy = self._specular_glossiness(material, pointer)
        if glossy is None:
            return read
        self._glossy[index] = glossy
        document.remark("specular-glossiness", pointer, detail=material.name)
        return replace(read, base_color_texture=None, metallic_roughness_texture=None, **glossy.factors())

    def _specular_glossiness(self, material: schema.Material, pointer: str) -> SpecularGlossiness | None:
        extension = self.document.extension(material, GLOSSINESS, schema.PbrSpecularGlossiness, pointer)
        if extension is None:
            return None
        where = f"{pointer}/extensions/{GLOSSINESS}"
        out = SpecularGlossiness(
            extension.diffuse_factor,
            extension.specular_factor,
            extension.glossiness_factor,
            self._texture(extension.diffuse_texture, f"{where}/diffuseTexture"),
            self._texture(extension.specular_glossiness_texture, f"{where}/specularGlossinessTexture"),
        )
        if not out.aligned:
            self.document.remark("specular-texture", where, detail=material.name)
            out = replace(out, specular_texture=None)
        return out

    def _dielectric(self, material: schema.Material, pointer: str) -> dict[str, Any]:
        """Fields of a material from KHR_materials_specular, ior, transmission and volume."""
        read, out = self.document.extension, {}
        if (specular := read(material, "KHR_materials_specular", schema.Specular, pointer)) is not None:
            where = f"{pointer}/extensions/KHR_materials_specular"
            out["specular"], out["specular_color"] = specular.specular_factor, specular.specular_color_factor
            out["specular_texture"] = self._texture(specular.specular_texture, f"{where}/specularTexture")
            color = self._texture(specular.specular_color_texture, f"{where}/specularColorTexture")
            out["specular_color_texture"] = color
        if (ior := read(material, "KHR_materials_ior", schema.Ior, pointer)) is not None:
            # Below 1 the extension has 0 alone.
            out["ior"] = ior.ior if ior.ior == 0.0 else max(ior.ior, 1.0)
        if (transmission := read(material, "KHR_materials_transmission", schema.Transmission, pointer)) is not None:
            where = f"{pointer}/extensions/KHR_materials_transmission/transmissionTexture"
            out["transmission"] = transmission.transmission_factor
            out["transmission_texture"] = self._texture(transmission.transmission_texture, where)
        if (volume := read(material, "KHR_materials_volume", schema.Volume, pointer)) is not None:
            out["thick"], out["attenuation_color"] = volume.thickness_factor > 0.0, volume.attenuation_color
            out["attenuation_distance"] = np.inf if volume.attenuation_distance is None else volume.attenuation_distance
        return out

    def _texture(self, info: schema.TextureInfo | None, pointer: str) -> Texture | None:
        if info is None:
            return None
        document = self.document
        if self._resolved("textures", info.index, f"{pointer}/index") is None:
            return None
        texture, where = document.root.textures[info.index], f"/textures/{info.index}"
        source = self._resolved("images", texture.source, f"{where}/source")
        for name in ("EXT_texture_webp", "KHR_texture_basisu"):
            other = document.extension(texture, name, schema.TextureSource, where)
            if other is not None:
                other_source = self._resolved("images", other.source, f"{where}/extensions/{name}/source")
                source = source if other_source is None else other_source
        if source is None:
            document.remark("texture-without-image", where)
            return None
        transform = document.extension(info, "KHR_texture_transform", schema.TextureTransform, pointer)
        texcoord = info.tex_coord
        if transform is not None and transform.tex_coord is not None:
            texcoord = transform.tex_coord
        if texcoord > 1:
            document.remark("texcoord-number", pointer, detail=f"TEXCOORD_{texcoord}")
            return None
        self._needed.add(source)
        return Texture(source, self._sampler(texture), texcoord, uv_transform(transform))

    def _resolved(self, collection: str, index: int | None, pointer: str) -> int | None:
        """``index`` if there is such an object, else None."""
        usable = index is not None and self.document.has(collection, index, pointer, "texture-reference")
        return index if usable else None

    def _sampler(self, texture: schema.Texture) -> Sampler:
        if texture.sampler is None or texture.sampler >= len(self.document.root.samplers or []):
            return Sampler()
        s = self.document.root.samplers[texture.sampler]
        default = Sampler()
        return Sampler(s.mag_filter or default.mag_filter, s.min_filter or default.min_filter, s.wrap_s, s.wrap_t)


def uv_transform(transform: schema.TextureTransform | None) -> Array:
    """KHR_texture_transform as uv' = M @ (u, v, 1): offset * rotation * scale.  (2, 3) float64.

    Rotation is counter-clockwise in the image, whose v axis points down; hence the sign of the sines.
    """
    if transform is None:
        return np.eye(2, 3)
    c, s = np.cos(transform.rotation), np.sin(transform.rotation)
    (x, y), (sx, sy) = transform.offset, transform.scale
    return np.array([[c * sx, s * sy, x], [-s * sx, c * sy, y]])
