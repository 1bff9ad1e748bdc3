"""What follows from declarations: bindings, interface, dispatch size, order, dependencies."""

from __future__ import annotations

import pytest

from taubench_gl.gpu.declare import (
    UPDATE,
    WRITE,
    ComputePass,
    RasterPass,
    Resource,
    dependencies,
    order_faults,
    stage,
    without_dependents,
)


def compute(name: str) -> ComputePass:
    return ComputePass(name, (f"{name}.comp.glsl",))


def test_a_name_is_declared_once():
    with pytest.raises(ValueError):
        compute("any").texture("a").image("a")


@pytest.mark.parametrize(
    ("invocations", "group", "each", "groups"),
    [((10, 3), (4, 2), 1, (3, 2)), (65, 64, 1, (2, 1)), ((160, 90), (8, 1), 60, (1, 90)), (0, 64, 1, (0, 1))],
)
def test_groups_cover_all_invocations(invocations, group, each, groups):
    assert compute("any").dispatch(invocations, group, each).groups == groups


def test_a_pass_reads_only_what_an_earlier_one_wrote():
    draw = RasterPass("draw", ("a.vert.glsl", "a.frag.glsl")).attachment("position")
    light = compute("light").texture("position").image("light_out", access=WRITE, resource="light")
    masks = compute("masks").texture("history_light", resource="light", history=True).texture("light")
    assert order_faults([draw, light, masks]) == []
    assert len(order_faults([light, draw])) == 1
    assert len(order_faults([draw, masks])) == 2  # of this frame and of the one before


def test_every_fault_of_an_order_is_found():
    twice = [compute(name).image("x_out", access=WRITE, resource="x") for name in ("one", "two")]
    faults = order_faults([*twice, compute("last").texture("y").texture("z").texture("table", filled=True)])
    assert len(faults) == 3


def test_an_update_may_follow_the_pass_that_wrote():
    first = compute("one").image("x_out", access=WRITE, resource="x")
    assert order_faults([first, compute("two").image("x", access=UPDATE)]) == []


def test_effects_depend_on_what_their_stages_need():
    def nothing(spec):
        return ()

    stages = [stage("light", options=("sky", "shadows"))(nothing), stage("shadows", "light")(nothing)]
    stages += [stage("bounce", "shadows", "light", options=("sky",))(nothing), stage(options=("maps",))(nothing)]
    depends = dependencies(stages)
    assert depends == {
        "light": frozenset(),
        "shadows": frozenset({"light"}),
        "bounce": frozenset({"shadows", "light"}),
        "sky": frozenset({"light"}),
        "maps": frozenset(),
    }
    assert without_dependents({"shadows", "bounce", "sky", "maps"}, depends) == {"maps"}
    assert without_dependents({"light", "bounce", "sky"}, depends) == {"light", "sky"}


@pytest.mark.parametrize(
    ("resource", "size"),
    [
        (Resource.texture("a", (10, 4)), 640),
        (Resource.texture("a", (10, 4), components=1, dtype="f2"), 80),
        (Resource.texture("a", (10, 4), dtype="depth"), 160),
        (Resource.buffer("a", 12), 12),
    ],
)
def test_bytes_of_a_resource(resource, size):
    assert resource.bytes == size
