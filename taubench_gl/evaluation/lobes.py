"""direct and indirect of single lobes, beside the columns of all lobes: on request only."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np

from taubench_gl.animation.pairs import reprojection
from taubench_gl.effects.path_tracing import GLASS
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.evaluation.pairs import Pair, PairEvaluator
from taubench_gl.lobes import BOUNCES, LOBE_EFFECT, LOBES, SCENE_LOBES, lobe_channels
from taubench_gl.settings import Settings


def require_lobes(lobes: Collection[str]) -> None:
    """Raises SettingsError for a name that is not a lobe."""
    for lobe in lobes:
        if lobe not in LOBES:
            raise SettingsError(f"no lobe is named {lobe!r:.60}", hint=f"choose from {', '.join(LOBES)}")


def scene_channels(lobes: Collection[str]) -> tuple[str, ...]:
    """Channels of the ``lobes`` of a rendered scene."""
    return lobe_channels([lobe for lobe in lobes if lobe in SCENE_LOBES])


def missing_of_scene(
    lobes: Collection[str], unmeasured: Mapping[str, str], effects: Mapping[str, Any], settings: Settings
) -> dict[str, dict[str, str]]:
    """lobe -> {direct or indirect: why it is null}, for a rendered scene.

    ``unmeasured``: of its source; ``effects``: the block of its summary.
    """
    why = {lobe: f"rendered scenes have no lobe {lobe}" for lobe in lobes if lobe not in SCENE_LOBES}
    for lobe in LOBE_EFFECT.keys() & set(lobes):
        name = LOBE_EFFECT[lobe]
        effect = effects[name]
        # Where light is sampled or decided, the source is the preview, and its columns are those of path-traced light.
        drawn = effect["on"] or settings.lighting.light in ("auto", "path-traced")
        if effect["reason"] == GLASS[name].absent or not drawn:
            why[lobe] = effect["reason"]
    return {
        lobe: {b: why.get(lobe) or unmeasured[b] for b in BOUNCES if lobe in why or b in unmeasured} for lobe in lobes
    }


def measured_lobes(missing: Mapping[str, Mapping[str, str]]) -> tuple[str, ...]:
    """Lobes of which direct or indirect is measured.  ``missing``: lobe -> {direct or indirect: why it is null}."""
    return tuple(lobe for lobe, reasons in missing.items() if len(reasons) < len(BOUNCES))


class LobeColumns:
    """Counts every pair once more for each lobe, with its textures instead of the sums of all lobes."""

    columns: tuple[str, ...] = ()
    distances = False

    def __init__(
        self,
        owner: GpuOwner,
        source: Any,
        settings: Settings,
        missing: Mapping[str, Mapping[str, str]],
        texture: Callable[[str, str], str],
    ):
        """``source``: has ``current_view`` and ``previous_view``; ``missing``: lobe -> {direct or indirect: why it is
        null}; ``texture``: name of the source's texture of a (lobe, direct or indirect).
        """
        self._source, self._dark = source, None
        self._lobes: dict[str, tuple[PairEvaluator, dict[str, str]]] = {}
        for lobe in measured_lobes(missing):
            names = {bounce: texture(lobe, bounce) for bounce in BOUNCES if bounce not in missing[lobe]}
            evaluator = owner.open_evaluator(source, settings, radiance=tuple(names), timed=False)
            self._lobes[lobe] = evaluator, names
            if self._dark is None and any(name not in source.current for name in names.values()):
                self._dark = owner.own(owner.gpu.texture(source.size))  # of a lobe that the preview leaves out
                self._dark.write(bytes(16 * source.size[0] * source.size[1]))

    def fill_row(self, pair: Pair) -> None:
        """Count ``pair``, whose frames the source holds, for every lobe whose pixels are not decided."""
        for lobe, (evaluator, names) in self._lobes.items():
            if lobe not in pair.evaluated.lobes:
                pair.evaluated.lobes[lobe] = self._count(evaluator, names, pair)

    def _count(self, evaluator: PairEvaluator, names: Mapping[str, str], pair: Pair) -> np.ndarray:
        """The mask histogram (MASK_WORDS,) of ``pair``; ``names``: of the textures for direct and indirect."""
        current, previous = (
            dict(textures) | {bounce: textures.get(name, self._dark) for bounce, name in names.items()}
            for textures in (self._source.current, self._source.previous)
        )
        step = reprojection(pair.view, self._source.previous_view, *self._source.size)
        return evaluator.read(evaluator.submit(step, current=current, previous=previous)).mask_histogram
