"""Scene statistics: what a scene contains and what of it changes (Table 1 of the paper, and more).

Counts include nodes that the chosen scene reaches; meshes count if they have triangles.  *Changes* compares every
evaluated time with the first, so a thing that moves only between two evaluated times, or never inside them, is static.

Matrices are compared as they are sampled.  A node without animation above it is sampled to the same bits every time;
the tolerance is for a child whose rotation cancels its parent's, where rounding remains.  A chain of some tens of
float64 products has an error of at most a few 1e-15 of its magnitude; 1e-12 is far above that, and far below what a
renderer can show.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from taubench_gl.animation.pose import Poser, is_skinned, target_count
from taubench_gl.animation.state import FrameState
from taubench_gl.scene.model import Scene

Array = np.ndarray

TOLERANCE = 1e-12

LIGHT_KINDS = ("point", "spot", "directional")


def census(scene: Scene, times: Iterable[float], poser: Poser | None = None) -> dict[str, Any]:
    """Count what ``scene`` contains and what of it changes over ``times`` (seconds; none: the time 0).

    Objects    ``dynamic_rigid_objects``, ``static_rigid_objects``: drawn mesh nodes that no skin deforms, one for each
               instance of EXT_mesh_gpu_instancing.  Dynamic: world transform or visibility changes.
               ``drawn_meshes``: drawn mesh nodes, skinned or not; ``triangles``, ``vertices``: theirs, per instance.
    Deforming  ``armatures``: skins that deform a drawn mesh; ``bones``: their joints, a shared joint once; ``morphs``:
               drawn mesh nodes with morph targets; ``morphs_dynamic``: those whose weights change.
    Lights     ``static_K_lights``, ``dynamic_K_lights`` for K = point, spot, directional.  Dynamic: position (point,
               spot), direction (spot, directional), intensity, color, range, cone or visibility changes.
    Cameras    ``cameras``, ``cameras_dynamic``: transform or parameters change.
    ``lights_per_frame``: lists ``born``, ``moved``, ``killed`` with a count per pair of times, all kinds of light.  A
    light is on when its node is visible and not scaled to zero, and its color times intensity is not black; moved
    counts lights that are on at both times.

    One pass over the times; memory does not grow with their number.
    """
    poser, changes = poser or Poser(scene), _Changes(scene)
    for time in times:
        changes.add(poser.sample(time))
    nodes, meshes = scene.nodes, changes.meshes.tolist()
    copies = {n: len(nodes.instances[n]) if n in nodes.instances else 1 for n in meshes}
    objects = np.array([copies[n] for n in changes.rigid.tolist()], dtype=np.int64)
    skins = sorted({int(s) for s in nodes.skin[changes.meshes[changes.skinned]]})
    kinds = np.array([scene.lights[k].kind for k in nodes.light[scene.light_nodes]], dtype=object)
    out: dict[str, Any] = {
        "dynamic_rigid_objects": int(objects[changes.of_rigid].sum()),
        "static_rigid_objects": int(objects[~changes.of_rigid].sum()),
        "armatures": len(skins),
        "bones": len({int(j) for s in skins for j in scene.skins[s].joints}),
    }
    for kind in LIGHT_KINDS:
        out[f"static_{kind}_lights"] = int(np.count_nonzero((kinds == kind) & ~changes.of_lights))
        out[f"dynamic_{kind}_lights"] = int(np.count_nonzero((kinds == kind) & changes.of_lights))
    return out | {
        "morphs": len(changes.morphing),
        "morphs_dynamic": int(np.count_nonzero(changes.of_morphs)),
        "cameras": len(scene.camera_nodes),
        "cameras_dynamic": int(np.count_nonzero(changes.of_cameras)),
        "drawn_meshes": len(meshes),
        "triangles": sum(len(p.triangles) * copies[n] for n, p in scene.drawn()),
        "vertices": sum(len(p.positions) * copies[n] for n, p in scene.drawn()),
        "lights_per_frame": changes.lights_per_frame,
    }


class _Changes:
    """What of a scene differs from the first of the states that are added, flags (n,) bool for each kind of node."""

    def __init__(self, scene: Scene):
        self._scene = scene
        self._first: tuple[FrameState, _Lights] | None = None
        self._previous_lights: _Lights | None = None
        self.meshes = np.array([n for n in scene.mesh_nodes.tolist() if scene.primitives(n)], dtype=np.int64)
        self.skinned = _flags(any(is_skinned(scene, n, p) for p in scene.primitives(n)) for n in self.meshes.tolist())
        self.rigid = self.meshes[~self.skinned]
        self.morphing = [n for n in self.meshes.tolist() if target_count(scene, int(scene.nodes.mesh[n]))]
        self.of_rigid = np.zeros(len(self.rigid), dtype=bool)
        self.of_morphs = np.zeros(len(self.morphing), dtype=bool)
        self.of_cameras = np.zeros(len(scene.camera_nodes), dtype=bool)
        self.of_lights = np.zeros(len(scene.light_nodes), dtype=bool)
        self.lights_per_frame: dict[str, list[int]] = {"born": [], "moved": [], "killed": []}

    def add(self, state: FrameState) -> None:
        """Compare ``state`` with the first one, and its lights with those before."""
        lights, cameras = _Lights(self._scene, state), self._scene.camera_nodes
        if self._first is None or self._previous_lights is None:
            self._first, self._previous_lights = (state, lights), lights
            return
        first, first_lights = self._first
        self.of_rigid |= _moved(first.world[self.rigid], state.world[self.rigid])
        self.of_rigid |= first.visible[self.rigid] != state.visible[self.rigid]
        self.of_cameras |= _moved(first.world[cameras], state.world[cameras])
        parameters = self._scene.nodes.camera[cameras].tolist()
        self.of_cameras |= _flags(first.cameras[c] != state.cameras[c] for c in parameters)
        self.of_morphs |= _flags(not np.array_equal(first.weights[n], state.weights[n]) for n in self.morphing)
        self.of_lights |= first_lights.moved(lights) | (first_lights.on != lights.on)
        self.of_lights |= first_lights.emission_differs(lights)
        previous, self._previous_lights = self._previous_lights, lights
        changed = {
            "born": lights.on & ~previous.on,
            "moved": lights.on & previous.on & previous.moved(lights),
            "killed": previous.on & ~lights.on,
        }
        for change, flags in changed.items():
            self.lights_per_frame[change].append(int(np.count_nonzero(flags)))


class _Lights:
    """The lights of a scene at one time, as arrays over ``scene.light_nodes`` (L,)."""

    def __init__(self, scene: Scene, state: FrameState):
        at = scene.light_nodes
        lights = [state.lights[k] for k in scene.nodes.light[at].tolist()]
        world = state.world[at]
        self.world = world
        self.has_position = _flags(light.kind != "directional" for light in lights)
        self.has_direction = _flags(light.kind != "point" for light in lights)
        self.parameters = np.array(
            [(*light.color, light.intensity, light.range, light.inner_cone, light.outer_cone) for light in lights]
        ).reshape(len(lights), 7)
        black = np.all(self.parameters[:, :3] * self.parameters[:, 3:4] == 0.0, axis=1)
        # Exporters that cannot switch a light off scale its node to zero; glTF says such a node may be skipped.
        self.on = state.visible[at] & np.any(world[:, :3, :3] != 0.0, axis=(1, 2)) & ~black

    def moved(self, later: _Lights) -> Array:
        """Which lights shine from another place, or in another direction (along local -Z), later.  -> (L,) bool."""
        position = self.has_position & _translated(self.world, later.world)
        return position | (self.has_direction & _differs(self.world[:, :3, 2], later.world[:, :3, 2]))

    def emission_differs(self, later: _Lights) -> Array:
        """Which lights have another color, intensity, range or cone later.  -> (L,) bool."""
        return np.any(self.parameters != later.parameters, axis=1)


def _moved(a: Array, b: Array) -> Array:
    """Whether world transforms differ, (n, 4, 4) and (n, 4, 4) -> (n,) bool."""
    return _differs(a[:, :3, :3].reshape(-1, 9), b[:, :3, :3].reshape(-1, 9)) | _translated(a, b)


def _translated(a: Array, b: Array) -> Array:
    """Whether world positions differ, (n, 4, 4) and (n, 4, 4) -> (n,) bool.

    The tolerance is relative to the whole transform: a position that should cancel to 0 leaves rounding.
    """
    return np.abs(a[:, :3, 3] - b[:, :3, 3]).max(axis=1) > TOLERANCE * _magnitude(a[:, :3], b[:, :3])


def _differs(a: Array, b: Array) -> Array:
    """Which rows differ by more than TOLERANCE times their larger magnitude.  (n, k), (n, k) -> (n,) bool."""
    return np.abs(a - b).max(axis=1) > TOLERANCE * _magnitude(a, b)


def _magnitude(a: Array, b: Array) -> Array:
    """Largest absolute entry of each row, whatever a row's shape.  -> (n,)."""
    axes = tuple(range(1, a.ndim))
    return np.maximum(np.abs(a).max(axis=axes), np.abs(b).max(axis=axes))


def _flags(values: Iterable[bool]) -> Array:
    return np.fromiter(values, dtype=bool)
