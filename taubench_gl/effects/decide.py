"""Which effects a scene calls for, with the evidence: what is off is not compiled, allocated or drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.animation.pose import is_skinned
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings


@dataclass(frozen=True, slots=True)
class Effect:
    """One thing the renderer can simulate, whether it does, and why."""

    on: bool
    reason: str


def decide(scene: Scene, settings: Settings) -> dict[str, Effect]:
    """Effects by name, for this scene and what is asked of it."""
    nodes = scene.mesh_nodes.tolist()
    primitives = [(n, p) for n in nodes for p in scene.meshes[scene.nodes.mesh[n]].primitives if len(p.triangles)]
    skins = {int(scene.nodes.skin[n]) for n, p in primitives if is_skinned(scene, n, p)}
    morphed = {n for n, p in primitives if p.targets}
    drawn = [scene.materials[p.material] for _, p in primitives if p.material >= 0]
    masked = sum(m.alpha_mode == "MASK" for m in drawn)
    blended = sum(m.alpha_mode == "BLEND" for m in drawn)
    mapped = sum(m.normal_texture is not None for m in drawn)
    moving = _moves_by_itself(scene)
    motion = settings.reprojection == "motion"
    if motion:
        history = Effect(moving, "surfaces move and the reprojection is 'motion'" if moving else "no surface moves")
    else:
        history = Effect(False, "the reprojection is 'camera'")
    light = "radiance is not simulated yet"
    return {
        "skinning": Effect(bool(skins), _count(len(skins), "skin deforms a drawn mesh", "skins deform drawn meshes")),
        "morphing": Effect(bool(morphed), _count(len(morphed), "drawn mesh has targets", "drawn meshes have targets")),
        "alpha_mask": Effect(
            bool(masked + blended),
            _count(masked, "masked primitive", "masked primitives") + f", {blended} blended (drawn where alpha >= 0.5)"
            if blended
            else _count(masked, "masked primitive", "masked primitives"),
        ),
        "normal_maps": Effect(bool(mapped), _count(mapped, "primitive has one", "primitives have one")),
        "previous_pose": history,
        "direct": Effect(False, light),
        "indirect": Effect(False, light),
        "color": Effect(False, light),
    }


def as_summary(effects: dict[str, Effect]) -> dict[str, Any]:
    """The ``effects`` block of summary.json."""
    return {name: {"on": e.on, "reason": e.reason} for name, e in effects.items()}


def _moves_by_itself(scene: Scene) -> bool:
    """Whether any channel can move a drawn surface: transforms above a mesh or joint, or morph weights."""
    carriers = set(scene.mesh_nodes.tolist())
    for node in scene.mesh_nodes.tolist():
        skin = int(scene.nodes.skin[node])
        if skin >= 0:
            carriers |= set(scene.skins[skin].joints.tolist())
    above = np.zeros(len(scene.nodes), dtype=bool)
    for node in carriers:
        while node >= 0 and not above[node]:
            above[node] = True
            node = int(scene.nodes.parent[node])
    return any(c.target == "node" and (above[c.index] or c.path == "weights") for c in scene.channels)


def _count(n: int, one: str, many: str) -> str:
    return f"no {many}" if n == 0 else f"{n} {one if n == 1 else many}"
