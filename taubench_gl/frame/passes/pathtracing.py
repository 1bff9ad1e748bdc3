"""Path-traced light: paths from the rasterized surface points, a bounce at a time.

Every dispatch is bounded: a tile of pixels, one sample, one vertex of the paths (or LIGHT_CHUNK lights).  Between
dispatches the paths of a tile lie in one image, whose layers ``shaders/pathtracing/state.glsl`` names.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from taubench_gl.animation import View
from taubench_gl.conventions import ABSENT, NO_HISTORY
from taubench_gl.effects.path_tracing import GLASS
from taubench_gl.frame.context import FrameContext
from taubench_gl.frame.environment import declare_environment, seen_of
from taubench_gl.frame.lights import KINDS as LIGHT_KINDS
from taubench_gl.frame.lights import LIGHT, LIGHT_ROW
from taubench_gl.frame.passes.lighting import KINDS, SURFACE
from taubench_gl.frame.raytracing.attributes import HitAttributes
from taubench_gl.frame.raytracing.hit_tables import HitOptions
from taubench_gl.frame.raytracing.structure import MAX_STEPS, SceneStructure
from taubench_gl.frame.renderer import Renderer
from taubench_gl.frame.spec import FrameSpec
from taubench_gl.gpu.declare import IMAGE, READ, TEXTURE, UPDATE, ComputePass, Pass, Resource, Use, stage
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.passes import CompiledCompute
from taubench_gl.lobes import BOUNCES, lobe_channels, lobe_macros, lobes_with
from taubench_gl.metrics.environment import CELLS, direction_choice
from taubench_gl.metrics.lighting import MIN_ALPHA, MIN_LIGHT_DISTANCE
from taubench_gl.metrics.path_samples import (
    BLOCKS_PER_VERTEX,
    SUBPATH_VERTEX,
    VERTICES,
    part_table,
    sample_table,
)
from taubench_gl.metrics.stochastic import LightCells, cell_choice, light_choice

Array = np.ndarray

PATH = Struct(
    "PathRecord",
    Field("sky", "vec4", "xyz: radiance of a uniform environment, linear"),
    Field("parallel_view", "vec4", "xyz: unit, towards a parallel camera; w: 1 if the camera is parallel"),
    Field("footprint", "vec4", "width of a pixel: x, meters of a parallel camera; y, meters for each meter of depth"),
    Field("size", "ivec4", "xy: pixels"),
    Field("numbers", "uvec4", "x: frame, y: seed"),
    Field("lights", "ivec4", "x: punctual lights; y: 1 where their light at the camera's vertex has no noise"),
    Field("cells", "vec4", "xyz: low corner of the grid of lights, relative to the camera; w: cells a meter"),
    Field("cell_counts", "ivec4", "xyz: cells along each axis; w: first of the cells of emissive triangles"),
)
LAYERS, LOBE_LAYERS, SUBPATH_LAYERS = 4, 4, 4
"""Layers of the path state of every path, of each lobe and of light subpaths (shaders/pathtracing/state.glsl)."""

CANDIDATES = 8
"""Most lights that compete for one light sample.  As many lights are all evaluated at the camera's vertex."""

EXACT_PER_SAMPLE = 4
"""Lights for each sample of a pixel that have a shadow ray each at the camera's vertex: a sample takes as long, because
its path has two rays a bounce and evaluates CANDIDATES lights at every vertex."""

MOST_EXACT = 1024
"""Lights of a cell, up to which listed pixels and images with ``every_light`` have no noise.  Only those that would
shine on a point without shadow have a ray there; as many samples of single lights as rays would still be noisy."""

MOST_CELLS, CELL_ENTRIES = 1 << 11, 1 << 20
"""Most cells of the grid of lights, and most lights in all cells together."""

LIGHT_CHUNK = 8
"""Shadow rays of a pixel in one dispatch."""

LIGHT_GAP = 1e-5
"""Shadow rays end before a point light by this share of the largest coordinate: what float32 positions are off."""

LIST_TILE = (256, 64)
"""Columns and rows of path state for a list: samples of its pixels that are traced together."""

LIST_MARGIN = 8
"""Rows after the last entries of a list that are without pixels: more than those of a work group."""

NO_PIXEL = 0xFFFFFFFF
"""Fills the last part of a pixel list: beyond every image."""

TABLE_ROWS = 256
"""Samples whose numbers are on the GPU at a time."""

COUNTS = ("non_finite",)
"""Counters of ``path_counts``: contributions that were not finite."""

TRACED = ("anchor", "exact", "subpath", "start", "extend")
"""Names of the passes that trace rays."""


def vertices(spec: FrameSpec) -> int:
    """Vertices after the camera's that a path may have: as many as bounces, unless only punctual lights, which no ray
    finds, are left for the last."""
    found = {"emitters", "environment"} & spec.path_traced_sources
    return spec.bounces if found else spec.bounces - 1


def path_lists(spec: FrameSpec) -> int:
    """Lists of paths that go on of one sample: to every vertex, and one that nothing extends."""
    return spec.bounces + 2


def path_lobes(spec: FrameSpec) -> tuple[str, ...]:
    """Lobes of path-traced light in the scene of ``spec``."""
    return lobes_with([name for name in GLASS if spec.glass[name.upper()]])


def listed_lobes(spec: FrameSpec) -> tuple[str, ...]:
    """Radiance of a sample of a listed pixel, in the order of ``listed_light``: lobes of direct, then of indirect."""
    return lobe_channels(path_lobes(spec))


def state_layers(spec: FrameSpec) -> int:
    """Number of layers of the path state."""
    dielectrics, transmission = spec.glass["DIELECTRICS"], spec.glass["TRANSMISSION"]
    path = LAYERS + dielectrics + transmission + LOBE_LAYERS * len(path_lobes(spec))
    return path + (SUBPATH_LAYERS + dielectrics) * spec.bidirectional


def exact_punctual(spec: FrameSpec) -> bool:
    """Whether every punctual light has a shadow ray at the camera's vertex: then its direct light has no noise.

    Of more lights than EXACT_PER_SAMPLE allows, in frames without a cell of more than MOST_EXACT.
    """
    traced = "punctual" in spec.path_traced_sources and not spec.shading.one_light
    return traced and (spec.pixel_list or spec.shading.every_light or _few_lights(spec))


def _few_lights(spec: FrameSpec) -> bool:
    return len(spec.light_kinds) <= max(CANDIDATES, EXACT_PER_SAMPLE * spec.spp)


def light_grid(spec: FrameSpec, emitters: int) -> LightCells:
    """The grid of the lights of ``spec`` and ``emitters``; without cells where all are candidates."""
    count = max(len(spec.light_kinds) * ("punctual" in spec.path_traced_sources), emitters)
    if count <= CANDIDATES:
        return LightCells(np.zeros(3), 1.0, (0, 0, 0))
    return LightCells.of_box(*spec.animated.box, min(max(CELL_ENTRIES // count, 1), MOST_CELLS))


def subpath_choice(power: Array, kinds: Array, spots: Array) -> Array:
    """Probabilities of the lights of light subpaths, as ``light_choice``: power times the solid angle they shine into.

    ``power`` (N,); ``kinds`` (N,) and ``spots`` (N, 4): of the light table.  Directional lights have none.
    """
    cone = spots[:, 0] > 0.0
    least = np.where(cone, -spots[:, 1] / np.where(cone, spots[:, 0], 1.0), -1.0)
    return light_choice(np.where(kinds == LIGHT_KINDS.index("directional"), 0.0, power * (1.0 - least)))


def tile_size(spec: FrameSpec) -> tuple[int, int]:
    """(columns, rows) of pixels that are traced together."""
    if spec.pixel_list:
        return LIST_TILE
    columns, rows = spec.tuning.path_tile
    return min(columns, spec.size[0]), min(rows, spec.size[1])


def declarations(spec: FrameSpec) -> dict[str, ComputePass]:
    """Passes by name: anchor, exact, subpath, start, extend, resolve; none where no light is path-traced.

    ``start``, which every frame has, owns what the passes share.
    """
    if not spec.path_traced_sources:
        return {}
    out = {"anchor": _traced_pass(spec, "anchor").use(*spec.channels("position"))}
    if spec.glass["DIELECTRICS"]:
        out["anchor"].use(*spec.channels("ids")).glsl(f"const uint MARKS = {NO_HISTORY | ABSENT}u;")
    if exact_punctual(spec):
        out["exact"] = _traced_pass(spec, "exact").use(*spec.channels(*SURFACE))
    if spec.bidirectional:
        out["subpath"] = _traced_pass(spec, "subpath")
    out["start"] = _traced_pass(spec, "start").use(*spec.channels(*SURFACE))
    if vertices(spec):
        out["extend"] = _traced_pass(spec, "extend")
    out["resolve"] = _resolve(spec)
    _share_state(spec, out)
    return out


def _constants(spec: FrameSpec) -> Callable[[FrameContext], dict[str, Any]]:
    """Values of ``PATH`` for a frame."""

    def values(frame: FrameContext) -> dict[str, Any]:
        seed, grid = spec.seed if frame.seed is None else frame.seed, frame.light_grid
        return {
            "sky": (*spec.environment.radiance, 0.0),
            "parallel_view": frame.view.towards_parallel_camera,
            "footprint": (*frame.footprint, 0.0, 0.0),
            "size": (*spec.size, 0, 0),
            "numbers": (frame.number & 0xFFFFFFFF, seed, 0, 0),
            "lights": (len(spec.light_kinds), frame.exact_light, 0, 0),
            "cells": (*(grid.low - frame.view.position), 1.0 / grid.side),
            "cell_counts": (*grid.counts, frame.emitter_cells),
        }

    return values


def _tile_pass(spec: FrameSpec, name: str) -> ComputePass:
    """A pass over the pixels of a tile, or the entries of a list, with their path state."""
    tile = tile_size(spec)
    p = ComputePass("path tracing", (f"pathtracing/{name}.comp.glsl",))
    p.define(EXACT_PUNCTUAL=exact_punctual(spec), **spec.glass).constants("P", PATH, _constants(spec))
    spec.declare_directions(p)
    p.image("path_state", access=UPDATE, filled=True)
    p.buffer("path_counts", "uint", access=UPDATE, filled=True)
    p.define(PIXEL_LIST=spec.pixel_list, **lobe_macros(path_lobes(spec)))
    if spec.pixel_list:
        p.buffer("pixel_list", "uvec4", filled=True)
    p.glsl(f"const ivec2 TILE_SIZE = ivec2({tile[0]}, {tile[1]});", "const int COUNT_NON_FINITE = 0;")
    return p.dispatch(tile, spec.tuning.shading_group)


def _environment_image(spec: FrameSpec) -> bool:
    """Whether paths sample an environment image."""
    return "environment" in spec.path_traced_sources and spec.environment.kind == "image"


def _traced_pass(spec: FrameSpec, name: str) -> ComputePass:
    """A pass that traces rays and samples lights."""
    sources, image, p = spec.path_traced_sources, _environment_image(spec), _tile_pass(spec, name)
    kinds = [0] * ("punctual" in sources) + [1] * ("emitters" in sources) + [2] * image
    p.define(
        GLOSSY="glossy" in spec.enabled or spec.glass["TRANSMISSION"],
        INDEPENDENT=spec.pattern == "independent",
        PUNCTUAL="punctual" in sources,
        BIDIRECTIONAL=spec.bidirectional,
        EMITTERS="emitters" in sources,
        ENVIRONMENT="environment" in sources,
        SOURCES=len(kinds),
        **{name.upper(): name in spec.enabled for name in KINDS},
    )
    if spec.sun is not None:
        p.define(DIRECTIONAL_LIGHTS=True)
    p.glsl(
        f"const float MIN_LIGHT_DISTANCE = {MIN_LIGHT_DISTANCE}, MIN_ALPHA = {MIN_ALPHA};",
        f"const float LIGHT_GAP = {LIGHT_GAP};",
        f"const int LIGHT_ROW = {LIGHT_ROW}, LIGHT_CHUNK = {LIGHT_CHUNK}, LAST_VERTEX = {spec.bounces};",
        f"const int CANDIDATES = {CANDIDATES};",
    )
    if spec.bidirectional:
        p.glsl(f"const int SUBPATH_VERTEX = {SUBPATH_VERTEX};")
    if kinds:
        p.glsl(f"const int SOURCE_KINDS[{len(kinds)}] = int[]({', '.join(map(str, kinds))});")
    p.use(lookup(spec, "sample_table", "rgba32ui"))
    if "punctual" in sources:
        p.glsl(LIGHT).use(lookup(spec, "light_table"))
    if spec.bidirectional:
        p.buffer("light_choice", "vec2", filled=True)
    if sources & {"punctual", "emitters"}:
        p.buffer("light_cells", "int", filled=True).buffer("light_entries", "vec2", filled=True)
    if image:
        declare_environment(p, spec.environment, lobes=False, owned=False)
        p.use(lookup(spec, "environment_choice", "rg32f"))
        p.glsl(f"const int ENVIRONMENT_CELLS = {cell_rows(spec)};")
    return p


def _share_state(spec: FrameSpec, passes: dict[str, ComputePass]) -> None:
    """Allocate what several passes use, and declare the lists of paths that go on and of entries."""
    start, (columns, rows), group = passes["start"], tile_size(spec), math.prod(spec.tuning.shading_group)
    paths = columns * rows
    start.allocate(
        Resource.texture("path_state", (columns, state_layers(spec) * rows), label="paths"),
        Resource.buffer("path_counts", 4 * len(COUNTS), label="paths"),
    )
    if "extend" in passes:
        passes["extend"].dispatch(paths, group)
    sizes = f"const int PATH_GROUP = {group}, PATH_LISTS = {path_lists(spec)};"
    for name, words in {"going_on": 2 * paths, "going_on_counts": 8 * path_lists(spec)}.items():
        start.allocate(Resource.buffer(name, 4 * words, label="paths"))
        for p in filter(None, (start, passes.get("extend"))):
            p.buffer(name, "uint", access=UPDATE, filled=True).glsl(sizes)
    if _environment_image(spec):
        maps = ComputePass("", ())
        declare_environment(maps, spec.environment, lobes=False, owned="color" not in spec.enabled)
        choice = (2 * cell_rows(spec) + 1, cell_rows(spec))
        start.allocate(
            *maps.resources, Resource.texture("environment_choice", choice, components=2, label="environment")
        )
    if spec.pixel_list:
        for name, entry in (("pixel_list", 16), ("listed_light", 3 * 16 * len(path_lobes(spec)))):
            start.allocate(Resource.buffer(name, entry * paths, label="paths"))
        passes["resolve"].buffer("listed_light", "vec4", access=UPDATE, filled=True)
    size = VERTICES * BLOCKS_PER_VERTEX, TABLE_ROWS
    start.allocate(Resource.texture("sample_table", size, dtype="u4", label="sample numbers"))


def pixel_footprint(view: View, size: tuple[int, int]) -> tuple[float, float]:
    """Larger side of a pixel: meters of a parallel camera, meters for each meter of depth of a perspective one."""
    clip_from_relative = view.clip_from_relative(*size)
    scale = np.linalg.norm(clip_from_relative[:2, :3], axis=1)  # 1 / half the image plane's sides
    side = float(np.max(2.0 / (scale * size)))
    return (side, 0.0) if view.camera.parallel else (0.0, side)


def _resolve(spec: FrameSpec) -> ComputePass:
    """The pass that writes the channels, or adds to what the raster method wrote."""
    p = _tile_pass(spec, "resolve")
    added = {"direct": spec.raster_direct, "indirect": spec.raster_indirect}
    p.define(**{f"ADD_TO_{name.upper()}": add for name, add in added.items()})
    split = {bounce: lobe_channels(path_lobes(spec), (bounce,)) for bounce in BOUNCES}
    for name, lobes in split.items():
        wanted = bool(set(lobes) & set(spec.extra))
        p.define(**{f"SPLIT_{name.upper()}": wanted})
        for use in spec.outputs(name, *(lobes if wanted else ())):
            p.use(Use(use.form, use.name, use.type, UPDATE, use.resource) if added[name] else use)
    return p.define(PATH_INFO=True).use(*spec.outputs("path_info"))


def lookup(spec: FrameSpec, name: str, form: str = "rgba32f") -> Use:
    """A table read texel by texel: an image on llvmpipe, where that costs half; else a texture, which are many."""
    if spec.tuning.software:
        return Use(IMAGE, name, form, READ, filled=True)
    return Use(TEXTURE, name, "usampler2D" if form.endswith("ui") else "sampler2D", READ, filled=True)


def cell_rows(spec: FrameSpec) -> int:
    """Rows of the cells from which directions to the environment image are sampled."""
    return min(len(seen_of(spec.environment)), CELLS)


@stage("direct", options=("path_traced", "emitter_light", "environment_light", *GLASS, "glossy", *KINDS))
def path_traced_light(spec: FrameSpec) -> Sequence[Pass]:
    """Light of the sources that paths are traced for."""
    return tuple(declarations(spec).values())


def hit_options(spec: FrameSpec) -> HitOptions:
    """What hits need of the scene's materials."""
    emission = "none"
    if "emitters" in spec.path_traced_sources:
        emission = "all" if "path_traced" in spec.enabled else "strong"
    return HitOptions(
        normal_maps="normal_maps" in spec.enabled,
        glossy="glossy" in spec.enabled or spec.glass["TRANSMISSION"],
        emission=emission,
        alpha_test="alpha_mask" in spec.enabled,
        dielectrics=spec.glass["DIELECTRICS"],
        transmission=spec.glass["TRANSMISSION"],
        surfaces=bool(vertices(spec)) or spec.bidirectional or spec.glass["DIELECTRICS"],
    )


class PathTracing(Owner):
    """Traces the paths of a frame, and writes or adds to its light."""

    def __init__(self, renderer: Renderer, spec: FrameSpec):
        super().__init__()
        context = renderer.context
        self._spec, self._gpu = spec, context.gpu
        passes = declarations(spec)
        self.tables = context.allocate_all(passes.values())
        """What the passes declare, by name; the light stage releases it."""
        self.tables["path_counts"].clear()
        self.tables["going_on_counts"].write(np.tile(np.uint32([0, 1, 1, 0]), 2 * path_lists(spec)).tobytes())
        self._odd_sample, self._rays = 0, range(0)  # shadow rays of a pixel before each dispatch of ``exact``
        if spec.bidirectional:
            self.tables["light_choice"] = context.gpu.ctx.buffer(reserve=8 * len(spec.light_kinds), dynamic=True)
        alpha_test, keep_previous = "alpha_mask" in spec.enabled, spec.shading.both_frames
        self.structure = self.own(SceneStructure(renderer, alpha_test=alpha_test, keep_previous=keep_previous))
        self.attributes = self.own(HitAttributes(renderer, hit_options(spec)))
        if spec.path_traced_sources & {"punctual", "emitters"}:
            for name in ("light_cells", "light_entries"):
                self.tables[name] = context.gpu.ctx.buffer(reserve=8, dynamic=True)
        self._grid = light_grid(spec, self.attributes.groups.count)
        for name in TRACED:
            if name in passes:
                self.attributes.declare(self.structure.declare(passes[name]))
        self._passes: dict[str, CompiledCompute] = {n: self.own(context.compute(p)) for n, p in passes.items()}
        self._tile, self.lobes = tile_size(spec), listed_lobes(spec)
        self._rows: tuple[int, int | None] | None = None  # first sample and seed of the numbers on the GPU; None: parts
        if "environment_choice" in self.tables:
            self.tables["environment_choice"].write(direction_choice(seen_of(spec.environment)).tobytes())
        self.first_sample = 0
        """Number of the first sample of the next frame: a sequence can be continued in several runs."""
        self.scramble = spec.seed if spec.pattern == "fixed" else 0
        """Seed of the sequence of the next frame; pattern ``independent`` shifts one sequence by ``spec.seed``."""
        self.sample_count = spec.spp
        """Samples per pixel of the next frame."""

    @property
    def memory(self) -> dict[str, int]:
        """GPU memory that the passes do not declare, bytes by name."""
        return {**self.structure.memory, **self.attributes.memory}

    def run(self, frame: FrameContext) -> None:
        """Light ``frame``, whose light table is filled."""
        self.structure.update(frame)
        self.attributes.update(frame)
        frame.tables |= self.structure.resources | self.attributes.resources
        if "light_choice" in self.tables:
            lights = frame.light_rows[: len(self._spec.light_kinds)]
            power = lights["color"][:, :3].max(axis=-1)
            choice = subpath_choice(power, lights["direction"][:, 3], lights["spot"])
            self.tables["light_choice"].write(choice.tobytes())
        frame.light_grid, frame.footprint = self._grid, pixel_footprint(frame.view, self._spec.size)
        if "light_cells" in self.tables:
            self._place_lights(frame)
        self.trace(frame, frame.resources)

    def _place_lights(self, frame: FrameContext) -> None:
        """Upload what each punctual light and each group of emissive triangles brings to each cell of the grid."""
        tables, sources = [], self._spec.path_traced_sources
        if "punctual" in sources:
            tables.append(self._punctual_cells(frame))
            most = int(np.diff(tables[0][0]).max())
            frame.exact_light = exact_punctual(self._spec) and (most <= MOST_EXACT or _few_lights(self._spec))
            self._rays = range(0, max(most, 1) * frame.exact_light, LIGHT_CHUNK)
        frame.emitter_cells = sum(len(first) for first, _ in tables)
        if "emitters" in sources:
            first, entries = self.attributes.groups.choice(self._grid, frame.placement)
            tables.append((first + np.int32(sum(len(entries) for _, entries in tables)), entries))
        firsts, entries = (np.concatenate(parts) for parts in zip(*tables, strict=True))
        for name, payload in (("light_cells", firsts.tobytes()), ("light_entries", entries.tobytes() or bytes(8))):
            self.tables[name].orphan(len(payload))
            self.tables[name].write(payload)

    def _punctual_cells(self, frame: FrameContext) -> tuple[Array, Array]:
        """What ``cell_choice`` returns for the punctual lights of ``frame``, whose entries name rows of the light
        table.
        """
        lights = frame.light_rows[: len(self._spec.light_kinds)]
        power = lights["color"][:, :3].max(axis=-1)
        at = lights["position"][:, :3] + frame.view.position
        place = lights["direction"][:, 3] != LIGHT_KINDS.index("directional")
        ranges, faded = np.where(place, lights["position"][:, 3], 0.0), place & (lights["spot"][:, 3] == 0.0)
        on = np.flatnonzero(power)
        first, entries = cell_choice(self._grid.importance(at[on], power[on], ranges[on], faded[on]))
        entries[:, 1] = on[entries[:, 1].astype(np.int64)]
        return first, entries

    def trace(self, frame: FrameContext, resources: dict) -> None:
        """``run`` with other surfaces and other textures for their light in ``resources``."""
        for where in () if self._spec.pixel_list else self._tiles():
            self._trace(frame, resources, where)

    def _tiles(self) -> Iterator[dict[str, Any]]:
        """Uniforms that place each tile of the image."""
        width, height = self._spec.size
        for y in range(0, height, self._tile[1]):
            for x in range(0, width, self._tile[0]):
                yield {"tile_origin": (x, y)}

    def listed_light(self, frame: FrameContext, pixels: Array, keys: Array, samples: range, *, parts: bool) -> Array:
        """Light of ``pixels`` (n, 2), column and GL row, in ``frame``, after ``run`` with ``spec.pixel_list``.

        ``keys`` (n, 2): the pixel whose sample numbers each has; ``samples``: their numbers, with ``parts`` those of
        ``part_table``.  A pixel may be listed more than once.  (n, samples, k, 3) float32, radiance of the k
        ``listed_lobes``; light without noise is part of every sample.
        """
        noiseless = self._noiseless(frame)
        if noiseless and len(samples) > 1:
            light = self.listed_light(frame, pixels, keys, samples[:1], parts=parts)
            return np.broadcast_to(light, (len(light), len(samples), *light.shape[2:]))
        count, size, lobes = len(pixels), self._tile[0] * self._tile[1], len(self.lobes)
        packed = [at[:, 0].astype(np.uint32) | at[:, 1].astype(np.uint32) << np.uint32(16) for at in (pixels, keys)]
        out = np.zeros((len(samples) * count, lobes + lobes // 2, 3), np.float32)
        done = 0
        while done < len(out):
            first = samples[done // count]
            table = range(first, min((first // TABLE_ROWS + 1) * TABLE_ROWS, samples.stop))
            end = min(done + size, (table.stop - samples.start) * count)
            number, pixel = divmod(np.arange(done, end), count)
            row = (0 if noiseless else self._table_row(first, parts)) + number - done // count
            rows = -(-(end - done) // self._tile[0])
            entries = np.full((min(self._tile[0] * (rows + LIST_MARGIN), size), 4), NO_PIXEL, dtype=np.uint32)
            columns = (packed[0][pixel], packed[1][pixel], row, number == 0)
            entries[: end - done] = np.stack(columns, axis=-1)
            self.tables["pixel_list"].write(entries.tobytes())
            self._trace_entries(frame, rows, exact=max(min(end, count) - done, 0))
            listed = self.tables["listed_light"]
            stored = np.frombuffer(listed.read(listed.size // size * (end - done)), np.float32)
            out[done:end] = stored.reshape(end - done, -1, 4)[..., :3]
            done = end
        out = out.reshape(len(samples), count, -1, 3).swapaxes(0, 1)
        out[..., : lobes // 2, :] += out[:, :1, lobes:]
        return out[..., :lobes, :]

    def _noiseless(self, frame: FrameContext) -> bool:
        """Whether all samples of a pixel are equal: direct light of punctual lights alone, without noise."""
        return self._spec.path_traced_sources == {"punctual"} and self._spec.bounces == 1 and frame.exact_light

    def _trace_entries(self, frame: FrameContext, rows: int, exact: int) -> None:
        """One sample of every entry in ``rows`` of the list; ``exact``: the first entries, with light without noise."""
        passes, resources = self._passes, frame.resources
        passes["anchor"].run(frame, resources, rows=rows)
        for before in self._rays if exact else ():
            of_exact = -(-exact // self._tile[0])
            passes["exact"].run(frame, resources, rows=of_exact, again=before > 0, rays_before=before)
        if "subpath" in passes:
            passes["subpath"].run(frame, resources, rows=rows)
        self._trace_paths(frame, resources, rows=rows, samples_before=0)
        passes["resolve"].run(frame, resources, rows=rows, sample_count=1)

    def _trace(self, frame: FrameContext, resources: dict, place: dict[str, Any]) -> None:
        passes = self._passes
        passes["anchor"].run(frame, resources, **place)
        for before in self._rays:
            passes["exact"].run(frame, resources, **place, again=before > 0, rays_before=before)
        for k in range(self.sample_count):
            row = self._table_row(self.first_sample + k)
            if "subpath" in passes:
                passes["subpath"].run(frame, resources, **place, sample_row=row)
            self._trace_paths(frame, resources, samples_before=k, **place, sample_row=row)
        passes["resolve"].run(frame, resources, **place, sample_count=self.sample_count)

    def _trace_paths(
        self, frame: FrameContext, resources: dict, samples_before: int, rows: int | None = None, **place: Any
    ) -> None:
        """Trace one sample of every path of a tile, or of its first ``rows``.  ``place``: uniforms that say where the
        tile lies and which numbers it has.
        """
        place["odd_sample"] = self._odd_sample
        self._passes["start"].run(frame, resources, rows=rows, samples_before=samples_before, **place)
        if self._spec.pattern == "fixed":
            place.pop("tile_origin", None)  # where a pixel lies matters for its numbers alone
        for vertex in range(1, vertices(self._spec) + 1):
            byte = 16 * (self._odd_sample * path_lists(self._spec) + vertex)
            at = "going_on_counts", byte
            self._passes["extend"].run(frame, resources, at, again=vertex > 1, vertex=vertex, **place)
        self._odd_sample = 1 - self._odd_sample

    def _table_row(self, sample: int, parts: bool = False) -> int:
        """Row of the table with the numbers of ``sample``, uploaded if need be.  ``parts``: of ``part_table``."""
        first = sample // TABLE_ROWS * TABLE_ROWS
        rows = (first, None if parts else self.scramble)
        if self._rows != rows:
            table = part_table(first, TABLE_ROWS) if parts else sample_table(first, TABLE_ROWS, self.scramble)
            self.tables["sample_table"].write(table.tobytes())
            self._rows = rows
        return sample - first

    def counts(self) -> dict[str, int]:
        """Counters of all frames so far by name.  Waits for the GPU."""
        words = np.frombuffer(self.tables["path_counts"].read(), np.uint32)
        return dict(zip(COUNTS, words.tolist(), strict=True)) | {"unfinished": self.structure.unfinished_rays}

    def notes(self) -> list[str]:
        """What paths left out, one line each."""
        counts, out = self.counts(), [*self.attributes.notes]
        if counts["unfinished"]:
            out.append(f"{counts['unfinished']} rays visited {MAX_STEPS} nodes without an end and count as unoccluded")
        if counts["non_finite"]:
            out.append(f"{counts['non_finite']} contributions of paths were not finite and are left out")
        return out
