"""What a frame is said to take before anything of it exists, against what the process takes then."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from fixed import fixed_settings

from taubench_gl.errors import GraphicsError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.frame.memory import memory_of_frame
from taubench_gl.frame.plan import frame_spec
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.memory_budget import VARIABLE
from taubench_gl.scene.builder import SceneBuilder, box, quad
from taubench_gl.scene.memory import DRAW_BYTES, memory_of
from taubench_gl.settings import Settings

MEASURE = """
import json, re, sys
from pathlib import Path
sys.path[:0] = [sys.argv[4], str(Path(sys.argv[4]).parent)]
from test_memory_of_frames import plate, settings_of
from taubench_gl.frame.memory import memory_of_frame
from taubench_gl.frame.plan import frame_spec
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import open_gpu

def peak():
    # ru_maxrss would be that of the program that started this one.
    return int(re.search(r"VmHWM:\\s*(\\d+) kB", Path("/proc/self/status").read_text())[1]) * 1024

def draw(width, cells):
    settings, animated = settings_of(width, sys.argv[3]), AnimatedScene(plate(cells))
    source = RasterSource(gpu, animated, settings)
    source.advance(0), source.advance(1), gpu.ctx.finish()
    return source, memory_of_frame(frame_spec(animated, settings))

with open_gpu() as gpu:
    kept = draw(32, 2)
    before = peak()
    source, sums = draw(int(sys.argv[1]), int(sys.argv[2]))
    print(json.dumps([sums, peak() - before]))
"""


def plate(cells: int):
    b = SceneBuilder()
    matte = b.material(metallic=0.0)
    b.node(mesh=b.mesh(quad(1.0, 1.0, cells=(cells, cells), material=matte)), translation=(0.0, 0.0, -2.0))
    b.light(translation=(0.0, 0.0, 1.0))
    b.camera(yfov=1.0, znear=0.1)
    return b.build()


def settings_of(width: int, light: str = "raster") -> Settings:
    return fixed_settings(
        width=width, height=width * 9 // 16, light=light, indirect="none" if light == "raster" else "auto", spp=1,
        bounces=1, shadow_lights=0, columns=("position", "normal", "direct", "color"),
    )  # fmt: skip


def measured(width: int, cells: int, light: str) -> tuple[dict[str, int], int]:
    """Bytes by kind as added up, and by how many the largest memory of a process grows."""
    words = [sys.executable, "-c", MEASURE, str(width), str(cells), light, str(Path(__file__).parent)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return tuple(json.loads(done.stdout))


@pytest.mark.parametrize("width", [640, 1920, pytest.param(3200, marks=pytest.mark.long)])
@pytest.mark.long
def test_channels_take_what_is_added_up(width):
    sums, growth = measured(width, 2, "raster")
    assert sums["channels"] > 0.99 * sum(sums.values()) and sums["rays"] == 0
    assert 0.8 * growth < sum(sums.values()) < 1.2 * growth


@pytest.mark.parametrize("cells", [300, pytest.param(700, marks=pytest.mark.long)])
@pytest.mark.long
def test_structures_of_rays_take_at_most_what_is_added_up(cells):
    """Beside what the same scene takes without them."""
    _, without = measured(64, cells, "raster")
    sums, growth = measured(64, cells, "path-traced")
    assert 0.25 * sums["rays"] < growth - without < sums["rays"]


def test_a_frame_that_is_too_large_is_refused_before_it_exists(monkeypatch):
    settings = settings_of(1920)
    sums = memory_of_frame(frame_spec(AnimatedScene(plate(2)), settings))
    monkeypatch.setenv(VARIABLE, f"{sum(sums.values()) // 2}")
    with pytest.raises(GraphicsError) as refused:
        evaluate_scene(plate(2), settings.replace(frames=(0, 2)))
    assert "--max-memory" in refused.value.hint and "\n" not in str(refused.value)
    evaluate_scene(plate(2), settings_of(640).replace(frames=(0, 2)))


def test_exact_visibility_has_structures_of_two_frames():
    plain, exact = (
        memory_of_frame(frame_spec(AnimatedScene(plate(100)), settings_of(64).replace(exact=exact)))["rays"]
        for exact in (False, True)
    )
    assert plain == 0 and exact >= 100 * 100 * 2 * 48


def test_every_draw_of_a_mesh_is_added_up():
    b = SceneBuilder()
    mesh = b.mesh(quad(), box())
    for x in range(3):
        b.node(mesh=mesh, translation=(float(x), 0.0, 0.0))
    b.node(mesh=b.mesh(quad()))
    assert memory_of(b.build())["instances"] == (3 * 2 + 1) * DRAW_BYTES
