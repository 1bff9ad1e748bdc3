"""AFF and OBJ scenes on the GPU: positions, normals and motion vectors against float64 ray casting; complete runs."""

from __future__ import annotations

import numpy as np
import obj_files
import pytest
from aff_files import keys, write
from frame_tools import looking_at, still_camera
from test_rays import Seen, check_motion, check_normals, check_positions

from taubench_gl.animation import choose_camera
from taubench_gl.frame.geometry import build_geometry
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Camera

pytestmark = pytest.mark.usefixtures("fixed_light")

WORLD = """
v
from 0 1 7
at 0 0 0
up 0 1 0
angle 45
hither 0.1
resolution 96 54
l 2 5 4 .6 .6 .6
fm 0 0 0  .6 .5 .4  .1 .1 .1  20 0 1
p 4  -6 -1.5 6  6 -1.5 6  6 -1.5 -6  -6 -1.5 -6
x ball { s 0 0 0 0.8  c 0 0 0 .3  1.6 0 0 .1 }
xs 1 2 1  1 1 0 30  -2 0 -1 { m vertices 4 -1 -1 0 1 -1 0 1 1 0 -1 1 0 triangles 2 0 1 2 0 2 3 }
tpa 3 0  1 -1 1 0 0 1  2.5 -1 1 0 0 1  1 1 1 0 0 1
      1  1 -1 0 0 .3 1  2.5 -1 1 0 0 1  1.4 1 1 .2 0 1
      2  1 -1 1 0 0 1  2.8 -.4 1 0 0 1  1 1 1 0 0 1
a 0 2 48
"""


def aff_world() -> str:
    rng = np.random.default_rng(4)
    times = np.array([-0.5, 0.0, 0.7, 1.1, 2.0, 2.5])[:, None]
    tcb = rng.uniform(-0.4, 0.4, (6, 3))
    place = np.hstack([times, rng.uniform(-0.8, 0.8, (6, 3)), tcb])
    spin = np.hstack([times, np.tile([0.1, 1.0, 0.3], (6, 1)), np.cumsum(rng.uniform(100, 400, (6, 1)), axis=0), tcb])
    eye = np.hstack([times, np.array([0, 1, 7.0]) + rng.uniform(-0.5, 0.5, (6, 3)), tcb])
    look = np.hstack([times, rng.normal(size=(6, 3)) * 0.1 + [1, 0.2, 0], rng.uniform(-12, -4, (6, 1)), tcb])
    return (
        WORLD
        + f"k ball {{ transl {keys(place)} rot {keys(spin)} }}\nk camera {{ transl {keys(eye)} rot {keys(look)} }}"
    )


@pytest.mark.parametrize("time", [0.25, 0.9, 1.75])
def test_aff_motion(gpu, tmp_path, time):
    scene = load_scene(write(tmp_path, aff_world()))
    seen = Seen(gpu, scene, choose_camera(scene), time)
    check_positions(seen)
    check_motion(seen)
    check_normals(seen)
    assert len(np.unique(seen.triangles.record[seen.hits.triangle[seen.hits.triangle >= 0]])) >= 4
    # check_motion compares with float64 at every pixel, to less than 0.01 px; here: every kind of motion occurs.
    motion, record = np.linalg.norm(seen.result.motion, axis=-1), seen.result.current["ids"][..., 0]
    moved = {name: motion[record == row + 1].max(initial=0.0) for row, name in enumerate(drawn_names(scene))}
    assert moved["ball"] > 1.0 and moved["animated triangles"] > 0.3, moved


def drawn_names(scene) -> list[str]:
    """Node names of the rows of the record table."""
    nodes = [scene.nodes.names[d.node] for d in build_geometry(scene).draws]
    return ["animated triangles" if "animated triangles" in name else name for name in nodes]


def swing(t: float):
    return lambda x, y: np.stack([x + 0.2 * np.sin(t + y), y * (1 + 0.1 * t), 0.3 * np.sin(2 * x + 3 * t)], axis=-1)


@pytest.mark.parametrize("smooth", [True, False])
def test_obj_motion(gpu, tmp_path, smooth):
    for i in range(5):
        obj_files.write(tmp_path, obj_files.grid(swing(0.1 * i), 9, smooth=smooth), f"s{i}.obj")
    scene = load_scene(tmp_path)
    camera = still_camera(Camera(yfov=0.8), (0.5, 0.7, 3.5), looking_at((0.5, 0.7, 3.5), (0, 0, 0)))
    for frame in (1, 3, 4):
        seen = Seen(gpu, scene, camera, frame / 24)
        check_positions(seen)
        check_motion(seen)
        if smooth:
            check_normals(seen)
        assert np.linalg.norm(seen.result.motion, axis=-1).max() > 0.3
