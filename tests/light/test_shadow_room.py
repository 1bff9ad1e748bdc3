"""Shadow maps that do not fit into one texture of the device are refused in one line."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from shadow_tools import Case

import taubench_gl.gpu.memory as memory
from taubench_gl.errors import GraphicsError
from taubench_gl.frame.passes.shadows import ShadowPass

BOUNDS = ((0.0, 0.0, 0.0), 5.0)


def shadows_on(limit: int, kind: str = "point", size: int = 1024, software: bool = False) -> ShadowPass:
    """The pass on a device whose textures end at ``limit``, which has nothing else: asked for more, it raises."""
    device = SimpleNamespace(ctx=SimpleNamespace(info={"GL_MAX_TEXTURE_SIZE": limit}), software=software)
    scene = Case(kind, 45.0).scene()
    return ShadowPass(
        device, None, scene, [0], BOUNDS, resolution=size, colored_materials=frozenset(), draws=()
    )  # fmt: skip


@pytest.mark.parametrize(("kind", "maps", "texels"), [("point", 6, 1024), ("directional", 1, 4096)])
def test_an_atlas_larger_than_a_texture_is_refused(kind, maps, texels):
    with pytest.raises(
        GraphicsError, match=rf"^{maps} shadow maps? of up to {texels} texels would need .* end at 2048 "
    ) as told:
        shadows_on(2048, kind)
    assert "--shadow-size" in told.value.hint


def test_an_atlas_that_fits_is_asked_for():
    with pytest.raises(AttributeError, match="depth_texture"):
        shadows_on(4096)


def test_an_atlas_that_memory_does_not_hold_is_refused(monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: 10_000_000)
    with pytest.raises(GraphicsError, match="an atlas of 6 shadow maps of up to 1024 texels needs"):
        shadows_on(16384, software=True)
