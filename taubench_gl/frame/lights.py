"""The light table: every punctual light of a frame, relative to the camera."""

from __future__ import annotations

import moderngl
import numpy as np

from taubench_gl.animation import FrameState, View
from taubench_gl.frame.shadow_faces import is_wide
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.math3d import normalize
from taubench_gl.metrics.lighting import spot_terms
from taubench_gl.scene.model import Scene

Array = np.ndarray

LIGHT = Struct(
    "LightRecord",
    Field("position", "vec4", "xyz: metres, relative to the current camera; w: range, 0 = unlimited"),
    Field("direction", "vec4", "xyz: unit, where it shines; w: 0 point, 1 spot, 2 directional, 3 spot with cube maps"),
    Field("color", "vec4", "xyz: linear colour x intensity (candela or lux); w: first shadow face, -1 = none"),
    Field("spot", "vec4", "xy: scale and offset of the cone falloff"),
)
LIGHT_ROW = 64
"""Lights in a row of the texture that holds the table, a texel for each of their fields."""

KINDS = ("point", "spot", "directional")
WIDE_SPOT = 3


class LightTable:
    """Rows for ``scene.light_nodes``; a light that is off has colour 0 and keeps its row."""

    def __init__(self, scene: Scene):
        self.nodes = scene.light_nodes
        self._index = scene.nodes.light[self.nodes]
        self.rows = LIGHT.zeros(max(len(self.nodes), 1))
        lights = (scene.lights[i] for i in self._index.tolist())
        self.kinds = tuple(WIDE_SPOT if is_wide(light) else KINDS.index(light.kind) for light in lights)

    def __len__(self) -> int:
        return len(self.nodes)

    def update(self, state: FrameState, view: View) -> Array:
        """Fill the rows for one frame (shadow fields are left alone)."""
        world = state.world[self.nodes]
        on = state.visible[self.nodes] & np.any(world[:, :3, :3] != 0.0, axis=(1, 2))
        if len(self.nodes):
            self.rows["position"][:, :3] = world[:, :3, 3] - view.position
            self.rows["direction"][:, :3] = -normalize(world[:, :3, 2])
        for row, i, kind, lit in zip(self.rows, self._index.tolist(), self.kinds, on.tolist(), strict=False):
            light = state.lights[i]
            row["position"][3] = light.range if np.isfinite(light.range) else 0.0
            row["direction"][3] = kind
            row["color"][:3] = np.multiply(light.color, light.intensity) if lit else 0.0
            if light.kind == "spot":
                row["spot"][:2] = spot_terms(light)
        return self.rows


class LightTexture:
    """The table where shaders read it (common/lights.glsl)."""

    def __init__(self, gpu: Gpu, count: int):
        rows = -(-max(count, 1) // LIGHT_ROW)
        self._padded = LIGHT.zeros(rows * LIGHT_ROW)
        self.texture: moderngl.Texture = gpu.ctx.texture((len(LIGHT.fields) * LIGHT_ROW, rows), 4, dtype="f4")

    def write(self, rows: Array) -> None:
        self._padded[: len(rows)] = rows
        self.texture.write(self._padded.tobytes())

    def release(self) -> None:
        self.texture.release()
