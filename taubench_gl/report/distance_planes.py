"""Distances of every pixel in 8 bits, so that a page can redraw the masks at other thresholds (evaluate --report-full).

A distance is stored as its *code*: the number of the feature's *levels* at or below it.  Levels are float32 numbers,
and so are distances, so a code tells exactly on which side of each level the distance lies.  The levels of a feature
with threshold a are

- the smallest float32 above a, since a pixel is discarded where its distance exceeds a,
- edges of the bins of its threshold curve (docs/conventions.md, Masks), those nearest to a,
- near a, 16 per octave.

So the pixels whose code is at least j are exactly those counted by the curve at level j.  Frames that compress badly
keep fewer levels, in steps (DETAIL): codes then count the kept ones only, and ``expand`` gives back the code among all.

Besides the features there are the planes ``depth``, the smaller of the position distance and of the change of depth,
which decides between disoccluded, newly occluding and neither, and ``signs`` of the changes; both are 0 far below the
threshold.  ``pack`` puts three planes into the channels of one RGB image, and these below one another.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from taubench_gl.features import FEATURES
from taubench_gl.metrics.counts import edges
from taubench_gl.metrics.masks import PixelDistances

Array = np.ndarray

CODES = 256
NEARER, ROSE, FELL = 1, 2, 4
"""Bits of the plane ``signs``: the history surface is nearer to the previous camera; direct luminance rose; it fell."""
MAX_BYTES_PER_PIXEL = 300 * 1024 / (640 * 360)
MIN_BYTES = 64 * 1024
"""Size limit of the packed planes of a frame: MAX_BYTES_PER_PIXEL of its pixels, at least MIN_BYTES."""
_CURVE_BITS, _FINE_BITS = 3, 4  # 2^bits levels an octave: of the threshold curve, and near the threshold


class Detail(NamedTuple):
    """Levels kept: ``near`` an octave within ``octaves`` of the threshold, ``far`` an octave elsewhere."""

    octaves: int
    near: int
    far: int


DETAIL = (
    Detail(2, 16, 8), Detail(2, 16, 4), Detail(2, 16, 2), Detail(2, 16, 1), Detail(1, 16, 1), Detail(1, 8, 1),
    Detail(1, 4, 1), Detail(0, 0, 1), Detail(0, 0, 0),
)  # fmt: skip
"""Steps from all levels to the threshold alone, which is as large as the mask; each keeps a part of the one before."""


@dataclass(frozen=True, slots=True)
class Levels:
    """Levels of one feature.

    ``values`` (n,) float32, ascending, n < CODES; ``home``: code from which the threshold of the run is exceeded, so
    ``values[home - 1]`` is the smallest float32 above it; ``kept``: per entry of DETAIL the codes of its levels.
    """

    values: Array
    home: int
    kept: tuple[Array, ...]

    def codes(self, distances: Array) -> Array:
        """Codes of distances >= 0 among all levels.  (...) float32 -> (...) uint8."""
        return np.searchsorted(self.values, np.asarray(distances, np.float32), side="right").astype(np.uint8)

    def reduced(self, codes: Array, step: int, first: int = 0) -> Array:
        """Codes among the levels kept at DETAIL[step], from code ``first`` on.  (...) uint8 -> (...) uint8."""
        codes_kept = self.kept_from(step, first)
        return np.searchsorted(codes_kept, np.arange(CODES), side="right").astype(np.uint8)[codes]

    def kept_from(self, step: int, first: int = 0) -> Array:
        """Codes of the levels kept at DETAIL[step] that are at least ``first``."""
        return self.kept[step][self.kept[step] >= first]

    def lowest_near(self, step: int) -> int:
        """Lowest code near the threshold at DETAIL[step]: from it on the planes ``depth`` and ``signs`` are stored."""
        low = np.float64(self.values[self.home - 1]) / 2.0 ** DETAIL[step].octaves
        return int(next(code for code in self.kept[step] if self.values[code - 1] >= low * (1.0 - 1e-6)))


def levels_of(threshold: float) -> Levels:
    """Levels of a feature with the threshold ``threshold`` > 0, in the unit of its distances."""
    limit = np.float32(threshold)
    home = np.nextafter(limit, np.float32(np.inf))
    octave = np.log2(edges(_FINE_BITS) / np.float64(limit))
    index = np.arange(len(octave))
    fine, curve = 1 << _FINE_BITS, 1 << _CURVE_BITS
    candidates = (index % (fine // curve) == 0) | (np.abs(octave) <= DETAIL[0].octaves)
    nearest = np.argsort(np.abs(octave[candidates]), kind="stable")[: CODES - 2]
    selected = np.sort(index[candidates][nearest])
    grid = edges(_FINE_BITS)[selected].astype(np.float32)
    values = np.union1d(grid, [home]).astype(np.float32)
    at = int(np.searchsorted(values, home)) + 1
    level_sets = []
    for octaves, near, far in DETAIL:
        per_octave = np.where(np.abs(octave[selected]) <= octaves, near, far)
        keep = (per_octave > 0) & (selected % (fine // np.maximum(per_octave, 1)) == 0)
        level_sets.append(np.union1d(np.searchsorted(values, grid[keep]) + 1, [at]))
    return Levels(values, at, tuple(level_sets))


class EncodedDistances(NamedTuple):
    """Codes of one pair among all levels: features and ``depth``, and ``signs``, (h, w) uint8 each."""

    features: Mapping[str, Array]
    depth: Array
    signs: Array


def encode(distances: PixelDistances, levels: Mapping[str, Levels]) -> EncodedDistances:
    """Codes of a pair; ``levels``: feature -> its levels, for the features of ``distances``."""
    features = {name: levels[name].codes(values) for name, values in distances.features.items()}
    depth = levels["position"].codes(np.minimum(distances.features["position"], np.abs(distances.depth)))
    signs = NEARER * (distances.depth > 0) + ROSE * (distances.luminance > 0) + FELL * (distances.luminance < 0)
    return EncodedDistances(features, depth, signs.astype(np.uint8))


def histogram(encoded: EncodedDistances, comparable: Array) -> Array:
    """Comparable pixels per code of each feature.  ``comparable`` (h, w) bool -> (features, CODES) uint32."""
    counts = [np.bincount(codes[comparable], minlength=CODES) for codes in encoded.features.values()]
    return np.array(counts, dtype=np.uint32).reshape(len(encoded.features), CODES)


def planes_at(encoded: EncodedDistances, levels: Mapping[str, Levels], step: int) -> dict[str, Array]:
    """The planes of a pair at DETAIL[step]: measured features, depth, signs, packed so.  (h, w) uint8 each."""
    features = encoded.features
    planes = {name: levels[name].reduced(features[name], step) for name in FEATURES if name in features}
    low = levels["position"].lowest_near(step)
    planes["depth"] = levels["position"].reduced(encoded.depth, step, low)
    signs = np.where(planes["depth"] > 0, encoded.signs & NEARER, 0)
    if "direct" in features:
        near = features["direct"] >= levels["direct"].lowest_near(step)
        signs = signs | np.where(near, encoded.signs & (ROSE | FELL), 0)
    planes["signs"] = signs.astype(np.uint8)
    return planes


def pack(planes: Sequence[Array]) -> Array:
    """n planes (h, w) uint8 -> (ceil(n / 3) * h, w, 3) uint8: plane i is channel i % 3 of part i // 3."""
    blank = [np.zeros_like(planes[0])] * (-len(planes) % 3)
    all_planes = [*planes, *blank]
    return np.concatenate([np.stack(all_planes[i : i + 3], axis=-1) for i in range(0, len(all_planes), 3)])


def unpack(image: Array, count: int) -> list[Array]:
    """The inverse of ``pack`` for ``count`` planes."""
    height = image.shape[0] // -(-count // 3)
    return [image[i // 3 * height : (i // 3 + 1) * height, :, i % 3] for i in range(count)]


def compressed(encoded: EncodedDistances, levels: Mapping[str, Levels], step: int) -> tuple[bytes, int]:
    """Lossless WebP of the packed planes, and the first step of DETAIL from ``step`` on at which it is small enough."""
    from PIL import Image

    while True:
        packed = pack(list(planes_at(encoded, levels, step).values()))
        out = io.BytesIO()
        Image.fromarray(packed).save(out, format="WEBP", lossless=True, quality=40, method=3)
        if out.tell() <= max(MIN_BYTES, MAX_BYTES_PER_PIXEL * encoded.depth.size) or step == len(DETAIL) - 1:
            return out.getvalue(), step
        step += 1


def levels_data(levels: Mapping[str, Levels], units: Mapping[str, float]) -> dict[str, Any]:
    """Levels as JSON holds them; ``units``: feature -> number of its units in one of those shown.

    Per feature ``values``, ``home``, and per step of DETAIL ``codes`` and ``near`` (``Levels.lowest_near``).
    """
    return {
        name: {
            "values": [float(value) / units.get(name, 1.0) for value in level.values.tolist()],
            "home": level.home,
            "kept": [codes.tolist() for codes in level.kept],
            "near": [level.lowest_near(step) for step in range(len(DETAIL))],
        }
        for name, level in levels.items()
    }
