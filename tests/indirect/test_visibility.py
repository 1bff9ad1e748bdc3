"""What probes see: bricks against the voxels they pack, rays against an exact test in float64, and what is kept."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from fixed import fixed_settings
from repeated import few

from taubench_gl.frame.geometry import build_geometry
from taubench_gl.frame.passes.indirect import BRICKS, GRID, VPL_LIFT, indirect_layout
from taubench_gl.frame.passes.shadows import fixed_draws
from taubench_gl.frame.shadow_faces import FACE
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import Gpu, open_gpu
from taubench_gl.scene.builder import SceneBuilder, box, morphed, quad, turn_y
from taubench_gl.scene.model import Channel, Scene
from taubench_gl.selftest.scenes import busy_room

FAR = 4  # bricks, as indirect/bricks.comp.glsl
SETTINGS = fixed_settings(width=48, height=32, indirect="probes", indirect_samples=256, probes=150)


def crowded() -> Scene:
    """A room with pillars askew, one of which moves under a moving lamp, and a block that bends."""
    s = SceneBuilder()
    gray = s.material(base_color=(0.6, 0.6, 0.6, 1.0), metallic=0.0, roughness=1.0, double_sided=True)
    s.node(mesh=s.mesh(box((3.0, 1.5, 2.0), inside=True, material=gray)))
    for i in range(3):
        pillar = s.mesh(box((0.2, 1.2, 0.3), material=gray))
        s.node(mesh=pillar, translation=(1.3 * i - 1.6, -0.2, 0.7 - 0.6 * i), rotation=turn_y(17.0 + 31.0 * i))
    walker = s.node(mesh=s.mesh(box((0.25, 0.9, 0.2), material=gray)), translation=(0.0, -0.5, 1.3))
    s.animate(walker, "translation", [0.0, 1.0], [[-2.0, -0.5, 1.3], [2.0, -0.5, 1.0]])
    soft = box((0.3, 0.3, 0.3), material=gray)
    bent = s.node(mesh=s.mesh(morphed(soft, 0.4 * soft.positions), weights=(0.0,)), translation=(0.7, -1.0, -1.0))
    s.animate(bent, "weights", [0.0, 1.0], [[0.0], [1.0]])
    lamp = s.light(kind="point", intensity=4.0, translation=(-1.0, 1.0, 0.0))
    s.animate(lamp, "translation", [0.0, 1.0], [[-1.0, 1.0, 0.0], [1.0, 1.0, 0.3]])
    eye = s.camera(translation=(-2.6, 0.3, 1.6), rotation=turn_y(-50.0), yfov=1.2, znear=0.05)
    s.animate(eye, "translation", [0.0, 1.0], [[-2.6, 0.3, 1.6], [-2.0, 0.5, 1.4]])
    return s.build()


@pytest.fixture(scope="module")
def gpu() -> Iterator[Gpu]:
    with open_gpu() as device:
        yield device


def source_of(gpu: Gpu, scene: Scene) -> RasterSource:
    return RasterSource(gpu, AnimatedScene(scene), SETTINGS)


@pytest.mark.parametrize("extent", [(2.0, 2.0, 2.0), (1e-3, 50.0, 7.0), (3e4, 1.0, 0.0), (0.1, 0.2, 1e4)])
@pytest.mark.parametrize("center", [(0.0, 0.0, 0.0), (1234.5, -6e3, 0.1)])
def test_the_grid_is_empty_along_its_sides(extent, center):
    """``brick_of`` (voxels.glsl) looks beside the grid where rounding lets a ray go on past its end, and reads a voxel
    of the opposite side: no surface may lie there.  In float64 from the record; at the low side but for its rounding.
    """
    half = 0.5 * np.array(extent)
    record = indirect_layout((center - half, center + half), (64, 48), SETTINGS.lighting.probes)
    low, voxel = record["grid_origin"][:3].astype(np.float64), float(record["grid_origin"][3])
    assert np.all((-half - low) / voxel > 1.0 - 1e-4)
    assert np.all((half - low) / voxel < GRID - 2)


def test_bricks_hold_the_voxels_and_the_way_to_the_next(gpu):
    source = source_of(gpu, crowded())
    source.advance(5)
    indirect = source.light.indirect
    voxels = indirect.grid.occupancy()
    texels = np.frombuffer(indirect.tables["bricks"].read(), np.uint32).reshape(BRICKS, BRICKS, BRICKS, 4)
    source.release()
    bits = np.unpackbits(np.ascontiguousarray(texels[..., :2]).view(np.uint8), axis=-1, bitorder="little")
    cells = bits.reshape(BRICKS, BRICKS, BRICKS, 4, 4, 4).transpose(0, 3, 1, 4, 2, 5).reshape(GRID, GRID, GRID)
    assert voxels.any() and np.array_equal(cells.astype(bool), voxels)
    filled = np.argwhere(bits.any(axis=-1))
    places = np.stack(np.meshgrid(*[np.arange(BRICKS)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    away = np.array([np.abs(filled - p).max(axis=1).min() for p in places]).reshape(BRICKS, BRICKS, BRICKS)
    assert set(np.unique(away)) >= set(range(FAR + 1))
    assert np.array_equal(texels[..., 2], np.minimum(away, FAR))


def meets(start: np.ndarray, end: np.ndarray, cells: np.ndarray, grow: float) -> bool:
    """Does a segment (voxels, float64) meet any of ``cells`` (K, 3), each grown by ``grow`` on every side?  Slabs."""
    d = np.where(np.abs(end - start) < 1e-12, 1e-12, end - start)
    a, b = (cells - grow - start) / d, (cells + 1 + grow - start) / d
    first, last = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
    return bool(np.any(np.maximum(first, 0.0) < np.minimum(last, 1.0)))


class LightMaps:
    """The reflective shadow maps of a frame, read back: what is near a light, in float64 (indirect/visibility.comp)."""

    def __init__(self, indirect, record):
        self.faces = np.frombuffer(indirect.tables["rsm_faces"].read(), FACE.dtype)
        self.first = np.frombuffer(indirect.tables["texels"].read(), np.uint32).reshape(-1, 4)[:, 3]
        maps = (indirect.tables[f"rsm_{name}"] for name in ("position", "normal"))
        self.position, self.normal = (np.frombuffer(m.read(), np.float32).reshape(m.height, m.width, 4) for m in maps)
        self.moved = record["scene_from_relative"][:3].astype(np.float64)
        self.near = 4.0 * VPL_LIFT * float(record["grid_origin"][3])

    def leaves(self, vpl: int, x: np.ndarray) -> set[int]:
        """What light from the light of ``vpl`` does on its way to x, scene space: {1} passes what is near, {0} does
        not; {} the maps do not cover x, or rounding decides."""
        first, found = int(self.first[vpl]), []
        for face in self.faces[first:]:
            if face["extent"][3] != self.faces[first]["extent"][3]:
                break
            q = x - self.moved - face["origin"][:3]
            right, up, forward = (face[name][:3].astype(np.float64) @ q for name in ("right", "up", "forward"))
            at = np.array([right, up]) / (1.0 if face["origin"][3] > 0.5 else max(forward, 1e-9))
            if forward <= face["forward"][3] or np.abs(at).max() > 1.0:
                continue
            texel = (at * 0.5 + 0.5) * face["extent"][0]
            if np.abs(texel - np.rint(texel)).min() < 1e-3:
                return set()
            column, row = np.array([face["right"][3], face["up"][3]], int) + np.floor(texel).astype(int)
            normal, hit = self.normal[row, column], self.position[row, column, :3] - face["origin"][:3]
            away = np.linalg.norm(hit)
            bounds = min(np.linalg.norm(q), self.near)
            side = float(normal[:3] @ (q - hit)) * float(normal[:3] @ -hit)
            if abs(away - bounds) < 1e-3 * away or abs(side) < 1e-4 * away:
                return set()
            found.append(1 if normal[3] <= 0.0 or away > bounds or side > 0.0 else 0)
        return set(found)


def test_rays_that_stride_see_what_an_exact_test_of_every_voxel_sees(gpu):
    source = source_of(gpu, crowded())
    source.advance(5)
    indirect = source.light.indirect
    seen, cells = indirect.grid.visibility(), np.argwhere(indirect.grid.occupancy())[:, ::-1].astype(np.float64)
    record, lights = indirect.record(source.renderer.frame), source.light.vpls()
    maps, hidden = LightMaps(indirect, record), 0
    source.release()
    counts = record["probe_counts"][:3]
    low, voxel = record["grid_origin"][:3].astype(np.float64), float(record["grid_origin"][3])
    rng = np.random.default_rng(4)
    seen_counts = {True: 0, False: 0}
    for _ in range(3000):
        i, k = rng.integers(len(seen)), rng.integers(len(lights))
        at = np.array([i % counts[0], i // counts[0] % counts[1], i // (counts[0] * counts[1])])
        probe = record["probe_origin"][:3] + at * record["probe_step"][:3].astype(np.float64)
        (*place, area), (*normal, lift) = (lights[f][k].astype(np.float64) for f in ("position", "normal"))
        facing = np.dot(normal, place - probe)
        if area <= 0.0 or facing >= -1e-5:
            assert facing > -1e-4 or area <= 0.0 or not seen[i, k]
            continue
        beside = lift < 0.999 * VPL_LIFT * voxel
        leaves = maps.leaves(k, probe) if beside else {1}
        if leaves == {0}:
            assert not seen[i, k], f"probe {i}, VPL {k}: its light does not get there"
            hidden += 1
        if leaves != {1}:
            continue
        slack, lift = (VPL_LIFT, VPL_LIFT * voxel) if beside else (0.5, lift)
        a, b = (probe - low) / voxel, (np.array(place) + lift * np.array(normal) - low) / voxel
        way = (b - a) / np.linalg.norm(b - a)
        start, end = a + 0.5 * way, b - slack * way
        blocked = {meets(start, end, cells, grow) for grow in (-1e-3, 1e-3)}
        if len(blocked) == 1:  # of 2: it grazes a voxel, and rounding decides
            seen_counts[seen[i, k]] += 1
            assert seen[i, k] != blocked.pop(), f"probe {i}, VPL {k}"
    assert min(seen_counts.values()) > 200 and hidden > 20, (seen_counts, hidden)


@pytest.mark.parametrize("make", few([crowded, partial(busy_room, lamps=2)]), ids=["crowded", "busy"])
def test_what_is_kept_is_what_would_be_drawn_again(gpu, make):
    """Frames one after the other, and each by a source that has seen no other: the same bits, whatever moved."""
    scene = make()
    kept = source_of(gpu, scene)
    for frame in (0, 1, 2, 9, 3):
        kept.advance(frame)
        alone = source_of(gpu, scene)
        alone.advance(frame)
        one, other = kept.light.indirect.grid, alone.light.indirect.grid
        assert np.array_equal(one.occupancy(), other.occupancy())
        assert np.array_equal(one.visibility(), other.visibility())
        assert np.array_equal(kept.read("indirect"), alone.read("indirect"))
        alone.release()
    kept.release()


@pytest.mark.parametrize(
    ("path", "values"), [("range", [2.0, 9.0]), ("inner_cone", [0.0, 0.6]), ("outer_cone", [0.7, 1.2])]
)
def test_a_lamp_that_changes_its_reach_or_cone_gives_other_indirect_light(gpu, path, values):
    """Nothing moves but one number of a light, back and forth: as a source that has seen no other frame."""
    s = SceneBuilder()
    gray = s.material(base_color=(0.6, 0.6, 0.6, 1.0), metallic=0.0, roughness=1.0, double_sided=True)
    s.node(mesh=s.mesh(box((3.0, 1.5, 2.0), inside=True, material=gray)))
    s.light(kind="spot", intensity=40.0, range=9.0, inner_cone=0.0, outer_cone=0.7, translation=(0.0, 0.5, 1.0))
    s.camera(translation=(-2.6, 0.3, 1.6), rotation=turn_y(-50.0), yfov=1.2, znear=0.05)
    change = Channel("light", 0, path, "LINEAR", np.array([0.0, 1.0]), np.array(values)[:, None])
    scene = replace(s.build(), channels=(change,))
    kept, seen = source_of(gpu, scene), []
    for frame in (0, 20, 10):
        kept.advance(frame)
        alone = source_of(gpu, scene)
        alone.advance(frame)
        assert np.array_equal(kept.read("indirect"), alone.read("indirect")), frame
        seen.append(kept.read("indirect").sum())
        alone.release()
    kept.release()
    assert len(set(seen)) == 3


def test_draws_below_an_animated_node_are_not_fixed():
    s = SceneBuilder()
    parent = s.node(name="moves")
    mesh = s.mesh(quad(1.0, 1.0))
    for above in (-1, parent):
        s.node(above, mesh=mesh)
    s.animate(parent, "rotation", [0.0, 1.0], [turn_y(0.0), turn_y(90.0)])
    hidden = s.node(mesh=mesh)
    s.animate(hidden, "visible", [0.0], [[0.0]], interpolation="STEP")
    plain = quad(1.0, 1.0)
    s.node(mesh=s.mesh(morphed(plain, plain.positions), weights=(0.0,)))
    scene = s.build()
    draws = build_geometry(scene).draws
    fixed = {d.node: bool(f) for d, f in zip(draws, fixed_draws(scene, draws), strict=True)}
    assert fixed == {1: True, 2: False, 3: False, 4: False}
