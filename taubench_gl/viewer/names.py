"""Names of what a pixel shows: its object, its material and the lights that shine on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taubench_gl.animation import FrameState
from taubench_gl.conventions import NO_HISTORY
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.targets import read_texel
from taubench_gl.gpu.context import Gpu
from taubench_gl.math3d import normalize
from taubench_gl.metrics.lighting import incident
from taubench_gl.scene.model import Scene

Array = np.ndarray
MOST_LIGHTS = 3


@dataclass(frozen=True, slots=True)
class PixelNames:
    """``lights``: names and their shares of the irradiance without shadows, largest first, at most MOST_LIGHTS."""

    object: str
    material: str
    lights: tuple[tuple[str, float], ...] = ()

    @property
    def lights_text(self) -> str:
        """The lights in words: ``lamp 80 %, sun 20 %``, or none."""
        return ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in self.lights) or "none"


def node_at(gpu: Gpu, source: RasterSource, x: int, row: int) -> int | None:
    """The node that pixel (x, row from the top) of the current frame shows; None for the sky.  Needs ``ids``."""
    record = int(read_texel(gpu, source.current["ids"], x, source.size[1] - 1 - row)[0])
    return source.renderer.draws[record - 1].node if record else None


def names_at(gpu: Gpu, source: RasterSource, x: int, row: int) -> PixelNames | None:
    """What pixel (x, row from the top) of the current frame shows; None for the sky.  Needs the channel ``ids``."""
    up = source.size[1] - 1 - row
    record, material = (int(v) for v in read_texel(gpu, source.current["ids"], x, up)[:2])
    if record == 0:
        return None
    renderer = source.renderer
    draw, scene = renderer.draws[record - 1], renderer.scene
    number = (material & ~NO_HISTORY) - 1
    name = scene.materials[number].name if 0 <= number < len(scene.materials) else ""
    position, normal = (
        read_texel(gpu, source.current[c], x, up)[:3].astype(np.float64) for c in ("position", "normal")
    )
    return PixelNames(
        scene.nodes.names[draw.node] or f"node {draw.node}",
        name or ("default" if number < 0 else f"material {number}"),
        light_shares(scene, renderer.frame.state, position + renderer.frame.view.position, normal),
    )


def light_shares(
    scene: Scene, state: FrameState, point: np.ndarray, normal: np.ndarray
) -> tuple[tuple[str, float], ...]:
    """Shares of the irradiance at a point, (3,) world space, by light."""
    lights = []
    for node in scene.light_nodes.tolist():
        light = state.lights[int(scene.nodes.light[node])]
        if not state.visible[node]:
            continue
        world = state.world[node]
        to_light, irradiance = incident(light, world[:3, 3], normalize(-world[:3, 2]), point)
        strength = max(float(to_light @ normal), 0.0) * float(np.max(irradiance))
        if strength > 0.0:
            lights.append((scene.nodes.names[node] or light.name or f"node {node}", strength))
    total = sum(strength for _, strength in lights)
    ranked = sorted(((name, strength / total) for name, strength in lights), key=lambda item: -item[1])
    return tuple(ranked[:MOST_LIGHTS])
