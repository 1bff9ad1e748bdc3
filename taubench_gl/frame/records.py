"""The record table: one row per draw, with its camera-relative matrices of this frame and of the frame before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taubench_gl.animation import FrameState, View
from taubench_gl.conventions import ABSENT, NO_HISTORY
from taubench_gl.frame.geometry import Draw, instanced_draws
from taubench_gl.gpu.layout import Field, Struct

Array = np.ndarray

RECORD = Struct(
    "DrawRecord",
    Field("x", "vec4", "row 0 of relative_from_object (world axes, relative to the current camera)"),
    Field("y", "vec4", "row 1"),
    Field("z", "vec4", "row 2"),
    Field("prev_x", "vec4", "row 0 of previous relative_from_object (relative to the previous camera)"),
    Field("prev_y", "vec4", "row 1"),
    Field("prev_z", "vec4", "row 2"),
    Field("ids", "uvec4", "x: record + 1, y: material + 1; z: NO_HISTORY, ABSENT; w: unused"),
)


@dataclass(frozen=True, slots=True)
class Placement:
    """Transforms of all draws at one instant, relative to one camera."""

    world: Array  # (D, 4, 4) float64 world_from_object (of the node, for posed draws)
    relative: Array  # (D, 4, 4) float64 relative_from_object; identity for posed draws
    visible: Array  # (D,) bool
    mirrored: Array  # (D,) bool: the world transform turns fronts into backs


class RecordTable:
    """Turns FrameStates into rows.  Vectorized over draws: a scene of thousands of objects takes a millisecond."""

    def __init__(self, draws: tuple[Draw, ...], replacements: frozenset[int] = frozenset()):
        """Records of ``draws``.  ``replacements``: surfaces that replace others, as in ``Scene.replacements``."""
        self._node = np.array([d.node for d in draws], dtype=np.int64)
        self._posed = np.array([d.posed for d in draws], dtype=bool)
        self._instanced, self._local = instanced_draws(draws)
        self.rows = RECORD.zeros(len(draws))
        self.rows["ids"][:, 0] = np.arange(len(draws)) + 1
        self.rows["ids"][:, 1] = [d.material + 1 for d in draws]
        self._replaces = np.isin(self._node, sorted(replacements))

    def place(self, state: FrameState, view: View, mirrored_posed: Array) -> Placement:
        """Transforms of all draws in ``state``, relative to the camera of ``view``.  ``mirrored_posed`` (D,) bool:
        mirror of the skin or node of posed draws, whose own matrix is the identity.
        """
        world = state.world[self._node]
        world[self._instanced] = world[self._instanced] @ self._local
        mirrored = np.linalg.det(world[:, :3, :3]) < 0
        relative = world.copy()
        relative[:, :3, 3] -= view.position  # float64: what is left is small enough for float32
        relative[self._posed] = np.eye(4)
        return Placement(world, relative, state.visible[self._node], np.where(self._posed, mirrored_posed, mirrored))

    def mark_cuts(self, now: FrameState, earlier: FrameState) -> None:
        """Mark the draws that replace another surface between ``earlier`` and ``now``."""
        came = self._replaces & now.visible[self._node] & ~earlier.visible[self._node]
        self.rows["ids"][:, 2] = np.where(came, NO_HISTORY, 0)

    def mark_absent(self, present: Array) -> None:
        """After ``mark_cuts``: mark the draws of nodes that are not ``present`` (N,) bool in the other frame."""
        self.rows["ids"][~present[self._node], 2] |= np.uint32(ABSENT)

    def update(self, now: Placement, previous: Placement) -> Array:
        """Fill in the matrices; the rows (D,) ready for upload."""
        for axis, name in enumerate(("x", "y", "z")):
            self.rows[name] = now.relative[:, axis]
            self.rows[f"prev_{name}"] = previous.relative[:, axis]
        return self.rows
