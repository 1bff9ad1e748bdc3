"""Materials on the GPU: parameters in one table, textures decoded in threads and only if some channel needs them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

from taubench_gl.errors import GraphicsError
from taubench_gl.frame.material_slots import (
    MIRRORED_REPEAT,
    SLOTS,
    SRGB_SLOTS,
    image_bytes,
    images_of,
    material_key,
    texture_of,
)
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.scene.model import Material, Scene, Texture

if TYPE_CHECKING:
    import moderngl

_GL_SRGB8_ALPHA8 = 0x8C43
BLEND_CUTOFF = 0.5
"""Blended surfaces are present where alpha >= 0.5 and absent elsewhere: Cycles' default for its data passes."""

MATERIAL = Struct(
    "MaterialRecord",
    Field("base_color", "vec4", "linear, 0..1, with alpha"),
    Field("emissive", "vec4", "xyz: linear radiance; w: 1 where unlit"),
    Field("factors", "vec4", "x: metallic, y: roughness, z: normal scale, w: occlusion strength"),
    Field("alpha_cutoff", "vec4", "x: smallest alpha that is drawn; y: specular factor of the dielectric lobe"),
    Field("uv_x", "vec4", "per slot, xyz: first row of uv_transform; w: texture-coordinate set", len(SLOTS)),
    Field("uv_y", "vec4", "per slot, xyz: second row; w: wrap mode bits, 1 mirrored s, 2 mirrored t", len(SLOTS)),
)
STRIDE = 256
"""Bytes from material to material: no driver needs a larger alignment of uniform buffer offsets.

One material at a time in a uniform block: llvmpipe reads a storage buffer lane by lane, which took most of the time of
a pass with eight channels.
"""


class MaterialTable:
    """Every material of the scene; row 0 is glTF's default material, row i + 1 the scene's material i."""

    def __init__(
        self,
        gpu: Gpu,
        scene: Scene,
        channels: Iterable[str],
        used: Iterable[int],
        *,
        normal_maps: bool = True,
        mipmaps: bool = True,
    ):
        self._gpu, self._mipmaps = gpu, mipmaps
        self._materials = (Material(), *scene.materials)
        channels = tuple(channels)
        self.keys = [material_key(m, channels, normal_maps=normal_maps) for m in self._materials]
        rows = MATERIAL.zeros(len(self._materials))
        for row, material in zip(rows, self._materials, strict=True):
            _fill(row, material)
        spread = np.zeros((len(rows), STRIDE), dtype=np.uint8)
        spread[:, : rows.itemsize] = rows.view(np.uint8).reshape(len(rows), -1)
        self._buffer = gpu.ctx.buffer(spread.tobytes())
        self._textures: dict[tuple[int, bool], moderngl.Texture] = {}
        self._samplers: dict[tuple, moderngl.Sampler] = {}
        self._upload(scene, set(used))

    def _upload(self, scene: Scene, used: set[int]) -> None:
        needed = images_of((self._materials[m + 1], self.keys[m + 1].slots) for m in used)
        images = sorted({image for image, _ in needed})
        with ThreadPoolExecutor() as pool:
            decoded = dict(zip(images, pool.map(lambda i: scene.images[i].decode(), images), strict=True))
        for image, srgb in sorted(needed):
            self._textures[image, srgb] = self._texture(decoded[image], srgb, scene.images[image].name)

    def _texture(self, pixels: np.ndarray, srgb: bool, name: str) -> moderngl.Texture:
        height, width = pixels.shape[:2]
        limit = self._gpu.ctx.info["GL_MAX_TEXTURE_SIZE"]
        if max(width, height) > limit:
            raise GraphicsError(f"image {name!r} is {width}x{height}, this device takes {limit}", hint="scale it down")
        extra = {"internal_format": _GL_SRGB8_ALPHA8} if srgb else {}
        # glTF's v runs downwards from the image's top row, so rows go up in file order: texture row 0 is v = 0.
        texture = self._gpu.ctx.texture((width, height), 4, np.ascontiguousarray(pixels).tobytes(), dtype="f1", **extra)
        texture.build_mipmaps()
        return texture

    def material(self, index: int) -> Material:
        """The scene's material ``index``, or glTF's default for -1."""
        return self._materials[index + 1]

    def bind(self, material: int, bindings: Mapping[str, int], only: tuple[str, ...] = SLOTS) -> None:
        """Bind scene material ``material`` (-1: default), its parameters and textures of slots ``only``.

        ``bindings``: of the pass that draws, by the names in its shader.
        """
        block = bindings["material"]
        self._buffer.bind_to_uniform_block(block, offset=(material + 1) * STRIDE, size=MATERIAL.dtype.itemsize)
        record = self._materials[material + 1]
        for slot in self.keys[material + 1].slots:
            if slot in only:
                texture, unit = texture_of(record, slot), bindings[f"{slot}_map"]
                self._textures[texture.image, slot in SRGB_SLOTS].use(unit)
                self._sampler(texture).use(unit)

    def unbind(self) -> None:
        """Samplers outlive textures on a unit: clear them, or the next pass reads its inputs through them."""
        for unit in range(len(SLOTS)):
            self._gpu.ctx.clear_samplers(unit, unit + 1)

    def _sampler(self, texture: Texture) -> moderngl.Sampler:
        s = texture.sampler
        # Without mipmaps, minified texels are read as magnified ones are.
        minify = s.min_filter if self._mipmaps else s.mag_filter
        key = (s.mag_filter, minify, s.wrap_s == 10497, s.wrap_t == 10497)
        if key not in self._samplers:
            sampler = self._gpu.ctx.sampler(repeat_x=key[2], repeat_y=key[3])
            sampler.filter = (minify, s.mag_filter)
            self._samplers[key] = sampler
        return self._samplers[key]

    @property
    def texture_bytes(self) -> int:
        """GPU memory of the textures with their mipmaps, bytes."""
        return sum(image_bytes(t.size) for t in self._textures.values())

    def release(self) -> None:
        self._buffer.release()
        for item in (*self._textures.values(), *self._samplers.values()):
            item.release()


def _fill(row: np.ndarray, m: Material) -> None:
    row["base_color"] = m.base_color
    row["emissive"] = (*m.emissive, float(m.unlit))
    row["factors"] = (m.metallic, m.roughness, m.normal_scale, m.occlusion_strength)
    row["alpha_cutoff"][1] = m.specular
    row["alpha_cutoff"][0] = m.alpha_cutoff if m.alpha_mode == "MASK" else BLEND_CUTOFF
    for i, slot in enumerate(SLOTS):
        texture = texture_of(m, slot)
        if texture is None:
            continue
        row["uv_x"][i] = (*texture.uv_transform[0], texture.texcoord)
        mirrored = (texture.sampler.wrap_s == MIRRORED_REPEAT) + 2 * (texture.sampler.wrap_t == MIRRORED_REPEAT)
        row["uv_y"][i] = (*texture.uv_transform[1], mirrored)
