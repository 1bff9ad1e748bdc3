"""Scenes in which light moves."""

from __future__ import annotations

from taubench_gl.scene.builder import SceneBuilder, box, quad, turn_x


def lamp_over_floor(*, moves: bool = True, emits: float = 0.0):
    """A floor, a box that throws a shadow, and a lamp that moves: a point light or a box that ``emits``."""
    b = SceneBuilder()
    gray = b.material(base_color=(0.7, 0.7, 0.7, 1.0), metallic=0.0, roughness=1.0)
    b.node(mesh=b.mesh(quad(4.0, 4.0, material=gray)), rotation=turn_x(-90.0))
    b.node(mesh=b.mesh(box((0.5, 1.0, 0.5), material=gray)), translation=(-0.6, 0.5, 0.0))
    if emits:
        glow = b.material(emissive=(emits, emits, 0.5 * emits), emissive_strength=emits)
        mover = b.node(mesh=b.mesh(box((0.4, 0.4, 0.4), material=glow)), translation=(0.5, 1.6, 0.5))
    else:
        mover = b.light(translation=(0.5, 1.6, 0.5), kind="point", intensity=20.0)
    if moves:
        b.animate(mover, "translation", [0.0, 0.125], [(0.5, 1.6, 0.5), (1.4, 1.6, 0.5)])
    b.camera(translation=(0.0, 1.5, 4.0), rotation=turn_x(-15.0))
    return b.build()
