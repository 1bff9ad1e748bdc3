"""Materials, textures and images.  Image headers are read with the scene, pixels on demand."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from taubench_gl.errors import SceneError
from taubench_gl.scene.files import ImageSource, decode_image, open_image
from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.accessors import Accessors
from taubench_gl.scene.gltf.document import Document, is_data_uri, read_uri, resolve_uri
from taubench_gl.scene.model import Image, Material, Sampler, Texture

Array = np.ndarray

IMAGE_MEDIA_TYPES = ("image/png", "image/jpeg", "image/webp")
IMAGE_FORMATS = ("PNG", "JPEG", "WEBP")


def read_image(document: Document, accessors: Accessors, index: int) -> Image:
    """One image of the file, its size from the header.  Raises SceneError."""
    image, pointer = document.root.images[index], f"/images/{index}"
    if (image.uri is None) == (image.buffer_view is None):
        raise document.error("must have either a uri or a bufferView", pointer)
    if image.mime_type is not None and image.mime_type not in IMAGE_MEDIA_TYPES:
        raise document.error(f"image of type {image.mime_type} is not supported", pointer, "use PNG, JPEG or WebP")
    if image.buffer_view is not None:
        source: ImageSource = accessors.view_bytes(image.buffer_view, f"{pointer}/bufferView")
    elif is_data_uri(image.uri):
        source = read_uri(document, image.uri, f"{pointer}/uri", IMAGE_MEDIA_TYPES)
    else:
        source = resolve_uri(document, image.uri, f"{pointer}/uri")
        document.identity.add_file(source)
    where = f"{document.path.name}#{pointer}"  # not the document, which the decoder would keep in memory

    def error(what: str, hint: str | None) -> SceneError:
        return SceneError(what, where=where, hint=hint)

    with open_image(source, IMAGE_FORMATS, error) as opened:
        size = opened.size
    name = image.name or (source.stem if isinstance(source, Path) else "")
    return Image(name, size, partial(decode_image, source, IMAGE_FORMATS, error))


def unused_image(document: Document, index: int) -> Image:
    """Placeholder for an image that no material samples: its file is never opened."""
    error = document.error("is not sampled by any material and was not read", f"/images/{index}")

    def decode() -> Array:
        raise error

    return Image(document.root.images[index].name, (0, 0), decode)


class MaterialReader:
    """Reads the materials of one document, then the images that they sample."""

    def __init__(self, document: Document, accessors: Accessors):
        self.document, self.accessors = document, accessors
        self._needed: set[int] = set()

    def materials(self) -> tuple[Material, ...]:
        """All materials.  Also checks the textures and samplers that no material uses."""
        root = self.document.root
        for i, texture in enumerate(root.textures or []):
            if texture.sampler is not None:
                self.document.item("samplers", texture.sampler, f"/textures/{i}/sampler")
            if texture.source is not None:
                self.document.item("images", texture.source, f"/textures/{i}/source")
        return tuple(self._material(m, f"/materials/{i}") for i, m in enumerate(root.materials or []))

    def images(self) -> tuple[Image, ...]:
        """All images of the file; images that no material samples are not opened.  Call after ``materials``."""
        document = self.document
        return tuple(
            read_image(document, self.accessors, i) if i in self._needed else unused_image(document, i)
            for i in range(len(document.root.images or []))
        )

    def _material(self, material: schema.Material, pointer: str) -> Material:
        document = self.document
        pbr = material.pbr_metallic_roughness or schema.MetallicRoughness()
        strength = document.extension(material, "KHR_materials_emissive_strength", schema.EmissiveStrength, pointer)
        scale = 1.0 if strength is None else strength.emissive_strength
        specular = self._specular(material, pointer)
        normal, occlusion = material.normal_texture, material.occlusion_texture
        return Material(
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
            specular=specular,
            unlit="KHR_materials_unlit" in material.extensions,
        )

    def _specular(self, material: schema.Material, pointer: str) -> float:
        """The factor of KHR_materials_specular; its color and textures are not simulated, with a note."""
        extension = self.document.extension(material, "KHR_materials_specular", schema.Specular, pointer)
        if extension is None:
            return 1.0
        if extension.specular_texture or extension.specular_color_factor or extension.specular_color_texture:
            self.document.note("KHR_materials_specular: only specularFactor is simulated", pointer)
        return extension.specular_factor

    def _texture(self, info: schema.TextureInfo | None, pointer: str) -> Texture | None:
        if info is None:
            return None
        document = self.document
        texture = document.item("textures", info.index, f"{pointer}/index")
        source, where = texture.source, f"/textures/{info.index}"
        webp = document.extension(texture, "EXT_texture_webp", schema.TextureSource, where)
        if webp is not None:
            source = webp.source
            document.item("images", source, f"{where}/extensions/EXT_texture_webp/source")
        if source is None:
            document.note("texture has no readable image; drawn without it", where)
            return None
        transform = document.extension(info, "KHR_texture_transform", schema.TextureTransform, pointer)
        texcoord = info.tex_coord
        if transform is not None and transform.tex_coord is not None:
            texcoord = transform.tex_coord
        if texcoord > 1:
            document.note(f"texture uses TEXCOORD_{texcoord}; only 0 and 1 are supported; drawn without it", pointer)
            return None
        self._needed.add(source)
        return Texture(source, self._sampler(texture), texcoord, uv_transform(transform))

    def _sampler(self, texture: schema.Texture) -> Sampler:
        if texture.sampler is None:
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
