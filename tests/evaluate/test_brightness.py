"""Pixels that count as black, lit and clipped, at surfaces of known display color."""

from __future__ import annotations

import pytest

from taubench_gl.evaluation import evaluate_scene
from taubench_gl.scene.builder import SceneBuilder, quad
from taubench_gl.settings import Settings

pytestmark = pytest.mark.usefixtures("coarse_light")

SIZE = (24, 16)


@pytest.mark.parametrize(
    ("display", "counted"), [(0.45 / 255, "black"), (0.55 / 255, "lit"), (0.9 / 255, "lit"), (1.0, "clipped")]
)
def test_pixels_are_counted_by_their_display_color(display, counted):
    """An emissive plane that fills the image; up to 0.04045 sRGB is 12.92 times the radiance."""
    radiance = display / 12.92 if display < 0.04 else display
    b = SceneBuilder()
    plane = b.material(base_color=(0.0, 0.0, 0.0, 1.0), specular=0.0, emissive=(radiance,) * 3, double_sided=True)
    b.node(mesh=b.mesh(quad(20.0, 20.0, material=plane)), translation=(0.0, 0.0, -2.0))
    b.light(translation=(0.0, 0.0, -30.0), intensity=1.0)
    camera = b.camera(translation=(0.0, 0.0, 0.0), yfov=0.7, znear=0.1)
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0)])
    settings = Settings(
        width=SIZE[0], height=SIZE[1], frames=(0, 2), light="raster", indirect="none", environment="none", exposure=1.0,
        light_unit="candela", storage="float",
    )  # fmt: skip
    found = evaluate_scene(b.build(), settings).summary["brightness"]
    pixels = SIZE[0] * SIZE[1] * found["frames"]
    expected = {
        "black": {"black": pixels, "lit": 0, "clipped": 0},
        "lit": {"black": 0, "lit": pixels, "clipped": 0},
        "clipped": {"black": 0, "lit": pixels, "clipped": pixels},
    }
    assert found["pixels"] == pixels > 0
    assert {name: found[name] for name in expected[counted]} == expected[counted]
