"""Virtual lights that do not fit into a texture or a buffer of the device are refused in one line."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from taubench_gl.errors import GraphicsError
from taubench_gl.frame.passes.indirect import IndirectPass
from taubench_gl.selftest.scenes import SceneBuilder, box
from taubench_gl.settings import Settings

BOX = np.array([-2.0, -2.0, -2.0]), np.array([2.0, 2.0, 2.0])


def indirect_on(texels: int, buffers: int = 1 << 27, **settings) -> IndirectPass:
    """The pass on a device whose textures and buffers end there, which has nothing else: asked for more, it raises."""
    limits = {"GL_MAX_TEXTURE_SIZE": texels, "GL_MAX_SHADER_STORAGE_BLOCK_SIZE": buffers}
    device = SimpleNamespace(ctx=SimpleNamespace(info=limits), software=False)
    s = SceneBuilder()
    s.node(mesh=s.mesh(box((1.0, 1.0, 1.0), inside=True)))
    s.light(kind="point")
    chosen = Settings.of(**{"indirect": "probes", **settings})
    bounds = np.zeros(3), 3.0
    return IndirectPass(device, None, s.build(), [0], bounds, BOX, (64, 48), chosen, frozenset(), draws=())


@pytest.mark.parametrize(
    ("samples", "told"),
    [
        (
            2_000_000,
            r"^1997574 virtual lights in 6 reflective shadow maps would need 256x31213 texels, .* at 16384 ",
        ),
        (200_000_000, r"^199965174 virtual lights in 6 .* would need 5773x34638 texels, .* end at 16384 "),
    ],
)
def test_more_virtual_lights_than_a_texture_holds_are_refused(samples, told):
    with pytest.raises(GraphicsError, match=told) as refusal:
        indirect_on(16384, indirect_samples=samples)
    assert "--shadow-lights" in refusal.value.hint


def test_virtual_lights_that_fit_are_asked_for():
    with pytest.raises(AttributeError, match="depth_texture"):
        indirect_on(16384, indirect_samples=500_000, indirect="rsm")


def test_sight_larger_than_a_buffer_is_refused():
    told = r"^what 729 probes see of 1014 virtual lights in 6 .* needs 93312 bytes, .* end at 90000 "
    with pytest.raises(GraphicsError, match=told):
        indirect_on(16384, 90_000, probes=700)
