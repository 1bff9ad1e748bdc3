"""Textures and buffers that the device has no room for are refused before anything is allocated."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from fixed import fixed_settings

import taubench_gl.gpu.memory as memory
from taubench_gl.errors import GraphicsError
from taubench_gl.frame.passes.indirect import indirect_light
from taubench_gl.frame.passes.shadows import shadow_maps
from taubench_gl.frame.spec import AnimatedScene, FrameSpec
from taubench_gl.gpu.passes import require_room
from taubench_gl.scene.builder import SceneBuilder, box

LIT = frozenset({"direct", "shadows", "indirect"})


def needed(stage, kind: str = "point", **settings) -> list:
    """Resources that a stage declares for a room with one light."""
    s = SceneBuilder()
    s.node(mesh=s.mesh(box((1.0, 1.0, 1.0), inside=True)))
    s.light(kind=kind)
    spec = FrameSpec(AnimatedScene(s.build()), fixed_settings(width=64, height=48, **settings), LIT)
    return [resource for declared in stage(spec) for resource in declared.resources]


def allocate(resources: list, texels: int, buffers: int = 1 << 27, software: bool = False) -> None:
    """On a device whose textures and buffers end there."""
    limits = {"GL_MAX_TEXTURE_SIZE": texels, "GL_MAX_SHADER_STORAGE_BLOCK_SIZE": buffers}
    device = SimpleNamespace(ctx=SimpleNamespace(info=limits), software=software)
    for resource in resources:
        require_room(device, resource)


@pytest.mark.parametrize("kind", ["point", "directional"])
def test_an_atlas_larger_than_a_texture_is_refused(kind):
    (atlas,) = needed(shadow_maps, kind, shadow_size=1024)
    with pytest.raises(GraphicsError) as refusal:
        allocate([atlas], 2048)
    assert "--shadow-size" in refusal.value.hint
    allocate([atlas], max(atlas.size))


def test_an_atlas_larger_than_memory_is_refused(monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: 10_000_000)
    with pytest.raises(GraphicsError):
        allocate(needed(shadow_maps, shadow_size=1024), 16384, software=True)


@pytest.mark.parametrize(("samples", "texels"), [(2_000_000, "256x31213"), (200_000_000, "16384x17319")])
def test_more_vpls_than_a_texture_holds_are_refused(samples, texels):
    with pytest.raises(GraphicsError, match=texels) as refusal:
        allocate(needed(indirect_light, indirect="probes", indirect_samples=samples), 16384)
    assert "--shadow-lights" in refusal.value.hint


def test_vpls_that_fit_are_allocated():
    allocate(needed(indirect_light, indirect="rsm", indirect_samples=500_000), 16384)


def test_probe_visibility_larger_than_a_buffer_is_refused():
    with pytest.raises(GraphicsError, match="93312") as refusal:
        allocate(needed(indirect_light, indirect="probes", probes=700), 16384, 90_000)
    assert "probes" in refusal.value.hint
