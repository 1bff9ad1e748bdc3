"""Cases: what the CPU makes for shaders, by its definition: maps, patches, trees, vertices, bounds, schedules."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import Poser, View, bounding_box, bounding_sphere, pose_vertices
from taubench_gl.evaluation import lighting, schedule
from taubench_gl.evaluation.brightness import Brightness, noise_of_a_sample
from taubench_gl.frame.draw_bounds import DrawBounds, in_view
from taubench_gl.frame.geometry import build_geometry, face_normals, instance_numbers, make_tangents
from taubench_gl.frame.passes import indirect
from taubench_gl.frame.patches import Patches, lamps_of, received
from taubench_gl.frame.plan import frame_spec
from taubench_gl.frame.raytracing import bvh, hit_tables, texels
from taubench_gl.frame.raytracing.atlas import plan_atlas
from taubench_gl.frame.raytracing.emitters import EMITTER, emitter_table, pyramid
from taubench_gl.frame.raytracing.instances import changing_nodes, instance_table
from taubench_gl.frame.records import RecordTable
from taubench_gl.frame.shadow_faces import FaceTable, faces_of, map_sizes, pack
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.scene.model import Camera, Sampler, Scene, Texture
from taubench_gl.selftest.bench import Bench, limits
from taubench_gl.selftest.case import Outcome, case, field, worst
from taubench_gl.selftest.direct import lambert
from taubench_gl.selftest.scenes import SceneBuilder, box, morphed, quad, skinned, turn, turn_x, turn_y
from taubench_gl.settings import FIXED_LIGHTING, Settings

Array = np.ndarray
EXACT = "exact: integers and comparisons"


def _lamps(points: int, suns: int = 0, **material) -> Scene:
    """A closed room of ``material`` with lamps of decreasing power, and directional lights after them."""
    b = SceneBuilder()
    walls = b.material(**material)
    b.node(mesh=b.mesh(box((4.0, 2.0, 1.0), inside=True, material=walls)), translation=(10.0, 0.0, 0.0))
    for i in range(points + suns):
        b.light(kind="point" if i < points else "directional", intensity=100.0 / (i + 1), translation=(10.0, 0.0, 0.0))
    b.camera(translation=(10.0, 0.0, 0.0))
    return b.build()


@case(
    "sizes-of-indirect-light",
    description="lamps and suns with fewer and fewer virtual point lights: which have maps, their texels, patches, "
    "probes",
    elsewhere="lights count alike although a lamp has six maps and a sun one of four times the side",
    here="maps while each side has 4 texels; all together give the number that was asked for",
    source=EXACT,
)
def sizes_of_indirect_light(bench: Bench) -> Outcome:
    errors = []
    for points, suns, samples in ((3, 0, 96), (3, 0, 191), (3, 0, 192), (3, 0, 288), (3, 0, 95), (3, 0, 5000),
                                  (1, 1, 351), (1, 1, 352), (1, 1, 2200)):  # fmt: skip
        settings = Settings(
            **FIXED_LIGHTING | {"indirect": "probes"}, light="raster", width=70, height=41, indirect_samples=samples,
            probes=300, columns=("direct", "indirect"),
        )  # fmt: skip
        spec = frame_spec(AnimatedScene(_lamps(points, suns)), settings)
        sides = [6] * points + [16] * suns  # texels of a light at a resolution of 1
        mapped = indirect.mapped_lights(spec)
        fitting = [n for n in range(len(sides) + 1) if 16 * sum(sides[:n]) <= samples]
        used = sum(sides[: fitting[-1]])
        side = math.isqrt(samples // used) if used else 2
        patches = 0 if fitting[-1] == len(sides) else (samples + 1) // 2
        errors += [
            float(mapped != list(range(fitting[-1]))), used and indirect.rsm_resolution(spec) - side,
            indirect.patch_count(spec) - patches, indirect.vpl_count(spec) - used * side**2 - 2 * patches,
        ]  # fmt: skip
        layout = indirect.indirect_layout(spec.animated.box, spec.size, 300)
        extent, step = np.array([8.0, 4.0, 2.0]), layout["probe_step"][:3].astype(float)
        counts = np.ceil(extent / (64.0 / 300) ** (1 / 3))
        errors += [
            worst(layout["probe_counts"][:3] - counts), worst(step - extent / counts) > 1e-6,
            worst(layout["probe_origin"][:3] - 0.5 * (step - extent)) > 1e-6,
            abs(layout["grid_origin"][3] - 8.16 / 94) > 1e-6,
            worst(layout["grid_origin"][:3] + 0.5 * extent + 8.16 / 94) > 1e-6,
            worst(layout["size"] - (70, 41, 9, 6)), worst(indirect.scene_center(spec) - (10.0, 0.0, 0.0)),
        ]  # fmt: skip
    errors += [worst(np.subtract(indirect.vpl_size(n), size)) for n, size in ((64, (256, 1)), (65, (256, 2)))]
    return field("sums of squares", errors)


def _room_of_lights() -> Scene:
    """A lamp, a narrow and a wide spot and a sun, each turned and moved."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(box((3.0, 3.0, 3.0))))
    for kind, cone in (("point", 0.5), ("spot", 0.4), ("spot", 1.5), ("directional", 0.5)):
        b.light(kind=kind, outer_cone=cone, inner_cone=0.1, translation=(1.0, 2.0, -0.5), rotation=turn((1, 2, 3), 70))
    return b.build()


@case(
    "faces-of-lights",
    description="shadow maps of a lamp, two spots and a sun: corners of their volumes, points they see and cover, "
    "atlases",
    elsewhere="a side plane is tested along the axis, a map is cut at its edge, two maps share texels",
    here="every point inside a volume is seen and covered by its sphere; maps of an atlas are apart",
    tolerance=1e-9,
    source="float64; comparisons are exact",
)
def faces_of_lights(bench: Bench) -> Outcome:
    scene, errors, rng = _room_of_lights(), [], np.random.default_rng(3)
    bounds = np.array([0.2, 0.1, -0.3]), 7.0
    faces = faces_of(scene, Poser(scene).sample(0.0), [0, 1, 2, 3], bounds, 16)
    errors += [float([f.light for f in faces] != [0] * 6 + [1] + [2] * 6 + [3]), faces[-1].resolution - 64]
    eye = np.array([5.0, -3.0, 2.0])
    for face in faces:
        axes = np.stack([face.right, face.up, face.forward])
        errors += [worst(axes @ axes.T - np.eye(3)), abs(np.linalg.det(axes)) - 1.0, face.resolution % 16]
        errors.append(face.half - (7.0 if face.parallel else 1.02 * math.tan(0.4) if face.light == 1 else 1.0))
        errors.append(face.near - (14.0 if face.parallel else 7e-4))
        matrix = face.clip_from_relative(eye)
        for x, y, depth in ((1, 1, 0.5), (-1, 1, 3.0), (1, -1, 10.0)):
            width = face.half if face.parallel else face.half * depth
            point = face.origin + (x * width) * face.right + (y * width) * face.up + depth * face.forward
            clip = matrix @ [*(point - eye), 1.0]
            z = 1.0 - depth / face.near if face.parallel else face.near / depth
            errors.append(worst(clip / clip[3] - [x, y, z, 1.0]))
        # Spheres at random: any of their points that a texel shows must be inside what is covered.
        centers, radii = rng.uniform(-8.0, 8.0, (60, 3)), rng.uniform(0.01, 2.0, 60)
        table, only = FaceTable([face]), np.zeros(60, dtype=int)
        (seen,), (first, end) = table.sees(centers, radii), table.cover(only, centers, radii)
        shell = math3d.normalize(rng.normal(size=(200, 3)))
        points = centers[:, None] + radii[:, None, None] * shell
        clip = np.concatenate([points - eye, np.ones((60, 200, 1))], axis=-1) @ matrix.T
        with np.errstate(divide="ignore", invalid="ignore"):
            at = clip[..., :3] / clip[..., 3:]
        inside = (np.abs(at[..., :2]) <= 1.0).all(axis=-1) & (clip[..., 3] > 0) & (at[..., 2] <= 1.0)
        texel = (0.5 + 0.5 * at[..., :2]) * face.resolution
        covered = ((first[:, None] <= texel) & (texel <= end[:, None])).all(axis=-1)
        errors += [float((inside.any(axis=1) & ~seen).any()), float((inside & ~covered).any())]
        # And not much more: at most the margin, and a pixel, beyond a sphere straight ahead.
        ahead = face.origin + 5.0 * face.forward
        low, high = table.cover(only[:1], ahead[None], np.array([0.3]))
        wide = 0.3 if face.parallel else 0.3 / 4.7
        across = face.resolution * wide / face.half
        margin = high - low - across
        errors.append(float(margin.min() < 0.0 or margin.max() > 8.0))
        behind = face.origin - 9.0 * face.forward
        errors.append(float(table.sees(behind[None], np.array([1.0]))[0, 0] != face.parallel))
        aside = face.origin + (20.0 * face.half) * face.right + 5.0 * face.forward
        errors.append(float(table.sees(aside[None], np.array([1.0]))[0, 0]))
    for limit in (80, 128, 4096):
        packed = dataclasses.replace(faces[0], resolution=48)
        offsets, size = pack([*faces, packed, packed], limit)
        taken = np.zeros(size[::-1], dtype=int)
        for (x, y), face in zip(offsets, [*faces, packed, packed], strict=True):
            taken[y : y + face.resolution, x : x + face.resolution] += 1
        errors += [float(taken.max() > 1), float(taken.sum() != sum(f.resolution**2 for f in faces) + 2 * 48**2)]
        errors.append(float(max(size) > 4096))
    # Twelve lamps: eight at 64 texels, four at 32, of which as few as possible are halved.
    for limit, total in ((4096, 6 * (8 * 64**2 + 4 * 32**2)), (400, None)):
        sizes = map_sizes(_lamps(12), list(range(12)), 64, limit)
        errors.append(float(total is not None and 6 * sum(n**2 for n in sizes.values()) != total))
        errors.append(float(sorted(sizes.values(), reverse=True) != list(sizes.values())))
        fits = pack([dataclasses.replace(faces[0], resolution=n) for n in sizes.values() for _ in range(6)], limit)
        errors.append(float(max(fits[1]) > 4096 or (total is None and max(fits[1]) > limit)))
    return field("inside what is covered", errors)


@case(
    "patches-by-area-and-light",
    description="patches of a still, a scaled and a growing plate: their area, normals and albedo, and the light on "
    "them",
    elsewhere="a patch keeps the area of its triangle at rest, or of a primitive that has another scale",
    here="patches add up to the area of what is drawn, in every frame",
    tolerance=1e-6,
    source="relative; a float32 record",
)
def patches_by_area_and_light(bench: Bench) -> Outcome:
    b, errors = SceneBuilder(), []
    gray = lambert(b, 0.25)
    b.node(mesh=b.mesh(quad(2.0, 1.0, cells=(3, 2), material=gray)), translation=(0.0, 0.0, -5.0))
    b.node(mesh=b.mesh(quad(1.0, 1.0, material=gray)), translation=(9.0, 0.0, 0.0), scale=(1.0, 3.0, 1.0))
    grown = morphed(quad(1.0, 1.0, material=gray), quad(1.0, 1.0).positions)
    plate = b.node(mesh=b.mesh(grown, weights=[0.0]), translation=(0.0, 9.0, 0.0), rotation=turn_x(90.0))
    b.animate(plate, "weights", [0.0, 1.0], [[0.0], [1.0]])
    scene = b.build()
    poser, draws = Poser(scene), build_geometry(scene).draws
    patches = Patches(poser, draws, [], 300)
    for time, areas in ((0.0, (8.0, 12.0, 4.0)), (1.0, (8.0, 12.0, 16.0))):
        state, center = poser.sample(time), np.array([1.0, 2.0, 3.0])
        placed = RecordTable(draws).place(state, View(np.zeros(3), np.eye(3), Camera()), np.zeros(len(draws), bool))
        rows = patches.records(state, placed, center)
        place = rows["position"][:, :3] + center
        groups = np.abs(place[:, 2] + 5.0) < 1e-4, np.abs(place[:, 0] - 9.0) < 1.1, np.abs(place[:, 1] - 9.0) < 1e-4
        normals, centers = ((0, 0, 1), (0, 0, 1), (0, -1, 0)), ((0, 0, -5), (9, 0, 0), (0, 9, 0))
        for of, area, normal, center_of in zip(groups, areas, normals, centers, strict=True):
            errors.append(rows["position"][of, 3].sum() / area - 1.0)
            errors.append(worst(rows["normal"][of, :3] - normal))
            middle = np.average(place[of], axis=0, weights=rows["position"][of, 3])
            errors.append(float(worst(middle - center_of) > 0.1))
        errors.append(worst(rows["albedo"][:, :3] - 0.25))
    # Light on them: three quarters of the patches are chosen by it.
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(1.0, 1.0, material=lambert(b))), translation=(0.0, 0.0, 0.0))
    b.node(mesh=b.mesh(quad(1.0, 1.0, material=lambert(b))), translation=(0.0, 0.0, 40.0))
    b.light(translation=(0.0, 0.0, 2.0), intensity=8.0, range=4.0)
    b.light(kind="directional", intensity=3.0, rotation=turn_y(60.0))
    scene = b.build()
    poser, draws = Poser(scene), build_geometry(scene).draws
    lamp, sun = lamps_of(poser, [0, 1], np.zeros(1))
    point, facing = np.array([[1.5, 0.0, 0.0], [3.5, 0.0, 0.0]]), np.tile([0.0, 0.0, 1.0], (2, 1))
    area, d2 = 0.5, np.array([6.25, 16.25])
    window = np.clip(1.0 - (d2 / 16.0) ** 2, 0.0, 1.0)
    expected = 8.0 * window * 2.0 / np.sqrt(d2) / (d2 + area / (2.0 * np.pi))
    errors += [
        worst(received(point, facing, area, [lamp]) - expected),
        worst(received(point, facing, area, [sun]) - 1.5), worst(received(point, facing, area, [sun, sun]) - 3.0),
        worst(received(point, facing, area, [dataclasses.replace(lamp, constant=True)]) - expected
              * (d2 + area / (2.0 * np.pi))),
    ]  # fmt: skip
    lit = Patches(poser, draws, [lamp], 400).records(
        poser.sample(0.0), RecordTable(draws).place(poser.sample(0.0), View(np.zeros(3), np.eye(3), Camera()),
                                                    np.zeros(2, bool)), np.zeros(3)
    )  # fmt: skip
    near = lit["position"][:, 2] < 1.0
    errors += [float(abs(near.sum() - 350) > 2), float(abs(lit["position"][near, 3].sum() - 4.0) > 0.1)]
    return field("sums of areas", errors)


def _boxes_of(kind: str, count: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(count)
    low = rng.normal(size=(count, 3)) * (1.0 if kind == "cloud" else (1.0, 0.0, 0.0))
    high = low + rng.uniform(0.0, 0.2, (count, 3))
    return low.astype(np.float32), high.astype(np.float32)


@case(
    "trees-of-boxes",
    description="trees over random boxes: boxes in no leaf or in two, bounds, skip pointers, words of nodes and "
    "triangles",
    elsewhere="a skip that lands inside the subtree it skips, or a bound that is rounded inwards",
    here="leaves hold every box once; a node's bounds are those of its children; grids round outwards",
    source=EXACT,
)
def trees_of_boxes(bench: Bench) -> Outcome:
    errors = []
    for kind, count, leaf in (("cloud", 1, 4), ("cloud", 700, 4), ("line", 300, 4), ("cloud", 90, 1)):
        low, high = _boxes_of(kind, count)
        tree = bvh.build(low, high, leaf)
        ends, inner = tree.count > 0, np.flatnonzero(tree.count == 0)
        errors += [float(sorted(tree.order.tolist()) != list(range(count))), float((tree.count > leaf).any())]
        errors += [float(len(tree) != 2 * ends.sum() - 1), float((tree.right[ends] != -1).any())]
        skip = bvh.skips(tree)
        for node in range(len(tree)):
            # What follows a node until its skip is its subtree: its leaves bound it.
            below = [n for n in range(node, skip[node]) if ends[n]]
            held = np.concatenate([tree.order[tree.first[n] : tree.first[n] + tree.count[n]] for n in below])
            errors.append(worst(tree.low[node] - low[held].min(axis=0)))
            errors.append(worst(tree.high[node] - high[held].max(axis=0)))
        height = bvh.heights(tree)
        errors += [float((height[ends] != 0).any()), float(skip[0] != len(tree))]
        errors.append(worst(height[inner] - np.maximum(height[inner + 1], height[tree.right[inner]]) - 1))
        errors.append(float(height[0] > 4 * max(math.ceil(math.log2(count)), 1)))
        # As texels: bounds rounded outwards by less than one, and what follows.
        grid = texels.Grid.around(tree.low[0], tree.high[0])
        scaled = dataclasses.replace(tree, low=(tree.low - grid.center) * grid.scale,
                                     high=(tree.high - grid.center) * grid.scale)  # fmt: skip
        words = texels.node_texels(scaled, 1000)
        down, up = ((words[:, :3] >> shift & 0xFFFF).astype(np.uint16).view(np.int16) for shift in (0, 16))
        errors += [
            float(((scaled.low - down) < -1e-9).any() or ((scaled.low - down) >= 1.0).any()),
            float(((up - scaled.high) < -1e-9).any() or ((up - scaled.high) >= 1.0).any()),
            float(down.min() < -32768 or abs(int(down[0].max()) + 32767) > 1 or abs(int(up[0].min()) - 32767) > 1),
            worst(words[inner, 3].astype(float) - skip[inner]), float((words[ends, 3] >> 31 != 1).any()),
            worst((words[ends, 3] >> 28 & 7).astype(float) - tree.count[ends] + 1),
            worst((words[ends, 3] & (1 << 28) - 1).astype(float) - tree.first[ends] - 1000),
        ]  # fmt: skip
    flat = texels.Grid.around(np.zeros(3), np.array([2.0, 4.0, 0.0]))
    errors += [worst(flat.scale / 32767.0 - [1.0, 0.5, 512.0]), worst(flat.matrix @ [2.0, 4.0, 0.0, 1.0] - [
        32767.0, 32767.0, 0.0, 1.0])]  # fmt: skip
    return field("by their definition", errors)


@case(
    "tables-of-hits",
    description="emitters, texture modes, atlases, texels in rows and the classes of draws: differences from "
    "definitions",
    elsewhere="a number on the border of two cells finds the emitter of neither, or two textures share texels",
    here="every number finds its row between the bounds of its cell; classes follow from the animation alone",
    source=EXACT,
)
def tables_of_hits(bench: Bench) -> Outcome:
    errors, rng = [], np.random.default_rng(5)
    for count in (1, 2, 3, 8, 9, 100):
        rows = np.zeros(count, EMITTER)
        power = rng.random(count) ** 4 * (rng.random(count) > 0.3) + 1e-9
        rows["cumulative"] = np.cumsum(power) / power.sum()
        rows["cumulative"][-1] = 1.0
        cells = hit_tables.emitter_cells(rows)
        errors += [float(len(cells) < count or len(cells) >= 2 * count), float(len(cells) & len(cells) - 1)]
        for number in np.concatenate([rng.random(200), np.arange(len(cells)) / len(cells)]):
            row = int(np.searchsorted(rows["cumulative"].astype(float), number, side="right"))
            first, last = cells[int(number * len(cells)), :2]
            errors.append(float(not first <= row <= last))
    errors += [worst(np.subtract(hit_tables.table_size(n), (8192, r))) for n, r in ((0, 1), (8192, 1), (8193, 2))]
    words = hit_tables.WordTable()
    starts = [words.add(np.full((n, 4), n, np.uint32)) for n in (3, 8190, 1)]
    image = words.image().reshape(-1, 4)
    errors += [float(starts != [0, 3, 8193]), float(image.shape[0] != 16384)]
    errors.append(float(image[[0, 2, 3, 8192, 8193, 8194], 1].tolist() != [3, 3, 8190, 8190, 1, 0]))
    modes = {(10497, 10497): 0, (33071, 10497): 1, (10497, 33648): 8, (33648, 33071): 6}
    for (s, t), bits in modes.items():
        texture = Texture(0, Sampler(wrap_s=s, wrap_t=t))
        turned = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
        other = Texture(0, Sampler(9728, wrap_s=s, wrap_t=t), texcoord=1, uv_transform=turned)
        errors += [hit_tables.texture_modes(texture) - bits, hit_tables.texture_modes(other) - bits - 16 - 32 - 64]
    for limit, budget in ((4096, 1 << 20), (64, 1 << 20), (4096, 6000)):
        sizes = {int(i): (int(w), int(h)) for i, (w, h) in enumerate(rng.integers(1, 80, (9, 2)))}
        plan = plan_atlas(sizes, limit, budget)
        taken = np.zeros(plan.size[::-1], dtype=int)
        for image_index, (x, y) in plan.places.items():
            w, h = plan.sizes[image_index]
            taken[y : y + h, x : x + w] += 1
            whole = sizes[image_index]
            errors.append(float(all((max(whole[0] >> k, 1), max(whole[1] >> k, 1)) != (w, h) for k in range(8))))
        errors += [float(taken.max() > 1), float(taken.sum() != sum(w * h for w, h in plan.sizes.values()))]
        errors.append(float(max(plan.size) > limit or 4 * taken.size > budget or plan.bytes != 4 * taken.size))
    means = pyramid(np.arange(15.0).reshape(3, 5))
    errors += [float([m.shape for m in means] != [(3, 5), (2, 3), (1, 2), (1, 1)])]
    errors += [worst(means[1] - [[3.0, 5.0, 6.5], [10.5, 12.5, 14.0]]), worst(means[2] - [[7.75, 10.25]])]
    errors += [*_classes_of_draws(), *_powers_of_emitters()]
    return field("definitions", errors)


def _powers_of_emitters() -> list[float]:
    """A scaled, a growing and a hidden luminous plate, and a dark one: shares of area times luminance."""
    b = SceneBuilder()
    bright, dim = b.material(emissive=(3.0, 2.0, 1.0)), b.material(emissive=(0.5, 0.5, 0.5))
    b.node(mesh=b.mesh(quad(1.0, 1.0, material=bright)), scale=(2.0, 1.0, 1.0))
    grown = b.node(mesh=b.mesh(quad(0.5, 0.5, material=dim)))
    b.animate(grown, "scale", [0.0, 1.0], [(1.0, 1.0, 1.0), (3.0, 1.0, 1.0)])
    hidden = b.node(mesh=b.mesh(quad(1.0, 1.0, material=dim)))
    b.animate(hidden, "visible", [0.0, 1.0], [[0.0], [0.0]], "STEP")
    b.node(mesh=b.mesh(quad(1.0, 1.0)))
    scene = b.build()
    poser = Poser(scene)
    draws, states = build_geometry(scene).draws, [poser.sample(time) for time in (0.0, 0.5, 1.0)]
    table = emitter_table(scene, draws, states, hit_tables.HitOptions(), lambda image: np.ones((1, 1, 4), np.uint8))
    power = np.repeat([4.0 * (3.0 * 0.2126 + 2.0 * 0.7152 + 0.0722), 1.5 * 0.5, 0.0], 2)
    shares = power / power.sum()
    return [
        float(table["draw"].tolist() != [0, 0, 1, 1, 2, 2]), float(table["triangle"].tolist() != [0, 1] * 3),
        float(not np.allclose(table["probability"], shares, atol=1e-6)),
        float(not np.allclose(table["cumulative"], np.cumsum(shares), atol=1e-6)),
    ]  # fmt: skip


def _classes_of_draws() -> list[float]:
    """A still, a far, a moving, a carried, a blinking, a hidden and a morphed plate."""
    b = SceneBuilder()
    plate = b.mesh(quad(1.0, 1.0))
    nodes = [b.node(mesh=plate, translation=(30.0, 1.0, 0.0)), b.node(mesh=b.mesh(quad(9e3, 9e3)))]
    nodes.append(b.node(mesh=plate))
    b.animate(nodes[2], "translation", [0.0, 1.0], [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    nodes.append(b.node(nodes[2], mesh=plate))
    nodes.append(b.node(mesh=plate))
    b.animate(nodes[4], "visible", [0.0, 1.0], [[1.0], [0.0]], "STEP")
    nodes.append(b.node(mesh=plate))
    b.animate(nodes[5], "visible", [0.0, 1.0], [[0.0], [0.0]], "STEP")
    nodes.append(b.node(mesh=b.mesh(morphed(quad(1.0, 1.0), np.ones((4, 3))), weights=[0.0])))
    nodes.append(b.node(mesh=plate, translation=(-40.0, 1.0, 0.0)))
    b.animate(nodes[7], "translation", [0.0, 1.0], [(-40.0, 1.0, 0.0)] * 2)
    scene = b.build()
    table = instance_table(scene, build_geometry(scene).draws)
    merged = [(group.draws.tolist(), group.origin.tolist()) for group in table.merged]
    expected = [([0, 7], [-5.0, 1.0, 0.0]), ([1], [0.0, 0.0, 0.0])]
    changing = [int(i) for i in np.flatnonzero(changing_nodes(scene))]
    return [
        float(merged != expected), float(table.rigid.tolist() != [2, 3, 4]), float(table.posed.tolist() != [6]),
        float(changing != [2, 3, 4]), float(table.count != 6), worst(table.world[7, :3, 3] - [-40.0, 1.0, 0.0]),
    ]  # fmt: skip


@case(
    "vertices-made-ready",
    description="flat normals, made tangents and joined vertices of plates and boxes: differences from geometry",
    elsewhere="the tangent of a mirrored map keeps its hand, a flat triangle shares its corners, pools overlap",
    here="tangents along u on the surface; corners of flat triangles are apart; draws name their place in the pool",
    tolerance=1e-6,
    source="float32: 16 ulps of 1",
)
def vertices_made_ready(bench: Bench) -> Outcome:
    errors, rng = [], np.random.default_rng(6)
    corners = rng.normal(size=(50, 3, 3))
    corners[0, 2] = corners[0, 1]
    normals = face_normals(corners.reshape(-1, 3))
    edges = corners[1:, [1, 2]] - corners[1:, :1]
    errors += [worst(normals[0]), worst(np.einsum("nij,nj->ni", edges, normals[1:])), worst(
        np.linalg.norm(normals[1:], axis=1) - 1.0), float((np.linalg.det(
            np.concatenate([edges, normals[1:, None]], axis=1)) < 0).any())]  # fmt: skip
    plate = quad(2.0, 1.0, cells=(2, 2))
    rotation = math3d.mat3_from_quat(turn((1.0, 2.0, 3.0), 50.0))
    place, normal = plate.positions @ rotation.T, plate.normals @ rotation.T
    for a, c, d, e in ((0.5, 0.0, 0.0, -0.5), (-0.5, 0.0, 0.0, -0.5), (0.3, 0.4, 0.8, -0.6), (0.1, 2.0, 1.0, 0.3)):
        uv = plate.positions[:, :2] @ np.array([[a, d], [c, e]])
        along = np.linalg.inv(np.array([[a, c], [d, e]]))[:, 0]  # x and y for one step of u
        tangent = make_tangents(place, normal, uv, plate.triangles)
        expected = math3d.normalize(np.array([*along, 0.0])) @ rotation.T
        hand = -np.sign(a * e - c * d)
        errors += [worst(tangent[:, :3] - expected), worst(tangent[:, 3] - hand)]
    spare = make_tangents(place, normal, np.zeros((len(place), 2)), plate.triangles)
    errors += [worst((spare[:, :3] * normal).sum(axis=1)), worst(np.linalg.norm(spare[:, :3], axis=1) - 1.0)]
    b = SceneBuilder()
    bent = morphed(quad(1.0, 1.0), np.ones((4, 3)))
    meshes = [b.mesh(quad(1.0, 1.0), quad(2.0, 2.0, normals=False)), b.mesh(bent, weights=[0.0])]
    b.node(mesh=meshes[0])
    b.node(mesh=meshes[0])
    b.node(mesh=meshes[1], instances=np.tile(np.eye(4), (2, 1, 1)))
    geometry = build_geometry(b.build())
    rows = [(d.base_vertex, d.first_index, d.index_count, d.vertex_count, d.posed, d.flat) for d in geometry.draws]
    expected = [(0, 0, 6, 4, False, False), (4, 6, 6, 6, False, True)] * 2 + [
        (0, 0, 6, 4, True, False), (4, 6, 6, 4, True, False)]  # fmt: skip
    errors += [float(rows != expected), float(instance_numbers(geometry.draws) != [None] * 4 + [0, 1])]
    errors += [float(geometry.fixed.positions.shape != (10, 3)), float(geometry.posed.indices.shape != (12,))]
    drawn = geometry.fixed.positions[geometry.fixed.indices[6:12] + 4]
    errors.append(worst(drawn - quad(2.0, 2.0).positions[quad().triangles.reshape(-1)]))
    return field("by geometry", errors)


@case(
    "bounds-of-draws",
    description="still, scaled, skinned and morphed plates at ten times: vertices outside their spheres, spheres out "
    "of view",
    elsewhere="a sphere of the rest pose: what a joint or a morph target moves is culled",
    here="every vertex is in the sphere of its draw, every draw with a vertex in view is in view",
    tolerance=1e-6,
    source="relative to the radius; float32 vertices",
)
def bounds_of_draws(bench: Bench) -> Outcome:
    b, errors = SceneBuilder(), []
    b.node(mesh=b.mesh(box((1.0, 2.0, 0.5))), translation=(5.0, 0.0, -8.0), rotation=turn((1, 1, 0), 33.0),
           scale=(2.0, 0.5, -1.0))  # fmt: skip
    push = np.tile([3.0, 0.0, 1.0], (4, 1))
    bent = b.node(mesh=b.mesh(morphed(quad(1.0, 1.0), push, -2.0 * push), weights=[0.0, 0.0]), scale=(1.0, 2.0, 1.0),
                  translation=(-4.0, 0.0, -9.0))  # fmt: skip
    b.animate(bent, "weights", [0.0, 1.0], [[0.0, 1.0], [2.0, -1.0]])
    joints = [b.node(translation=(0.0, 0.0, -12.0)), b.node(translation=(0.0, 0.0, -12.0))]
    b.animate(joints[1], "translation", [0.0, 1.0], [(0.0, 0.0, -12.0), (6.0, -2.0, -20.0)])
    b.animate(joints[1], "rotation", [0.0, 1.0], [turn_y(0.0), turn_y(120.0)])
    strip = quad(0.5, 2.0, cells=(1, 8))
    share = 0.5 + 0.25 * strip.positions[:, 1:2]
    strip = skinned(strip, np.tile([0, 1], (len(strip.positions), 1)), np.concatenate([1 - share, share], axis=1))
    b.node(mesh=b.mesh(strip), skin=b.skin(joints))
    b.camera(yfov=0.8, znear=0.1, zfar=60.0)
    scene = b.build()
    poser, draws = Poser(scene), build_geometry(scene).draws
    bounds = DrawBounds(scene, draws)
    times, clouds = np.linspace(0.0, 1.0, 10), []
    for time in times:
        state = poser.sample(float(time))
        world = np.array([state.world[d.node] for d in draws])
        centers, radii = bounds.at(state, world)
        fixed = bounds.of_fixed(world)
        errors += [worst(fixed[0][0] - centers[0]), float(np.isinf(fixed[1]).tolist() != [False, True, True])]
        for row, d in enumerate(draws):
            primitive = scene.meshes[d.mesh].primitives[d.primitive]
            points = pose_vertices(scene, state, d.node, primitive)
            clouds.append(points)
            off = np.linalg.norm(points - centers[row], axis=1).max() / radii[row]
            errors += [max(off - 1.0, 0.0), max(0.15 - off, 0.0)]  # and not seven times as large
            for yaw in (-60.0, -25.0, 0.0, 25.0, 180.0):
                view = View(np.zeros(3), math3d.mat3_from_quat(turn_y(yaw)), scene.cameras[0])
                matrix = view.clip_from_relative(96, 64)
                clip = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ matrix.T
                inside = (np.abs(clip[:, :2]) <= clip[:, 3:]).all(axis=1)
                inside &= (clip[:, 2] >= 0) & (clip[:, 2] <= clip[:, 3])
                seen = in_view(matrix, centers[row : row + 1], radii[row : row + 1], np.zeros(1))[0]
                errors.append(float(inside.any() and not seen))
    every = np.concatenate(clouds)
    (low, high), (middle, radius) = bounding_box(poser, times), bounding_sphere(poser, times)
    errors += [worst(low - every.min(axis=0)), worst(high - every.max(axis=0)), worst(2.0 * middle - low - high)]
    errors.append(np.linalg.norm(every - middle, axis=1).max() / radius - 1.0)
    # A sphere that touches a side, or misses it by a twentieth.
    view = View(np.zeros(3), np.eye(3), Camera(yfov=math.radians(90.0), znear=1.0, zfar=100.0))
    matrix, root = view.clip_from_relative(64, 64), math.sqrt(0.5)
    for normal, offset in (((root, 0, root), 0), ((-root, 0, root), 0), ((0, root, root), 0), ((0, -root, root), 0),
                           ((0, 0, 1), 1.0), ((0, 0, -1), -100.0)):  # fmt: skip
        onto = {1.0: -1.0, -100.0: -100.0}.get(offset)
        center = np.array([[0.0, 0.0, onto]]) if onto else -20.0 * root * np.array([[np.sign(-normal[0]), np.sign(
            -normal[1]), 1.0]]) * (np.abs(normal) > 0)  # fmt: skip
        center = center + 2.0 * np.array(normal)
        seen = [bool(in_view(matrix, center, np.array([r]), np.zeros(1))[0]) for r in (2.0, 1.9)]
        errors.append(float(seen != [True, False]))
    return field("inside", errors)


@case(
    "schedules-and-notes",
    description="frames to draw, pairs within a budget of samples, frames that are checked, noise and shares of notes",
    elsewhere="a pair is evaluated although its first frame was not drawn, or a deviation lacks the root of 2",
    here="sets of pairs by definition; sqrt(2 n v) times the exposure over the threshold",
    tolerance=1e-6,
    source="relative; float32 channels",
)
def schedules_and_notes(bench: Bench) -> Outcome:
    errors = []
    for positions in ((0,), (0, 1, 2), (1, 4, 5, 9)):
        drawn = schedule.pair_schedule(range(100, 120), positions)
        frames = [frame for frame, _ in drawn]
        errors.append(float([f - 101 for f, evaluated in drawn if evaluated] != list(positions)))
        errors.append(float(frames != sorted({100 + p + k for p in positions for k in (0, 1)})))
    thirds = {0: (), 1: (7,), 2: (7, 8), 3: (7, 8, 9), 6: (7, 10, 12)}
    errors += [float(schedule.first_middle_last(range(7, 7 + n)) != frames) for n, frames in thirds.items()]
    scene, glowing = _lamps(1), _lamps(1, emissive=(5.0, 5.0, 5.0), emissive_strength=5.0)
    for drawn, size, frames, pairs in (
        (scene, (64, 64), 145, "all"), (scene, (64, 64), 146, "strata:36"), (glowing, (64, 64), 32, "all"),
        (glowing, (64, 64), 33, "strata:8"), (glowing, (4096, 4096), 50, "strata:2"),
        (glowing, (8, 8), 500, "strata:36"),
    ):  # fmt: skip
        for each, places in ((64, 1), (16, 4)):
            own = {"width": size[0], "height": size[1], "spp": each, "samples_per_pixel": places, "light": "auto"}
            found = lighting.with_pairs(drawn, Settings(**own, **FIXED_LIGHTING), range(frames))
            errors.append(float(found.metrics.pairs != pairs))
    width, height = 4, 3
    position, info = np.ones((height, width, 4)), np.zeros((height, width, 4))
    info[..., 1], info[..., 2], info[..., 3] = 16.0, np.arange(12.0).reshape(3, 4), 2.0
    info[0, 0, 2:], position[2, 3, 3] = 0.0, 0.0
    textures = {name: bench._texture(v, "f4") for name, v in (("position", position), ("path_info", info))}
    settings = Settings(**FIXED_LIGHTING | {"exposure": 4.0}, thresholds=limits({"direct": 0.5, "indirect": 0.25}))
    noise = np.maximum(np.sqrt(32.0 * info[..., 2]) * 8.0, np.sqrt(32.0 * info[..., 3]) * 16.0)
    noise[2, 3] = 0.0
    errors.append(worst(noise_of_a_sample(textures, settings) - noise) / 1e3)
    for texture in textures.values():
        texture.release()
    counts = Brightness(3, pixels=1000, black=990, lit=10, clipped=8, noisy=620, behind=370)
    percents = [[float(n) for n in re.findall(r"([0-9]+) %", note)] for note in counts.notes(settings)]
    errors.append(float(percents != [[80.0], [99.0], [62.0], [37.0]]))
    at_most = Brightness(3, pixels=1000, black=900, lit=100, clipped=20, noisy=10, behind=10)
    more = Brightness(3, pixels=1000, black=901, lit=100, clipped=21, noisy=11, behind=11)
    errors += [float(len(at_most.notes(settings)) != 0), float(len(more.notes(settings)) != 4)]
    return field("by their definition", errors)
