"""LIT and SHADOWED where light comes and goes, color against its float64 reference, and exposure (docs/light.md)."""

from __future__ import annotations

import numpy as np
import pytest
from fixed import fixed_settings
from light_tools import facing, floor, lambert, look, look_down, opened, picture, shoot
from shadow_tools import Case, on_plane

from taubench_gl.conventions import Reason
from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.scene.builder import SceneBuilder, box
from taubench_gl.scene.model import Scene

SIZE = 128
WIDTH = 160


def swept(case: Case, *, box_path=None, light_path=None) -> Scene:
    """The box, the light, or both move over one second under a parallel camera that stands still."""
    b = SceneBuilder()
    material = lambert(b, 0.5)
    floor(b, case.ground, material=material)
    node = b.node(mesh=b.mesh(box(case.half, material=material)), translation=case.center)
    lamp = b.light(
        translation=case.place, rotation=facing(-case.towards), kind=case.kind, intensity=80.0, outer_cone=0.87
    )
    if box_path is not None:
        b.animate(node, "translation", [0.0, 1.0], box_path)
    if light_path is not None:
        b.animate(lamp, "translation", [0.0, 1.0], light_path)
    look_down(b, case.ground)
    return b.build()


def mask_of(scene: Scene, **settings) -> tuple[np.ndarray, dict]:
    """Reason words of the pair (0, 1) at one frame per second, and its row of counts."""
    masks = []
    settings = {"width": WIDTH, "height": WIDTH, "fps": 1.0, "columns": ("position", "direct"), "shadow_size": SIZE,
                "thresholds": {"direct": 0.05}} | settings  # fmt: skip
    run = evaluate_scene(scene, fixed_settings(**settings), Observers(on_pair=lambda pair: masks.append(pair.mask)))
    assert len(masks) == 1
    return masks[0], run.frames[0]


@pytest.mark.parametrize("kind", ["directional", "point", "spot"])
def test_a_moving_box_uncovers_light_behind_it_and_shadows_what_is_ahead(gpu, kind):
    """Figure 2: ground that leaves the shadow is LIT, ground that enters it is SHADOWED, nothing else changes."""
    case = Case(kind, 35.0)
    path = np.array([[-0.2, 0.5, -0.2], [0.1, 0.5, 0.3]])
    scene = swept(case, box_path=path)
    mask, row = mask_of(scene)
    with opened(gpu, scene, width=WIDTH, height=WIDTH) as source:
        shot = shoot(source, 0)
    before, after = (Case(kind, 35.0, center=tuple(p)) for p in path)
    # Tested on ground that neither box covers, where position does not change.
    ground = on_plane(shot) & (mask & Reason.POSITION == 0) & (np.abs(shot.points[..., :3:2]).max(axis=-1) < 3.0)
    (lit0, dark0), (lit1, dark1) = (c.band(shot.points, 2.0, SIZE) for c in (before, after))
    for sure, bits in (
        (ground & dark0 & lit1, Reason.DIRECT | Reason.LIT),
        (ground & lit0 & dark1, Reason.DIRECT | Reason.SHADOWED),
        (ground & lit0 & lit1, 0),
        (ground & dark0 & dark1, 0),
    ):
        assert sure.sum() > 20, f"no pixel tests {bits!r}"
        assert np.all(mask[sure] == int(bits)), f"{bits!r}: {np.mean(mask[sure] == int(bits)):.4f}"
    assert row["direct"] == np.count_nonzero(mask & Reason.DIRECT)
    assert row["lit"] == np.count_nonzero(mask & Reason.LIT)
    assert row["shadowed"] == np.count_nonzero(mask & Reason.SHADOWED)


def test_a_moving_light_lights_what_it_nears_and_dims_what_it_leaves(gpu):
    b = SceneBuilder()
    floor(b, 4.0, material=lambert(b, 0.5))
    lamp = b.light(kind="point", intensity=20.0)
    path = np.array([[-1.5, 1.0, 0.0], [1.5, 1.0, 0.0]])
    b.animate(lamp, "translation", [0.0, 1.0], path)
    look_down(b, 4.0)
    scene = b.build()
    mask, _ = mask_of(scene, thresholds={"direct": 0.1})
    with opened(gpu, scene, width=WIDTH, height=WIDTH) as source:
        points = shoot(source, 0).points
    before, after = (
        0.5 / np.pi * 20.0 * 1.0 / np.sum((points - p) ** 2, axis=-1) ** 1.5 for p in path
    )  # albedo / pi * I * cos / d^2 with cos = height / d
    change = np.sqrt(3.0) * (after - before)
    sure = np.abs(np.abs(change) - 0.1) > 2e-3
    expected = np.where(
        np.abs(change) <= 0.1, 0, int(Reason.DIRECT) | np.where(change > 0, int(Reason.LIT), int(Reason.SHADOWED))
    )
    assert np.array_equal(mask[sure], expected[sure])
    assert np.array_equal(mask & Reason.LIT != 0, (mask & Reason.SHADOWED != 0)[:, ::-1])
    assert 0.1 < np.mean(mask & Reason.LIT != 0) < 0.5


def bulbs() -> Scene:
    """Bright and dim floor, a glowing box, an unlit box, and sky behind: every source of color."""
    b = SceneBuilder()
    floor(b, 3.0, material=lambert(b, 0.7))
    glow = b.material(base_color=(0.2, 0.2, 0.2, 1), metallic=0.0, specular=0.0, emissive=(0.1, 2.5, 0.6))
    unlit = b.material(base_color=(0.9, 0.3, 0.05, 1), unlit=True)
    b.node(mesh=b.mesh(box((0.3, 0.3, 0.3), material=glow)), translation=(-0.8, 0.3, 0))
    b.node(mesh=b.mesh(box((0.3, 0.3, 0.3), material=unlit)), translation=(0.8, 0.3, 0))
    b.light(translation=(0.0, 1.0, 0.5), kind="point", intensity=30.0, color=(1.0, 0.6, 0.2))
    look(b, (0.0, 1.5, 3.5), (0.0, 0.3, 0.0), yfov=0.9)
    return b.build()


def test_emission_alone_is_emission_beside_base_color(gpu):
    """What is unlit sends out its base color, whether or not somebody wants that channel too."""
    extras = ("emission",), ("emission", "base_color")
    alone, beside = (picture(gpu, bulbs(), extra=extra, columns=("frustum",))["emission"] for extra in extras)
    assert np.array_equal(alone, beside) and np.isclose(alone[..., 0], 0.9, atol=1e-3).any()


@pytest.mark.parametrize("exposure", [0.25, 4.0])
def test_exposure_and_threshold_are_one_scale(exposure):
    """direct compares radiance x exposure: exposure e with a is exposure 1 with a / e, for powers of 2 exactly."""
    scene = swept(Case("point", 50.0), light_path=np.array([[3.0, 4.0, 0.0], [3.0, 4.5, 0.5]]))
    one, _ = mask_of(scene, exposure=exposure, thresholds={"direct": 0.125})
    other, _ = mask_of(scene, exposure=1.0, thresholds={"direct": 0.125 / exposure})
    assert np.any(one & Reason.DIRECT) and np.array_equal(one, other)
