"""Scenes in which light moves."""

from __future__ import annotations

from taubench_gl.scene.builder import SceneBuilder, box, quad, turn_x


def matte_room(lamp_to, camera_to=(0.0, 0.0, 1.2), *, empty: bool = False):
    """A room with a small box or ``empty``, a lamp and a camera, which move within a second."""
    b = SceneBuilder()
    matte = b.material(metallic=0.0, roughness=1.0, specular=0.0)
    b.node(mesh=b.mesh(box((2.0, 1.5, 2.0), inside=True, material=matte)))
    if not empty:
        b.node(mesh=b.mesh(box((0.3, 0.3, 0.3), material=matte)), translation=(0.1, -0.4, -0.2))
    lamp = b.light(translation=(0.0, 1.0, 0.0), intensity=40.0)
    b.animate(lamp, "translation", [0.0, 1.0], [(0.0, 1.0, 0.0), lamp_to])
    camera = b.camera(translation=(0.0, 0.0, 1.2), yfov=1.0, znear=0.05)
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 0.0, 1.2), camera_to])
    return b.build()


def lamp_over_floor(*, moves: bool = True, emits: float = 0.0, lights: int = 0):
    """A floor, a box that throws a shadow, and a lamp that moves: a point light or a box that ``emits``.

    ``lights``: further ones that stand still; a lamp that does not move has keys all the same.
    """
    b = SceneBuilder()
    gray = b.material(base_color=(0.7, 0.7, 0.7, 1.0), metallic=0.0, roughness=1.0)
    b.node(mesh=b.mesh(quad(4.0, 4.0, material=gray)), rotation=turn_x(-90.0))
    b.node(mesh=b.mesh(box((0.5, 1.0, 0.5), material=gray)), translation=(-0.6, 0.5, 0.0))
    if emits:
        glow = b.material(emissive=(emits, emits, 0.5 * emits), emissive_strength=emits)
        mover = b.node(mesh=b.mesh(box((0.4, 0.4, 0.4), material=glow)), translation=(0.5, 1.6, 0.5))
    else:
        mover = b.light(translation=(0.5, 1.6, 0.5), kind="point", intensity=20.0)
    b.animate(mover, "translation", [0.0, 0.125], [(0.5, 1.6, 0.5), (1.4 if moves else 0.5, 1.6, 0.5)])
    for _ in range(lights):
        b.light(translation=(1.0, 2.0, 1.0), kind="point", intensity=5.0)
    b.camera(translation=(0.0, 1.5, 4.0), rotation=turn_x(-15.0))
    return b.build()
