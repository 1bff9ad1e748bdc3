"""Path-traced inputs and references: noise of a renderer, with a reference that it converges to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import OpenEXR
import pytest
from reuse_scenes import glowing, lit_room, settings, still
from reuse_tools import arrays

from taubench_gl.animation import Poser, choose_camera
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.features import COLUMNS
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.pathtraced.references import LOBES, References
from taubench_gl.reuse.evaluate import evaluate_methods
from taubench_gl.reuse.input_kind import parse_input
from taubench_gl.reuse.inputs import FrameRequest, RasterInputs
from taubench_gl.reuse.quality import reusable
from taubench_gl.reuse.references import PathTracedReference
from taubench_gl.scene.builder import SceneBuilder, box, turn_x

pytestmark = pytest.mark.usefixtures("fixed_light")

SMALL = {"width": 20, "height": 15, "light": "auto", "indirect": "auto", "bounces": 3, "shadow_size": 32}


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))


def chosen(**changes):
    return settings(**(SMALL | changes))


def source_of(gpu, scene, made, extra=()):
    return RasterSource(gpu, AnimatedScene(scene), made, extra=extra)


def test_a_reference_is_the_mean_of_its_samples(gpu):
    """32 samples in two halves and four parts, against frames of the same halves in one part."""
    scene, made = still(), chosen()
    with GpuOwner(gpu) as owner:
        references = References.open(owner, AnimatedScene(scene), made, 32)
        found = references.frame(3)
        again = references.frame(5)
    assert found.samples == 32 and found.noise.rms > 0
    for lobe in LOBES:  # the scene is still and so is the pattern
        np.testing.assert_array_equal(found.lobes[lobe], again.lobes[lobe])
    traced = made.replace(light="path-traced", spp=16, pattern="independent", columns=("direct", "indirect"))
    halves = []
    with GpuOwner(gpu) as owner:
        source = owner.own(source_of(gpu, scene, traced, (*LOBES, "path_info")))
        for number in (1 << 31, (1 << 31) + 1):
            source.draw(3)
            source.trace(number, 0, 16)
            halves.append({name: source.read(name)[..., :3] for name in (*LOBES, "direct", "indirect")})
            np.testing.assert_array_equal(source.read("path_info")[..., 1], 16.0)
    gpu.collect()
    for lobe in LOBES:
        np.testing.assert_allclose(found.lobes[lobe], (halves[0][lobe] + halves[1][lobe]) / 2, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(found.direct, (halves[0]["direct"] + halves[1]["direct"]) / 2, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(
        found.indirect, (halves[0]["indirect"] + halves[1]["indirect"]) / 2, rtol=1e-5, atol=1e-6
    )


def test_inputs_have_the_noise_of_their_samples_in_every_frame(gpu):
    scene, kind = still(), parse_input("path-traced@2", seed=4)
    request = FrameRequest(gpu, scene, choose_camera(scene), chosen(exposure=2.0), kind, Poser(scene))
    reads = ("mask", "motion", "exact_mask", "base_color")
    with PathTracedReference(request, 64) as reference, RasterInputs(request, reads, exact=reference) as inputs:
        frames = [arrays(inputs.advance(frame)) for frame in range(3)]
        clean = reference.image(2).radiance
        described = inputs.describe()
    gpu.collect()
    noisy, masks = [frame["radiance"][..., :3] for frame in frames], [frame["exact_mask"] for frame in frames]
    assert described["path_samples"] == 2 and described["seed"] == 4
    assert not np.array_equal(noisy[0], noisy[1]) and not np.array_equal(noisy[1], noisy[2])
    error = [np.abs(image - clean).mean() for image in (*noisy, np.mean(noisy, axis=0))]
    assert 0 < error[3] < min(error[:3]) < clean.mean()
    assert reusable(masks[1]).all() and reusable(masks[2]).all()  # nothing changes, whatever the noise


def test_a_path_traced_input_needs_a_reference(gpu):
    scene = still()
    request = FrameRequest(gpu, scene, choose_camera(scene), chosen(), parse_input("path-traced@1"))
    with pytest.raises(SettingsError):
        RasterInputs(request, ("exact_mask",), exact=True)


@pytest.mark.parametrize("environment", ["none", (0.2, 0.3, 0.4)])
def test_evaluation_with_a_path_traced_reference(environment):
    said = []
    done = evaluate_methods(
        still(), ["none", "accumulate"], chosen(frames=(0, 4), environment=environment), input="path-traced@1",
        reference="path-traced@32", metrics=("psnr",), announce=said.append,
    )  # fmt: skip
    assert not done.failed and done.summary["reference"]["kind"] == "path-traced"
    assert done.summary["reference"]["samples"] == 32 and done.summary["reference"]["noise_percent"] > 0
    means = {label: method["mean"] for label, method in done.summary["methods"].items()}
    assert means["accumulate"]["relmse"] < means["none"]["relmse"]
    assert len(said) == 1 and done.summary["mask_source"] == "exact"


def test_a_dark_scene_has_no_reference(gpu):
    b = SceneBuilder()
    lit_room(b)
    scene = b.build()
    dark = replace(scene, lights=(), nodes=replace(scene.nodes, light=np.full_like(scene.nodes.light, -1)))
    with pytest.raises(SettingsError):
        References.open(GpuOwner(gpu), AnimatedScene(dark), chosen(), 4)


@pytest.mark.parametrize("environment", ["none", (0.2, 0.3, 0.4), "image"])
def test_sky_and_emission_are_those_of_the_renderer(gpu, tmp_path, environment):
    """Against a path-traced frame of the renderer, at pixel centers: sky, emission, and color of all of it."""
    if environment == "image":
        environment = str(tmp_path / "sky.exr")
        rows, columns = np.mgrid[0:16, 0:32]
        pixels = np.stack([rows / 16, columns / 32, 0.5 + 0.0 * rows], axis=-1).astype(np.float32)
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"RGB": pixels}).write(environment)
    b = SceneBuilder()
    lit_room(b)
    b.node(mesh=b.mesh(box((0.5, 0.5, 0.5), material=glowing(b, (0.3, 0.6, 0.9)))), translation=(1.2, 1.6, 0.5))
    b.camera(translation=(0.0, 2.5, 4.0), rotation=turn_x(-12.0), yfov=np.radians(80.0), znear=0.1)
    scene, made = b.build(), chosen(environment=environment, exposure=0.5, bounces=1)
    request = FrameRequest(gpu, scene, choose_camera(scene), made, parse_input("path-traced@1"), Poser(scene))
    every = made.replace(columns=COLUMNS, light="path-traced", pattern="independent", spp=1)
    with PathTracedReference(request, 2) as reference, GpuOwner(gpu) as owner:
        source = owner.own(source_of(gpu, scene, every))
        image = reference.image(0).radiance
        color = reference.read("color")[..., :3]
        source.advance(0)
        surface = source.read("position")[..., 3] > 0.0
        emission, theirs = source.read("emission")[..., :3], source.read("color")[..., :3]
    gpu.collect()
    emits = surface & (emission.max(axis=-1) > 0.0)
    assert (~surface).any() and emits.any()
    np.testing.assert_allclose(color[~surface], theirs[~surface], atol=2e-3)
    # The box is black: it shows its emission alone.
    np.testing.assert_allclose(image[emits], 0.5 * emission[emits], rtol=1e-6)
    np.testing.assert_allclose(color[emits], theirs[emits], atol=2e-3)
