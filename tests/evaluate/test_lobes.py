"""Columns of single lobes of rendered scenes: the channels add up, and the columns are those of the channels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fixed import fixed_settings

from taubench_gl import evaluate
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.evaluation.lobes import scene_channels
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import open_gpu
from taubench_gl.scene.builder import SceneBuilder, box, quad, turn_x
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

pytestmark = pytest.mark.usefixtures("coarse_light")

LOBES = ("diffuse", "glossy")


def shiny(*, glowing: bool = False) -> Scene:
    """A room with a shiny floor, a moving lamp and, with ``glowing``, a luminous panel."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(box((2.0, 1.0, 2.0), inside=True, material=b.material(metallic=0.0, roughness=1.0))))
    floor = b.material(metallic=0.5, roughness=0.3, base_color=(0.8, 0.6, 0.4, 1.0))
    b.node(mesh=b.mesh(quad(2.0, 2.0, material=floor)), translation=(0.0, -0.9, 0.0), rotation=turn_x(-90.0))
    if glowing:
        panel = b.material(emissive=(4.0, 4.0, 4.0), emissive_strength=4.0, double_sided=True)
        b.node(mesh=b.mesh(quad(0.5, 0.5, material=panel)), translation=(0.0, 0.9, 0.0), rotation=turn_x(90.0))
    lamp = b.light(intensity=3.0)
    b.animate(lamp, "translation", [0.0, 1.0], [(-1.0, 0.3, 0.0), (1.0, 0.3, 0.5)])
    b.camera(translation=(0.0, 0.2, 1.8), yfov=1.2, znear=0.01)
    return b.build()


def glazed() -> Scene:
    """The room with a block of glass, part of which is diffuse."""
    scene = shiny()
    glass = replace(scene.materials[1], metallic=0.0, transmission=0.6, thick=True)
    return replace(scene, materials=(scene.materials[0], glass, *scene.materials[2:]))


def settings(**more) -> Settings:
    own = {"width": 48, "height": 32, "fps": 4.0, "shadow_size": 64, "indirect_samples": 256, "probes": 64, "spp": 2}
    return fixed_settings(**(own | {"columns": ("direct", "indirect")} | more))


@pytest.mark.parametrize(
    ("scene", "more"),
    [
        (shiny(), {}),
        (shiny(), {"indirect": "rsm"}),
        (shiny(), {"shadow_lights": 0}),
        (shiny(), {"light": "path-traced", "bounces": 3}),
        (shiny(glowing=True), {"bounces": 3}),
        (glazed(), {"light": "path-traced", "bounces": 3, "spp": 4}),
    ],
    ids=["probes", "rsm", "no shadow maps", "path-traced", "raster and a luminous panel", "glass"],
)
def test_lobes_add_up(scene, more):
    chosen, glass = settings(**more), any(material.transmission for material in scene.materials)
    lobes = (*LOBES, "transmission") if glass else LOBES
    with open_gpu() as gpu:
        source = RasterSource(gpu, AnimatedScene(scene), chosen, extra=scene_channels(lobes))
        plain = RasterSource(gpu, AnimatedScene(scene), chosen)
        for each in (source, plain):
            each.advance(1)
        for name in ("direct", "indirect"):
            whole = source.read(name)[..., :3]
            parts = [source.read(f"{name}_{lobe}")[..., :3] for lobe in lobes]
            assert all(part.max() > 0.0 for part in parts[: None if name == "indirect" else 2])
            np.testing.assert_allclose(sum(parts), whole, rtol=2e-6, atol=1e-6 * whole.max())
            # Compilers of GPUs fuse a multiply and an add in one variant of a shader and not in another.
            rounding = 0.0 if gpu.software else 1e-5
            np.testing.assert_allclose(whole, plain.read(name)[..., :3], rtol=rounding, atol=rounding * whole.mean())
        source.release()
        plain.release()
        gpu.collect()


def test_transmission_is_null_where_nothing_lets_light_through_and_where_light_is_raster():
    own = settings(frames=(0, 2), indirect="none", light="raster")
    for scene in (shiny(), glazed()):
        found = evaluate(scene, own, lobes="transmission").summary["lobes"]["transmission"]["direct"]
        assert found["mean_percent"] is None and found["reason"]
    traced = settings(frames=(0, 2), light="path-traced", spp=2, bounces=3, exposure=64.0)
    found = evaluate(glazed(), traced, lobes="transmission").summary["lobes"]["transmission"]
    assert found["indirect"]["mean_percent"] > 0.0


def test_columns_of_lobes_are_counts_of_their_channels():
    """Against the number of pixels whose lobe changes by more than the threshold, of a still camera."""
    scene, chosen = shiny(), settings(exposure=8.0)
    run = evaluate_scene(scene, chosen, lobes=LOBES)
    found, changed = run.summary["lobes"], {}
    with open_gpu() as gpu:
        source = RasterSource(gpu, AnimatedScene(scene), chosen, extra=scene_channels(LOBES))
        source.advance(0)
        for frame in range(1, run.summary["pairs"] + 1):
            source.advance(frame)
            for name in scene_channels(LOBES):
                now, then = (source.read(name, previous=p)[..., :3].astype(np.float64) for p in (False, True))
                over = np.linalg.norm(now - then, axis=-1) * 8.0 > chosen.metrics.threshold("direct")
                changed.setdefault(name, []).append(100.0 * over.mean())
        source.release()
        gpu.collect()
    for bounce in ("direct", "indirect"):
        for lobe in LOBES:
            expected = np.mean(changed[f"{bounce}_{lobe}"])
            assert found[lobe][bounce]["mean_percent"] == pytest.approx(expected, abs=0.1), (bounce, lobe)
    assert found["diffuse"]["direct"]["mean_percent"] > 1.0 and found["glossy"]["direct"]["mean_percent"] > 1.0


def test_what_a_scene_does_not_have_is_null_with_a_reason():
    run = evaluate(shiny(), settings(frames=(0, 2), indirect="none"), lobes="diffuse,volume")
    found = run.summary["lobes"]
    assert found["diffuse"]["direct"]["mean_percent"] is not None
    for lobe, bounce in (("diffuse", "indirect"), ("volume", "direct"), ("volume", "indirect")):
        assert found[lobe][bounce]["mean_percent"] is None and found[lobe][bounce]["reason"]
    assert "lobes" not in evaluate(shiny(), settings(frames=(0, 2), indirect="none")).summary


@pytest.mark.parametrize(("lobes", "more"), [(("shiny",), {}), (("glossy",), {"samples_per_pixel": 4})])
def test_lobes_that_cannot_be_measured_are_refused(lobes, more):
    with pytest.raises(SettingsError):
        evaluate_scene(shiny(), settings(**more), lobes=lobes)
