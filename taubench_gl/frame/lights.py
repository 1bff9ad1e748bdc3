"""Punctual lights: the table of a frame, which lights are significant, which ones shaders unroll."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taubench_gl.animation import CameraTrack, FrameState, Poser, View
from taubench_gl.effects.lighting import Sun, unit_divisor
from taubench_gl.frame.shadow_faces import is_wide
from taubench_gl.frame.tuning import MAX_UNROLLED
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.gpu.owner import Owner
from taubench_gl.math3d import normalize
from taubench_gl.metrics.lighting import spot_terms
from taubench_gl.scene.model import Scene

Array = np.ndarray

LIGHT = Struct(
    "LightRecord",
    Field("position", "vec4", "xyz: meters, relative to the current camera; w: range, 0 = unlimited"),
    Field("direction", "vec4", "xyz: unit, where it shines; w: 0 point, 1 spot, 2 directional, 3 spot with cube maps"),
    Field(
        "color",
        "vec4",
        "xyz: linear color x intensity (cd or lux; W/sr or W/m2); w: first shadow face, -1 = none",
    ),
    Field(
        "spot",
        "vec4",
        "xyz: scale, offset and smooth of the cone (metrics/lighting.py); w: 1 = constant with distance, else 0",
    ),
)
LIGHT_ROW = 64
"""Lights in a row of the texture that holds the table, a texel for each of their fields."""

KINDS = ("point", "spot", "directional")
WIDE_SPOT = 3


def light_kinds(scene: Scene, sun: Sun | None = None) -> tuple[int, ...]:
    """``LIGHT.direction.w`` of every row of the light table: the lights of the scene, and after them ``sun``."""
    lights = (scene.lights[i] for i in scene.nodes.light[scene.light_nodes].tolist())
    kinds = tuple(WIDE_SPOT if is_wide(light) else KINDS.index(light.kind) for light in lights)
    return kinds if sun is None else (*kinds, KINDS.index("directional"))


def significant_lights(scene: Scene, poser: Poser, camera: CameraTrack, times: Array) -> list[int]:
    """Rows of the light table, the most significant first: by the largest irradiance at the camera's position.

    Taken over the whole animation (``times``, seconds), so that no light gains or loses its shadow during it.
    """
    nodes = scene.light_nodes
    index = scene.nodes.light[nodes]
    best = np.zeros(len(nodes))
    for t in times:
        state = poser.sample(float(t))
        view = camera.view_at(state)
        for row, node in enumerate(nodes.tolist()):
            light = state.lights[int(index[row])]
            if not state.visible[node]:
                continue
            strength = max(light.color) * light.intensity
            if light.kind != "directional" and not light.constant:
                d2 = float(np.sum((state.world[node, :3, 3] - view.position) ** 2))
                strength /= max(d2, 1.0)
            best[row] = max(best[row], strength)
    return [int(i) for i in np.argsort(-best, kind="stable")]


@dataclass(frozen=True, slots=True)
class UnrolledLights:
    """Lights that shaders are compiled for one by one, by their rows of the light table; see ``tuning.MAX_UNROLLED``.

    What never changes of a light is a constant of the shader, the rest lies at a constant place of a uniform block.
    """

    rows: tuple[int, ...] = ()
    kinds: tuple[int, ...] = ()  # as LIGHT.direction.w
    first_faces: tuple[int, ...] = ()  # as LIGHT.color.w

    @property
    def glsl(self) -> str:
        """Constants for common/lights.glsl, and a macro that does something with the number of each light."""
        if not self.rows:
            return ""
        count, numbers = len(self.rows), range(len(self.rows))
        return "\n".join(
            (
                f"const float UNROLLED_KINDS[{count}] = float[]({', '.join(f'{k}.0' for k in self.kinds)});",
                f"const float UNROLLED_FACES[{count}] = float[]({', '.join(f'{f}.0' for f in self.first_faces)});",
                f"#define EACH_UNROLLED_LIGHT(DO) {' '.join(f'DO({i})' for i in numbers)}",
            )
        )


def unrolled_lights(kinds: tuple[int, ...], first_faces: dict[int, int]) -> UnrolledLights:
    """All lights where they are few, else those with shadow maps where these are few, else none.

    ``kinds``: of every row of the light table; ``first_faces``: row -> first shadow face, of the lights with maps.
    """
    rows = range(len(kinds)) if len(kinds) <= MAX_UNROLLED else sorted(first_faces)
    if len(rows) > MAX_UNROLLED:
        return UnrolledLights()
    return UnrolledLights(tuple(rows), tuple(kinds[r] for r in rows), tuple(first_faces.get(r, -1) for r in rows))


class LightTable:
    """Rows for ``scene.light_nodes`` and after them the sun; a light that is off has color 0 and keeps its row."""

    def __init__(self, scene: Scene, light_unit: str = "candela", sun: Sun | None = None):
        """``light_unit``: watt or candela, of the lights of the scene; not of ``sun``.

        Watts are Blender's, so a spot then has the cone of Cycles.
        """
        self._divisor, self._cycles_cone = unit_divisor(light_unit), light_unit == "watt"
        self.nodes = scene.light_nodes
        self._index = scene.nodes.light[self.nodes]
        self._kinds = light_kinds(scene, sun)
        self.rows = LIGHT.zeros(max(len(self._kinds), 1))
        self.rows["color"][:, 3] = -1.0
        if sun is not None:
            self.rows["direction"][-1] = (*sun.direction, self._kinds[-1])
            self.rows["color"][-1, :3] = sun.irradiance

    def __len__(self) -> int:
        return len(self._kinds)

    def update(self, state: FrameState, view: View) -> Array:
        """Fill the rows for one frame (shadow fields are left alone)."""
        world = state.world[self.nodes]
        on = state.visible[self.nodes] & np.any(world[:, :3, :3] != 0.0, axis=(1, 2))
        if count := len(self.nodes):
            self.rows["position"][:count, :3] = world[:, :3, 3] - view.position
            self.rows["direction"][:count, :3] = -normalize(world[:, :3, 2])
        for row, i, kind, lit in zip(self.rows, self._index.tolist(), self._kinds, on.tolist(), strict=False):
            light = state.lights[i]
            row["position"][3] = light.range if np.isfinite(light.range) else 0.0
            row["direction"][3] = kind
            row["color"][:3] = np.multiply(light.color, light.intensity / self._divisor) if lit else 0.0
            row["spot"][3] = light.constant
            if light.kind == "spot":
                row["spot"][:3] = spot_terms(light, self._cycles_cone)
        return self.rows


class LightTexture(Owner):
    """The table where shaders read it (common/lights.glsl)."""

    def __init__(self, gpu: Gpu, count: int):
        super().__init__()
        rows = -(-max(count, 1) // LIGHT_ROW)
        self._padded = LIGHT.zeros(rows * LIGHT_ROW)
        self.texture = self.own(gpu.ctx.texture((len(LIGHT.fields) * LIGHT_ROW, rows), 4, dtype="f4"))

    def write(self, rows: Array) -> None:
        self._padded[: len(rows)] = rows
        self.texture.write(self._padded.tobytes())
