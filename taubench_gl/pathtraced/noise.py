"""The noise floor: discards that two renders of the same frame, differing only in their seed, already have."""

from __future__ import annotations

from typing import Any

import numpy as np

from taubench_gl.animation.pairs import reprojection
from taubench_gl.errors import PathTracedError
from taubench_gl.evaluation import PairEvaluator
from taubench_gl.frame.counting import SequenceStats
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.pathtraced.cameras import PathTracedCamera
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.pathtraced.source import PathTracedSource
from taubench_gl.settings import Settings

RADIANCE = ("color", "direct", "indirect")


def noise_floor(
    context: GpuContext,
    first: PathTracedSequence,
    second: PathTracedSequence,
    camera: PathTracedCamera,
    frames: range,
    settings: Settings,
) -> dict[str, Any]:
    """Per radiance column the ``discard`` entry of frame i of one render against frame i of the other.

    The camera stands still in such a pair, so whatever a mask counts there is noise; of a real pair's discards about
    as many are.  Raises PathTracedError if ``second`` lacks frames or has another size.
    """
    if second.size != first.size:
        a, b = ("x".join(map(str, s.size)) for s in (first, second))
        raise PathTracedError(f"is {b} pixels, the first render {a}", where=str(second.path))
    lost = sorted(set(frames) - set(second.frames))
    if lost:
        raise PathTracedError(f"lacks frame {lost[0]} of the first render", where=str(second.path))
    sources = [PathTracedSource(context.gpu, sequence, camera, settings) for sequence in (first, second)]
    measured = tuple(c for c in RADIANCE if not any(c in source.unmeasured for source in sources))
    reasons = {c: source.unmeasured[c] for source in sources for c in RADIANCE if c in source.unmeasured}
    stats = SequenceStats(measured, reasons)
    still = settings.replace(sampling="nearest")
    evaluator = PairEvaluator(context, sources[0], still, reprojection="camera", radiance=measured)
    try:
        for frame in frames:
            view, _ = (source.advance(frame) for source in sources)
            pair = reprojection(view, view, *first.size)
            stats.add(evaluator.compare(pair, previous=sources[1].current))
    finally:
        evaluator.release()
        for source in sources:
            source.release()
    discard = stats.discard(np.zeros(stats.pairs, dtype=bool))
    return {column: discard[column] for column in RADIANCE}
