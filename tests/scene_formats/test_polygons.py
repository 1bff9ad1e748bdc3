"""Polygons that are not convex: areas and covered points of OBJ and AFF faces against the polygon itself."""

from __future__ import annotations

import numpy as np
import pytest
from obj_files import write
from scipy.spatial.transform import Rotation

from taubench_gl.scene import load_scene
from taubench_gl.scene.polygons import cut_polygons

BOW_TIE = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]], dtype=float)
WALL = np.array([[0, 0], [1, 1], [1, 2], [3, 2], [3, 1], [1, 1], [0, 0], [4, 0], [4, 3], [0, 3]], dtype=float)
"""4 x 3 with a window of 2 x 1 and a bridge to it."""


def placed(scene) -> np.ndarray:
    """Corners of all triangles (T, 3, 3)."""
    return np.concatenate([p.positions[p.triangles] for mesh in scene.meshes for p in mesh.primitives]).astype(float)


def areas(triangles: np.ndarray) -> np.ndarray:
    """Area vectors (T, 3)."""
    return 0.5 * np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def inside(outline: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Even-odd rule in the plane; ``outline`` (n, 2), ``points`` (m, 2) -> (m,) bool."""
    (x0, y0), (x1, y1) = outline.T[:, :, None], np.roll(outline, -1, axis=0).T[:, :, None]
    x, y = points.T
    crosses = (y0 > y) != (y1 > y)
    at = x0 + (y - y0) / np.where(y1 == y0, 1.0, y1 - y0) * (x1 - x0)
    return np.count_nonzero(crosses & (x < at), axis=0) % 2 == 1


def covered(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How many of the triangles (T, 3, 2) contain each point (m,)."""
    return sum(inside(triangle, points).astype(int) for triangle in triangles)


def simple_polygon(rng: np.random.Generator, corners: int) -> np.ndarray:
    """An outline around the origin that no ray from there meets twice, in random distances.  (n, 2), n >= 4."""
    angles = (np.arange(corners) + rng.uniform(0.0, 0.9, corners)) * (2 * np.pi / corners)
    return rng.uniform(0.1, 1.0, corners)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def test_random_simple_polygons_in_any_plane():
    rng = np.random.default_rng(7)
    outlines, points, places = [], [], []
    for _ in range(200):
        outline = np.roll(simple_polygon(rng, int(rng.integers(4, 24))), int(rng.integers(24)), axis=0)
        place = Rotation.random(rng=rng), rng.uniform(-100, 100, 3)
        outlines.append(outline), places.append(place)
        points.append(place[0].apply(np.pad(outline, ((0, 0), (0, 1)))) + place[1])
    sizes = np.array([len(outline) for outline in outlines])
    corners = np.concatenate(points)
    fans, drawn, crossing = cut_polygons(corners, sizes)
    assert len(crossing) == 0 and len(fans) == (sizes - 2).sum() and drawn is not fans
    owner = np.searchsorted(np.cumsum(sizes), drawn, side="right")
    assert np.all(owner == owner[:, :1])
    for k, (outline, (turn, _)) in enumerate(zip(outlines, places, strict=True)):
        x, y = outline.T
        expected = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
        along = areas(corners[drawn[owner[:, 0] == k]]) @ turn.apply([0, 0, 1])
        assert np.all(along * np.sign(expected) > -1e-9)  # none is wound the other way, so none overlaps
        assert np.abs(along).sum() == pytest.approx(abs(expected), rel=1e-6)


def test_fans_stay_where_they_cover_the_polygon():
    angles = np.linspace(0, 2 * np.pi, 9)[:-1]
    convex = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    # The first corner of the arrow sees all others.
    arrow = np.array([[0, 0, 0], [2, -1, 0], [1, 0, 0], [2, 1, 0]], dtype=float)
    fans, drawn, crossing = cut_polygons(np.concatenate([convex, arrow]), np.array([8, 4]))
    assert drawn is fans and len(crossing) == 0
    np.testing.assert_array_equal(fans[:6], [[0, k, k + 1] for k in range(1, 7)])
    _, drawn, _ = cut_polygons(np.roll(arrow, -1, axis=0), np.array([4]))
    assert np.linalg.norm(areas(np.roll(arrow, -1, axis=0)[drawn]), axis=1).sum() == pytest.approx(1.0)


@pytest.mark.parametrize("start", range(len(WALL)))
def test_a_window_stays_open_whatever_corner_comes_first(start, tmp_path):
    outline = np.roll(WALL, -start, axis=0)
    lines = [f"v {x} {y} 0" for x, y in outline] + ["f " + " ".join(str(k + 1) for k in range(len(outline)))]
    triangles = placed(load_scene(write(tmp_path, "\n".join(lines))))
    np.testing.assert_allclose(areas(triangles).sum(axis=0), [0, 0, 10], atol=1e-6)
    points = np.random.default_rng(start).uniform([-1, -1], [5, 4], (4000, 2))
    np.testing.assert_array_equal(covered(triangles[..., :2], points), inside(WALL, points))


def test_aff_polygons_of_any_shape(tmp_path):
    corners = "\n".join(f"{x} {y} 0" for x, y in WALL)
    tie = "\n".join(" ".join(map(str, corner)) for corner in BOW_TIE + [0, 0, 5])
    square = "0 0 9\n1 0 9\n1 1 9\n0 1 9"
    file = tmp_path / "wall.aff"
    file.write_text(f"f 1 1 1 1 0 0 0 1\np {len(WALL)}\n{corners}\np 4\n{square}\np 4\n{tie}\n")
    scene = load_scene(file)
    triangles = placed(scene)
    for z, area in ((0, 10.0), (9, 1.0)):
        assert np.linalg.norm(areas(triangles[triangles[:, 0, 2] == z]), axis=1).sum() == pytest.approx(area)
    assert [n.count for n in scene.notes if n.kind == "polygon-crossing"] == [1]


def test_an_outline_that_crosses_itself_is_noted(tmp_path):
    lines = [f"v {x} {y} {z}" for x, y, z in BOW_TIE] + ["f 1 2 3 4", "f 1 3 2"]
    scene = load_scene(write(tmp_path, "\n".join(lines)))
    assert [(n.kind, n.count, n.where) for n in scene.notes] == [("polygon-crossing", 1, "scene.obj:5")]
    assert len(placed(scene)) == 3


def test_a_polygon_that_deforms_keeps_its_triangles(tmp_path):
    """The faces of a sequence are those of the files, however each frame's shape would be cut."""
    for frame, tip in enumerate((0.2, 1.8, 0.2)):  # concave, convex, concave
        points = [(1, tip), (0, 1), (-1, 0), (2, 0), (2, 1)]
        lines = [f"v {x} {y} 0" for x, y in points] + ["f 1 2 3 4 5"]
        (tmp_path / f"f{frame}.obj").write_text("\n".join(lines))
    scene = load_scene(tmp_path)
    assert len(scene.meshes) == 1 and not scene.replacements
    assert len(scene.meshes[0].primitives[0].targets) == 1
