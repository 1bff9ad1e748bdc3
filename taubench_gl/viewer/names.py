"""Names of what a pixel shows: its object and its material."""

from __future__ import annotations

from dataclasses import dataclass

from taubench_gl.conventions import NO_HISTORY
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.targets import read_texel
from taubench_gl.gpu.context import Gpu


@dataclass(frozen=True, slots=True)
class PixelNames:
    """Names of the node and of the material that a pixel shows; a number stands for a name that the file lacks."""

    object: str
    material: str


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
    return PixelNames(
        scene.nodes.names[draw.node] or f"node {draw.node}",
        name or ("default" if number < 0 else f"material {number}"),
    )
