"""The functions of GLSL methods for Python methods: ``frame["helpers"]``, for NumPy arrays and for torch tensors.

Images are (height, width, components), row 0 at the top.  Points ``at`` are (..., 2): x to the right and y down, in
pixels, center of pixel i at i.  Readers outside of the image return the nearest pixel.  Results equal those of GLSL up
to the rounding of float32.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from taubench_gl.conventions import GUARD_PX, NOT_COMPARABLE, Reason
from taubench_gl.srgb import LUMINANCE

Image = Any
"""An image or array of the method's library: numpy.ndarray or torch.Tensor."""

REJECT = int(NOT_COMPARABLE | Reason.POSITION | Reason.NORMAL)
_CHANGED = int(Reason.DIRECT | Reason.INDIRECT | Reason.COLOR)


class Helpers:
    """Functions of one frame.  ``frame``: the dict that ``step`` gets; ``size``: (width, height) of the result."""

    def __init__(self, frame: Mapping[str, Any], size: tuple[int, int], input_size: tuple[int, int], library: Any = np):
        self._frame, self._xp = frame, library
        self.output_size, self.input_size = size, input_size

    # ------------------------------------------------------------------------------------------------- pixels
    def pixels(self) -> Image:
        """Coordinates of all pixels of the result, (height, width, 2) float32."""
        return self._to_library(_pixels(self.output_size).copy())

    def input_pixels(self) -> Image:
        """The input pixel that contains the center of each pixel of the result, (height, width, 2) int64."""
        return self._to_library(_input_pixels(self.output_size, self.input_size).copy())

    def input_from_output(self, at: Image) -> Image:
        """Points ``at`` of the result, (..., 2), in pixels of the input."""
        return (at + 0.5) / self._scale() - 0.5

    def output_from_input(self, at: Image) -> Image:
        """Points ``at`` of the input, (..., 2), in pixels of the result."""
        return (at + 0.5) * self._scale() - 0.5

    def previous_px(self) -> Image:
        """Where the surface of each pixel was in the previous frame, (height, width, 2) (reads motion)."""
        return self.pixels() + self._at_result_pixels("motion") * self._scale()

    def reusable(self) -> Image:
        """Pixels with a history that no geometry mask discards, (height, width) bool (reads mask)."""
        return self._without_reasons("mask", REJECT)

    def reusable_exact(self) -> Image:
        """Pixels with a history that no geometry mask of the exact frames discards, (height, width) bool (reads
        exact_mask).
        """
        return self._without_reasons("exact_mask", REJECT | _CHANGED)

    def inside(self, at: Image) -> Image:
        """Whether points are inside the image of the result."""
        width, height = self.output_size
        x, y = at[..., 0], at[..., 1]
        within = (x >= -GUARD_PX) & (y >= -GUARD_PX)
        return within & (x <= width - 1 + GUARD_PX) & (y <= height - 1 + GUARD_PX)

    def nearest_surface(self) -> Image:
        """The pixel nearest to the camera in the 3x3 neighborhood of each input pixel, (height, width, 2) int64."""
        depth = self._frame["position"][..., 3:]
        at = self._to_library(_pixels(self.input_size).copy())
        best, nearest_depth = self._int(at), depth
        nearest = self._xp.where(nearest_depth > 0, nearest_depth, nearest_depth * 0 + 1e30)
        for dy in (1, 0, -1):  # rows count from the bottom in GLSL, where the first of equals is kept
            for dx in (-1, 0, 1):
                moved = self._int(at) + self._to_library(np.array([dx, dy]))
                other = self.fetch(depth, moved)
                closer = (other > 0) & (other < nearest)
                nearest, best = self._xp.where(closer, other, nearest), self._xp.where(closer, moved, best)
        width, height = self.input_size
        return self._xp.stack([best[..., 0].clip(0, width - 1), best[..., 1].clip(0, height - 1)], -1)

    # ---------------------------------------------------------------------------------------------- reading images
    def fetch(self, image: Image, pixel: Image) -> Image:
        """Values of pixels (..., 2) of integers."""
        height, width = image.shape[:2]
        return image[pixel[..., 1].clip(0, height - 1), pixel[..., 0].clip(0, width - 1)]

    def nearest(self, image: Image, at: Image) -> Image:
        """Values of the nearest pixels; of two, the right and the upper one."""
        x, y = at[..., 0], at[..., 1]
        return self.fetch(image, self._int(self._xp.stack([self._xp.floor(x + 0.5), self._xp.ceil(y - 0.5)], -1)))

    def sample(self, image: Image, at: Image) -> Image:
        """Values of ``image`` at points ``at``, interpolated bilinearly."""
        low = self._xp.floor(at)
        f, b = at - low, self._int(low)
        fx, fy = f[..., :1], f[..., 1:]

        def row(dy: int) -> Image:
            left, right = (self.fetch(image, b + self._to_library(np.array([dx, dy]))) for dx in (0, 1))
            return left * (1 - fx) + right * fx

        return row(0) * (1 - fy) + row(1) * fy

    def cubic(self, image: Image, at: Image) -> Image:
        """Catmull-Rom (Keys 1981, a = -1/2): sharper; can undershoot below 0."""
        low = self._xp.floor(at)
        f, b = at - low, self._int(low)
        weights = [_catmull_rom(f[..., k : k + 1]) for k in (0, 1)]
        total = 0.0
        for j in range(4):
            for i in range(4):
                tap = self.fetch(image, b + self._to_library(np.array([i - 1, j - 1])))
                total = total + weights[0][i] * weights[1][j] * tap
        return total

    # ------------------------------------------------------------------------------------------------ of the library
    def where(self, condition: Image, first: Image, second: Image) -> Image:
        """Elements of one image or another by a condition, as ``numpy.where``."""
        return self._xp.where(condition, first, second)

    def concatenate(self, images: list[Image]) -> Image:
        """Components of all images, one after another."""
        return self._xp.concatenate(images, -1)

    # -------------------------------------------------------------------------------------------------------- color
    def luminance(self, rgb: Image) -> Image:
        """Luminance (...) of linear RGB (..., >= 3)."""
        return sum(float(weight) * rgb[..., k] for k, weight in enumerate(LUMINANCE))

    def ycocg_from_rgb(self, c: Image) -> Image:
        """YCoCg (..., 3) of RGB: the real-valued transform of Malvar and Sullivan 2003."""
        r, g, b = c[..., 0], c[..., 1], c[..., 2]
        return self._xp.stack([0.25 * r + 0.5 * g + 0.25 * b, 0.5 * r - 0.5 * b, -0.25 * r + 0.5 * g - 0.25 * b], -1)

    def rgb_from_ycocg(self, c: Image) -> Image:
        y, co, cg = c[..., 0], c[..., 1], c[..., 2]
        return self._xp.stack([y + co - cg, y + cg, y - co - cg], -1)

    def clip_to_box(self, low: Image, high: Image, c: Image) -> Image:
        """Colors moved towards the center of the box until they are inside (Pedersen 2016)."""
        middle, extent = 0.5 * (high + low), 0.5 * (high - low) + 1e-7
        offset = c - middle
        farthest = self._xp.amax(abs(offset) / extent, -1)[..., None]
        outside = farthest > 1
        return self._xp.where(outside, middle + offset / self._xp.where(outside, farthest, 0 * farthest + 1), c)

    def remodulate(self, diffuse: Image, specular: Image) -> Image:
        """Radiance of demodulated light (..., 3) (reads diffuse_albedo, specular_albedo, emitted)."""
        names = ("diffuse_albedo", "specular_albedo", "emitted")
        albedo, glossy, emitted = (self._at_result_pixels(name)[..., :3] for name in names)
        return diffuse * albedo + specular * glossy + emitted

    # --------------------------------------------------------------------------------------------------------- parts
    def _at_result_pixels(self, name: str) -> Image:
        """An input at the pixels of the result."""
        image = self._frame[name]
        return image if self.input_size == self.output_size else self.fetch(image, self.input_pixels())

    def _without_reasons(self, name: str, bits: int) -> Image:
        """Pixels whose mask has none of ``bits``, where there is a history at all."""
        mask = self._at_result_pixels(name)[..., 0]
        return ((mask & bits) == 0) & bool(self._frame["has_history"])

    def _scale(self) -> Image:
        (width, height), (w, h) = self.output_size, self.input_size
        return self._to_library(np.array([width / w, height / h], dtype=np.float32))

    def _to_library(self, values: np.ndarray) -> Image:
        """A NumPy array as an array of the method's library, sharing its memory."""
        return values if self._xp is np else self._xp.from_numpy(values)

    def _int(self, values: Image) -> Image:
        return values.astype(np.int64) if self._xp is np else values.long()


def _catmull_rom(f: Image) -> list[Image]:
    f2, f3 = f * f, f * f * f
    return [-0.5 * f3 + f2 - 0.5 * f, 1.5 * f3 - 2.5 * f2 + 1.0, -1.5 * f3 + 2.0 * f2 + 0.5 * f, 0.5 * f3 - 0.5 * f2]


@lru_cache(maxsize=8)
def _pixels(size: tuple[int, int]) -> np.ndarray:
    return np.stack(np.meshgrid(*(np.arange(n, dtype=np.float32) for n in size)), axis=-1)


@lru_cache(maxsize=8)
def _input_pixels(size: tuple[int, int], input_size: tuple[int, int]) -> np.ndarray:
    x, y = ((2 * np.arange(n) + 1) * m // (2 * n) for n, m in zip(size, input_size, strict=True))
    rows = input_size[1] - 1 - y[::-1]  # rows count from the bottom in GLSL
    return np.stack(np.meshgrid(x, rows), axis=-1)
