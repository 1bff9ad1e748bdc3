"""KHR_materials_pbrSpecularGlossiness as metallic-roughness materials.

The conversion is that of the sample code of the extension's definition (Khronos, "convert between workflows").  A
surface with diffuse color d and specular color s becomes the metallic m for which a dielectric reflectance of 0.04
gives the same diffuse and specular brightness, and the base color that gives both colors.  Roughness is 1 - glossiness.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import PIL.Image

from taubench_gl.scene.model import Image, Material, Texture
from taubench_gl.srgb import srgb_decode, srgb_encode

Array = np.ndarray

NAME = "KHR_materials_pbrSpecularGlossiness"
DIELECTRIC = 0.04
"""Reflectance of a dielectric surface at normal incidence."""
_EPSILON = 1e-6


def metallic_roughness(diffuse: Array, specular: Array) -> tuple[Array, Array]:
    """Base color (..., 3) and metallic (...) of linear diffuse and specular colors (..., 3), all in 0..1."""
    diffuse, specular = np.asarray(diffuse, np.float64), np.asarray(specular, np.float64)
    rest = 1.0 - specular.max(axis=-1)
    metallic = solve_metallic(_brightness(diffuse), _brightness(specular), rest)
    m = metallic[..., None]
    from_diffuse = diffuse * rest[..., None] / (1.0 - DIELECTRIC) / np.maximum(1.0 - m, _EPSILON)
    from_specular = (specular - DIELECTRIC * (1.0 - m)) / np.maximum(m, _EPSILON)
    base = from_diffuse + (from_specular - from_diffuse) * m * m
    return np.clip(base, 0.0, 1.0), metallic


def solve_metallic(diffuse: Array, specular: Array, rest: Array) -> Array:
    """The root in 0..1 of 0.04 m^2 + b m + c = 0; 0 where the specular brightness is below 0.04.  (...) -> (...)."""
    b = diffuse * rest / (1.0 - DIELECTRIC) + specular - 2.0 * DIELECTRIC
    c = DIELECTRIC - specular
    root = (-b + np.sqrt(np.maximum(b * b - 4.0 * DIELECTRIC * c, 0.0))) / (2.0 * DIELECTRIC)
    return np.where(specular < DIELECTRIC, 0.0, np.clip(root, 0.0, 1.0))


def _brightness(color: Array) -> Array:
    """Perceived brightness of a linear color.  (..., 3) -> (...)."""
    return np.sqrt(np.clip(color, 0.0, None) ** 2 @ np.array([0.299, 0.587, 0.114]))


@dataclass(frozen=True, slots=True)
class SpecularGlossiness:
    """One material of the extension: linear factors in 0..1 and its textures."""

    diffuse: tuple[float, float, float, float]
    specular: tuple[float, float, float]
    glossiness: float
    diffuse_texture: Texture | None
    specular_texture: Texture | None  # rgb: specular, sRGB; a: glossiness

    def factors(self) -> dict[str, object]:
        """Fields of ``Material`` without textures."""
        base, metallic = metallic_roughness(np.array(self.diffuse[:3]), np.array(self.specular))
        return {
            "base_color": (*base.tolist(), self.diffuse[3]),
            "metallic": float(metallic),
            "roughness": 1.0 - self.glossiness,
        }

    def textured(self, material: Material, images: list[Image]) -> Material:
        """``material`` with converted textures, whose images are appended to ``images``."""
        lead = self.diffuse_texture or self.specular_texture
        if lead is None:
            return material
        sources = tuple(None if t is None else images[t.image] for t in (self.diffuse_texture, self.specular_texture))
        sizes = [image.size for image in sources if image is not None]
        size = max(w for w, _ in sizes), max(h for _, h in sizes)
        first, name = len(images), material.name or "material"
        images.append(Image(f"{name} base color", size, partial(_pixels, self, sources, size, True)))
        images.append(Image(f"{name} metallic roughness", size, partial(_pixels, self, sources, size, False)))
        return replace(
            material,
            base_color=(1.0, 1.0, 1.0, 1.0),
            metallic=1.0,
            roughness=1.0,
            base_color_texture=replace(lead, image=first),
            metallic_roughness_texture=replace(lead, image=first + 1),
        )

    @property
    def aligned(self) -> bool:
        """Whether its textures have the same coordinates and wrapping, so that they can be combined texel by texel."""
        a, b = self.diffuse_texture, self.specular_texture
        if a is None or b is None:
            return True
        same_wrap = (a.sampler.wrap_s, a.sampler.wrap_t) == (b.sampler.wrap_s, b.sampler.wrap_t)
        return a.texcoord == b.texcoord and same_wrap and np.array_equal(a.uv_transform, b.uv_transform)


def _pixels(
    source: SpecularGlossiness, images: tuple[Image | None, Image | None], size: tuple[int, int], base: bool
) -> Array:
    """Texels of the converted base color (sRGB, with alpha) or of metallic (blue) and roughness (green).

    (h, w, 4) uint8.  Rows are converted a few at a time: the float64 arrays of a whole texture are 100 bytes a texel.
    """
    diffuse, specular = (None if image is None else _resized(image, size) for image in images)
    out = np.empty((size[1], size[0], 4), np.uint8)
    step = max(1, 2**18 // size[0])
    for top in range(0, size[1], step):
        rows = slice(top, top + step)
        count = len(out[rows])
        d = _linear(diffuse, rows, (count, size[0])) * source.diffuse
        s = _linear(specular, rows, (count, size[0])) * (*source.specular, source.glossiness)
        color, metallic = metallic_roughness(d[..., :3], s[..., :3])
        if base:
            texels = np.concatenate([srgb_encode(color), d[..., 3:]], axis=-1)
        else:
            ones = np.ones_like(metallic)
            texels = np.stack([ones, 1.0 - s[..., 3], metallic, ones], axis=-1)
        out[rows] = np.rint(np.clip(texels, 0.0, 1.0) * 255.0)
    return out


def _linear(pixels: Array | None, rows: slice, shape: tuple[int, int]) -> Array:
    """Linear RGBA in 0..1 of these rows, 1 without a texture.  (h, w, 4) float64."""
    if pixels is None:
        return np.ones((*shape, 4))
    out = pixels[rows] / 255.0
    out[..., :3] = srgb_decode(out[..., :3])
    return out


def _resized(image: Image, size: tuple[int, int]) -> Array:
    pixels = image.decode()
    if image.size == size:
        return pixels
    resized = PIL.Image.fromarray(pixels, "RGBA").resize(size, PIL.Image.Resampling.BILINEAR)
    return np.asarray(resized)
