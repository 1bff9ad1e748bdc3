"""An owner frees all that it opened, and everything that draws opens its sources with one."""

import pytest
from fixed import fixed_settings
from repeated import few

from taubench_gl.errors import GraphicsError
from taubench_gl.evaluation.exposure import meter
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.evaluation.scene import evaluate_scene, plan_scene
from taubench_gl.evaluation.session import Readback, Session
from taubench_gl.export.run import ExportOptions, export_scene
from taubench_gl.frame import sources
from taubench_gl.gpu.context import open_gpu
from taubench_gl.reject.evaluate import evaluate_tests
from taubench_gl.reuse.evaluate import evaluate_methods
from taubench_gl.scene import load_scene
from tests.gpu.test_context import DEMO, alive, alive_before

pytestmark = pytest.mark.usefixtures("own_programs")

SMALL = {"width": 32, "height": 18, "frames": (0, 3), "spp": 1, "shadow_size": 64, "probes": 32}


@pytest.fixture(scope="module")
def demo():
    return load_scene(DEMO)


def _pairs(demo, out):
    wants = Readback(images=True, lobes=("diffuse",))
    with Session(plan_scene(demo, fixed_settings(exact=True, **SMALL)), wants) as session:
        for pair in session.pairs():
            assert pair.mask.any() or pair.row["pixels"]


def _left_early(demo, out):
    with Session(plan_scene(demo, fixed_settings(**SMALL)), Readback(images=True)) as session:
        next(iter(session.pairs()))


ACTS = {
    "evaluate": lambda demo, out: evaluate_scene(demo, fixed_settings(**SMALL)),
    "exact pairs": _pairs,
    "left early": _left_early,
    "metering": lambda demo, out: meter(demo, plan_scene(demo, fixed_settings(**SMALL)).settings),
    "export": lambda demo, out: export_scene(
        DEMO, out, fixed_settings(**SMALL), ExportOptions(format="npz", channels=("mask", "motion_forward"))
    ),
    "reject": lambda demo, out: evaluate_tests(DEMO, ("plane_distance",), fixed_settings(**SMALL)),
    "reuse": lambda demo, out: evaluate_methods(
        demo,
        ("none", "accumulate"),
        fixed_settings(reprojection="motion", **SMALL),
        input="full",
        metrics=("psnr",),
        reference_samples=1,
    ),
}


@pytest.mark.parametrize("act", few(ACTS.values(), 3), ids=ACTS.keys())
def test_no_object_stays(demo, tmp_path, act):
    with open_gpu() as gpu:
        earlier = alive_before(gpu)
        act(demo, tmp_path / "first")  # the program used last is deleted, yet lives until another is used
        before = alive(gpu)
        assert sum(before.values()) <= earlier + 2, before
        act(demo, tmp_path / "out")
        assert alive(gpu) == before


def test_a_part_that_fails_to_open_frees_the_others(demo):
    given = plan_scene(demo, fixed_settings(**SMALL))
    with open_gpu() as gpu:
        before = alive(gpu)
        with pytest.raises(ZeroDivisionError), GpuOwner(gpu) as owner:
            owner.open_source(given.animated, given.settings)
            assert alive(gpu) != before
            _ = 1 / 0
        assert alive(gpu) == before


def test_parts_are_freed_once_and_the_last_first(gpu):
    class Part:
        def __init__(self, name):
            self.name = name

        def release(self):
            freed.append(self.name)

    freed, owner = [], GpuOwner(gpu)
    for name in "abc":
        owner.own(Part(name))
    owner.release()
    owner.release()
    assert freed == ["c", "b", "a"]


def test_a_source_that_cannot_be_opened_frees_its_parts(demo, monkeypatch):
    def fail(*_):
        raise GraphicsError("no room")

    opened = plan_scene(demo, fixed_settings(**SMALL))
    monkeypatch.setattr(sources, "LightStage", fail)
    with open_gpu() as gpu, GpuOwner(gpu) as owner:
        before = alive(gpu)
        with pytest.raises(GraphicsError):
            owner.open_source(opened.animated, opened.settings)
        # The owner keeps compiled programs for other sources.
        assert alive(gpu) | {"Program": 0} == before | {"Program": 0}
