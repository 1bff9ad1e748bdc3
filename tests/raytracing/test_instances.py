"""Which draws share a tree, and that the answer to a ray does not depend on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from frame_tools import make_scene, quad, room, still_camera
from ray_tools import TriangleList, some_rays, traced, visible_triangles

from taubench_gl.animation import choose_camera
from taubench_gl.frame.geometry import build_geometry
from taubench_gl.frame.raytracing import instances
from taubench_gl.frame.raytracing.instances import changing_nodes, instance_table
from taubench_gl.paths import ASSETS
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Camera, Channel

WALL = quad((-1, -1, -2), (2, 0, 0), (0, 2, 0))
TIMES = np.array([0.0, 1.0])


def channel(node, path, values, interpolation="LINEAR") -> Channel:
    return Channel("node", node, path, interpolation, TIMES, np.array(values, dtype=float))


def test_what_moves_or_vanishes_is_not_merged():
    """Root 0 with children 1 to 5; a constant channel moves nothing, a cubic one with a tangent does."""
    still, tangent = np.zeros((2, 3)), np.zeros((2, 3, 3))
    tangent[0, 2] = 1.0
    scene = make_scene(
        *[WALL] * 5,
        channels=(
            channel(1, "translation", still),
            channel(2, "rotation", [[0, 0, 0, 1], [0, 1, 0, 0]]),
            channel(3, "visible", [[1], [0]], "STEP"),
            channel(4, "translation", tangent, "CUBICSPLINE"),
            channel(5, "weights", [[0], [1]]),
        ),
    )
    assert changing_nodes(scene).tolist() == [False, False, True, True, True, False]
    table = instance_table(scene, build_geometry(scene).draws)
    assert [m.draws.tolist() for m in table.merged] == [[0, 4]] and table.rigid.tolist() == [1, 2, 3]
    moved = replace(scene, channels=(channel(0, "translation", [[0, 0, 0], [1, 0, 0]]),))
    assert instance_table(moved, build_geometry(moved).draws).rigid.tolist() == [0, 1, 2, 3, 4]


def test_a_primitive_with_many_copies_is_stored_once(monkeypatch):
    scene = make_scene(WALL, room())
    nodes = scene.nodes
    copies = {1: np.tile(np.eye(4), (50, 1, 1))}
    copies[1][:, 0, 3] = np.arange(50)
    scene = replace(scene, nodes=replace(nodes, instances=copies))
    draws = build_geometry(scene).draws
    assert instance_table(scene, draws).count == 1
    monkeypatch.setattr(instances, "MERGED_TRIANGLES", 90)
    table = instance_table(scene, draws)
    assert len(table.rigid) == 50 and table.merged[0].draws.tolist() == [50]


def test_a_copy_in_the_place_of_another_is_in_no_tree():
    """Neither of a still node nor of one that moves: a ray would meet the earlier one."""
    scene = make_scene(WALL)
    at = np.tile(np.eye(4), (5, 1, 1))
    at[:, 0, 3] = 0, 1, 0, 2, 1
    scene = replace(scene, nodes=replace(scene.nodes, instances={1: at}))
    draws = build_geometry(scene).draws
    assert len(draws) == 5 and instance_table(scene, draws).merged[0].draws.tolist() == [0, 1, 3]
    moves = replace(scene, channels=(channel(1, "translation", [[0, 0, 0], [1, 0, 0]]),))
    assert instance_table(moves, draws).rigid.tolist() == [0, 1, 3]


def test_two_levels_answer_as_one(gpu, monkeypatch):
    """Every draw an instance of its own, against all of them in one tree: the same primitives at the same distances."""
    scene = load_scene(ASSETS / "demo.glb")
    answers = []
    for most in (instances.MERGED_TRIANGLES, -1):
        monkeypatch.setattr(instances, "MERGED_TRIANGLES", most)
        with traced(gpu, scene, choose_camera(scene)) as t:
            answers.append((t.structure.table.count, t.at(0.5)))
            triangles = visible_triangles(t.renderer)
            o, d = some_rays(triangles, 20_000)
            answers[-1] = (*answers[-1], t.query(o, d))
    (merged, _, a), (single, _, b) = answers
    assert single > merged
    same = (a.draw == b.draw) & (a.triangle == b.triangle)
    close = (a.draw >= 0) & (b.draw >= 0) & (np.abs(a.t - b.t) <= 1e-5 * b.t)
    assert np.mean(same | close) > 0.9995
    hit = same & (a.draw >= 0)
    corners = triangles.corners[triangles.index(a)[hit]]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    off = (a.t - b.t)[hit] * np.einsum("nc,nc->n", d[hit], across) / np.linalg.norm(across, axis=1)
    assert np.abs(off).max() < 1e-5  # meters from the surface; along a ray that grazes it, any distance


def test_frames_in_any_order_give_the_same_bits(gpu):
    """Posed, moving and still draws: nothing of an earlier frame is left."""
    scene = load_scene(ASSETS / "demo.glb")
    times = (0.0, 0.3, 0.9, 1.7)
    runs = []
    for order in (times, times[::-1]):
        with traced(gpu, scene, choose_camera(scene)) as t:
            answers = {}
            for time in order:
                t.at(time)
                o, d = some_rays(visible_triangles(t.renderer), 4000)
                hits = t.query(o, d)
                answers[time] = hits.t.tobytes() + hits.draw.tobytes() + hits.triangle.tobytes()
            runs.append(answers)
    assert runs[0] == runs[1]


def grid_of_quads(side: int) -> tuple:
    step = 1.5
    return [quad((step * i, step * j, -50.0), (1, 0, 0), (0, 1, 0)) for i in range(side) for j in range(side)]


def test_thousands_of_moving_instances(gpu):
    """Each is hit where it is; the tree over them is rebuilt."""
    side = 40
    scene = make_scene(*grid_of_quads(side), channels=(channel(0, "translation", [[0, 0, 0], [0, 0, -50]]),))
    with traced(gpu, scene, still_camera(Camera(), (30.0, 30.0, 0.0))) as t:
        assert len(t.structure.table.rigid) == side * side
        for time, depth in ((0.0, 50.0), (0.5, 75.0)):
            t.at(time)
            i, j = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
            p = np.stack([1.5 * i + 0.3, 1.5 * j + 0.6, np.full(i.shape, -depth)], -1).reshape(-1, 3) - (30, 30, 0)
            length = np.linalg.norm(p, axis=1)
            hits = t.query(np.zeros_like(p), p / length[:, None])
            assert hits.draw.tolist() == list(range(side * side))
            np.testing.assert_allclose(hits.t, length, rtol=1e-6)


def test_the_frame_before_is_kept_on_request(gpu):
    """Still, moving and vanishing walls and a camera that moves; all rays are relative to the current camera."""
    from frame_tools import FormulaCamera

    far, vanishing = quad((-9, -9, -6), (18, 0, 0), (0, 18, 0)), quad((2, -1, -2), (2, 0, 0), (0, 2, 0))
    scene = make_scene(
        WALL, far, vanishing,
        channels=(channel(1, "translation", [[0, 0, 0], [0, 0, -1]]), channel(3, "visible", [[1], [0]], "STEP")),
    )  # fmt: skip
    camera = FormulaCamera(Camera(), lambda time: ((0.0, 0.0, 0.5 * time), np.eye(3)))
    d = np.float32([[0.05, 0.05, -1], [1.2, 0, -1], [-1.2, 0.4, -1]])
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    with traced(gpu, scene, camera, keep_previous=True) as t:
        t.at(1.0, 0.0)
        now, before = (t.query(np.zeros_like(d), d, before=b) for b in (False, True))
        assert now.draw.tolist() == [0, 1, 1] and before.draw.tolist() == [0, 2, 1]
        depth = -d[:, 2]
        np.testing.assert_allclose(now.t * depth, [3.5, 6.5, 6.5], rtol=1e-6)
        np.testing.assert_allclose(before.t * depth, [2.5, 2.5, 6.5], rtol=1e-6)


def test_posed_draws_of_the_frame_before(gpu):
    """Rays into the previous frame of the demo are answered as by the structure of that frame."""
    scene = load_scene(ASSETS / "demo.glb")
    with traced(gpu, scene, choose_camera(scene), keep_previous=True) as t:
        assert len(t.structure.table.posed)
        t.at(0.6, 0.5)
        earlier: TriangleList = visible_triangles(t.renderer)
        o, d = some_rays(earlier, 20_000)
        move = t.renderer.view(0.6)[1].position - t.renderer.view(0.5)[1].position
        before = t.query(o, d, before=True)
        t.at(0.5)
        now = t.query((o + move).astype(np.float32), d)
    same = (before.draw == now.draw) & (before.triangle == now.triangle)
    assert same.mean() > 0.998
    assert np.isclose(before.t[same], now.t[same], rtol=1e-4, atol=1e-5).mean() > 0.9995
