"""Why the light of a point changed, by time or by the direction to the camera: closed forms and float64."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from fixed import fixed_settings
from references.punctual import incident

from taubench_gl.conventions import CHANGED_LIGHT, Visibility
from taubench_gl.evaluation import plan_scene
from taubench_gl.evaluation.exact import ExactReasons, exact_channels
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.math3d import normalize
from taubench_gl.metrics.exact_rates import light_reasons
from taubench_gl.metrics.lighting import SurfaceMaterial, evaluate_brdf
from taubench_gl.scene.builder import SceneBuilder, quad, sphere, turn_x, turn_y
from taubench_gl.scene.model import Light

SIZE = (96, 64)
VIEW, LIT, DARK = Visibility.VIEW_DEPENDENT, Visibility.BRIGHTENED, Visibility.DARKENED


class Pair:
    """One pair of frames of a scene: reasons, and what they were found from."""

    def __init__(self, gpu, scene, frame=1, *, noise=False, **more):
        own = {"width": SIZE[0], "height": SIZE[1], "fps": 4.0, "columns": ("frustum", "direct"), "shadow_lights": 0}
        given = plan_scene(scene, fixed_settings(**(own | {"reprojection": "motion"} | more)))
        with gpu, GpuOwner(gpu) as owner:
            source = owner.open_source(given.animated, given.settings, extra=exact_channels())
            exact = ExactReasons(partial(owner.open_source, given.animated), given.settings, source.radiance)
            source.advance(frame - 1)
            source.advance(frame)
            found = exact.of(source, frame, noise=noise)
            self.bits, self.light = found.bits, found.light
            self.channels = {name: source.read(name) for name in source.channels}
            self.views = source.renderer.frame.view, source.renderer.frame.before[1]
        gpu.collect()

    def count(self, bit) -> int:
        return int(np.count_nonzero(self.bits & bit))


def ball(roughness, metallic, *, camera_to=(0.0, 0.0, 4.0), lamp_to=(2.0, 2.0, 3.0), carried=None, size=1.0):
    """A ball, a lamp and a camera that are at their first places in frame 0 and at the others in frame 1 (4 fps).

    ``carried``: everything moves together by this.  ``size``: of all lengths; the light at the ball stays.
    """
    b = SceneBuilder()
    own = b.material(metallic=metallic, roughness=roughness, base_color=(0.8, 0.7, 0.6, 1.0))
    node = b.node(mesh=b.mesh(replace(sphere(rings=64), material=own)), scale=(size, size, size))
    lamp = b.light(translation=(2.0 * size, 2.0 * size, 3.0 * size), intensity=30.0 * size**2)
    camera = b.camera(translation=(0.0, 0.0, 4.0 * size), yfov=0.7, znear=0.1 * size)
    places = {camera: ((0.0, 0.0, 4.0), camera_to), lamp: ((2.0, 2.0, 3.0), lamp_to)}
    if carried is not None:
        places = {
            n: (at, tuple(np.add(at, carried)))
            for n, at in ((node, (0.0, 0.0, 0.0)), (camera, (0.0, 0.0, 4.0)), (lamp, (2.0, 2.0, 3.0)))
        }
    for moving, keys in places.items():
        b.animate(moving, "translation", [0.0, 0.25], (size * np.array(keys)).tolist())
    return b.build()


def test_a_mirror_like_ball_under_a_moving_camera_is_view_dependent_only(gpu):
    """A still lamp: nothing changes by time.  The highlight lies where the normal halves lamp and camera."""
    pair = Pair(gpu, ball(0.25, 1.0, camera_to=(1.2, 0.0, 3.8)))
    assert pair.count(VIEW) > 50 and pair.count(LIT | DARK) == 0
    world = pair.channels["position"][..., :3] + pair.views[0].position
    normal = normalize(world)
    to_lamp = normalize(np.array([2.0, 2.0, 3.0]) - world)
    halves = [normalize(to_lamp + normalize(view.position - world)) for view in pair.views]
    away = np.degrees(np.arccos(np.clip(np.max([(normal * h).sum(axis=-1) for h in halves], axis=0), -1, 1)))
    assert away[(pair.bits & VIEW) != 0].max() < 30.0
    peaks = [(normal * h).sum(axis=-1) > np.cos(np.radians(2.0)) for h in halves]
    surface = pair.channels["position"][..., 3] > 0
    for peak in peaks:
        assert ((pair.bits & VIEW) != 0)[peak & surface].all() and (peak & surface).any()


def test_a_moving_lamp_over_a_diffuse_ball_is_brightened_and_darkened_only(gpu):
    """Rough dielectric without a highlight: the direction to the camera changes its light by less than the lamp."""
    pair = Pair(gpu, ball(1.0, 0.0, lamp_to=(-2.0, 2.0, 3.0)))
    assert pair.count(VIEW) == 0 and pair.count(LIT) > 100 and pair.count(DARK) > 100
    world = pair.channels["position"][..., :3] + pair.views[0].position
    lamps = [np.array([x, 2.0, 3.0]) for x in (-2.0, 2.0)]
    irradiance = [
        np.maximum((normalize(world) * normalize(p - world)).sum(axis=-1), 0) / ((p - world) ** 2).sum(axis=-1)
        for p in lamps
    ]
    rose = irradiance[0] > irradiance[1]
    assert rose[(pair.bits & LIT) != 0].all() and not rose[(pair.bits & DARK) != 0].any()


def test_what_moves_together_does_not_change(gpu):
    """Object, lamp and camera carried along: in the object's own frame nothing moves, and no light changes."""
    pair = Pair(gpu, ball(0.25, 1.0, carried=(0.7, -0.2, 0.4)), thresholds={"direct": 1e-3})
    assert (pair.bits & Visibility.MOVED).any() and pair.count(CHANGED_LIGHT) == 0
    assert np.abs(pair.light.by_direction["direct"]).max() < 2e-4


@pytest.mark.parametrize(("roughness", "size"), [(0.3, 1.0), (0.5, 1.0), (0.5, 0.1)])
def test_changes_as_in_float64(gpu, roughness, size):
    """Lamp and camera move: both parts of the change against the BRDF in float64, at every pixel."""
    pair = Pair(gpu, ball(roughness, 0.3, camera_to=(0.6, 0.2, 3.9), lamp_to=(1.5, 2.2, 3.2), size=size))
    now, before = pair.views
    c = {name: values.astype(np.float64) for name, values in pair.channels.items()}
    surface = c["position"][..., 3] > 0
    world = c["position"][..., :3][surface] + now.position
    normal = c["normal"][..., :3][surface]
    material = SurfaceMaterial(
        c["base_color"][..., :3][surface], c["material"][surface][:, 0], c["material"][surface][:, 1]
    )

    def radiance(lamp_at, eye):
        lamp = Light(kind="point", intensity=30.0 * size**2)
        to_lamp, arriving = incident(lamp, size * np.array(lamp_at), np.zeros(3), world)
        facing = (c["geometric_normal"][..., :3][surface] * to_lamp).sum(axis=-1, keepdims=True) > 0
        return sum(evaluate_brdf(material, normal, normalize(eye - world), to_lamp)) * arriving * facing

    then, turned = (radiance((2.0, 2.0, 3.0), view.position) for view in (before, now))
    after = radiance((1.5, 2.2, 3.2), now.position)
    scale = max(np.abs(after).max(), np.abs(then).max())
    for found, expected in ((pair.light.total, after - then), (pair.light.by_direction, turned - then)):
        assert np.abs(found["direct"][surface] - expected).max() < 2e-3 * scale
    visible = (pair.bits & (Visibility.VISIBLE | Visibility.SKY)) == Visibility.VISIBLE
    full = [np.zeros((*surface.shape, 3)) for _ in range(2)]
    full[0][surface], full[1][surface] = after - then, turned - then
    expected = light_reasons({"direct": full[0]}, {"direct": full[1]}, {"direct": 32 / 255}, visible)
    differs = (pair.bits & CHANGED_LIGHT) != expected
    assert differs.mean() < 2e-3 and all(np.count_nonzero(expected & bit) > 20 for bit in (VIEW, LIT | DARK))


def test_the_larger_cause_decides():
    one = np.array([[[0.5, 0.5, 0.5], [0.5, 0.5, 0.5], [-0.5, -0.5, -0.5], [0.05, 0.05, 0.05], [0.5, 0.5, 0.5]]])
    turned = one * np.array([0.6, 0.4, 0.4, 1.0, 0.0])[:, None]
    visible = np.array([[True, True, True, True, False]])
    found = light_reasons({"direct": one}, {"direct": turned}, {"direct": 0.1}, visible)
    assert found.tolist() == [[VIEW, LIT, DARK, 0, 0]]
    none = np.zeros_like(one)
    found = light_reasons(
        {"direct": none, "indirect": one}, {"direct": none, "indirect": one}, {"direct": 0.1, "indirect": 0.1}, visible
    )
    assert found.tolist() == [[VIEW, VIEW, VIEW, 0, 0]]


@pytest.mark.long
def test_path_traced_light_has_a_noise_floor(gpu):
    """A glossy floor that mirrors a lit panel, by samples: the share of points that differ between two sets of them."""
    b = SceneBuilder()
    floor = b.material(metallic=1.0, roughness=0.3)
    panel = b.material(emissive=(1.0, 1.0, 1.0), double_sided=True)
    b.node(mesh=b.mesh(quad(8.0, 8.0, material=floor)), rotation=turn_x(-90.0))
    b.node(mesh=b.mesh(quad(2.0, 2.0, material=panel)), translation=(0.0, 1.5, -2.0), rotation=turn_y(0.0))
    camera = b.camera(translation=(0.0, 1.0, 3.0), rotation=turn_x(-15.0), yfov=0.9, znear=0.1)
    b.animate(camera, "translation", [0.0, 0.25], [(0.0, 1.0, 3.0), (0.4, 1.0, 3.0)])
    light = {"light": "path-traced", "bounces": 1, "width": 36, "height": 24}
    shares = []
    for spp in (2, 32):
        pair = Pair(gpu, b.build(), noise=True, spp=spp, **light)
        other = np.linalg.norm(pair.light.noise["direct"], axis=-1) > 32 / 255
        shares.append(float(other.mean()))
        # The panel does not move: what changes by more than the noise does so by direction.
        assert pair.count(LIT | DARK) <= 2 * other.sum()
    assert pair.count(VIEW) > 20 and shares[1] < 0.5 * shares[0] and shares[1] < 0.1
