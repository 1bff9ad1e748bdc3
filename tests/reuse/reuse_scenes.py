"""Small animated scenes with known artifacts of temporal reuse."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from fixed import fixed_settings

from taubench_gl.scene.builder import SceneBuilder, box, quad, turn_x
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

SECONDS = 2.0
SIZE = (64, 48)


def settings(**more) -> Settings:
    """64x48 at 24 fps, motion reprojection, no indirect light by default."""
    given = {"width": SIZE[0], "height": SIZE[1], "reprojection": "motion", "indirect": "none", "shadow_size": 128}
    given |= {"camera": 0}  # also of still scenes
    return fixed_settings(**(given | more))


def lit_room(b: SceneBuilder) -> None:
    """A floor, a wall, a box and three point lights."""
    gray = b.material(base_color=(0.7, 0.6, 0.5, 1.0), metallic=0.0, roughness=1.0, specular=0.0)
    b.node(mesh=b.mesh(quad(4.0, 4.0, material=gray)), rotation=turn_x(-90.0))
    b.node(mesh=b.mesh(quad(4.0, 4.0, material=gray)), translation=(0.0, 0.0, -3.0))
    b.node(mesh=b.mesh(box((1.0, 1.0, 1.0), material=gray)), translation=(0.0, 0.5, -0.4))
    for place, intensity in (((1.5, 2.0, 0.5), 8.0), ((-1.5, 1.5, 1.0), 5.0), ((0.0, 2.5, -1.0), 3.0)):
        b.light(translation=place, intensity=intensity)


def still() -> Scene:
    """A still scene of SECONDS."""
    b = SceneBuilder()
    lit_room(b)
    camera = b.camera(translation=(0.0, 1.5, 4.0), rotation=turn_x(-12.0), yfov=np.radians(50.0), znear=0.1)
    b.animate(camera, "translation", [0.0, SECONDS], [(0.0, 1.5, 4.0)] * 2)
    return b.build()


def glowing(b: SceneBuilder, color: Sequence[float]) -> int:
    return b.material(base_color=(0.0, 0.0, 0.0, 1.0), emissive=tuple(color), metallic=0.0, specular=0.0)


def passing_box(speed: float = 3.0) -> Scene:
    """A bright box passes in front of a wall of vertical stripes; the camera is still.  Emission only."""
    b = SceneBuilder()
    shades = [glowing(b, (s, s, 1.2 * s)) for s in (0.05, 0.12, 0.2, 0.3)]
    for k in range(40):
        x = -10.0 + 0.5 * k
        strip = quad(0.25, 6.0, material=shades[(7 * k) % len(shades)])
        b.node(mesh=b.mesh(strip), translation=(x, 0.0, -3.0))
    mover = b.node(mesh=b.mesh(box((1.0, 2.0, 0.2), material=glowing(b, (0.9, 0.8, 0.2)))))
    b.animate(mover, "translation", [0.0, SECONDS], [(-2.0, 0.0, 0.0), (-2.0 + speed * SECONDS, 0.0, 0.0)])
    b.camera(translation=(0.0, 0.0, 4.0), yfov=np.radians(50.0), znear=0.1)
    return b.build()


def sliding() -> Scene:
    """Panels at two distances; a camera that translates."""
    b = SceneBuilder()
    for k in range(24):
        far, shade = k % 2, 0.15 + 0.08 * (5 * k % 9)
        panel = quad(0.5 + 0.3 * far, 4.0, material=glowing(b, (shade, shade, 0.5)))
        place = (-9.0 + 0.8 * k, 0.0, -3.0 - 3.0 * far)
        b.node(mesh=b.mesh(panel), translation=place)
    camera = b.camera(yfov=np.radians(60.0), znear=0.1)
    b.animate(camera, "translation", [0.0, SECONDS], [(0.0, 0.0, 0.0), (-6.0 * SECONDS, 0.0, 0.0)])
    return b.build()


def drifting_checks() -> Scene:
    """A wall with a fine checker pattern; the camera translates by a fraction of a pixel per frame."""
    b = SceneBuilder()
    dark, bright = glowing(b, (0.1, 0.1, 0.1)), glowing(b, (0.8, 0.8, 0.8))
    b.node(mesh=b.mesh(quad(8.0, 8.0, material=dark)), translation=(0.0, 0.0, -4.01))
    for i in range(-12, 13):
        for j in range(-9, 10):
            if (i + j) % 2:
                b.node(mesh=b.mesh(quad(0.15, 0.15, material=bright)), translation=(0.3 * i, 0.3 * j, -4.0))
    camera = b.camera(yfov=np.radians(50.0), znear=0.1)
    b.animate(camera, "translation", [0.0, SECONDS], [(0.0, 0.0, 0.0), (1.3, 0.7, 0.0)])
    return b.build()
