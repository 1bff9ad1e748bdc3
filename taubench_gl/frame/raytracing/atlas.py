"""The atlas: every texture that hits of rays need, as encoded texels of one RGBA8 texture.

Shaders wrap, filter and decode (``shaders/raytracing/hit_textures.glsl``), so textures need no border, and an image may
serve as color and as numbers at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import PIL.Image

from taubench_gl.srgb import srgb_decode, srgb_encode

Array = np.ndarray
ATLAS_BYTES = 512 * 1024 * 1024
"""Memory of the atlas.  Where images need more, the largest are halved until they fit."""

BAND = 64
"""Rows of a smaller image that are averaged at a time: larger parts leave the processor's cache."""


@dataclass(frozen=True, slots=True)
class AtlasPlan:
    """Where each image lies in the atlas, and at what size."""

    size: tuple[int, int]  # texels of the atlas; (0, 0): no images
    places: dict[int, tuple[int, int]]  # image -> lower left texel
    sizes: dict[int, tuple[int, int]]  # image -> width, height as stored
    reduced: tuple[int, ...]  # images stored smaller than they are, ascending

    @property
    def bytes(self) -> int:
        return 4 * self.size[0] * self.size[1]


def plan_atlas(sizes: Mapping[int, tuple[int, int]], limit: int, budget: int = ATLAS_BYTES) -> AtlasPlan:
    """Pack images of ``sizes`` (image -> width, height) into one texture.

    ``limit``: largest side of a texture of the device; ``budget``: bytes of the atlas.
    """
    stored = {image: (w, h) for image, (w, h) in sizes.items()}
    while True:
        too_wide = [image for image, (w, h) in stored.items() if max(w, h) > limit]
        size, places = ((0, 0), {}) if too_wide else _shelves(stored, limit)
        if not too_wide and 4 * size[0] * size[1] <= budget and max(size) <= limit:
            break
        largest = max(w * h for w, h in stored.values())
        if largest == 1:
            break  # the device refuses it when it is allocated
        for image in too_wide or [i for i, (w, h) in stored.items() if w * h > largest // 2]:
            w, h = stored[image]
            stored[image] = max(w // 2, 1), max(h // 2, 1)
    reduced = sorted(image for image in stored if stored[image] != tuple(sizes[image]))
    return AtlasPlan(size, places, stored, tuple(reduced))


def _shelves(sizes: Mapping[int, tuple[int, int]], limit: int) -> tuple[tuple[int, int], dict[int, tuple[int, int]]]:
    """Pack rows of images, the highest first: (width, height) of the whole and the place of each."""
    if not sizes:
        return (0, 0), {}
    area = sum(w * h for w, h in sizes.values())
    width = max(max(w for w, _ in sizes.values()), int(np.ceil(np.sqrt(area))))
    while True:
        places, x, y, row = {}, 0, 0, 0
        for image in sorted(sizes, key=lambda i: (-sizes[i][1], -sizes[i][0], i)):
            w, h = sizes[image]
            if x + w > width:
                x, y = 0, y + row
                row = 0
            places[image] = x, y
            x, row = x + w, max(row, h)
        if y + row <= limit or width >= limit:
            return (width, y + row), places
        width = min(2 * width, limit)


def reduced_pixels(pixels: Array, size: tuple[int, int], *, color: bool) -> Array:
    """``pixels`` (h, w, 4) uint8 averaged by boxes to ``size`` (width, height) -> uint8.

    ``color``: RGB is sRGB-encoded and averaged in linear light.
    """
    if pixels.shape[1::-1] == size:
        return pixels
    values = np.arange(256, dtype=np.float32) / np.float32(255.0)  # of every byte: a lookup instead of a power
    decoded = srgb_decode(values).astype(np.float32) if color else values
    out = np.empty((*size[::-1], 4), np.uint8)
    factor, rest = divmod(len(pixels), size[1])
    rows = size[1] if rest else BAND  # of whole boxes a few rows at a time
    for first in range(0, size[1], rows):
        part, of = out[first : first + rows], pixels if rest else pixels[factor * first : factor * (first + rows)]
        for k in range(4):
            band = (decoded if k < 3 else values)[of[..., k]]
            band = np.asarray(PIL.Image.fromarray(band).resize(part.shape[1::-1], PIL.Image.Resampling.BOX))
            if color and k < 3:
                band = srgb_encode(np.clip(band, 0.0, 1.0)).astype(np.float32)
            part[..., k] = np.clip(np.rint(band * 255.0), 0, 255)
    return out


def atlas_pixels(
    plan: AtlasPlan, pixels: Callable[[int], Array], colors: Iterable[int]
) -> Iterable[tuple[tuple[int, int, int, int], Array]]:
    """(x, y, width, height) and texels (height, width, 4) uint8 of every image, one at a time.

    ``pixels``: image -> (h, w, 4) uint8; ``colors``: images whose RGB is sRGB-encoded.
    """
    colors = set(colors)
    for image, place in plan.places.items():
        yield (*place, *plan.sizes[image]), reduced_pixels(pixels(image), plan.sizes[image], color=image in colors)
