"""A shadow face is redrawn only when what it sees has moved, and the image does not depend on it."""

from __future__ import annotations

import pytest
from light_tools import facing, floor, lambert, opened, shoot

from taubench_gl.frame.materials import MaterialKey
from taubench_gl.frame.passes.gbuffer import geometry_variant
from taubench_gl.frame.passes.shadows import merged
from taubench_gl.frame.scene_buffers import Group
from taubench_gl.scene.builder import SceneBuilder, box, quad, sphere, turn_y
from taubench_gl.scene.model import Scene

SIZE = {"shadow_size": 128, "width": 96, "height": 64}


def street(*, move_box: bool = False, move_light: bool = False) -> Scene:
    """A floor, two boxes left and right of a point light, a spot and a sun; the camera walks and turns."""
    b = SceneBuilder()
    material = lambert(b)
    floor(b, 6.0, material=material)
    right = b.node(mesh=b.mesh(box((0.4, 0.5, 0.4), material=material)), translation=(2.0, 0.5, 0.0))
    b.node(mesh=b.mesh(box((0.3, 0.7, 0.3), material=material)), translation=(-2.0, 0.7, 0.3), rotation=turn_y(30.0))
    b.node(mesh=b.mesh(sphere(0.5)), translation=(0.0, 0.5, -2.0))
    lamp = b.light(translation=(0.0, 1.0, 0.1), kind="point", intensity=10.0)
    b.light(translation=(-4.0, 3.0, 1.0), rotation=facing((2.0, -2.0, -0.5)), kind="spot", intensity=60.0)
    b.light(rotation=facing((-0.5, -1.0, -0.3)), kind="directional", intensity=1.0)
    if move_box:
        b.animate(right, "translation", [0.0, 1.0], [(2.0, 0.5, -0.3), (2.0, 0.5, 0.3)])
    if move_light:
        b.animate(lamp, "translation", [0.0, 1.0], [(0.0, 1.0, 0.1), (0.0, 1.2, 0.1)])
    camera = b.camera(yfov=1.0, znear=0.05)
    b.animate(camera, "translation", [0.0, 1.0], [(0.3, 1.7, 5.03), (0.91, 2.13, 4.1)])
    b.animate(camera, "rotation", [0.0, 1.0], [turn_y(-3.0), turn_y(9.0)])
    return b.build()


FACES = 6 + 1 + 1


def redrawn(gpu, scene: Scene, frames: int) -> list[int]:
    """Faces that are rendered in every frame."""
    out = []
    with opened(gpu, scene, **SIZE) as source:
        for frame in range(frames):
            shoot(source, frame)
            out.append(source.light.shadow.redrawn)
    return out


@pytest.mark.parametrize(
    ("moving", "later"), [({}, 0), ({"move_box": True}, 3), ({"move_light": True}, 6)], ids=["camera", "box", "light"]
)
def test_what_moves_redraws_the_faces_that_see_it(gpu, moving, later):
    """A camera none, a light its own.  The box at +X: the point light's +X face alone (|y|, |z| stay below x), the spot
    that faces it, and the sun."""
    assert redrawn(gpu, street(**moving), 4) == [FACES, later, later, later]


def test_a_light_that_is_off_draws_no_map(gpu):
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad()))
    lamp = b.light(translation=(0.0, 0.0, 2.0), kind="point")
    b.animate(lamp, "scale", [0.0, 0.5], [(1.0, 1.0, 1.0), (0.0, 0.0, 0.0)], "STEP")
    b.camera(translation=(0.0, 0.0, 3.0))
    with opened(gpu, b.build(), fps=4.0, **SIZE) as source:
        counts = []
        for frame in range(4):
            shot = shoot(source, frame)
            counts.append((source.light.shadow.redrawn, bool(shot.direct.max() > 0)))
    assert counts == [(6, True), (0, True), (0, False), (0, False)]


OPAQUE, MASKED = (
    geometry_variant(MaterialKey((), False, True), False),
    geometry_variant(MaterialKey((), True, True), False),
)


@pytest.mark.parametrize(
    ("variants", "expected"),
    [
        ([OPAQUE, OPAQUE, OPAQUE], [(0, 0, 6)]),
        ([OPAQUE, MASKED, MASKED], [(0, 0, 2), (1, 2, 2), (2, 4, 2)]),  # the mask is the material's
        ([OPAQUE, MASKED, OPAQUE], [(0, 0, 2), (1, 2, 2), (2, 4, 2)]),
    ],
)
def test_groups_that_read_no_material_are_one_draw(variants, expected):
    groups = [Group(False, i, False, False, 2 * i, 2) for i in range(3)]
    drawn = merged([(g, g.first, g.count) for g in groups], lambda group: (variants[group.material], ()))
    assert [(group.material, first, count) for group, _, first, count in drawn] == expected


def test_fixed_and_posed_groups_stay_apart():
    groups = [Group(posed, 0, False, False, 2 * i, 2) for i, posed in enumerate((False, True))]
    assert len(merged([(g, g.first, g.count) for g in groups], lambda group: (OPAQUE, ()))) == 2
