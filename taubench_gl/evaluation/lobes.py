"""direct and indirect of single lobes, beside the columns of all lobes: on request only."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import HISTOGRAM_BINS
from taubench_gl.effects.path_tracing import GLASS
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.evaluation.pairs import Pair, PairEvaluator
from taubench_gl.features import FEATURES
from taubench_gl.lobes import BOUNCES, LOBE_EFFECT, LOBES, SCENE_LOBES, lobe_channels, lobes_with
from taubench_gl.metrics.counts import Counts
from taubench_gl.metrics.sequence_stats import SequenceStats
from taubench_gl.settings import Settings

if TYPE_CHECKING:
    from taubench_gl.evaluation.session import Session


def require_lobes(lobes: Collection[str]) -> None:
    """Raises SettingsError for a name that is not a lobe."""
    for lobe in lobes:
        if lobe not in LOBES:
            raise SettingsError(f"no lobe is named {lobe!r:.60}", hint=f"choose from {', '.join(LOBES)}")


def scene_channels(lobes: Collection[str]) -> tuple[str, ...]:
    """Channels of the ``lobes`` of a rendered scene."""
    return lobe_channels([lobe for lobe in lobes if lobe in SCENE_LOBES])


def scene_lobes(lobes: Collection[str], effects: Mapping[str, Any]) -> tuple[str, ...]:
    """The part of ``lobes`` that a rendered scene has.  ``effects``: the block of its summary."""
    absent = {name for name, effect in GLASS.items() if effects[name]["reason"] == effect.absent}
    found = lobes_with(effects.keys() - absent)
    return tuple(lobe for lobe in lobes if lobe in found)


def missing_of_scene(
    lobes: Collection[str], unmeasured: Mapping[str, str], effects: Mapping[str, Any], settings: Settings
) -> dict[str, dict[str, str]]:
    """lobe -> {direct or indirect: why it is null}, for a rendered scene.

    ``unmeasured``: of its source; ``effects``: the block of its summary.
    """
    found = scene_lobes(lobes, effects)
    why = {lobe: f"rendered scenes have no lobe {lobe}" for lobe in lobes if lobe not in SCENE_LOBES}
    # Where light is sampled or decided, the source is the preview, and its columns are those of path-traced light.
    traced = settings.lighting.light in ("auto", "path-traced")
    for lobe in LOBE_EFFECT.keys() & set(lobes):
        effect = effects[LOBE_EFFECT[lobe]]
        if lobe not in found or not (effect["on"] or traced):
            why[lobe] = effect["reason"]
    return {
        lobe: {b: why.get(lobe) or unmeasured[b] for b in BOUNCES if lobe in why or b in unmeasured} for lobe in lobes
    }


def summarize_lobes(
    missing: Mapping[str, Mapping[str, str]], histograms: Sequence[Mapping[str, np.ndarray]]
) -> dict[str, Any]:
    """The ``lobes`` block of a summary from the mask histogram of every pair and lobe, as ``LobeColumns`` makes it."""
    out = {}
    for lobe, reasons in missing.items():
        stats = SequenceStats(tuple(b for b in BOUNCES if b not in reasons), dict(reasons))
        for of_pair in histograms:
            if lobe in of_pair:
                stats.add(_of_words(of_pair[lobe]))
        out[lobe] = _block(stats)
    return out


def _block(stats: SequenceStats) -> dict[str, Any]:
    discard = stats.discard(np.zeros(stats.pairs, dtype=bool))
    return {bounce: discard[bounce] for bounce in BOUNCES}


class LobeColumns:
    """The evaluator of the columns, with the textures of one lobe instead of the sums of all."""

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
        self._source, self._texture = source, texture
        self._dark: Any = None
        self._lobes: dict[str, tuple[PairEvaluator | None, SequenceStats]] = {}
        for lobe, reasons in missing.items():
            measured = tuple(b for b in BOUNCES if b not in reasons)
            how = {"radiance": measured, "timed": False}
            evaluator = owner.open_evaluator(source, settings, **how) if measured else None
            self._lobes[lobe] = evaluator, SequenceStats(measured, dict(reasons))
            if self._dark is None and any(texture(lobe, b) not in source.current for b in measured):
                self._dark = owner.own(owner.gpu.texture(source.size))  # of a lobe that the preview leaves out
                self._dark.write(bytes(16 * source.size[0] * source.size[1]))

    def blocks(self, session: Session) -> dict[str, Any]:
        """The block ``lobes`` of summary.json."""
        return {"lobes": {lobe: _block(stats) for lobe, (_, stats) in self._lobes.items()}}

    def complete(self, pair: Pair) -> None:
        """Count ``pair``, whose frames the source holds, for every lobe."""
        for lobe, (evaluator, stats) in self._lobes.items():
            if evaluator is None:
                continue
            if lobe not in pair.evaluated.lobes:  # else its pixels are decided
                pair.evaluated.lobes[lobe] = self._count(lobe, evaluator, pair)
            stats.add(_of_words(pair.evaluated.lobes[lobe]))

    def _count(self, lobe: str, evaluator: PairEvaluator, pair: Pair) -> np.ndarray:
        """The mask histogram of ``pair`` with a lobe for direct and indirect."""
        names = {b: self._texture(lobe, b) for b in self._lobes[lobe][1].measured}
        current, previous = (
            dict(textures) | {b: textures.get(name, self._dark) for b, name in names.items()}
            for textures in (self._source.current, self._source.previous)
        )
        step = reprojection(pair.view, self._source.previous_view, *self._source.size)
        return evaluator.compare(step, current=current, previous=previous).mask_histogram


def _of_words(mask_histogram: np.ndarray) -> Counts:
    """Counts without distances."""
    return Counts(mask_histogram, np.zeros((len(FEATURES), HISTOGRAM_BINS), dtype=np.int64))
