"""Materials: which textures the channels need, and parameters and textures on the GPU."""

from __future__ import annotations

import logging
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from taubench_gl.errors import GraphicsError
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.gpu.shared import Held
from taubench_gl.memory_budget import IMAGE_BLOCK, return_freed
from taubench_gl.scene.model import Material, Scene, Texture
from taubench_gl.stage_log import lasting, progressed

if TYPE_CHECKING:
    import moderngl

log = logging.getLogger(__name__)

SLOTS = ("base_color", "normal", "metallic_roughness", "emissive", "occlusion")
"""Texture slots of a material in binding order."""

SRGB_SLOTS = ("base_color", "emissive")
"""Texture slots whose texels are sRGB-encoded."""

REPEAT = 10497
"""Wrap mode of a sampler that repeats the texture (OpenGL's number)."""

MIRRORED_REPEAT = 33648
"""Wrap mode that samplers do not use: the shaders fold the coordinates instead."""

TEXTURE = "texture of an image"
"""Kind of the objects that tables share; also whether it is sRGB-encoded."""

DECODED_AHEAD = max(min(os.cpu_count() or 1, 8) - 1, 1)
"""Images that are decoded at the same time, while one is uploaded."""

BLEND_CUTOFF = 0.5
"""Blended surfaces are present where alpha >= 0.5 and absent elsewhere, as in Cycles' passes Vector and Normal."""

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


@dataclass(frozen=True, slots=True)
class MaterialKey:
    """Properties of a material that select its shader variant."""

    slots: tuple[str, ...]  # textures sampled
    alpha_test: bool
    double_sided: bool
    plain_uv: bool = False  # ``has_plain_uv`` of those slots
    stochastic: bool = False  # the alpha test has a random threshold


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


def transformed_uv(texture: Texture, uv: np.ndarray) -> np.ndarray:
    """Texture coordinates (..., 2) after the transform of ``texture``, float64."""
    return uv @ texture.uv_transform[:, :2].T + texture.uv_transform[:, 2]


def texels_at(texture: Texture, uv: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows (...) int64 of the texels that transformed coordinates ``uv`` (..., 2) lie in, wrapped.

    ``size``: width and height.  Coordinates that are not finite are taken as 0.
    """
    out = []
    for axis, wrap in enumerate((texture.sampler.wrap_s, texture.sampler.wrap_t)):
        x = np.where(np.isfinite(uv[..., axis]), uv[..., axis], 0.0)
        if wrap == REPEAT:
            x = x - np.floor(x)
        elif wrap == MIRRORED_REPEAT:
            x = 1.0 - np.abs(np.mod(x, 2.0) - 1.0)
        out.append(np.floor(np.clip(x, 0.0, 1.0) * size[axis]).astype(np.int64).clip(0, size[axis] - 1))
    return out[0], out[1]


def tests_alpha(material: Material) -> bool:
    return material.alpha_mode in ("MASK", "BLEND")


def material_cutoff(material: Material) -> float:
    """The smallest alpha that is drawn, where alpha is tested."""
    return material.alpha_cutoff if material.alpha_mode == "MASK" else BLEND_CUTOFF


def material_key(material: Material, channels: Iterable[str], *, normal_maps: bool = True) -> MaterialKey:
    """Key of the shader variant of ``material`` that writes ``channels``."""
    slots = wanted_slots(channels, material, normal_maps=normal_maps)
    plain, stochastic = has_plain_uv(material, slots), material.stochastic and material.alpha_mode == "BLEND"
    return MaterialKey(slots, tests_alpha(material), material.double_sided, plain, stochastic)


def with_blend(scene: Scene, blend: str) -> Scene:
    """``scene`` with its blended materials drawn as the setting ``blend`` says."""
    if blend == "cutoff" or not any(m.alpha_mode == "BLEND" for m in scene.materials):
        return scene
    changes: dict[str, Any] = {"alpha_mode": "OPAQUE"} if blend == "opaque" else {"stochastic": True}
    materials = (replace(m, **changes) if m.alpha_mode == "BLEND" else m for m in scene.materials)
    return replace(scene, materials=tuple(materials))


def images_of(used: Iterable[tuple[Material, tuple[str, ...]]]) -> set[tuple[int, bool]]:
    """(image, sRGB-encoded) of every texture of these slots of materials; an image used both ways is there twice."""
    return {(texture_of(material, slot).image, slot in SRGB_SLOTS) for material, slots in used for slot in slots}


def decoded_images(scene: Scene, images: Iterable[int]) -> Iterator[tuple[int, np.ndarray]]:
    """(image, texels (h, w, 4) uint8) in order.  Threads decode a few images ahead, so few are held at a time."""
    return_freed(IMAGE_BLOCK)  # an image takes the memory of the one before it
    ahead: deque[tuple[int, Future[np.ndarray]]] = deque()
    with ThreadPoolExecutor(DECODED_AHEAD) as pool:
        for image in images:
            if len(ahead) == DECODED_AHEAD:
                yield ahead[0][0], ahead.popleft()[1].result()
            ahead.append((image, pool.submit(scene.images[image].decode)))
        while ahead:
            yield ahead[0][0], ahead.popleft()[1].result()
    return_freed()


def image_bytes(size: tuple[int, int]) -> int:
    """GPU memory of an RGBA8 texture with its mipmaps."""
    return size[0] * size[1] * 4 * 4 // 3


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
        self._scene, self._used = scene, set(used)
        self._held: list[Held] = []  # textures, which all tables of a context share
        self._samplers: dict[tuple, moderngl.Sampler] = {}

    @cached_property
    def textures(self) -> dict[tuple[int, bool], moderngl.Texture]:
        """The textures of the images that are used, by (image, sRGB-encoded), uploaded when first asked for.

        Raises SceneError where an image cannot be decoded, and GraphicsError where it is too large.
        """
        scene, shared = self._scene, self._gpu.shared
        needed = images_of((self._materials[m + 1], self.keys[m + 1].slots) for m in self._used)
        missing = {(i, srgb) for i, srgb in needed if not shared.has(scene.images[i], (TEXTURE, srgb))}
        out = {}

        def hold(image: int, srgb: bool, make: Callable[[], Any] = lambda: None) -> None:
            self._held.append(shared.hold(scene.images[image], (TEXTURE, srgb), make))
            out[image, srgb] = self._held[-1].value

        images = sorted({image for image, _ in missing})
        with lasting(log, "decoding %d images", len(images)) if images else nullcontext():
            for number, (image, pixels) in enumerate(decoded_images(scene, images), start=1):
                for srgb in (srgb for i, srgb in sorted(missing) if i == image):
                    hold(image, srgb, partial(self._texture, pixels, srgb, scene.images[image].name))
                del pixels  # before the next one is waited for
                progressed(number / len(images))
        for image, srgb in needed - missing:
            hold(image, srgb)
        return out

    def _texture(self, pixels: np.ndarray, srgb: bool, name: str) -> moderngl.Texture:
        height, width = pixels.shape[:2]
        limit = self._gpu.ctx.info["GL_MAX_TEXTURE_SIZE"]
        if max(width, height) > limit:
            raise GraphicsError(f"image {name!r} is {width}x{height}, this device takes {limit}", hint="scale it down")
        texture = self._gpu.mipmapped((width, height), srgb=srgb)
        # glTF's v runs downwards from the image's top row, so rows go up in file order: texture row 0 is v = 0.
        texture.write(np.ascontiguousarray(pixels))
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
                self.textures[texture.image, slot in SRGB_SLOTS].use(unit)
                self._sampler(texture).use(unit)

    def unbind(self) -> None:
        """Samplers outlive textures on a unit: clear them, or the next pass reads its inputs through them."""
        for unit in range(len(SLOTS)):
            self._gpu.ctx.clear_samplers(unit, unit + 1)

    def _sampler(self, texture: Texture) -> moderngl.Sampler:
        s = texture.sampler
        # Without mipmaps, minified texels are read as magnified ones are.
        minify = s.min_filter if self._mipmaps else s.mag_filter
        key = (s.mag_filter, minify, s.wrap_s == REPEAT, s.wrap_t == REPEAT)
        if key not in self._samplers:
            sampler = self._gpu.ctx.sampler(repeat_x=key[2], repeat_y=key[3])
            sampler.filter = (minify, s.mag_filter)
            self._samplers[key] = sampler
        return self._samplers[key]

    def pixels(self, image: int) -> np.ndarray | None:
        """Texels of an image as in its file, (h, w, 4) uint8, where a texture of it is on the GPU."""
        for srgb in (True, False):
            if (image, srgb) in self.textures:
                texture = self.textures[image, srgb]
                return np.frombuffer(texture.read(), np.uint8).reshape(*texture.size[::-1], 4)
        return None

    @property
    def texture_bytes(self) -> int:
        """GPU memory of the textures with their mipmaps, bytes."""
        return sum(image_bytes(t.size) for t in self.textures.values())

    def release(self) -> None:
        self._buffer.release()
        for item in (*self._held, *self._samplers.values()):
            item.release()


def _fill(row: np.ndarray, m: Material) -> None:
    row["base_color"] = m.base_color
    row["emissive"] = (*m.emissive, float(m.unlit))
    row["factors"] = (m.metallic, m.roughness, m.normal_scale, m.occlusion_strength)
    row["alpha_cutoff"][1] = m.specular
    row["alpha_cutoff"][0] = material_cutoff(m)
    for i, slot in enumerate(SLOTS):
        texture = texture_of(m, slot)
        if texture is None:
            continue
        row["uv_x"][i] = (*texture.uv_transform[0], texture.texcoord)
        mirrored = (texture.sampler.wrap_s == MIRRORED_REPEAT) + 2 * (texture.sampler.wrap_t == MIRRORED_REPEAT)
        row["uv_y"][i] = (*texture.uv_transform[1], mirrored)
