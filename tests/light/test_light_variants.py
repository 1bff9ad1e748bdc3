"""The light passes have two variants, one for llvmpipe and one for GPUs, with the same results bit for bit."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from light_tools import lambert, look, opened, shoot
from test_shadow_cache import street

from taubench_gl.frame.tuning import Tuning
from taubench_gl.scene.builder import SceneBuilder, box
from taubench_gl.scene.model import Scene

SIZE = {"width": 61, "height": 43, "shadow_size": 64, "probes": 60, "indirect_samples": 128}
"""No multiple of any work group."""
LOBES = ("direct_diffuse", "direct_glossy")


def lamps() -> Scene:
    """More lights than are compiled one by one, all kinds, some of them with shadow maps; faces that see none."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(box((3.0, 1.5, 3.0), inside=True, material=lambert(b))))
    shiny = b.material(metallic=0.5, roughness=0.3)
    b.node(mesh=b.mesh(box((0.5, 0.5, 0.5), material=shiny)), translation=(0.3, -0.6, 0.2))
    b.light(kind="directional", intensity=0.5)
    for i in range(20):
        kind = "spot" if i % 3 == 0 else "point"
        b.light(kind=kind, translation=(0.25 * i - 2.5, 0.2 + 0.03 * i, 0.8), intensity=1.0, range=4.0)
    look(b, (-2.0, 0.8, 2.5), (0.3, -0.5, 0.2), yfov=1.1)
    return b.build()


@pytest.mark.parametrize("storage", ["float", "half"])
@pytest.mark.parametrize("indirect", ["probes", "rsm"])
@pytest.mark.parametrize("make", [street, lamps])
def test_both_ways_give_the_same_bits(gpu, monkeypatch, make, indirect, storage):
    if not gpu.software:
        pytest.skip("compilers of GPUs fuse a multiply and an add in one variant and not in the other")
    monkeypatch.setattr(Tuning, "snapped_corners", False)  # both draw the same positions
    settings = {"columns": ("direct", "indirect", "color"), "indirect": indirect, "storage": storage, **SIZE}
    settings |= {"environment": (0.1, 0.2, 0.3), "shadow_lights": 4}
    found = []
    for software in (True, False):
        device = dataclasses.replace(gpu, software=software)
        with opened(device, make(), extra=LOBES, **settings) as source:
            shoot(source, 0)
            shoot(source, 5)
            found.append({name: source.read(name) for name in (*LOBES, "direct", "indirect", "color")})
    one, other = found
    for name, values in one.items():
        assert np.isfinite(values).all() and np.ptp(values[..., :3].astype(np.float32)) > 0
        assert np.array_equal(values, other[name]), name
