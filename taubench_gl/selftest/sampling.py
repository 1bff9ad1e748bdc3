"""Cases: pixels decided under path-traced light, and shares estimated at random pixels."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from taubench_gl.animation import choose_camera
from taubench_gl.conventions import Reason
from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.evaluation.pairs import Pair
from taubench_gl.metrics.path_samples import LEAST, LIMIT
from taubench_gl.run import Run
from taubench_gl.scene.builder import SceneBuilder, quad, sphere
from taubench_gl.scene.model import Channel, Scene
from taubench_gl.selftest.bench import Bench, pixel_grid
from taubench_gl.selftest.case import Outcome, case, count, field, scalar
from taubench_gl.selftest.direct import lambert
from taubench_gl.selftest.geometry import one_metre_per_pixel

Array = np.ndarray
SIZE = (24, 16)
HEIGHT, INTENSITY, ALBEDO = 4.0, 60.0, 0.5
LIMIT_OF_DIRECT = 0.1


def _decided(bench: Bench, scene: Scene, **settings: Any) -> tuple[Run, list[Pair]]:
    """A run with all lobes that decides every pixel of a small image, and its pairs with distances."""
    options = {"light": "path-traced", "fps": 1.0, "width": SIZE[0], "height": SIZE[1], "camera": 0}
    values, pairs = bench.settings_of({"indirect": "auto"} | options | settings), []
    observers, camera = Observers(on_pair=pairs.append, distances=True), choose_camera(scene)
    return evaluate_scene(scene, values, observers, camera=camera, sampled=True, lobes=("diffuse", "glossy")), pairs


def _lamp_before_a_wall(bench: Bench) -> Scene:
    """A lamp that moves by 5 and 2 m before a wall, and a camera that moves by 3 and 1 pixels."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(100.0, 100.0, material=lambert(b, ALBEDO))), translation=(0.0, 0.0, -10.0))
    lamp = b.light(translation=(-6.0, 0.0, HEIGHT - 10.0), intensity=INTENSITY)
    b.animate(lamp, "translation", [0.0, 1.0, 2.0], [(x, 0.0, HEIGHT - 10.0) for x in (-6.0, -1.0, 1.0)])
    with Bench(bench.gpu, SIZE) as small:
        camera = one_metre_per_pixel(b, small)
    b.animate(camera, "translation", [0.0, 1.0, 2.0], [(0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (3.0, 1.0, 0.0)])
    return b.build()


def _changes_of_light(pair: int) -> Array:
    """Direct radiance of ``_lamp_before_a_wall`` now less that before.  (h, w) float64."""
    lamp, camera = ((-6.0, -1.0, 1.0), ((0.0, 0.0), (3.0, 0.0), (3.0, 1.0)))
    at = (pixel_grid(SIZE) - (np.array(SIZE) - 1) / 2) * (1.0, -1.0) + camera[pair + 1]

    def radiance(x: float) -> Array:
        square = (at[..., 0] - x) ** 2 + at[..., 1] ** 2 + HEIGHT**2
        return ALBEDO / np.pi * INTENSITY * HEIGHT / square**1.5

    return radiance(lamp[pair + 1]) - radiance(lamp[pair])


@case(
    "decided-direct",
    tolerance=2e-5,
    source="float32: 64 ulps of a radiance of 2; a wrong mask or count is an error of 1",
)
def decided_direct(bench: Bench) -> Outcome:
    """A lamp and a camera that move before a wall: distances, masks and samples of all decided pixels.

    A noisy image is compared with another one, and its noise is counted as change.
    """
    columns = ("frustum", "direct", "indirect", "color")
    run, pairs = _decided(bench, _lamp_before_a_wall(bench), columns=columns, thresholds={"direct": LIMIT_OF_DIRECT})
    errors, audited = [], 0
    for number, pair in enumerate(pairs):
        change, comparable = _changes_of_light(number), (pair.mask & np.uint32(Reason.OUTSIDE)) == 0
        distance = np.sqrt(3.0) * np.abs(change)
        errors.append((pair.distances.features["direct"] - distance)[comparable])
        errors.append((pair.distances.luminance - change)[comparable])
        over = comparable & (distance > LIMIT_OF_DIRECT)
        words = {Reason.DIRECT: over, Reason.LIT: over & (change > 0), Reason.SHADOWED: over & (change < 0)}
        words |= {Reason.INDIRECT: np.zeros_like(over)}
        wrong = sum(int((((pair.mask & np.uint32(bit)) != 0) != where).sum()) for bit, where in words.items())
        row, pixels = pair.row, int(comparable.sum())
        wrong += abs(row["direct"] - int(over.sum())) + abs(row["traced"] - pixels)
        wrong += row["undecided"] + row["audited_wrong"]
        wrong += abs(row["light_samples"] - 2 * (LEAST * pixels + (LIMIT - LEAST) * row["audited"]))
        audited += row["audited"]
        errors.append(np.array([wrong]))
    lobes = run.summary["lobes"]
    shares = [of["direct"]["mean_percent"] for of in (run.summary["discard"], lobes["diffuse"], lobes["glossy"])]
    errors.append(np.array([shares[0] - shares[1], shares[2], 0.0 if 0 < audited < 200 else 1.0]))
    return field("albedo / pi I cos / r^2", np.concatenate([e.ravel() for e in errors]))


RADIUS, BOUNCES = 4.0, 12


def _in_a_sphere(intensity: float) -> float:
    """Indirect radiance inside a sphere of ALBEDO with a lamp: the first reflection is even, whatever its place."""
    of_first = ALBEDO**2 * intensity / (np.pi * RADIUS**2)
    return of_first * sum(ALBEDO**k for k in range(BOUNCES - 1))


@case(
    "decided-indirect",
    tolerance=1.5e-2,
    source="relative to the change; 0.4 % less area of the sphere's triangles, sampling noise; a wrong mask is 1",
)
def decided_indirect(bench: Bench) -> Outcome:
    """A lamp in a closed sphere moves, then becomes stronger: indirect light changes in no pixel, then in all.

    Noise at a moving lamp is counted as a change of indirect light.
    """
    b = SceneBuilder()
    inside = dataclasses.replace(sphere(RADIUS, 32), material=lambert(b, ALBEDO, double_sided=True))
    b.node(mesh=b.mesh(inside))
    lamp = b.light(translation=(0.0, 1.0, 0.0), intensity=8.0)
    b.animate(lamp, "translation", [0.0, 1.0], [(0.0, 1.0, 0.0), (0.5, 1.0, 0.0)])
    b._channels.append(Channel("light", 0, "intensity", "LINEAR", np.array([1.0, 2.0]), np.array([[8.0], [24.0]])))
    b.camera(translation=(0.0, 0.0, 1.0), yfov=np.radians(60.0))
    columns = ("frustum", "direct", "indirect")
    _, pairs = _decided(bench, b.build(), columns=columns, thresholds={"indirect": 0.25}, width=12, height=8)
    changed = [int((pair.mask & np.uint32(Reason.INDIRECT) != 0).sum()) for pair in pairs]
    expected = np.sqrt(3.0) * (_in_a_sphere(24.0) - _in_a_sphere(8.0))
    still, grown = (pair.distances.features["indirect"] for pair in pairs)
    wrong = abs(changed[0]) + abs(changed[1] - still.size) + int((still > 0.1).sum())
    return scalar(expected, float(grown.mean()) + wrong * expected, relative=True)


@case("sampled-direct", source="exact count: the truth is outside an interval, or an interval is wider than asked for")
def sampled_direct(bench: Bench) -> Outcome:
    """A lamp and a camera that move before a wall: the interval of direct light from random pixels holds the truth.

    An estimate has no interval, or one from pixels that have been chosen by their result.
    """
    options = {"light": "auto", "fps": 1.0, "width": SIZE[0], "height": SIZE[1], "camera": 0, "shadow_lights": 0}
    columns = ("frustum", "position", "normal", "direct")
    settings = bench.settings_of(options | {"columns": columns, "thresholds": {"direct": LIMIT_OF_DIRECT}})
    scene = _lamp_before_a_wall(bench)
    summary = evaluate_scene(scene, settings, camera=choose_camera(scene), sampled=True).summary
    outside = np.zeros((2, SIZE[1], SIZE[0]), bool)
    outside[0, :, -3:] = outside[1, 0] = True
    over = np.stack([np.sqrt(3.0) * np.abs(_changes_of_light(k)) > LIMIT_OF_DIRECT for k in range(2)]) & ~outside
    sampled, entry = summary["sampled_light"], summary["discard"]["direct"]
    low, high = entry["interval95_percent"]
    truth, preview = 100.0 * over.mean(), entry["preview_percent"]
    wrong = [
        not low <= truth <= high, high - low > 2.0 or high == low, abs(preview - truth) > 1e-9,
        sampled["pixels"] != entry["pixels"], not sampled["narrow"], sampled["audited_wrong"] > 0,
        not 0 < sampled["audited"] < 0.5 * sampled["pixels"], entry["undecided_percent"] > 0, sampled["pairs"] != 2,
    ]  # fmt: skip
    return count(0, sum(wrong))
