"""With Blender: light units in closed form, and our rasterizer against pixel-centre renders of real scenes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cycles_scenes import BASE_COLOR, DOWN, plane

from taubench_gl.animation import choose_camera
from taubench_gl.cycles.job import Quality
from taubench_gl.cycles.render import render_truth
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.evaluation_truth import TruthOptions, evaluate_truth
from taubench_gl.reference.sequence import TruthSequence
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings

pytestmark = pytest.mark.long
SIZE = (192, 108)
SCENES = {
    "rigid": ("BoxAnimated/BoxAnimated.glb", (20, 23)),
    "textured": ("CesiumMilkTruck/CesiumMilkTruck.glb", (5, 8)),
    "skinned": ("CesiumMan/CesiumMan.glb", (10, 13)),
    "morphed": ("AnimatedMorphCube/AnimatedMorphCube.glb", (10, 13)),
    "interpolated": ("InterpolationTest/InterpolationTest.glb", (7, 10)),
}


@pytest.mark.parametrize("kind", ["point", "spot", "directional"])
def test_lights_have_gltf_units(tmp_path, blender, kind):
    """Diffuse radiance under a lamp: base colour / pi x irradiance, I cos / d^2 or lux.  Cycles' principled shader
    keeps 1.3 % for its specular lobe."""
    lamp = {"light": {"type": kind, "intensity": 5.0, "color": [1.0, 0.5, 1.0]},
            "node": {"translation": [0, 2, 0], "rotation": DOWN}}  # fmt: skip
    if kind == "spot":
        lamp["light"]["spot"] = {"innerConeAngle": 0.3, "outerConeAngle": 0.6}
    scene = load_scene(plane(tmp_path / "s.gltf", [lamp]))
    out = tmp_path / "out"
    quality = Quality(samples=4, crisp=True)
    render_truth(scene, choose_camera(scene), range(1), out, fps=24.0, size=(33, 33), quality=quality, python=blender)
    frame = TruthSequence.open(out).read(0, ("diffuse",))
    ray = frame.position - np.array([0.0, 2.0, 0.0])
    distance = np.linalg.norm(ray, axis=-1)
    irradiance = np.full((33, 33), 5.0) if kind == "directional" else 5.0 * (2.0 / distance) / distance**2
    inside = np.degrees(np.arccos(2.0 / distance)) < math.degrees(0.2)
    expected = np.array(BASE_COLOR) / math.pi * irradiance[..., None] * [1.0, 0.5, 1.0]
    np.testing.assert_allclose(frame.lobes["diffuse_direct"][inside], expected[inside], rtol=0.02)
    assert np.all(frame.lobes["diffuse_direct"][inside] < expected[inside])
    assert frame.radiance["indirect"].max() == 0.0


@pytest.mark.parametrize("name", SCENES)
def test_the_rasterizer_against_crisp_cycles(data, tmp_path, blender, name):
    file, frames = SCENES[name]
    path, out = data / "khronos" / file, tmp_path / "out"
    scene = load_scene(path)
    quality = Quality(samples=1, crisp=True)
    numbers = range(*frames)
    render_truth(scene, choose_camera(scene), numbers, out, fps=24.0, size=SIZE, quality=quality, python=blender)
    columns = ("frustum", "position", "normal")
    kept = {"truth": [], "raster": [], "motion": []}

    def keep(key):
        return lambda pair: kept[key].append((pair.frame, pair.source.read("position").copy(), pair.motion()))

    truth = evaluate_truth(
        f"exr:{out}", Settings(columns=columns), TruthOptions(camera_file=out / "camera.json"), on_pair=keep("truth")
    )
    settings = dict(width=SIZE[0], height=SIZE[1], frames=frames, columns=columns)
    raster = evaluate_scene(scene, Settings(**settings), on_pair=keep("raster"))
    evaluate_scene(scene, Settings(**settings, reprojection="motion"), on_pair=keep("motion"))
    for column, limit in zip(columns, (0.02, 0.15, 0.2)):
        difference = [run.summary["discard"][column]["mean_percent"] for run in (raster, truth)]
        assert abs(difference[0] - difference[1]) <= limit, column
    sequence = TruthSequence.open(out)
    size = np.percentile([np.abs(p[..., :3]).max() for _, p, _ in kept["raster"]], 50)
    for (frame, ours, _), (_, theirs, _), (_, _, motion) in zip(kept["raster"], kept["truth"], kept["motion"]):
        both = (ours[..., 3] > 0) & (theirs[..., 3] > 0)
        error = np.linalg.norm((ours - theirs)[both][:, :3], axis=-1)
        assert np.median(error) < max(1e-4, 1e-5 * size)
        vector = sequence.read(frame).motion
        assert np.median(np.linalg.norm(vector - motion, axis=-1)[both]) < 0.05
