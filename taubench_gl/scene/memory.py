"""How much memory a scene takes once it is drawn, added up from its sizes before anything is expanded.

A file can share one list of indices among hundreds of primitives, one mesh among millions of instances, or hold images
that decode to a thousand times their bytes: what it takes does not follow from its size.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from taubench_gl.errors import SceneError, TaubenchError
from taubench_gl.memory_budget import limit, over, shown_bytes
from taubench_gl.scene.environment import environment_bytes
from taubench_gl.scene.model import Primitive, Scene

Array = np.ndarray

VERTEX_BYTES = 160
"""Bytes of a vertex: 72 in the joined pool and on the GPU, and its source; measured with software rendering: 150."""
INDEX_BYTES = 12
"""Bytes of an index: in its primitive, in the joined pool and on the GPU."""
DRAW_BYTES = 1536
"""Bytes of one instance of one primitive: its draw, record, matrices of two frames and bounds; measured: 1450."""
TEXEL_BYTES = 6
"""Bytes of a texel on the GPU with its smaller levels; measured with software rendering: 5.4."""
DECODING_BYTES = 20
"""Bytes of a texel of the largest image while it is decoded: Pillow's, the decoder's and the result's; measured: 18."""


def parts(scene: Scene) -> Iterator[tuple[str, str, int]]:
    """(kind, name, bytes) of every object that takes memory when ``scene`` is drawn."""
    counted: set[int] = set()
    shared = 0
    times = np.zeros(len(scene.meshes), dtype=np.int64)  # draws of each mesh
    for node in map(int, scene.mesh_nodes):
        times[scene.nodes.mesh[node]] += len(scene.nodes.instances[node]) if node in scene.nodes.instances else 1
    for mesh_index, mesh in enumerate(scene.meshes):
        for index, primitive in enumerate(mesh.primitives):
            for array in _arrays(primitive):
                base = _owner(array)
                shared += 0 if id(base) in counted else base.nbytes
                counted.add(id(base))
            if not times[mesh_index]:
                continue
            name = f"primitive {index} of mesh {mesh_index} {mesh.name!r:.40}"
            moves = bool(primitive.targets) or primitive.joints is not None
            copies = int(times[mesh_index]) if moves else 1  # vertices that move are stored for each draw
            flat = primitive.normals is None
            vertices = primitive.triangles.size if flat else len(primitive.positions)
            yield "primitives", name, copies * (vertices * VERTEX_BYTES + primitive.triangles.size * INDEX_BYTES)
        drawn = sum(1 for primitive in mesh.primitives if len(primitive.triangles))
        if times[mesh_index]:
            yield (
                "instances",
                f"{times[mesh_index]:,} x mesh {mesh_index} {mesh.name!r:.40}",
                int(times[mesh_index]) * drawn * DRAW_BYTES,
            )
    for node, matrices in scene.nodes.instances.items():
        if id(matrices) not in counted:
            counted.add(id(matrices))
            yield "instances", f"instances of node {node} {scene.nodes.names[node]!r:.40}", matrices.nbytes
    yield "arrays", "arrays of the file", shared
    largest = max((math.prod(image.size) for image in scene.images), default=0)
    for number, image in enumerate(scene.images):
        name = f"image {number} {image.name!r:.40} of {image.size[0]}x{image.size[1]} pixels"
        yield "images", name, math.prod(image.size) * TEXEL_BYTES
    yield "images", "the largest image while it is decoded", largest * DECODING_BYTES
    if isinstance(scene.environment, str):
        try:
            yield "environment", f"environment {scene.environment!r:.60}", environment_bytes(scene.environment)
        except TaubenchError:  # reported when it is used
            return


def memory_of(scene: Scene) -> dict[str, int]:
    """Bytes by kind, of ``parts``: primitives, instances, arrays, images, environment."""
    out: dict[str, int] = {}
    for kind, _, count in parts(scene):
        out[kind] = out.get(kind, 0) + count
    return out


def within_memory(scene: Scene) -> Scene:
    """``scene``.  Raises SceneError, with the largest object, if it takes more than the limit."""
    sums = memory_of(scene)
    if (total := sum(sums.values())) <= (most := limit()):
        return scene
    kind, name, count = max(parts(scene), key=lambda part: part[2])
    message = f"the scene would take {shown_bytes(total)} of memory, {shown_bytes(sums[kind])} of it for {kind}"
    raise SceneError(f"{message}, such as {name} with {shown_bytes(count)}", where=scene.name, hint=over(most))


def _arrays(primitive: Primitive) -> Iterable[Array]:
    arrays = [primitive.positions, primitive.triangles, primitive.normals, primitive.tangents, primitive.colors,
             primitive.joints, primitive.weights, *primitive.texcoords]  # fmt: skip
    for target in primitive.targets:
        arrays += [target.positions, target.normals, target.tangents]
    return (array for array in arrays if array is not None)


def _owner(array: Array) -> Array:
    """The array whose memory ``array`` shows."""
    while isinstance(array.base, np.ndarray):
        array = array.base
    return array
