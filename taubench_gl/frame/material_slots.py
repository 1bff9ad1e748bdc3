"""Which textures of a material the channels need.  No OpenGL."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from taubench_gl.scene.model import Material, Texture

SLOTS = ("base_color", "normal", "metallic_roughness", "emissive", "occlusion")
"""Texture slots in binding order."""

SRGB_SLOTS = ("base_color", "emissive")
"""Slots whose texels are sRGB-encoded."""

MIRRORED_REPEAT = 33648
"""Wrap mode that samplers do not use: the shaders fold the coordinates instead."""


@dataclass(frozen=True, slots=True)
class MaterialKey:
    """Properties of a material that select its shader variant."""

    slots: tuple[str, ...]  # textures sampled
    alpha_test: bool
    double_sided: bool
    plain_uv: bool = False  # ``has_plain_uv`` of those slots


def texture_of(material: Material, slot: str) -> Texture | None:
    return getattr(material, f"{slot}_texture")


def wanted_slots(channels: Iterable[str], material: Material, *, normal_maps: bool = True) -> tuple[str, ...]:
    """Texture slots that ``channels`` need for this material."""
    channels = set(channels)
    needed = {
        "base_color": "base_color" in channels or tests_alpha(material),
        "normal": normal_maps and "normal" in channels and material.normal_scale != 0.0,
        "metallic_roughness": "material" in channels,
        "emissive": "emission" in channels and any(material.emissive) and not material.unlit,
        "occlusion": "material" in channels and material.occlusion_strength != 0.0,
    }
    return tuple(s for s in SLOTS if needed[s] and texture_of(material, s) is not None)


def has_plain_uv(material: Material, slots: Iterable[str]) -> bool:
    """Whether all these textures use the first texture coordinates without transform and without mirroring."""
    textures = [texture_of(material, slot) for slot in slots]
    return all(
        t.texcoord == 0
        and np.array_equal(t.uv_transform, np.eye(2, 3))
        and MIRRORED_REPEAT not in (t.sampler.wrap_s, t.sampler.wrap_t)
        for t in textures
    )


def tests_alpha(material: Material) -> bool:
    return material.alpha_mode in ("MASK", "BLEND")


def material_key(material: Material, channels: Iterable[str], *, normal_maps: bool = True) -> MaterialKey:
    """Key of the shader variant of ``material`` that writes ``channels``."""
    slots = wanted_slots(channels, material, normal_maps=normal_maps)
    return MaterialKey(slots, tests_alpha(material), material.double_sided, has_plain_uv(material, slots))


def images_of(used: Iterable[tuple[Material, tuple[str, ...]]]) -> set[tuple[int, bool]]:
    """(image, sRGB-encoded) of every texture of these slots of materials; an image used both ways is there twice."""
    return {(texture_of(material, slot).image, slot in SRGB_SLOTS) for material, slots in used for slot in slots}


def image_bytes(size: tuple[int, int]) -> int:
    """GPU memory of an RGBA8 texture with its mipmaps."""
    return size[0] * size[1] * 4 * 4 // 3
