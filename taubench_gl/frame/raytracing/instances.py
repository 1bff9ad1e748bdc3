"""Which draws share a tree of the acceleration structure: the table that trees, hits and hit attributes agree on.

A hit names a *draw* (a row of ``Renderer.draws``, so node, primitive and material) and a triangle of that draw's
primitive, whichever tree it was found in.  Draws fall into three classes, by the scene alone:

*merged*  rigid draws that neither move nor appear or vanish in the whole animation: the world-space triangles of many
          draws in one tree, relative to an origin of its own in float64
*rigid*   every other draw whose vertices do not move in its own space: an instance of the tree of its primitive
*posed*   draws that the deform pass moves (skinned, morphed): a tree of its own each, in camera-relative space

A surface that replaces another (OBJ sequences) is a node whose visibility changes: class *rigid*.  NumPy only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taubench_gl.animation import Poser
from taubench_gl.animation.curves import varies
from taubench_gl.animation.pose import moved_nodes
from taubench_gl.frame.geometry import Draw, instanced_draws
from taubench_gl.math3d import bounds
from taubench_gl.scene.model import Scene

Array = np.ndarray

MERGED_TRIANGLES = 2_000_000
"""Triangles that may be stored more than once because their draws are merged.  Beyond it, the primitives with the most
copies stay instances of one tree."""

SCALE_STEP = 64.0
"""Merged draws that reach this many times farther than all smaller ones have a tree of their own, so that a sky dome
takes no precision from the room inside it."""


@dataclass(frozen=True, slots=True)
class MergedDraws:
    """Draws whose triangles share one tree in world space."""

    draws: Array  # (K,) int64 rows of the draws, ascending
    origin: Array  # (3,) float64, world: vertices are stored relative to it


@dataclass(frozen=True, slots=True)
class InstanceTable:
    """The classes of all draws.  Draws that are never visible, and still, or that repeat others are in none."""

    merged: tuple[MergedDraws, ...]
    rigid: Array  # (R,) int64 rows, ascending
    posed: Array  # (P,) int64 rows, ascending
    world: Array  # (D, 4, 4) float64 world_from_object at time 0; of merged draws at every time

    @property
    def count(self) -> int:
        """Number of instances of the top level."""
        return len(self.merged) + len(self.rigid) + len(self.posed)


def instance_table(scene: Scene, draws: tuple[Draw, ...], poser: Poser | None = None) -> InstanceTable:
    """Classes of ``draws``: a pure function of the scene, whole animation included."""
    state = (poser or Poser(scene)).sample(0.0)
    node = np.array([d.node for d in draws], dtype=np.int64)
    posed = np.array([d.posed for d in draws], dtype=bool)
    world = state.world[node].reshape(-1, 4, 4)
    instanced, local = instanced_draws(draws)
    world[instanced] = world[instanced] @ local
    changes = changing_nodes(scene)[node]
    never = ~changes & ~state.visible[node]
    still = ~posed & ~changes & ~never
    still &= ~_too_often(draws, still)
    rows = np.flatnonzero(still)
    low, high = _boxes(scene, draws, rows, world)
    distinct = np.array([not d.repeats for d in draws], dtype=bool)
    groups = [MergedDraws(rows[g][distinct[rows[g]]], _center(low[g], high[g])) for g in _by_scale(low, high)]
    rigid = np.flatnonzero(~posed & ~still & ~never & distinct)
    return InstanceTable(tuple(groups), rigid, np.flatnonzero(posed & ~never), world)


def changing_nodes(scene: Scene) -> Array:
    """Nodes whose world transform or visibility changes at any time of the animation.  (N,) bool.

    By their channels and those of their ancestors, so that nothing between two sampled times is missed.
    """
    nodes = scene.nodes
    free = [c for c in scene.channels if c.target == "node" and (c.path == "visible" or not nodes.has_matrix[c.index])]
    return moved_nodes(scene, filter(varies, free))


def _too_often(draws: tuple[Draw, ...], still: Array) -> Array:
    """Draws that are not merged because copies of their primitive would take too many triangles.  (D,) bool."""
    copies: dict[tuple[int, int], list[int]] = {}
    for i in np.flatnonzero(still).tolist():
        copies.setdefault((draws[i].mesh, draws[i].primitive), []).append(i)
    repeated = {key: (len(rows) - 1) * draws[rows[0]].index_count // 3 for key, rows in copies.items()}
    out, total = np.zeros(len(draws), dtype=bool), sum(repeated.values())
    for key in sorted(repeated, key=lambda k: (-repeated[k], k)):
        if total <= MERGED_TRIANGLES:
            break
        out[copies[key]] = True
        total -= repeated[key]
    return out


def _boxes(scene: Scene, draws: tuple[Draw, ...], rows: Array, world: Array) -> tuple[Array, Array]:
    """World boxes of the draws ``rows``: (K, 3), (K, 3)."""
    local: dict[tuple[int, int], tuple[Array, Array]] = {}  # box by mesh and primitive
    low, high = np.zeros((len(rows), 3)), np.zeros((len(rows), 3))
    for k, i in enumerate(rows.tolist()):
        key = draws[i].mesh, draws[i].primitive
        if key not in local:
            points = np.asarray(scene.meshes[key[0]].primitives[key[1]].positions, dtype=np.float64)
            local[key] = bounds(points)
        center, half = 0.5 * (local[key][0] + local[key][1]), 0.5 * (local[key][1] - local[key][0])
        center = world[i, :3, :3] @ center + world[i, :3, 3]
        half = np.abs(world[i, :3, :3]) @ half
        low[k], high[k] = center - half, center + half
    return low, high


def _center(low: Array, high: Array) -> Array:
    return 0.5 * (low.min(axis=0) + high.max(axis=0))


def _by_scale(low: Array, high: Array) -> list[Array]:
    """Indices of the boxes (K, 3), (K, 3), grouped by how far they reach from the middle of them all."""
    if not len(low):
        return []
    middle = np.median(0.5 * (low + high), axis=0)
    reach = np.maximum(high - middle, middle - low).max(axis=1)
    order = np.argsort(reach, kind="stable")
    sorted_reach = np.maximum(reach[order], np.finfo(np.float32).tiny)
    cuts = np.flatnonzero(sorted_reach[1:] > SCALE_STEP * sorted_reach[:-1]) + 1
    return [np.sort(group) for group in np.split(order, cuts)]
