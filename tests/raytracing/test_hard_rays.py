"""Closed forms of hard cases: shared edges, small gaps, large offsets and scales, mirrors, degenerate triangles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from frame_tools import make_scene, primitive, quad, room, still_camera
from ray_tools import directions, traced, visible_triangles

from taubench_gl.frame.raytracing import structure
from taubench_gl.scene import builder
from taubench_gl.scene.model import Camera, Channel

Array = np.ndarray


def floor_and_wall(scale: float = 1.0):
    """A floor and a wall that share the edge x in [-1, 1], y = z = 0, as two draws of many triangles."""
    wall = builder.quad(1.0, 0.5, cells=(7, 7))
    p = scale * (wall.positions + (0.0, 0.5, 0.0))
    return tuple(primitive(corners, wall.triangles) for corners in (p[:, [0, 2, 1]], p))


def rays_at(points: Array, origin: Array) -> tuple[Array, Array]:
    d = points - origin
    d = d / np.linalg.norm(d, axis=1, keepdims=True)
    return np.broadcast_to(origin, d.shape).astype(np.float32), d.astype(np.float32)


@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_no_ray_leaks_through_a_shared_edge(gpu, scale, offset):
    """A hundred thousand rays at edges and corners of the floor and of the wall, the common edge among them."""
    floor, wall = floor_and_wall(scale)
    origin = (offset, -offset, offset)
    camera = still_camera(Camera(), origin)
    with traced(gpu, make_scene(floor, wall, origin=origin), camera) as t:
        rng = np.random.default_rng(7)
        n = 100_000
        steps = np.linspace(-0.95, 0.95, 15)
        x = np.where(rng.random(n) < 0.3, rng.choice(steps, n), rng.uniform(-0.95, 0.95, n))
        other = np.where(rng.random(n) < 0.5, 0.0, rng.choice(np.linspace(0, 0.9, 8), n))
        on_floor = rng.random(n) < 0.5
        p = np.where(on_floor[:, None], np.column_stack([x, 0 * x, other]), np.column_stack([x, other, 0 * x])) * scale
        o, d = rays_at(p, np.array([0.31, 0.77, 0.63]) * scale)
        hits = t.query(o, d)
        assert (hits.draw >= 0).all()
        np.testing.assert_allclose(hits.t, np.linalg.norm(p - o, axis=1), rtol=2e-6)
        assert (t.query(o, d, any_hit=True).draw >= 0).all()


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_gaps_of_a_ten_thousandth_of_the_distance_are_resolved(gpu, scale):
    """Sheets one behind the other, 1e-4 of the distance apart: the first is hit, and a ray between them sees both."""
    z = -10.0 * scale
    gap = 1e-4 * abs(z)
    sheets = [quad((-9 * scale, -9 * scale, z - k * gap), (18 * scale, 0, 0), (0, 18 * scale, 0)) for k in range(3)]
    with traced(gpu, make_scene(*sheets)) as t:
        d = directions(20_000)
        d = d[d[:, 2] < -0.75]
        hits = t.query(np.zeros_like(d), d)
        assert (hits.draw == 0).all()
        np.testing.assert_allclose(hits.t, z / d[:, 2], rtol=2e-6)
        middle = np.tile(np.float32([0.3 * scale, 0.2 * scale, z - 0.5 * gap]), (len(d), 1))
        assert (t.query(middle, d).draw == 1).all()
        assert (t.query(middle, -d).draw == 0).all()


def test_equal_distances_go_to_the_lower_primitive(gpu):
    """Three times the same wall, in one merged tree and in trees of moving draws."""
    wall = quad((-1, -1, -2), (2, 0, 0), (0, 2, 0))
    times = np.array([0.0, 1.0])
    still = np.zeros((2, 3))
    moving = tuple(
        Channel("node", node, "translation", "LINEAR", times, np.array([[0, 0, 0], [node, 0, 0]])) for node in (1, 3)
    )
    for channels in ((), moving, (replace(moving[0], values=still), moving[1])):
        with traced(gpu, make_scene(wall, wall, wall, channels=channels)) as t:
            o, d = rays_at(np.random.default_rng(2).uniform(-0.9, 0.9, (500, 3)) * (1, 1, 0) - (0, 0, 2), np.zeros(3))
            assert (t.query(o, d).draw == 0).all()


def spun(i: int, axis=(0.3, 0.5, 0.8)) -> Array:
    from scipy.spatial.transform import Rotation

    out = np.eye(4)
    out[:3, :3] = Rotation.from_rotvec(np.array(axis) * i).as_matrix()
    return out


def placed(kind: str) -> Array:
    out = spun(1)
    scales = {"mirrored": (-1, 1, 1), "skewed": (1, 3, 0.2), "zero": (0, 0, 0), "tiny": (1e-3,) * 3, "huge": (1e4,) * 3}
    out[:3, :3] = out[:3, :3] @ np.diag(scales[kind])
    out[:3, 3] = (2.0, -1.0, 0.5)
    return out


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("kind", ["mirrored", "skewed", "zero", "tiny", "huge"])
def test_instances_of_any_scale_and_hand(gpu, kind, moving):
    """A room with all but one wall, against the float64 caster.  An instance of scale 0 is never hit."""
    from ray_caster import cast, gather

    box = replace(room(1.0), triangles=room(1.0).triangles[:-2])
    matrix = placed(kind)
    scene = make_scene(box, matrices=[matrix])
    if moving:  # the parent moves, after time 0
        keys = np.array([[0.0, 0, 0], [1.0, 0, 0]])
        scene = replace(scene, channels=(Channel("node", 0, "translation", "LINEAR", np.array([0.0, 1.0]), keys),))
    middle = tuple(matrix[:3, 3])
    with traced(gpu, scene, still_camera(Camera(), middle)) as t:
        assert (len(t.structure.table.rigid) == 1) == moving
        size = {"tiny": 1e-3, "huge": 1e4}.get(kind, 1.0)
        d = directions(3000)
        o = np.tile(np.float32([0.1, -0.1, 0.05]) * size, (len(d), 1))
        hits = t.query(o, d)
        if kind == "zero":
            assert (hits.draw == -1).all()
            return
        reference = cast(gather(scene, t.renderer.frame.state, t.renderer.frame.state), o + np.float64(middle),
                         d.astype(np.float64), 0.0, np.inf, cull=False)  # fmt: skip
        sure = np.min(reference.weights, axis=1) > 1e-4
        sure |= reference.triangle < 0
        assert np.mean((hits.draw >= 0) == (reference.triangle >= 0)) > 0.999
        both = sure & (hits.draw >= 0) & (reference.triangle >= 0)
        assert both.sum() > 1000
        np.testing.assert_allclose(hits.t[both], reference.depth[both], rtol=1e-5)
        np.testing.assert_array_equal(hits.triangle[both], reference.triangle[both])
        corners = (2, 1) if kind == "mirrored" else (1, 2)  # the reference turns mirrored triangles around
        np.testing.assert_allclose(hits.weights[both], reference.weights[both][:, corners], atol=2e-5)


def test_degenerate_triangles_are_never_hit_and_hide_nothing(gpu):
    """Points, lines and slivers among a wall; all finite answers."""
    wall = quad((-1, -1, -2), (2, 0, 0), (0, 2, 0))
    point = primitive([[0.1, 0.1, -1]] * 3, [[0, 1, 2]])
    line = primitive([[-1, 0.1, -1], [0, 0.1, -1], [1, 0.1, -1]], [[0, 1, 2]])
    sliver = primitive([[-1, 0.3, -1], [1, 0.3, -1], [0, 0.3 + 1e-7, -1]], [[0, 1, 2]])
    with traced(gpu, make_scene(point, line, sliver, wall)) as t:
        p = np.random.default_rng(4).uniform(-0.95, 0.95, (5000, 3)) * (1, 1, 0) - (0, 0, 2)
        p[:200, :2] = 0.2, 0.2  # through the point
        p[200:400, 1] = 0.2  # through the line
        o, d = rays_at(p, np.zeros(3))
        hits = t.query(o, d)
        assert np.isfinite(hits.t).all() and np.isfinite(hits.weights).all()
        assert np.isin(hits.draw, (2, 3)).all() and np.mean(hits.draw == 3) > 0.99


def test_a_scene_of_nothing_is_missed(gpu):
    hidden = replace(make_scene(quad((-1, -1, -2), (2, 0, 0), (0, 2, 0))))
    nodes = replace(hidden.nodes, visible=np.zeros(len(hidden.nodes), bool))
    with traced(gpu, replace(hidden, nodes=nodes)) as t:
        assert t.structure.table.count == 0
        d = directions(100)
        assert (t.query(np.zeros_like(d), d).draw == -1).all()
        assert t.structure.unfinished_rays == 0


def test_a_moving_mesh_without_finite_corners_adds_no_nodes(gpu):
    """The tree of such a mesh is empty; rays meet the wall behind it, which comes later in the node image."""
    nothing = primitive(np.full((3, 3), np.nan), [[0, 1, 2]])
    wall = quad((-1, -1, -2), (2, 0, 0), (0, 2, 0))
    scene = make_scene(nothing, wall)
    keys = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    moves = tuple(Channel("node", node, "translation", "LINEAR", np.array([0.0, 1.0]), keys) for node in (0, 1))
    with traced(gpu, replace(scene, channels=moves)) as t:
        assert (t.structure._fixed.words[:, 1] > 0).tolist() == [False, True]
        p = np.random.default_rng(4).uniform(-0.95, 0.95, (500, 3)) * (1, 1, 0) - (0, 0, 2)
        assert (t.query(*rays_at(p, np.zeros(3))).draw == 1).all()


def test_thousands_of_equal_triangles(gpu):
    """None separates them: the tree halves them by number, and a ray tests them all within its bound."""
    same = primitive(np.tile([[-1, -1, -1], [1, -1, -1], [0, 1, -1]], (3000, 1)), np.arange(9000).reshape(-1, 3))
    with traced(gpu, make_scene(same)) as t:
        o, d = rays_at(np.array([[0.0, 0.0, -1.0], [0.1, -0.3, -1.0]]), np.zeros(3))
        hits = t.query(o, d)
        assert hits.triangle.tolist() == [0, 0] and t.structure.unfinished_rays == 0


def test_rays_beyond_the_bound_are_counted(gpu, monkeypatch):
    """Sheets behind one another: a ray that may visit too few nodes is counted, once, whatever kind it is."""
    sheets = [quad((-1, -1, -2 - k), (2, 0, 0), (0, 2, 0)) for k in range(40)]
    d = np.tile(np.float32([0, 0, -1]), (64, 1))
    o = np.tile(np.float32([0.1, 0.2, -1]), (64, 1))
    for bound, unfinished in ((10, 64), (structure.MAX_STEPS, 0)):
        monkeypatch.setattr(structure, "MAX_STEPS", bound)
        with traced(gpu, make_scene(*sheets)) as t:
            t.query(o, d)
            assert t.structure.unfinished_rays == unfinished
            t.query(o, -d, any_hit=True)  # nothing there
            assert t.structure.unfinished_rays == unfinished
            t.at(0.0)
            assert t.structure.unfinished_rays == unfinished  # of all frames


def test_a_dome_takes_no_precision_from_a_room(gpu):
    """A shell of 1e6 m around a room of 1 m: trees of their own."""
    with traced(gpu, make_scene(room(1e6), room(1.0))) as t:
        assert len(t.structure.table.merged) == 2
        d = directions(2000)
        hits = t.query(np.zeros_like(d), d)
        assert (hits.draw == 1).all()
        np.testing.assert_allclose(hits.t, 1.0 / np.abs(d).max(axis=1), rtol=1e-6)
        assert (t.query(np.zeros_like(d), d, 0.998, any_hit=True).draw == -1).all()
        assert (t.query(np.zeros_like(d), d, 1.74, any_hit=True).draw >= 0).all()
        assert len(visible_triangles(t.renderer).corners) == 24


def test_a_scene_that_does_not_fit_is_refused_in_one_line(gpu, monkeypatch):
    from taubench_gl.errors import GraphicsError

    if not gpu.software:
        pytest.skip("memory is checked for software rendering only")
    monkeypatch.setattr(structure, "TRIANGLE_BYTES", 1 << 50)
    with pytest.raises(GraphicsError) as error, traced(gpu, make_scene(room())):
        pass
    assert "12 triangles" in str(error.value) and "\n" not in str(error.value)


def test_structures_of_one_scene_share_their_trees(gpu):
    with traced(gpu, make_scene(room())) as t, traced(gpu, t.renderer.scene) as other:
        assert t.structure.resources["trace_nodes"] is other.structure.resources["trace_nodes"]
        d = np.eye(3)
        t.renderer.draw(0.0, 0.0)
        assert t.query(np.zeros_like(d), d).t.tolist() == other.query(np.zeros_like(d), d).t.tolist()
        with traced(gpu, make_scene(room())) as third:
            assert third.structure.resources["trace_nodes"] is not t.structure.resources["trace_nodes"]
