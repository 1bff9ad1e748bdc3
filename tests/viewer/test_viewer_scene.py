"""The tree of the scene: names and kinds of nodes, picks in the image, and the outline of the selected node."""

from __future__ import annotations

import numpy as np
import pytest
from references.display import outline
from viewer_tools import DEMO, SIZE

from taubench_gl.demos.stage import Props
from taubench_gl.scene import load_scene
from taubench_gl.viewer.display import OUTLINE_COLOR
from taubench_gl.viewer.scene_tree import SceneTree

pytestmark = pytest.mark.usefixtures("coarse_light")


def draws_under(driven, name: str) -> list[int]:
    """Values of ``ids`` that belong to a node or to one below it, by walking up from every draw."""
    renderer, node = driven.engine.source.renderer, driven.state.nodes.index(name)
    parent, out = renderer.scene.nodes.parent, []
    for number, draw in enumerate(renderer.draws, 1):
        above = draw.node
        while above >= 0 and above != node:
            above = int(parent[above])
        out += [number] * (above == node)
    return out


def outlined(image: np.ndarray) -> np.ndarray:
    return (np.abs(image - 255.0 * np.array(OUTLINE_COLOR[:3])) <= 1.0).all(axis=-1)


def right_click(driven, x: int, row: int) -> None:
    at = driven.viewer.layout.place(x, row, driven.state.size)
    driven.run(f"mouse {at[0]} {at[1]}\npress 1\nrelease 1")


def test_labels_are_unique_and_nodes_have_kinds():
    b = Props()
    parent = b.node(name="none")
    nodes = [b.ball(0.5, (1, 1, 1), 8, name=name, parent=parent) for name in ("ball", "ball", "ball 2", "")]
    camera = b.camera(yfov=1.0)
    b.animate(nodes[1], "translation", [0.0, 1.0], [(0, 0, 0), (1, 0, 0)])
    tree = SceneTree.of(b.build())
    assert len(set(tree.labels)) == len(tree.labels) == 6 and not {"none", ""} & set(tree.labels)
    assert tree.labels[nodes[0]] == "ball"
    assert [tree.kinds[n] for n in (parent, *nodes, camera)] == ["", *["mesh"] * 4, "camera"]
    assert tree.children[parent] == tuple(nodes) and tree.roots == (parent, camera)
    assert np.flatnonzero(tree.animated).tolist() == [nodes[1]]


def test_animated_nodes_of_the_demo():
    """A skinned mesh is animated by its joints, a morphed one by its weights, others by a node above them."""
    tree = SceneTree.of(load_scene(DEMO))
    animated = dict(zip(tree.labels, tree.animated, strict=True))
    assert all(animated[name] for name in ("tentacle skin", "morph", "carousel", "car 0", "eye"))
    assert not any(animated[name] for name in ("court", "joint 0", "sun", "trees"))
    kinds = dict(zip(tree.labels, tree.kinds, strict=True))
    assert (kinds["joint 0"], kinds["sun"], kinds["eye"], kinds["walker"]) == ("joint", "light", "camera", "")
    assert tree.ancestors(tree.labels.index("car 0")) == {tree.labels.index(n) for n in ("carousel", "post")}


@pytest.mark.parametrize("name", ["ball", "carousel", "court"])
def test_the_outline_is_the_boundary_of_the_draws(drive, name):
    driven = drive()
    driven.run("frame 8\nset overlays off\nset channel headlight")
    before = driven.engine.image().astype(int)
    driven.run(f"set selection {name}\nexpect selection == {name}")
    image = driven.engine.image().astype(int)
    selected = np.isin(driven.engine.source.read("ids")[..., 0], draws_under(driven, name))
    boundary = outline(selected)
    assert 5 < selected.sum() < selected.size and boundary.any() and not outlined(before).any()
    assert (outlined(image) == boundary).all()
    assert (image[~boundary] == before[~boundary]).all()
    driven.run("key ESCAPE\nexpect selection == none")
    assert (driven.engine.image() == before).all()


def test_the_outline_follows_the_frame_and_is_beside_too(drive):
    driven = drive(window=(1280, 720))
    driven.run("frame 8\nset overlays off\nset against history\nkey Z\nset selection carousel")
    for _ in range(2):
        selected = np.isin(driven.engine.source.read("ids")[..., 0], draws_under(driven, "carousel"))
        parts = np.split(driven.engine.picture().astype(int), 3, axis=1)
        assert all((outlined(part) == outline(selected)).all() for part in parts)
        driven.run("key RIGHT")
    assert driven.engine.drawn.plans == 1, "a selection needs no other source"


def test_a_pick_selects_the_node_of_the_pixel(drive):
    driven = drive(window=(1280, 720))
    driven.run("frame 8\nset overlays off")
    source = driven.engine.source
    ids = source.read("ids")[..., 0]
    for number in np.unique(ids)[[0, 1, 3, -1]]:
        row, x = (int(v) for v in np.argwhere(ids == number)[0])
        right_click(driven, x, row)
        name = "none" if number == 0 else driven.state.nodes[source.renderer.draws[number - 1].node]
        driven.run(f"expect selection == {name!r}\nexpect probe_pinned == 0\nkey ESCAPE\nexpect selection == none")
        driven.run(f"set probe_pinned on\nset probe {x},{row}\nkey SHIFT+P\nexpect selection == {name!r}")
        driven.run("set probe_pinned off\nkey ESCAPE")
    at = driven.viewer.layout.place(20, 20, SIZE)
    driven.run(f"mouse {at[0]} {at[1]}\npress 1\nmouse {at[0] + 60} {at[1]}\nrelease 1\nexpect selection == none")


def test_the_tree_scrolls_to_a_pick_and_is_searched_by_name(drive):
    """The nodes above the pick are opened; a click on a row selects its node or none; a new selection ends a search."""
    driven = drive(window=(1280, 720))
    driven.run("frame 8\nset selection 'car 2'\nwait 1\nwait 1")
    widgets, panel = driven.viewer.panels.widgets, driven.viewer.layout.left
    x, y, _, height = widgets["node.car 2"]
    assert panel[0] <= x and panel[1] <= y and y + height <= panel[1] + panel[3]
    assert "node.carousel" in widgets
    driven.run(
        "click '@node.car 1' 0.9\nexpect selection == 'car 1'\nclick '@node.car 1' 0.9\nexpect selection == none"
    )

    driven.run("click @search 0.5")
    for letter in "CAR":
        driven.viewer.input.char(ord(letter))
    driven.run("wait 1\nwait 1")
    listed = {n.removeprefix("node.") for n in driven.viewer.panels.widgets if n.startswith("node.")}
    assert listed == {n for n in driven.state.nodes if "car" in n} and len(listed) == 5
    driven.run("set selection ball\nwait 1\nwait 1")
    assert "node.ball" in driven.viewer.panels.widgets


def test_from_outside_nothing_is_picked(drive):
    driven = drive(window=(1280, 720))
    driven.run("frame 8\nset overlays off\nset selection court\nkey C\nkey F\nhold S 3")
    assert driven.engine.image().shape == (SIZE[1], SIZE[0], 3) and driven.state.selection is not None
    selection = driven.state.selection
    right_click(driven, 40, 40)
    assert driven.state.selection == selection


def test_thousands_of_nodes_are_listed_by_rows_in_view(drive, monkeypatch):
    driven = drive(window=(1280, 720))
    tree = driven.engine.feed.tree
    many = 5000
    labels = (*tree.labels, *(f"leaf {i}" for i in range(many)))
    grown = SceneTree(
        labels, (*tree.kinds, *["mesh"] * many), np.append(tree.parent, np.zeros(many, np.int32)),
        np.append(tree.animated, np.zeros(many, bool)),
        (tuple(range(len(tree.labels), len(labels))), *tree.children[1:], *[()] * many), tree.roots,
    )  # fmt: skip
    driven.engine.feed.tree, driven.state.nodes = grown, labels
    monkeypatch.setattr(type(driven.engine), "visible", lambda self, node: True)
    driven.run("set selection 'leaf 4000'\nwait 1\nwait 1")
    rows = [name for name in driven.viewer.panels.widgets if name.startswith("node.")]
    assert "node.leaf 4000" in rows and len(rows) < 100
