"""Tables of what rays find at hits, for ``shaders/raytracing/hit_tables.glsl``.  NumPy only.

Two tables of texels of four 32-bit words each (floats as their bits), in rows of 2^ROW_BITS texels:

*hit_static*  vertices, triangles, materials and emitters, written once
*hit_draws*   DRAW_TEXELS texels a draw, written every frame: three rows of relative_from_object (of posed draws: x of
              the first is the draw's first vertex), then the words and the places of ``DrawTable``
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from taubench_gl.effects.lighting import counts_as_light, emits
from taubench_gl.frame.geometry import DEFAULTS, Draw
from taubench_gl.frame.materials import MIRRORED_REPEAT, material_cutoff, tests_alpha, texture_of
from taubench_gl.frame.materials import REPEAT as GL_REPEAT
from taubench_gl.frame.raytracing.atlas import AtlasPlan
from taubench_gl.frame.raytracing.texels import AT_ONCE, Texels
from taubench_gl.frame.records import Placement
from taubench_gl.scene.model import Material, Scene, Texture

if TYPE_CHECKING:
    import moderngl

Array = np.ndarray
_WIDTHS = {"positions": 3, "normals": 3, "tangents": 4, "texcoords0": 2, "texcoords1": 2, "colors": 4}

ROW_BITS = 13
DRAW_TEXELS = 5
MATERIAL_TEXELS, SLOT_TEXELS = 4, 3
HIT_SLOTS = ("base_color", "metallic_roughness", "normal", "emissive")
"""Texture slots of hits, in the order of their records."""

DIELECTRIC_SLOTS = ("specular", "specular_color", "transmission")
"""Slots of materials with more than the common dielectric lobe; their records follow, where a scene needs them."""

DIELECTRIC_TEXELS = 2
"""Texels of such a material, behind its slots."""

COLOR_SLOTS = ("base_color", "emissive", "specular_color")
POSED, MIRRORED, VISIBLE, ALPHA_TEST, UV1, COLORS = (1 << i for i in range(6))
"""Flags in a draw's record."""

UNLIT, FIRST_MAP = 1, 2
"""Bits of a material; the bit of slot i, also of DIELECTRIC_SLOTS, is FIRST_MAP << i."""

THICK = FIRST_MAP << len(HIT_SLOTS) + len(DIELECTRIC_SLOTS)
"""Bit of a material that bounds a volume."""

REPEAT, CLAMP, MIRROR = 0, 1, 2
MAP_UV1, MAP_TRANSFORMED, MAP_NEAREST = 16, 32, 64
"""Bits of a texture, above two bits of wrap mode for each axis."""

_GL_NEAREST = 9728


@dataclass(frozen=True, slots=True)
class HitOptions:
    """Which properties of surfaces the tables of hits contain."""

    normal_maps: bool = True
    glossy: bool = True  # False: nothing is metal and no dielectric has a glossy lobe, so roughness does not matter
    emission: str = "all"  # "none" | "strong": only what counts as light (``counts_as_light``) | "all"
    alpha_test: bool = True
    dielectrics: bool = False  # more than the common dielectric lobe: color, index of refraction, textures
    transmission: bool = False
    surfaces: bool = True  # False: of a hit, rays look at nothing but its alpha test

    @property
    def slots(self) -> tuple[str, ...]:
        """Slots that materials have records of."""
        return HIT_SLOTS + DIELECTRIC_SLOTS * self.dielectrics

    @property
    def material_texels(self) -> int:
        """Texels of a material with its slots."""
        return MATERIAL_TEXELS + SLOT_TEXELS * len(self.slots) + DIELECTRIC_TEXELS * self.dielectrics


def hit_emission(material: Material, options: HitOptions) -> tuple[float, float, float]:
    """Radiance factor of a material at hits; (0, 0, 0) where it emits nothing under ``options``."""
    shines = {"none": False, "strong": counts_as_light(material), "all": emits(material)}[options.emission]
    return material.emissive if shines else (0.0, 0.0, 0.0)


def hit_slots(material: Material, options: HitOptions) -> tuple[str, ...]:
    """Slots whose textures hits on ``material`` need."""
    lit = options.surfaces and not material.unlit
    needed = {
        "base_color": lit or (options.alpha_test and tests_alpha(material)),
        "metallic_roughness": lit and options.glossy,
        "normal": lit and options.normal_maps and material.normal_scale != 0.0,
        "emissive": any(hit_emission(material, options)),
        "specular": lit,
        "specular_color": lit,
        "transmission": lit and options.transmission and material.transmission > 0.0,
    }
    return tuple(s for s in options.slots if needed[s] and texture_of(material, s) is not None)


class DrawnPool:
    """Attributes of the ``draws`` of one vertex pool, read back from its buffers part by part.

    Positions of the posed pool are of some frame.
    """

    def __init__(self, buffers: Mapping[str, moderngl.Buffer], draws: Sequence[Draw]):
        self._buffers = buffers
        self.vertices = max((d.base_vertex + d.vertex_count for d in draws), default=0)
        self.indices = max((d.first_index + d.index_count for d in draws), default=0)

    def read(self, name: str, first: int, count: int) -> Array:
        """``count`` numbers of ``indices``, or rows of an attribute of ``geometry.Pool``, from number ``first`` on."""
        width = _WIDTHS.get(name, 1)
        if name in _WIDTHS and self._buffers[name].size < 4 * width * self.vertices:  # all have the default
            return np.broadcast_to(DEFAULTS.get(name, np.float32(0)), (count, width))
        data = self._buffers[name].read(4 * width * count, offset=4 * width * first)
        return np.frombuffer(data, np.uint32 if name == "indices" else np.float32).reshape(count, width)


def vertex_texels(positions: Array, normals: Array, texcoords: Array) -> Array:
    """(V, 2, 4) float32: position and normal x; texture coordinates, normal y and z."""
    out = np.empty((len(positions), 2, 4), np.float32)
    out[:, 0, :3], out[:, 0, 3] = positions, normals[:, 0]
    out[:, 1, :2], out[:, 1, 2:] = texcoords, normals[:, 1:]
    return out


def draw_centers(draws: Sequence[Draw], pool: DrawnPool) -> Array:
    """Middle of the box of each fixed draw's vertices, float32 numbers; 0 of posed draws.  (D, 3) float64.

    Far from it, float32 would have fewer digits for a point on a triangle than for the triangle's corners.
    """
    out = np.zeros((len(draws), 3))
    known: dict[int, Array] = {}
    for i, d in enumerate(draws):
        if d.posed:
            continue
        if d.base_vertex not in known:
            vertices = pool.read("positions", d.base_vertex, d.vertex_count).astype(np.float64)
            known[d.base_vertex] = (0.5 * (vertices.min(axis=0) + vertices.max(axis=0))).astype(np.float32)
        out[i] = known[d.base_vertex]
    return out


def _vertices(pool: DrawnPool, origins: Mapping[int, Array]) -> Iterator[Array]:
    """``vertex_texels`` of a pool, AT_ONCE vertices at a time.

    ``origins``: first vertex of a draw, ascending -> (3,) what its positions are relative to.
    """
    first, origin = np.array([*origins]), np.array([*origins.values()])
    for at in range(0, pool.vertices, AT_ONCE):
        count = min(AT_ONCE, pool.vertices - at)
        positions, normals, texcoords = (pool.read(n, at, count) for n in ("positions", "normals", "texcoords0"))
        owner = np.searchsorted(first, np.arange(at, at + count), side="right") - 1
        yield vertex_texels(positions.astype(np.float64) - origin[owner], normals, texcoords)


def _triangles(pool: DrawnPool) -> Iterator[Array]:
    """Vertices of the triangles of a pool, a texel each, AT_ONCE at a time."""
    for at in range(0, pool.indices, 3 * AT_ONCE):
        indices = pool.read("indices", at, min(3 * AT_ONCE, pool.indices - at)).reshape(-1, 3)
        yield np.pad(indices, ((0, 0), (0, 1)))


def material_texels(
    materials: Sequence[Material], atlas: AtlasPlan, options: HitOptions
) -> tuple[Array, list[tuple[str, ...]]]:
    """Rows (M, ``options.material_texels``, 4) uint32 and the slots of each material that are in the atlas."""
    rows = np.zeros((len(materials), options.material_texels, 4), np.float32)
    words = rows.view(np.uint32)
    # The atlas has no image of a material that nothing drawn has.
    used = [tuple(s for s in hit_slots(m, options) if texture_of(m, s).image in atlas.places) for m in materials]
    for i, (m, slots) in enumerate(zip(materials, used, strict=True)):
        rows[i, 0] = m.base_color
        rows[i, 1, :3] = hit_emission(m, options)
        words[i, 1, 3] = UNLIT * m.unlit + sum(FIRST_MAP << options.slots.index(s) for s in slots)
        rows[i, 2] = m.metallic, m.roughness, m.specular, material_cutoff(m)
        rows[i, 3, 0] = m.normal_scale
        if options.dielectrics:
            words[i, 1, 3] |= THICK * m.thick
            rows[i, -DIELECTRIC_TEXELS:] = dielectric_texels(m, options)
        for slot in slots:
            at = MATERIAL_TEXELS + SLOT_TEXELS * options.slots.index(slot)
            texture = texture_of(m, slot)
            (x, y), (w, h) = atlas.places[texture.image], atlas.sizes[texture.image]
            words[i, at] = x | y << 16, w | h << 16, texture_modes(texture), 0
            rows[i, at + 1, :3], rows[i, at + 2, :3] = texture.uv_transform
    return words, used


def dielectric_texels(m: Material, options: HitOptions) -> Array:
    """(2, 4): reflectance of the lobe at normal incidence, without ``specular``, and index of refraction; absorption in
    the volume, 1/m, and transmission.

    An infinite index transmits nothing.
    """
    reflectance = ((m.ior - 1.0) / (m.ior + 1.0)) ** 2 if m.ior else 1.0
    absorption = np.zeros(3)
    if m.thick and np.isfinite(m.attenuation_distance):
        absorption = -np.log(np.maximum(m.attenuation_color, 1e-9)) / m.attenuation_distance
    transmission = m.transmission if options.transmission and m.ior else 0.0
    return np.array([[*(reflectance * np.array(m.specular_color)), m.ior], [*absorption, transmission]])


def texture_modes(texture: Texture) -> int:
    """Word of a texture slot: wrap modes and MAP_* bits."""
    wrap = {GL_REPEAT: REPEAT, MIRRORED_REPEAT: MIRROR}
    s = texture.sampler
    modes = wrap.get(s.wrap_s, CLAMP) | wrap.get(s.wrap_t, CLAMP) << 2
    return (
        modes
        | MAP_UV1 * (texture.texcoord == 1)
        | MAP_TRANSFORMED * is_transformed(texture)
        | MAP_NEAREST * (s.mag_filter == _GL_NEAREST)
    )


def is_transformed(texture: Texture) -> bool:
    return not np.array_equal(texture.uv_transform, np.eye(2, 3))


@dataclass(slots=True)
class DrawTable:
    """The table of draws; ``rows`` (D, DRAW_TEXELS, 4) uint32 as uploaded last."""

    draws: tuple[Draw, ...]
    centers: Array  # (D, 3) float64: vertices of a fixed draw are stored relative to it
    rows: Array = field(init=False)
    _posed: Array = field(init=False)

    def __post_init__(self) -> None:
        self.rows = np.zeros((len(self.draws), DRAW_TEXELS, 4), np.uint32)
        self._posed = np.array([d.posed for d in self.draws], dtype=bool)

    def place(self, placement: Placement) -> bool:
        """Fill in one frame; whether anything has changed."""
        before, posed = self.rows.copy(), self._posed
        matrices = placement.relative[:, :3].copy()
        matrices[:, :, 3] += np.einsum("dij,dj->di", matrices[:, :, :3], self.centers)
        self.rows[:, :3] = matrices.astype(np.float32).view(np.uint32)
        self.rows[posed, :3] = 0
        self.rows[posed, 0, 0] = [d.base_vertex for d in self.draws if d.posed]
        bits = self.rows[:, 3, 1] & ~np.uint32(MIRRORED | VISIBLE)
        moved = MIRRORED * placement.mirrored.astype(np.uint32) | VISIBLE * placement.visible.astype(np.uint32)
        self.rows[:, 3, 1] = bits | moved
        return not np.array_equal(before, self.rows)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in texels of an image of all records."""
        return Texels(len(self.texels), ROW_BITS).size

    @property
    def texels(self) -> Array:
        """Records of all draws, (N, 4) uint32."""
        return self.rows.reshape(-1, 4)


@dataclass(slots=True)
class HitTables:
    """Everything of a scene that does not change from frame to frame."""

    static: Texels
    draws: DrawTable
    slots: dict[str, bool]  # texture slot -> whether some draw needs it
    transformed: bool  # whether a texture has a transform
    second_uv: bool
    colors: bool
    alpha_test: bool
    emission: bool  # whether a drawn surface emits
    places: dict[str, int]  # of the emitter tables, in texels
    emitters: int  # rows


def build_tables(
    scene: Scene,
    draws: tuple[Draw, ...],
    pools: Mapping[bool, DrawnPool],
    atlas: AtlasPlan,
    options: HitOptions,
    emitters: Array,
) -> HitTables:
    """The tables of ``draws``.  ``pools``: vertex pools by whether they are posed; ``emitters``: rows of
    ``EMITTER``.
    """
    table = Texels(row_bits=ROW_BITS)
    materials = (Material(), *scene.materials)
    rows, slots = material_texels(materials, atlas, options)
    first_material = table.add(rows)
    first_vertex, first_triangle = {}, {}
    centers = draw_centers(draws, pools[False])
    for posed, pool in pools.items():
        origins = {d.base_vertex: center for d, center in zip(draws, centers, strict=True) if d.posed == posed}
        made = partial(_vertices, pool, dict(sorted(origins.items())))
        first_vertex[posed] = table.add_later(2 * pool.vertices, made)
        first_triangle[posed] = table.add_later(pool.indices // 3, partial(_triangles, pool))
    extras = _Extras(table, pools)
    out = DrawTable(draws, centers)
    first_emitter = {int(d): int(r) for d, r in zip(*np.unique(emitters["draw"], return_index=True), strict=True)}
    for i, d in enumerate(draws):
        m, used = materials[d.material + 1], slots[d.material + 1]
        second = any(texture_of(m, s).texcoord == 1 for s in used)
        alpha = options.alpha_test and tests_alpha(m)
        colors = scene.meshes[d.mesh].primitives[d.primitive].colors is not None and (alpha or not m.unlit)
        bits = POSED * d.posed | ALPHA_TEST * alpha | UV1 * second | COLORS * colors
        out.rows[i, 3] = (
            first_triangle[d.posed] + d.first_index // 3, bits,
            first_material + rows.shape[1] * (d.material + 1), first_emitter.get(i, -1) + 1,
        )  # fmt: skip
        out.rows[i, 4] = (
            first_vertex[d.posed] + 2 * d.base_vertex,
            extras.place("tangents", d) if "normal" in used and not d.posed else 0,
            extras.place("texcoords1", d) if second else 0,
            extras.place("colors", d) if colors else 0,
        )
    places = {"emitters": table.add(emitter_texels(emitters)), "cells": table.add(emitter_cells(emitters))}
    drawn = {d.material + 1 for d in draws}
    bits = out.rows[:, 3, 1]
    return HitTables(
        table, out,
        slots={s: any(s in slots[m] for m in drawn) for s in options.slots},
        transformed=any(is_transformed(texture_of(materials[m], s)) for m in drawn for s in slots[m]),
        second_uv=bool((bits & UV1).any()), colors=bool((bits & COLORS).any()),
        alpha_test=bool((bits & ALPHA_TEST).any()),
        emission=any(any(hit_emission(materials[m], options)) for m in drawn),
        places=places, emitters=len(emitters),
    )  # fmt: skip


class _Extras:
    """Attributes that only some primitives need: one texel a vertex, stored once for each primitive of a pool."""

    def __init__(self, table: Texels, pools: Mapping[bool, DrawnPool]):
        self._table, self._pools = table, pools
        self._known: dict[tuple[str, bool, int], int] = {}

    def place(self, name: str, d: Draw) -> int:
        key = name, d.posed, d.base_vertex
        if key not in self._known:
            values = self._pools[d.posed].read(name, d.base_vertex, d.vertex_count)
            texels = np.zeros((len(values), 4), np.float32)
            texels[:, : values.shape[1]] = values
            self._known[key] = self._table.add(texels)
        return self._known[key]


def emitter_texels(emitters: Array) -> Array:
    """(E, 4) uint32: draw, triangle, cumulative probability and probability."""
    out = np.zeros((len(emitters), 4), np.uint32)
    out[:, 0], out[:, 1] = emitters["draw"], emitters["triangle"]
    out[:, 2], out[:, 3] = emitters["cumulative"].view(np.uint32), emitters["probability"].view(np.uint32)
    return out


def emitter_cells(emitters: Array) -> Array:
    """(C, 4) uint32, x and y: first and last row that a number in cell i, [i/C, (i+1)/C), can choose."""
    count = emitter_cell_count(len(emitters))
    ends = np.arange(count + 1) / count
    cumulative = np.ascontiguousarray(emitters["cumulative"]).astype(np.float64)
    found = np.minimum(np.searchsorted(cumulative, ends, side="right"), max(len(emitters) - 1, 0))
    out = np.zeros((count, 4), np.uint32)
    out[:, 0], out[:, 1] = found[:-1], found[1:]
    return out


def emitter_cell_count(emitters: int) -> int:
    """A power of two, so that cells have exact ends, about as many as emitters."""
    return 1 << max(emitters - 1, 0).bit_length()
