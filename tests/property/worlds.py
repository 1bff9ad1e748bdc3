"""Random small worlds, and several equivalent ways to build each as a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from taubench_gl.scene.builder import SceneBuilder, box, quad, sphere, turn
from taubench_gl.scene.model import Primitive, Scene

relaxed = settings(deadline=None, derandomize=True, max_examples=30, suppress_health_check=[HealthCheck.too_slow])
"""No deadline, because the first draw compiles shaders; the same examples in every run."""

SHAPES = {"box": box, "sphere": lambda: sphere(1.0, 8), "quad": quad}

sixteenths = st.integers(-40, 40).map(lambda i: i / 16)
places = st.tuples(sixteenths, st.integers(-20, 20).map(lambda i: i / 16), st.integers(-60, -16).map(lambda i: i / 16))
angles = st.floats(-179.0, 179.0).map(lambda a: round(a, 3) + 0.123456)
axes = st.tuples(*[st.integers(-9, 9)] * 3).filter(any)
rotations = st.builds(turn, axes, angles)


@dataclass(frozen=True)
class Thing:
    """One object: shape, positions at 0 s and 1 s, rotation, and size (a power of 2)."""

    shape: str
    start: tuple
    end: tuple
    rotation: np.ndarray
    size: float


@dataclass(frozen=True)
class World:
    """Objects, and a camera that moves and turns.  All lengths are multiples of 1/16 m, which float64 adds exactly."""

    things: list
    camera_start: tuple
    camera_end: tuple
    camera_rotation: np.ndarray
    camera_rotation_end: np.ndarray
    yfov: float


things = st.builds(Thing, st.sampled_from(sorted(SHAPES)), places, places, rotations, st.sampled_from([0.25, 0.5, 1.0]))
small_turns = st.builds(turn, axes, st.floats(-25.0, 25.0).map(lambda a: round(a, 3)))
shifts = st.tuples(*[st.integers(-8, 8).map(lambda i: i / 16)] * 3)
worlds = st.builds(
    World,
    st.lists(things, min_size=1, max_size=5),
    shifts,
    shifts,
    small_turns,
    small_turns,
    st.floats(0.3, 2.0).map(lambda a: round(a, 4)),
)


def build(
    world: World,
    *,
    offset: tuple = (0.0, 0.0, 0.0),
    scale: float = 1.0,
    order: list[int] | None = None,
    rename: bool = False,
    indexed: bool = True,
    deep: bool = False,
    room: bool = True,
) -> Scene:
    """``order``: of the things; ``deep``: extra identity nodes."""
    b = SceneBuilder()
    root = b.node(translation=offset, scale=(scale,) * 3, name="root")

    def parent() -> int:
        return b.node(b.node(root)) if deep else root

    if room:
        b.node(parent(), mesh=b.mesh(shaped(box((5.0, 3.0, 6.0), inside=True, cells=2), indexed)))
    for number in order if order is not None else range(len(world.things)):
        thing = world.things[number]
        mesh = b.mesh(shaped(SHAPES[thing.shape](), indexed))
        name = f"renamed {17 - number}" if rename else None
        size = (thing.size,) * 3
        node = b.node(parent(), mesh=mesh, rotation=thing.rotation, scale=size, translation=thing.start, name=name)
        b.animate(node, "translation", [0.0, 1.0], [thing.start, thing.end])
    camera = b.camera(root, yfov=world.yfov, znear=0.0625 * scale, zfar=64.0 * scale)
    b.animate(camera, "translation", [0.0, 1.0], [world.camera_start, world.camera_end])
    b.animate(camera, "rotation", [0.0, 1.0], [world.camera_rotation, world.camera_rotation_end])
    return b.build()


def shaped(primitive: Primitive, indexed: bool) -> Primitive:
    """The primitive with the same triangles; without ``indexed``, no two share a vertex."""
    if indexed:
        return primitive
    corners = primitive.triangles.reshape(-1)
    separate = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
    return Primitive(primitive.positions[corners], separate, primitive.material, normals=primitive.normals[corners])
