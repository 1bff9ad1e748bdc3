"""Whatever opens a scene refuses one without triangles, and one whose distances vanish in float32."""

from __future__ import annotations

import json

import pytest
from fixed import fixed_settings

from taubench_gl import pairs
from taubench_gl.batch.spec import Job
from taubench_gl.batch.units import head_unit
from taubench_gl.cost.study import cost
from taubench_gl.datasets.gltf_from_scene import write_scene
from taubench_gl.errors import SceneError
from taubench_gl.evaluation import evaluate_scene, open_session, plan_scene
from taubench_gl.export.run import export_scene
from taubench_gl.gpu.context import open_gpu
from taubench_gl.option_groups import ExportOptions
from taubench_gl.reject.evaluate import evaluate_tests
from taubench_gl.reuse.evaluate import evaluate_methods
from taubench_gl.scene.builder import SceneBuilder, sphere
from taubench_gl.study.unit import Worker
from taubench_gl.viewer.feeds import OpenRequest, open_feed
from taubench_gl.viewer.model import LiveTimer


def _session(path, settings, out):
    with open_session(path, settings):
        pass


def _view(path, settings, out):
    with open_gpu() as gpu:
        open_feed(gpu, OpenRequest(str(path), settings), LiveTimer(gpu))


ACTS = {
    "open": lambda path, settings, out: plan_scene(path, settings),
    "session": _session,
    "evaluate": lambda path, settings, out: evaluate_scene(path, settings, out=out),
    "pairs": lambda path, settings, out: pairs(path, settings),
    "export": lambda path, settings, out: export_scene(path, out, settings, ExportOptions(channels=("normal",))),
    "reject": lambda path, settings, out: evaluate_tests(path, ("plane_distance",), settings),
    "reuse": lambda path, settings, out: evaluate_methods(path, ("none",), settings),
    "batch": lambda path, settings, out: head_unit(Job("a", str(path), settings, {}), None).run(Worker()),
    "view": _view,
    "cost": lambda path, settings, out: cost(path, settings.replace(light="auto"), out=out),
}


@pytest.fixture(scope="module")
def refused(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes")
    empty, small = folder / "empty.gltf", folder / "small.glb"
    nodes = [{"name": "point"}]
    empty.write_text(json.dumps({"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "scene": 0, "nodes": nodes}))
    b = SceneBuilder()
    b.node(mesh=b.mesh(sphere(2.0**-70, 8)))
    b.camera(translation=(0.0, 0.0, 2.0**-68))
    write_scene(b.build(), small)
    return {"triangles": empty, "scale": small}


@pytest.mark.parametrize("fault", ["triangles", "scale"])
@pytest.mark.parametrize("act", ACTS.values(), ids=ACTS.keys())
def test_a_scene_that_cannot_be_drawn_or_measured_is_refused(refused, tmp_path, act, fault):
    settings = fixed_settings(
        size="32x18", frames=(0, 3), reprojection="motion", thresholds={"position": 0.0}, environment="none"
    )
    with pytest.raises(SceneError) as caught:
        act(refused[fault], settings, tmp_path / "out")
    assert refused[fault].stem in caught.value.where
    assert not (tmp_path / "out" / "frames.csv").exists()
