"""Rotations of matrices that have none, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.math3d import orthonormal

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
