"""Cases: lights on surfaces, far from the origin, very bright, or switched on by scale; shaded by the light stage."""

from __future__ import annotations

import numpy as np

from taubench_gl.scene.builder import SceneBuilder, quad
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Outcome, case, count, difference, field
from taubench_gl.selftest.geometry import one_metre_per_pixel
from taubench_gl.selftest.scenes import busy_room

WALL_Z = -2.0


def _wall(bench: Bench, height: float, intensity: float = 1.0, offset: float = 0.0) -> SceneBuilder:
    """A 20 x 20 m wall, 1 m per pixel, and a point light ``height`` in front of the center of a pixel."""
    b = SceneBuilder()
    root = b.node(translation=(offset, -offset, offset))
    b.node(root, mesh=b.mesh(quad(10, 10, material=b.material(metallic=0.0))), translation=(0.0, 0.0, WALL_Z))
    one_metre_per_pixel(b, bench, parent=root)
    b.light(root, translation=(0.5, 0.5, WALL_Z + height), intensity=intensity)
    return b


def _foot(bench: Bench) -> tuple[int, int]:
    """Row and column of the pixel whose center is (0.5, 0.5) m."""
    return bench.size[1] // 2 - 1, bench.size[0] // 2


@case("light-on-the-surface", source="exact: a count")
def light_on_the_surface(bench: Bench) -> Outcome:
    """A point light exactly on a wall: pixels of direct radiance that are NaN or Inf.

    1 / d^2 is Inf and the direction is 0 / 0: the product is NaN.
    """
    lit = bench.shots(_wall(bench, 0.0, 1e8).build())[0].direct
    return count(0, int((~np.isfinite(lit)).any(axis=-1).sum()))


@case(
    "inverse-square-near",
    tolerance=1e-4,
    source="relative; float32: 2 ulps of 2 m (the camera's distance) in 1/64 m, twice",
)
def inverse_square_near(bench: Bench) -> Outcome:
    """A light 1 m, 1/8 m and 1/64 m from a wall: radiance at the nearest point against 1 / d^2, relative.

    1 / (d^2 + 1) or a clamp at a few centimeters makes near lights up to 100 times too dark.
    """
    distances = (1.0, 1 / 8, 1 / 64)
    with bench.even() as even:
        measured = [float(even.shots(_wall(even, d).build())[0].direct[_foot(even)][0]) for d in distances]
    ratios = [m / measured[0] for m in measured]
    off = max(difference(1 / d**2, r, relative=True) for d, r in zip(distances, ratios, strict=True))
    text = ", ".join(f"{r:.6g}" for r in ratios)
    return Outcome("1, 64, 4096", text, off)


@case("light-far-from-origin", source="exact: dyadic numbers, so float64 holds every difference")
def light_far_from_origin(bench: Bench) -> Outcome:
    """A lit wall at 1e6 m: largest relative difference of direct radiance from that at the origin.

    A float32 world position of a light is off by up to 6 cm.
    """
    near, far = (bench.shots(_wall(bench, 0.125, offset=o).build())[0].direct for o in (0.0, 1e6))
    return field("no difference", (far - near) / near.max())


@case("light-from-scale-zero", source="exact: every pixel of the wall exceeds the threshold")
def light_from_scale_zero(bench: Bench) -> Outcome:
    """A light whose node jumps from scale 0 to 1: pixels of a wall that are LIT.

    The scale of a light's node is ignored, so lights switched by scale are always on.
    """
    b = _wall(bench, 5.0, 1e5)
    b.animate(3, "scale", [0.0, 1.0], [(0, 0, 0), (1, 1, 1)], "STEP")
    b.animate(3, "translation", [0.0], [(0.5, 0.5, WALL_Z + 5.0)])
    counts = bench.evaluate(b.build(), columns=("direct",), fps=1.0).frames[0]
    return count(400, counts["lit"])


@case("color-of-1e8", source="exact: a count")
def color_of_1e8(bench: Bench) -> Outcome:
    """Direct radiance of about 1e8 as tone-mapped color: values outside [0, 1] or not finite.

    The quotient x / (1 + x) of Inf is NaN; 1e8 in half floats is Inf.
    """
    wrong = 0
    for tone_map in ("linear", "reinhard"):
        shot = bench.shots(_wall(bench, 1.0, 1e9).build(), columns=("direct", "color"), tone_map=tone_map)[0]
        color = shot["color"][..., :3]
        wrong += int((~((color >= 0) & (color <= 1))).any(axis=-1).sum())
    return count(0, wrong)


@case("still-light", source="exact: the same arithmetic is done twice")
def still_light(bench: Bench) -> Outcome:
    """A still camera and room with four still shadowed lights: pixels with a reason bit.

    Shadow maps that follow the camera, or random sampling, flicker in a still image.
    """
    columns = ("direct", "color", "position", "normal")
    run = bench.evaluate(busy_room(still=True, lamps=4), columns=columns, fps=2.0, camera=0)
    marked = sum(row[name] for row in run.frames for name in (*columns, "lit", "shadowed", "invalid"))
    return count(0, marked if len(run.frames) == 2 else -1)
