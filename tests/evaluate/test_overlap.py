"""Overlapping passes give the results of passes that are waited for: no pass reads unfinished data."""

from __future__ import annotations

import pytest
from fixed import fixed_settings
from repeated import few

from taubench_gl.animation import choose_camera
from taubench_gl.evaluation import Session, plan_scene
from taubench_gl.gpu.context import Gpu
from taubench_gl.paths import ASSETS
from taubench_gl.scene import load_scene

pytestmark = pytest.mark.usefixtures("coarse_light")

FRAMES = range(20, 24)


@pytest.mark.parametrize("reprojection", few(["motion", "camera"]))
def test_overlapping_passes_give_the_same_counts(gpu: Gpu, reprojection: str) -> None:
    scene = load_scene(ASSETS / "demo.glb")
    settings = fixed_settings(width=640, height=360, frames=(FRAMES.start, FRAMES.stop), reprojection=reprojection)
    rows = []
    for every in (1, 1 << 20, 1 << 20):
        with Session(plan_scene(scene, settings, choose_camera(scene)), every=every) as session:
            assert len(list(session.pairs())) == 3
            rows.append(session.tally.rows)
    assert len(rows[0]) == 3 and all(row["direct"] > 0 and row["normal"] > 0 for row in rows[0])
    assert rows[0] == rows[1] == rows[2]
