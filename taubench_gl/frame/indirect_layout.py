"""Sizes of the indirect pass: virtual lights, probes, grids, and the memory they take.  NumPy only."""

from __future__ import annotations

import numpy as np

from taubench_gl.channels import CHANNELS
from taubench_gl.frame.geometry import Draw
from taubench_gl.frame.shadow_faces import faces_of, pack
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray

INDIRECT = Struct(
    "IndirectRecord",
    Field("scene_from_relative", "vec4", "xyz: current camera - centre of the scene's bounds, metres"),
    Field("grid_origin", "vec4", "xyz: low corner of the occupancy grid, scene space; w: size of a voxel, metres"),
    Field("probe_origin", "vec4", "xyz: first probe, scene space"),
    Field("probe_step", "vec4", "xyz: distance between probes along each axis, metres"),
    Field("probe_counts", "ivec4", "xyz: probes along each axis"),
    Field("size", "ivec4", "xy: pixels, zw: pixels of the small irradiance image"),
    Field("counts", "ivec4", "x: virtual lights, y: phase of the shading rate, z: faces of lights"),
)
VIRTUAL = Struct(
    "VirtualLight",
    Field("position", "vec4", "xyz: scene space, metres; w: area of its patch, m2, 0 = none"),
    Field("normal", "vec4", "xyz: unit, world axes; w: how far above the patch visibility rays aim, metres"),
    Field("flux", "vec4", "xyz: reflected flux, linear"),
    Field("albedo", "vec4", "xyz: diffuse albedo of its patch; w: 1 / lights that see it, its share of later bounces"),
)
CHANNEL_NAMES = ("position", "normal", "base_color", "material")
VIRTUAL_ROW = 64  # virtual lights in a row of their texture, a texel for each of the four fields
GRID = 96  # voxels along the longest side
BRICKS = GRID // 4  # bricks of 4 x 4 x 4 voxels, the rays' strides, along a side
SCALE = 8  # the cheap rung gathers at every 8th pixel of both axes


def indirect_layout(box: tuple[Array, Array], size: tuple[int, int], settings: Settings) -> Array:
    """An ``INDIRECT`` record with grid, probes and sizes filled in; ``box``: corners (3,) of all geometry, world."""
    center = 0.5 * (box[0] + box[1])
    low, high = box[0] - center, box[1] - center
    extent = np.maximum(high - low, 1e-6 * max(float((high - low).max()), 1e-6))
    record = INDIRECT.zeros()
    voxel = float(extent.max()) * 1.02 / (GRID - 2)
    record["grid_origin"] = (*(low - voxel), voxel)
    # As cubic as the budget allows: one spacing for all axes.
    spacing = float((extent.prod() / max(settings.lighting.probes, 8)) ** (1.0 / 3.0))
    spacing = max(spacing, float(extent.max()) / 64.0)
    counts = np.clip(np.ceil(extent / spacing).astype(int), 2, 64)
    step = extent / counts  # probes at cell centres: none lies on the outer walls
    record["probe_origin"][:3], record["probe_step"][:3] = low + 0.5 * step, step
    record["probe_counts"][:3] = counts
    small = -(-size[0] // SCALE), -(-size[1] // SCALE)
    record["size"] = (*size, *small)
    return record


def rsm_resolution(scene: Scene, lights: list[int], samples: int) -> int:
    """Texels along a face so that all lights together give about ``samples`` virtual lights, at least 2."""
    weight = sum(f.resolution**2 for f in faces_of(scene, None, lights, (np.zeros(3), 1.0), 1))
    return max(2, int(np.sqrt(samples / max(weight, 1))))


def fixed_draws(scene: Scene, draws: tuple[Draw, ...]) -> Array:
    """Draws that no animation moves, bends or hides, (D,) bool."""
    nodes = scene.nodes
    moves = np.zeros(len(nodes.parent), dtype=bool)
    moves[[c.index for c in scene.channels if c.target == "node" and c.path != "weights"]] = True
    for level in nodes.levels()[1:]:
        moves[level] |= moves[nodes.parent[level]]
    return np.array([not (d.posed or moves[d.node]) for d in draws], dtype=bool)


def virtual_size(count: int) -> tuple[int, int]:
    """Texels of the texture of ``count`` virtual lights, a texel for each of their fields."""
    return len(VIRTUAL.fields) * VIRTUAL_ROW, -(-count // VIRTUAL_ROW)


def probe_size(record: Array) -> tuple[int, int]:
    """Texels of the probes' texture, six for each; ``record``: an ``INDIRECT`` record."""
    x, y, z = (int(n) for n in record["probe_counts"][:3])
    return 6 * x, y * z


def visibility_bytes(probes: int, virtual_lights: int) -> int:
    """One bit per pair of a probe and a virtual light, in whole words per probe."""
    return 4 * probes * -(-virtual_lights // 32)


def indirect_bytes(
    scene: Scene, lights: list[int], box: tuple[Array, Array], size: tuple[int, int], settings: Settings, rung: str
) -> int:
    """GPU memory of the pass, bytes, its channel left out; ``lights``: rows of the light table with shadow maps."""
    resolution = rsm_resolution(scene, lights, settings.lighting.indirect_samples)
    faces = faces_of(scene, None, lights, (np.zeros(3), 1.0), resolution)
    width, height = pack(faces)[1]
    texel = 4 + sum(CHANNELS[n].bytes for n in CHANNEL_NAMES)
    count = sum(f.resolution**2 for f in faces)
    rows = int(np.prod(virtual_size(count)))
    own = 16 * rows + width * height * texel
    record = indirect_layout(box, size, settings)
    if rung == "probes":
        probes = int(np.prod(record["probe_counts"][:3]))
        flux = 16 * rows // len(VIRTUAL.fields)
        grid = 2 * GRID**3 // 8 + 16 * BRICKS**3 + 4 * BRICKS**2
        return own + flux + 6 * 16 * probes + grid + visibility_bytes(probes, count)
    return own + 16 * int(np.prod(record["size"][2:]))
