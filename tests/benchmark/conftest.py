"""Coarse parts of the scenes of suites whose accuracy is no subject here."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from taubench_gl.datasets.free_space import SAMPLES, VOXELS, VoxelSpace, surface_points


@pytest.fixture(scope="module")
def coarse_space() -> Iterator[None]:
    """An eighth of the voxels in which cameras find free space, and points for them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(VoxelSpace.__init__, "__defaults__", (VOXELS // 8,))
        patch.setattr(surface_points, "__defaults__", (SAMPLES // 4,))
        yield
