"""Notes on surfaces that look different from what the file describes, with their share of the image."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from taubench_gl.effects.lighting import without_auto
from taubench_gl.effects.path_tracing import left_out
from taubench_gl.evaluation.owner import GpuOwner, opened_gpu
from taubench_gl.evaluation.schedule import first_middle_last
from taubench_gl.frame.materials import BLEND_CUTOFF
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.scene.model import Scene
from taubench_gl.scene.notes import listed
from taubench_gl.settings import Settings

Array = np.ndarray

SIDE = 480
"""Largest width and height of the images in which shares are measured, pixels."""


@dataclass(frozen=True, slots=True)
class Surfaces:
    """What is visible in each pixel of the measured frames."""

    materials: Array  # (P,) int, -2 sky, -1 the default material
    alpha: Array  # (P,) float, 1 where nothing is drawn

    def percent(self, chosen: Array) -> float:
        """Share of the pixels that are ``chosen`` (P,) bool, in percent; 0 without pixels."""
        return 100.0 * float(np.mean(chosen)) if chosen.size else 0.0

    def of(self, materials: Iterable[int]) -> Array:
        """Which pixels show one of these ``materials``.  (P,) bool."""
        return np.isin(self.materials, list(materials))


def appearance_notes(
    animated: AnimatedScene, settings: Settings, frames: range, owner: GpuOwner | None = None
) -> list[str]:
    """The scene's notes, what its raster light leaves out, and notes on blended surfaces.

    With the share of the image of those that concern materials.

    Draws only if there are such materials: the first, middle and last of ``frames``, small and without light, with
    the programs of ``owner``.
    """
    scene = animated.scene
    blended, every = blended_materials(scene), (*scene.notes, *left_out(scene, settings))
    if not blended and not any(note.materials for note in every):
        return [str(note) for note in every]
    metered = first_middle_last(frames)
    where = f"of pixels in frame{'s' * (len(metered) > 1)} {', '.join(map(str, metered))}"
    # Drawn opaque, so that surfaces that the cutoff removes are seen.
    seen = _surfaces(animated, settings.replace(blend="opaque"), metered, owner)
    notes = []
    for note in every:
        share = f"; {seen.percent(seen.of(note.materials)):.1f} % {where}" if note.materials else ""
        notes.append(f"{note}{share}")
    if blended:
        notes += transparency_notes(scene, settings.sequence.blend, seen, where)
    return notes


def blended_materials(scene: Scene) -> frozenset[int]:
    """Materials of alpha mode BLEND that are drawn."""
    used = {p.material for _, p in scene.drawn()}
    return frozenset(i for i in used if i >= 0 and scene.materials[i].alpha_mode == "BLEND")


def is_invisible(scene: Scene, material: int) -> bool:
    """Whether surfaces of a material have opacity 0 everywhere."""
    return material in blended_materials(scene) and scene.materials[material].base_color[3] == 0.0


def transparency_notes(scene: Scene, blend: str, seen: Surfaces | None = None, where: str = "") -> list[str]:
    """At most one note on what the setting ``blend`` does to blended surfaces below alpha 0.5.

    ``seen``: the image of the opaque scene; None: nothing was drawn, and only materials whose own alpha is below 0.5
    are known.
    """
    used = {p.material for _, p in scene.drawn()}
    if used and blend != "opaque" and all(is_invisible(scene, i) for i in used):
        text = "all surfaces have opacity 0, and nothing is drawn: --blend opaque draws them"
        return [f"{text} ({len(used)} material{'s' * (len(used) > 1)})"]
    faint = {i for i in blended_materials(scene) if scene.materials[i].base_color[3] < BLEND_CUTOFF}
    pixels = None
    if seen is not None:
        below = seen.of(blended_materials(scene)) & (seen.alpha < BLEND_CUTOFF)
        faint |= set(np.unique(seen.materials[below]).tolist())
        pixels = seen.percent(below)
    if not faint:
        return []
    names = listed(scene.materials[i].name or f"number {i}" for i in sorted(faint))
    objects = len({node for node, p in scene.drawn() if p.material in faint})
    counted = f"{len(faint)} material{'s' * (len(faint) > 1)} ({names}), {objects} object{'s' * (objects != 1)}"
    if pixels is not None:
        counted += f", {pixels:.1f} % {where}"
    consequence = {
        "cutoff": "not drawn; --blend opaque or stochastic draws them",
        "opaque": "drawn opaque",
        "stochastic": "drawn with a probability of alpha, whose noise counts as change where the camera moves",
    }[blend]
    return [f"blended surfaces below alpha {BLEND_CUTOFF:g}: {counted}: {consequence}"]


def _surfaces(animated: AnimatedScene, settings: Settings, frames: tuple[int, ...], owner: GpuOwner | None) -> Surfaces:
    width, height = settings.sequence.width, settings.sequence.height
    factor = max(1.0, max(width, height) / SIDE)
    small = without_auto(animated.scene, settings).replace(
        width=max(1, round(width / factor)),
        height=max(1, round(height / factor)),
        columns=("position",),
        samples_per_pixel=1,
        storage="float",
        pairs="all",
        environment="none",
        textures="finest",  # alpha as the test of the cutoff reads it
    )
    materials, alpha = [], []
    with opened_gpu(settings, owner) as opened:
        source = opened.open_source(animated, small, extra=("ids", "base_color"))
        of_draw = np.array([-2, *(draw.material for draw in source.renderer.draws)])
        for frame in frames:
            source.advance(frame)
            draws = source.read("ids")[..., 0].astype(np.int64).ravel()
            materials.append(of_draw[draws])
            alpha.append(np.where(draws > 0, source.read("base_color")[..., 3].ravel(), 1.0))
        opened.gpu.check("shares of materials")
    return Surfaces(np.concatenate(materials), np.concatenate(alpha))
