"""Choices by measurement for a kind of device: work-group sizes, how textures are read, what is unrolled.

Nothing here changes a result.  The GLSL side is ``shaders/common/tuning.glsl``.  Facts measured on Mesa 22.3 llvmpipe:
a texel costs half through an image load of what it costs through a sampler; storage buffers are read lane by lane;
uniforms are loaded again at every use in loops with atomics; branches run both ways; loops of one invocation end
silently after 65,535 iterations in all.
"""

from __future__ import annotations

from dataclasses import dataclass

from taubench_gl.gpu.layout import Struct

LOOP_LIMIT = 65_535
"""Iterations of all loops of one invocation after which llvmpipe ends them silently."""

MAX_LIGHTS = 30_000
"""Lights of a scene: shaders loop over all lights twice and over a tile's pixels, below LOOP_LIMIT."""

VPL_CHUNK = 60_000 // 8 // 32 * 32
"""VPLs per dispatch of the probe pass, a multiple of 32: below LOOP_LIMIT at 8 iterations for each."""

PATCH_LIGHT_CHUNK = 192
"""Lights per dispatch of the patch pass: below LOOP_LIMIT at 3 voxels of 96 along each axis for each."""

MAX_UNROLLED = 8
"""Lights that are compiled one by one, at constant places of a uniform block, which llvmpipe reads once for all lanes;
from a texture a light and its shadow face are nine texels, more expensive than all that is computed from them.  More
lights would compile for longer than they save."""

WIDE, NARROW = 64, 16
"""Work-group sizes of passes without pixels: little work per invocation, and much."""


@dataclass(frozen=True, slots=True)
class Tuning:
    """The choices for software rendering (``software``) or a GPU, and its limits."""

    software: bool = False
    texture_limit: int = 16384  # texels along a side of the largest texture

    @property
    def snapped_corners(self) -> bool:
        """Whether attributes are interpolated between corners snapped to 1/256 pixel, as GPUs do: the position then is
        up to half of that beside the pixel's center.  llvmpipe snaps corners only to find the pixels of a triangle."""
        return not self.software

    @property
    def shading_group(self) -> tuple[int, int]:
        """Work group of passes that read many channels: llvmpipe keeps textures by scanline, GPUs in square tiles."""
        return (32, 1) if self.software else (8, 8)

    @property
    def pixel_group(self) -> tuple[int, int]:
        """Work group of passes that read few texels of a pixel."""
        return (64, 1) if self.software else (8, 8)

    @property
    def path_tile(self) -> tuple[int, int]:
        """Pixels whose paths are traced together.  llvmpipe: their state stays in the cache, and a dispatch is short;
        GPUs need many."""
        return (512, 128) if self.software else (1024, 1024)

    @property
    def mask_group(self) -> tuple[tuple[int, int], int]:
        """Group of the mask pass, and pixels per invocation.

        llvmpipe: one vector of lanes along a row and few work groups, whose start costs as much as several pixels.
        GPUs want square tiles, and enough of them.
        """
        return ((8, 1), 60) if self.software else ((8, 8), 4)

    @property
    def defines(self) -> dict[str, bool]:
        """Macros that ``common/tuning.glsl`` reads."""
        return {"LLVMPIPE": self.software}

    def kept_fields(self, struct: Struct) -> dict[str, str]:
        """Macro KEPT_FIELDS of ``common/tuning.glsl``: the floating-point fields of ``struct``, kept in registers."""
        names = [f.name for f in struct.fields if f.type in ("float", "vec4", "mat4")]
        kept = {"PARAMETERS": struct.name}
        return kept | {"KEPT_FIELDS(KEEP)": " ".join(f"KEEP({name})" for name in names)} if self.software else kept

    def mask_images(self, dtypes: set[str]) -> bool:
        """Whether the mask pass reads geometry channels of these types as images: only 32-bit floats pay."""
        return self.software and dtypes == {"f4"}
