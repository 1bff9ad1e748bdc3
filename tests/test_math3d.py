"""Rotations of matrices that have none, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.math3d import affine, bounds, orthonormal

S = 0.5**0.5
ROTATIONS = {  # columns of a matrix -> columns of its rotation
    "scale": (((2, 0, 0), (0, 3, 0), (0, 0, 4)), ((1, 0, 0), (0, 1, 0), (0, 0, 1))),
    "mirror": (((-1, 0, 0), (0, 1, 0), (0, 0, 1)), ((1, 0, 0), (0, 1, 0), (0, 0, 1))),
    "shear": (((1, 0, 0), (0, 2, 2), (0, 0, 1)), ((1, 0, 0), (0, 1, 0), (0, 0, 1))),
    "without Z": (((0, 3, 0), (-2, 0, 0), (0, 0, 0)), ((0, 1, 0), (-1, 0, 0), (0, 0, 1))),
    "without Y": (((2, 0, 0), (0, 0, 0), (0, 3, 0)), ((1, 0, 0), (0, 0, -1), (0, 1, 0))),
    "Z alone": (((0, 0, 0), (0, 0, 0), (5, 0, 5)), ((S, 0, -S), (0, 1, 0), (S, 0, S))),
    "Z along the world's Y": (((0, 0, 0), (0, 0, 0), (0, 5, 0)), ((-1, 0, 0), (0, 0, 1), (0, 1, 0))),
    "nothing": (((0, 0, 0), (0, 0, 0), (0, 0, 0)), ((1, 0, 0), (0, 1, 0), (0, 0, 1))),
}


@pytest.mark.parametrize("name", ROTATIONS)
def test_rotation_of_a_matrix(name: str) -> None:
    matrix, expected = (np.array(columns, float).T for columns in ROTATIONS[name])
    assert orthonormal(matrix) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("count", [1, 63, 1024, 1087, 5000])
@pytest.mark.parametrize("columns", [1, 3, 16])
def test_bounds_are_those_of_each_column(count, columns):
    points = np.random.default_rng(count).normal(size=(count, columns)).astype(np.float32)
    for made in (points, points[::-1], np.asfortranarray(points)):
        low, high = bounds(made)
        assert np.array_equal(low, points.min(axis=0)) and np.array_equal(high, points.max(axis=0))


def test_bounds_show_what_is_not_finite():
    points = np.zeros((3000, 3), np.float32)
    points[1500, 1] = np.nan
    assert np.isnan(bounds(points)).tolist() == 2 * [[False, True, False]]


@pytest.mark.parametrize(("turns", "moves"), [((), (4,)), ((4,), ()), ((3, 1), (4,))])
def test_one_rotation_goes_with_many_translations(turns, moves):
    rng = np.random.default_rng(1)
    turn, move, point = rng.normal(size=(*turns, 3, 3)), rng.normal(size=(*moves, 3)), rng.normal(size=3)
    made = affine(turn, move)
    assert made.shape == (*np.broadcast_shapes(turns, moves), 4, 4)
    moved = made @ np.append(point, 1.0)
    assert moved[..., :3] == pytest.approx(turn @ point + move, abs=1e-14) and (moved[..., 3] == 1.0).all()
