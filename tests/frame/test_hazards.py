"""No pass of a frame reads what another wrote before a barrier of the right kind, and no two images share a unit."""

from __future__ import annotations

import numpy as np
import pytest
from fixed import fixed_settings
from hazards import FETCH, IMAGE, Hazards
from repeated import few

from taubench_gl.animation.pairs import reprojection
from taubench_gl.features import FEATURES
from taubench_gl.frame.passes.masks import MaskPass
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import EXACT, AnimatedScene
from taubench_gl.gpu.hazards import Hazards as GpuHazards
from taubench_gl.scene.builder import SceneBuilder, quad
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.scenes import busy_room

ALL = ("frustum", "position", "normal", "direct", "indirect", "color")
LOBES = ("direct_diffuse", "direct_glossy")
SIZE = (48, 32)


def glowing_card() -> Scene:
    """An emitter and no light: no direct light comes between drawing and color."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(material=b.material(emissive=(1.0, 0.5, 0.25)))), translation=(0.0, 0.0, -3.0))
    b.camera()
    return b.build()


def run(gpu, scene: Scene, *, shading: Shading = EXACT, extra: tuple[str, ...] = (), **settings) -> None:
    """Three frames and the masks of each pair, read back."""
    settings = fixed_settings(width=SIZE[0], height=SIZE[1], fps=8.0, probes=64, indirect_samples=256, **settings)
    with RasterSource(gpu, AnimatedScene(scene), settings, shading=shading, extra=extra) as source:
        radiance = source.radiance if shading.exact else ()
        masks = source.own(MaskPass.for_source(source.context, source, settings, radiance=radiance, images=True))
        before = source.advance(0)
        for frame in (1, 2):
            now = source.advance(frame)
            pair = reprojection(now, before, *SIZE)
            masks.run(pair, dict.fromkeys(FEATURES, 0.1), source.current, source.previous)
            before = now
            assert masks.read().mask_histogram.sum() == SIZE[0] * SIZE[1]
            for texture in (masks.mask, masks.motion, *source.current.values()):
                assert len(np.frombuffer(texture.read(), np.uint8))
    gpu.collect()


CASES = {
    "geometry alone": (lambda: busy_room(), {"columns": ("frustum", "position", "normal")}),
    "half storage": (lambda: busy_room(lamps=2), {"columns": ALL, "storage": "half"}),
    "emission alone": (glowing_card, {"columns": ALL}),
    "few lights": (lambda: busy_room(lamps=2), {"columns": ALL, "environment": (0.1, 0.1, 0.1)}),
    "more lights than are unrolled": (lambda: busy_room(lamps=20), {"columns": ALL, "extra": LOBES}),
    "no visibility": (lambda: busy_room(lamps=2), {"columns": ALL, "indirect": "rsm"}),
    "stochastic light": (
        lambda: busy_room(lamps=20),
        {"columns": ALL, "shading": Shading(light_samples=1, indirect_samples=1)},
    ),
    "half of the pixels": (lambda: busy_room(lamps=20), {"columns": ALL, "shading": Shading(rate="half")}),
}


@pytest.mark.parametrize("case", few(CASES, 4))
def test_every_read_is_behind_its_barrier(gpu, monkeypatch, case):
    make, how = CASES[case]
    watched = Hazards(gpu, monkeypatch)
    run(gpu, make(), **how)
    assert watched.dispatches >= 2
    assert not watched.faults, sorted(set(watched.faults))


@pytest.mark.parametrize(("kept", "read"), [(0, "image"), (IMAGE, "sampler"), (FETCH, "storage buffer")])
def test_the_watch_finds_a_missing_barrier_and_one_of_the_wrong_kind(gpu, monkeypatch, kept, read):
    """The barriers of a frame, of which only the bits ``kept`` arrive."""
    watched = Hazards(gpu, monkeypatch)
    monkeypatch.setattr(GpuHazards, "_barrier", lambda hazards, bits: hazards._ctx.memory_barrier(bits & kept))
    run(gpu, busy_room(lamps=20), columns=ALL)
    assert any(fault.startswith(read) for fault in watched.faults), sorted(set(watched.faults))


def test_the_watch_finds_images_that_share_a_unit(gpu, monkeypatch):
    watched = Hazards(gpu, monkeypatch)
    texture = gpu.ctx.texture((8, 8), 4, dtype="f4")
    program = gpu.ctx.compute_shader("""#version 450
        layout(local_size_x = 8) in;
        layout(rgba32f, binding = 3) readonly uniform image2D lights;
        layout(rgba32f, binding = 3) readonly uniform image2D position;
        layout(rgba32f, binding = 0) writeonly uniform image2D result;
        void main() {
            ivec2 at = ivec2(gl_LocalInvocationID.xy);
            imageStore(result, at, imageLoad(lights, at) + imageLoad(position, at));
        }""")
    for unit in (0, 3):
        texture.bind_to_image(unit)
    program.run()
    gpu.ctx.memory_barrier()
    assert {"image lights shares unit 3", "image position shares unit 3"} <= set(watched.faults)
    for item in (texture, program):
        item.release()
