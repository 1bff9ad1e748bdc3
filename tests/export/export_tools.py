"""Exports of the demo scene at a small size, and helpers of their tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from fixed import fixed_settings

from taubench_gl.export.channels import EXPORTS, choose_channels
from taubench_gl.export.frames import ExportFrame, FrameSource
from taubench_gl.export.run import ExportOptions, ExportResult, export_scene
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import open_gpu
from taubench_gl.paths import PACKAGE
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings

DEMO = PACKAGE.parent / "assets" / "demo.glb"
WIDTH, HEIGHT = 64, 36
SETTINGS: dict[str, Any] = {"width": WIDTH, "height": HEIGHT, "shadow_size": 64, "probes": 32}


def settings(**changes: Any) -> Settings:
    return fixed_settings(**(SETTINGS | {"frames": (8, 11)} | changes))


def export(out: Path, format: str, **changes: Any) -> ExportResult:
    chosen = {"channels": ("all",)} | {k: changes.pop(k) for k in ("channels", "precision", "jitter") if k in changes}
    control = {k: changes.pop(k) for k in ("overwrite", "progress") if k in changes}
    return export_scene(DEMO, out, settings(**changes), ExportOptions(format, **chosen), **control)


_OTHERS = ("indirect_diffuse", "indirect_glossy", "direct_transmission", "indirect_transmission", "path_info",
           "exact_reasons", "disparity")  # fmt: skip
RASTERIZED = {n: c for n, c in EXPORTS.items() if n not in _OTHERS}
"""Channels of ``all`` that frames of one camera without path-traced light have."""


def drawn(numbers, names=tuple(RASTERIZED), jitter="none", buffered=None, **changes: Any) -> list[ExportFrame]:
    """Rendered frames, before a file format converts them."""
    scene, gpu = load_scene(DEMO), open_gpu()
    with gpu:
        names = choose_channels(tuple(names))
        source = FrameSource(gpu, AnimatedScene(scene), settings(**changes), names, jitter=jitter, buffered=buffered)
        try:
            return list(source.frames(numbers))
        finally:
            source.release()


def same(ours: np.ndarray, theirs: np.ndarray) -> None:
    """Assert equality bit for bit, type and NaN included."""
    assert ours.dtype == theirs.dtype and ours.shape == theirs.shape
    assert np.ascontiguousarray(ours).tobytes() == np.ascontiguousarray(theirs).tobytes()


def spoiled(frame: ExportFrame) -> ExportFrame:
    """The frame with NaN, infinities, a negative zero and a denormal in every float channel."""
    from dataclasses import replace

    out = {name: values.copy() for name, values in frame.channels.items()}
    for values in out.values():
        if values.dtype.kind == "f":
            values[0, :5, 0] = [np.nan, np.inf, -np.inf, -0.0, np.finfo(values.dtype).smallest_subnormal]
    return replace(frame, channels=out)
