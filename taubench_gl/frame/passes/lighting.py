"""Direct light: tile light lists, the exact pass, the stochastic pass, and the color that is the sum of all light."""

from __future__ import annotations

from collections.abc import Sequence

from taubench_gl.animation.pairs import sky_directions
from taubench_gl.frame.context import FrameContext
from taubench_gl.frame.environment import declare_environment
from taubench_gl.frame.lights import LIGHT, LIGHT_ROW, UnrolledLights, unrolled_lights
from taubench_gl.frame.passes.indirect import LOBES as INDIRECT_LOBES
from taubench_gl.frame.passes.indirect import VPL, VPL_ROW, scene_center, vpl_count
from taubench_gl.frame.shadow_faces import FACE, FACE_ROW, first_faces
from taubench_gl.frame.spec import FrameSpec
from taubench_gl.gpu.declare import WRITE, ComputePass, Pass, Resource, stage
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.lobes import COMMON_LOBES, lobe_channels
from taubench_gl.metrics.lighting import ALBEDO_TABLE, MIN_ALPHA, MIN_LIGHT_DISTANCE
from taubench_gl.metrics.shading_rate import RATES, invocations, phase
from taubench_gl.metrics.stochastic import light_choice
from taubench_gl.settings import TONE_MAPS

LIGHTING = Struct(
    "LightingRecord",
    Field("sky", "vec4", "xyz: uniform sky radiance, linear"),
    Field("parallel_view", "vec4", "xyz: unit, towards a parallel camera; w: 1 if the camera is parallel"),
    Field("size", "ivec4", "xy: pixels, z: tiles in a row, w: lights"),
    Field("tiles", "int", "tiles of the image"),
    Field("light_error", "float", "largest radiance x exposure that culling may leave out of a tile"),
    Field("exposure", "float", "factor on radiance in culling"),
    Field("phase", "int", "which pixels a shading rate other than full shades in this frame"),
)
STOCHASTIC = Struct(
    "StochasticRecord",
    Field("scene_from_relative", "vec4", "xyz: current camera - center of the scene's bounds, meters"),
    Field("samples", "uvec4", "x: frame, y: seed, z: light samples per pixel, w: VPL samples per pixel"),
    Field("counts", "ivec4", "x: lights, 0 if all are off, y: VPLs, z: phase of the shading rate"),
)
COLOR = Struct(
    "ColorRecord",
    Field("sky", "vec4", "xyz: uniform sky radiance, linear"),
    Field("sky_origin", "vec4", "xyz: view direction of pixel (0, 0), world axes, not normalized"),
    Field("sky_dx", "vec4", "xyz: its step per pixel to the right"),
    Field("sky_dy", "vec4", "xyz: its step per pixel up"),
    Field("size", "ivec4", "xy: pixels"),
    Field("exposure", "float", "factor on radiance before tone mapping"),
)

SURFACE = ("position", "normal", "geometric_normal", "base_color", "material")
"""Channels that direct light reads."""

LOBES = lobe_channels(COMMON_LOBES, ("direct",))
SUMMED = ("direct", "indirect", "emission")
"""Channels that color is the sum of."""

KINDS = ("point_lights", "spot_lights", "directional_lights")
TILE = 16
"""Pixels along a side of the tiles that have light lists."""

SHADOW_BIAS = 0.5
"""Bias of shadow tests in texels of the map, along the light: for curved and creased surfaces; planes need none."""

SHADOW_REACH = 256.0
"""Texels of the map, along the light, by which a receiver's plane may differ from a pixel to the texel beside it."""


def _tiles(spec: FrameSpec) -> tuple[int, int]:
    return -(-spec.size[0] // TILE), -(-spec.size[1] // TILE)


def _unrolled(spec: FrameSpec) -> UnrolledLights:
    return unrolled_lights(spec.light_kinds, first_faces(spec.light_faces(1)))


def _lit(spec: FrameSpec, name: str, shader: str) -> ComputePass:
    """The common part of all passes over lights."""
    lighting = spec.settings.lighting
    columns, rows = _tiles(spec)

    def values(frame: FrameContext) -> dict:
        return {
            "sky": (*spec.environment.radiance, 0.0),
            "parallel_view": frame.view.towards_parallel_camera,
            "size": (*spec.size, columns, len(spec.light_kinds)),
            "tiles": columns * rows,
            "light_error": lighting.light_error,
            "exposure": lighting.exposure_factor,
            "phase": phase(spec.shading.rate, frame.number),
        }

    constants = f"const float MIN_LIGHT_DISTANCE = {MIN_LIGHT_DISTANCE}, MIN_ALPHA = {MIN_ALPHA};"
    sizes = f"const int TILE = {TILE}, LIGHT_ROW = {LIGHT_ROW}, FACE_ROW = {FACE_ROW};"
    return spec.declare_directions(
        ComputePass(name, (shader,))
        .define(GLOSSY="glossy" in spec.enabled, SHADING_RATE=RATES.index(spec.shading.rate), **spec.tuning.defines)
        .glsl(LIGHT, FACE, constants, sizes)
        .constants("P", LIGHTING, values)
    )


def _shadowed(spec: FrameSpec, p: ComputePass, taps: int) -> ComputePass:
    """Light that reaches the pixel: kinds of lights, the sky, shadow maps."""
    shadows = "shadows" in spec.enabled and bool(spec.light_kinds)
    p.define(SKY="sky" in spec.enabled, SHADOWS=shadows)
    p.define(**{name.upper(): name in spec.enabled for name in KINDS})
    if spec.sun is not None:
        p.define(DIRECTIONAL_LIGHTS=True)
    if shadows:
        p.define(SHADOW_TAPS=taps).glsl(f"const float SHADOW_BIAS = {SHADOW_BIAS}, SHADOW_REACH = {SHADOW_REACH};")
        p.texture("shadow_atlas")
    if {"sky", "glossy"} <= spec.enabled:
        table = Resource.texture("albedo_table", (ALBEDO_TABLE, ALBEDO_TABLE), label="albedo table")
        p.texture("albedo_table", filled=True).allocate(table)
    if "sky" in spec.enabled:
        declare_environment(p, spec.environment, lobes=True, owned=True)
    return p


@stage("light_culling", "direct", options=("glossy",))
def light_lists(spec: FrameSpec) -> Sequence[Pass]:
    """Lights of each tile, up to a bounded error."""
    lights = len(spec.light_kinds)
    if spec.shading.stochastic or not lights:
        return ()
    columns, rows = _tiles(spec)
    tiles = columns * rows
    return (
        _lit(spec, "light lists", "lighting/cull.comp.glsl")
        .define(SHADOWED_UNROLLED=bool(_unrolled(spec).rows))
        .use(*spec.channels("position", "base_color", "material", *("normal",) * ("glossy" in spec.enabled)))
        .image("light_table", filled=True)
        .buffer("tile_counts", "uint", access=WRITE)
        .buffer("tile_lists", "uint", access=WRITE)
        .allocate(Resource.buffer("tile_counts", 4 * tiles, label="light lists"))
        .allocate(Resource.buffer("tile_lists", 4 * tiles * lights, label="light lists"))
        .dispatch(tiles, 8),
    )


@stage("direct", options=("shadows", "light_culling", "glossy", "sky", "sun", *KINDS))
def direct_light(spec: FrameSpec) -> Sequence[Pass]:
    """All light of the raster method, of every pixel, exactly."""
    if spec.shading.stochastic or not spec.raster_direct:
        return ()
    unrolled, lights = _unrolled(spec), len(spec.light_kinds)
    taps = 4 if spec.settings.lighting.shadow_filter == "bilinear" else 1
    tiled, lobes = "light_culling" in spec.enabled and lights > 0, bool(set(LOBES) & set(spec.extra))
    p = (
        _shadowed(spec, _lit(spec, "direct", "lighting/lighting.comp.glsl"), taps)
        .define(TILED=tiled, SPLIT_LOBES=lobes)
        .define(UNROLLED_LIGHTS=len(unrolled.rows), LOOPED_LIGHTS=len(unrolled.rows) < lights)
        .glsl(unrolled.glsl)
        .use(*spec.channels(*SURFACE))
        .image("light_table", filled=True)
        .use(*spec.outputs("direct", *(LOBES if lobes else ())))
        .dispatch(invocations(spec.shading.rate, spec.size), spec.tuning.shading_group)
    )
    shadows = p.defines["SHADOWS"]
    if unrolled.rows:
        rows = list(unrolled.rows)
        p.constants("unrolled_lights", LIGHT, lambda frame: frame.light_rows[rows], count=len(rows))
        if shadows:
            faces = max(len(spec.light_faces(1)), 1)
            p.constants("unrolled_faces", FACE, lambda frame: frame.tables["shadow_face_rows"], count=faces)
    elif shadows:
        p.texture("shadow_faces", filled=True)
    if tiled:
        p.buffer("tile_counts", "uint").buffer("tile_lists", "uint")
    return (p,)


@stage("direct", options=("shadows", "glossy", "sky", "sun", "indirect", *KINDS))
def stochastic_light(spec: FrameSpec) -> Sequence[Pass]:
    """Direct and indirect light from a few random samples per pixel: unbiased, with the noise of that many."""
    shading, lights = spec.shading, len(spec.light_kinds)
    if not shading.stochastic:
        return ()
    indirect = "indirect" in spec.enabled
    vpls, center = (vpl_count(spec), scene_center(spec)) if indirect else (0, None)

    def values(frame: FrameContext) -> dict:
        lit = light_choice(frame.light_rows["color"][:lights, :3].max(axis=-1)).any()
        seed = shading.seed if frame.seed is None else frame.seed
        return {
            "scene_from_relative": (*(frame.view.position - center), 0.0) if indirect else 0.0,
            "samples": (frame.number, seed, shading.light_samples, shading.indirect_samples),
            "counts": (lights if lit else 0, vpls, phase(shading.rate, frame.number), 0),
        }

    # A hard filter has one tap, so there is nothing to choose at random.
    bilinear = spec.settings.lighting.shadow_filter == "bilinear"
    lobes = bool({*LOBES, *INDIRECT_LOBES} & set(spec.extra))
    p = (
        _shadowed(spec, _lit(spec, "stochastic", "lighting/stochastic.comp.glsl"), 1)
        .define(SHADOW_RANDOM=bilinear, INDIRECT=indirect, SPLIT_LOBES=lobes)
        .constants("S", STOCHASTIC, values)
        .use(*spec.channels(*SURFACE))
        .texture("light_table", filled=True)
        .buffer("light_choice", "vec2", filled=True)
        .use(*spec.outputs("direct", *(LOBES if lobes else ())))
        .dispatch(invocations(shading.rate, spec.size), spec.tuning.shading_group)
    )
    if p.defines["SHADOWS"]:
        p.texture("shadow_faces", filled=True)
    if indirect:
        p.glsl(VPL, f"const int VPL_ROW = {VPL_ROW};").image("vpls")
        p.use(*spec.outputs("indirect", *(INDIRECT_LOBES if lobes else ())))
    return (p,)


@stage("color", options=SUMMED)
def color(spec: FrameSpec) -> Sequence[Pass]:
    """Light and emission, exposed, tone-mapped, encoded."""
    inputs = tuple(name for name in SUMMED if name in spec.enabled)
    lighting = spec.settings.lighting

    def values(frame: FrameContext) -> dict:
        out = {"sky": (*spec.environment.radiance, 0.0), "size": (*spec.size, 0, 0)}
        if spec.environment.kind == "image":
            rays = sky_directions(frame.view, *spec.size)
            out |= {n: (*ray, 0.0) for n, ray in zip(("sky_origin", "sky_dx", "sky_dy"), rays, strict=True)}
        return {**out, "exposure": lighting.exposure_factor}

    p = ComputePass("color", ("color/color.comp.glsl",))
    declare_environment(p, spec.environment, lobes=False, owned="sky" not in spec.enabled)
    return (
        p.define(TONE_MAP=TONE_MAPS.index(lighting.tone_map))
        .define(**{f"HAS_{name.upper()}": name in inputs for name in SUMMED})
        .constants("P", COLOR, values)
        .use(*spec.channels("position", *inputs, images=True))
        .use(*spec.outputs("color"))
        .dispatch(spec.size, spec.tuning.pixel_group),
    )
