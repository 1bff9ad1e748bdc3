"""Memory of a frame: what the scene takes, its channels and tables, and the trees of rays, added up from declarations.

Sizes and effects decide what a frame takes, so the sum is known before anything of it exists.
"""

from __future__ import annotations

import math

from taubench_gl.errors import GraphicsError
from taubench_gl.frame.plan import frame_resources
from taubench_gl.frame.raytracing.atlas import ATLAS_BYTES
from taubench_gl.frame.raytracing.instances import MERGED_TRIANGLES
from taubench_gl.frame.raytracing.structure import TRIANGLE_BYTES
from taubench_gl.frame.spec import FrameSpec
from taubench_gl.memory_budget import limit, over, shown_bytes
from taubench_gl.scene.memory import memory_of

HIT_BYTES = 64
"""Bytes of a triangle in the tables of what rays find: its vertices and indices."""


def memory_of_frame(spec: FrameSpec) -> dict[str, int]:
    """Bytes of a frame by kind: kinds of ``memory_of``, ``channels`` (and tables, shadow maps, probes), ``rays``."""
    resources = frame_resources(spec)
    channels = sum(count for name, count in resources.memory.items() if name not in resources.images)
    return memory_of(spec.scene) | {"channels": channels, "rays": _ray_bytes(spec)}


def require_frame_memory(spec: FrameSpec) -> None:
    """Raises GraphicsError if a frame of ``spec`` takes more than the limit."""
    sums = memory_of_frame(spec)
    if (total := sum(sums.values())) > (most := limit()):
        kind = max(sums, key=sums.__getitem__)
        size = "x".join(map(str, spec.size))
        message = f"a frame of {size} pixels would take {shown_bytes(total)} of memory, {shown_bytes(sums[kind])} of it"
        hint = f"lower --size, or {over(most)}" if kind == "channels" else over(most)
        raise GraphicsError(f"{message} for {kind}", where=spec.scene.name, hint=hint)


def _ray_bytes(spec: FrameSpec) -> int:
    """Bytes of the structures that path-traced light and exact visibility trace rays through."""
    traced, exact = bool(spec.path_traced_sources), spec.settings.metrics.exact
    if not traced and not exact:
        return 0
    scene = spec.scene
    once: dict[int, int] = {}  # triangles of primitives that are stored once, by identity
    repeated = posed = 0
    for node, primitive in spec.animated.drawn:
        triangles = len(primitive.triangles) * len(scene.nodes.instances.get(node, (None,)))
        if spec.is_posed(node, primitive):
            posed += triangles
        else:
            repeated += triangles
            once[id(primitive)] = len(primitive.triangles)
    fixed = min(repeated, sum(once.values()) + MERGED_TRIANGLES)
    # Exact visibility also has the poses of the frame before.
    trees = traced * (fixed + posed) + exact * (fixed + 2 * posed)
    atlas = min(4 * sum(math.prod(image.size) for image in scene.images), ATLAS_BYTES)
    return TRIANGLE_BYTES * trees + traced * (HIT_BYTES * (fixed + posed) + atlas)
