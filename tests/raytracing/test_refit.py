"""Trees of posed draws: renewed bounds hold, and rays are answered as by a tree built for the pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from frame_tools import make_scene
from ray_caster import cast, gather
from ray_tools import traced

from taubench_gl.scene import load_scene
from taubench_gl.scene.builder import quad
from taubench_gl.scene.model import Channel, MorphTarget


def sheet(n: int, target_z: float, bad: bool = False):
    """A sheet of 2 n^2 triangles that bends away by a morph target; ``bad``: one vertex goes to infinity."""
    flat = quad(cells=(n, n))
    p, move = flat.positions - np.float32([0, 0, 2]), np.zeros(flat.positions.shape, np.float32)
    move[:, 2] = target_z * p[:, 0] ** 2
    if bad:
        move[0] = 3e38
    return replace(flat, positions=p, targets=(MorphTarget(move),))


def bending(*primitives):
    times, values = np.array([0.0, 1.0]), np.array([[0.0], [1.0]])
    channels = tuple(Channel("node", 1 + i, "weights", "LINEAR", times, values) for i in range(len(primitives)))
    return make_scene(*primitives, channels=channels)


@pytest.mark.parametrize("time", [0.0, 0.4, 1.0])
def test_a_bending_sheet_against_float64(gpu, time):
    scene = bending(sheet(12, -3.0), sheet(5, 1.5))
    with traced(gpu, scene) as t:
        t.at(time)
        state = t.renderer.frame.state
        rng = np.random.default_rng(5)
        d = np.column_stack([rng.uniform(-0.6, 0.6, (3000, 2)), -np.ones(3000)])
        d = (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)
        hits = t.query(np.zeros_like(d), d)
        triangles = gather(scene, state, state)
        reference = cast(triangles, np.zeros(d.shape), d.astype(np.float64), 0.0, np.inf, cull=False)
        sure = (reference.triangle < 0) | (reference.weights.min(axis=1) > 1e-4)
        found = (hits.draw >= 0) & (reference.triangle >= 0) & sure
        assert ((hits.draw >= 0) == (reference.triangle >= 0))[sure].mean() > 0.999 and found.sum() > 1000
        np.testing.assert_allclose(hits.t[found], reference.depth[found], rtol=1e-5)


def test_a_vertex_at_infinity_takes_only_its_triangles_away(gpu):
    with traced(gpu, bending(sheet(8, 0.0, bad=True))) as t:
        t.at(1.0)
        p = np.array([[0.6, 0.65, -2.0], [0.1, 0.15, -2.0], [-0.99, -0.98, -2.0]])
        d = p / np.linalg.norm(p, axis=1, keepdims=True)
        hits = t.query(np.zeros_like(p), d)
        assert hits.draw.tolist() == [0, 0, -1] and np.isfinite(hits.weights).all()


def write_sequence(folder) -> None:
    """A square that approaches by half a meter a frame; from frame 2 on it has another triangulation."""
    for i, faces in enumerate(("f 1 2 3 4\n", "f 1 2 3 4\n", "f 1 2 3\nf 1 3 4\nf 4 3 2 1\n")):
        corners = "".join(f"v {x} {y} {0.5 * i - 4}\n" for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
        (folder / f"s{i}.obj").write_text(f"o square\n{corners}{faces}")


def test_surfaces_that_replace_one_another(gpu, tmp_path):
    """A sequence of OBJ files whose topology changes: at each of its times one surface is there."""
    write_sequence(tmp_path)
    scene = load_scene(tmp_path)
    assert scene.replacements
    d = np.float32([[0.05, 0.1, -1.0]])
    with traced(gpu, scene) as t:
        for frame in (0, 1, 2, 1):
            hits = t.at(frame / 24.0).query(0 * d, d / np.linalg.norm(d))
            np.testing.assert_allclose(hits.t, (4 - 0.5 * frame) * np.linalg.norm(d), rtol=1e-5)
