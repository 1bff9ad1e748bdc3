"""Masks of single pixels under path-traced light, with as many samples as each pixel needs for a yes or no.

A pixel has sample numbers of its own, the same in both frames of the pair: noise that a surface point has in both is no
change.  Samples come in parts with independent numbers, so that their spread tells how sure a distance is.  A pixel is
decided when its distances are clear of their thresholds; the others get twice as many samples, up to a limit.  What
halves of the samples say tells how noise biases a share of undecided pixels (``metrics.sampled_light``).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from taubench_gl.conventions import COUNTED, NOT_COMPARABLE, OTHER_REPROJECTION, Reason
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.evaluation.pairs import PairEvaluator
from taubench_gl.features import FEATURE_BIT, LIGHT_FEATURES, RADIANCE_FEATURES
from taubench_gl.frame.sources import RasterSource
from taubench_gl.metrics.color import display_color
from taubench_gl.metrics.masks import blend, history_taps
from taubench_gl.metrics.path_samples import HALVES, LEAST, PARTS
from taubench_gl.metrics.sampled_light import PixelMasks, lobe_distance
from taubench_gl.settings import MAX_BOUNCES, Settings
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray

CONFIDENCE = 0.9973
"""Probability with which a distance must be clear of its threshold, by Student's t over the parts: 3 sigma."""

FLOOR_QUANTILE = 0.999
"""The error of a distance is at least what one more sample would add that is as far off as this quantile of the pair's
parts: equal samples do not prove that all others are equal."""

SAME_PX = 1e-3
"""Distance of two histories, pixels, up to which a pixel is decided once for both: what float32 makes of equal ones."""

AUDITED = (0.02, 0.1)
"""Share of the decided pixels that are traced to the limit all the same; the second one of those that are decided by
less than twice the distance that CONFIDENCE asks for, where errors are."""

LIGHT_BITS = np.uint32(sum(FEATURE_BIT[name] for name in LIGHT_FEATURES) | int(Reason.LIT | Reason.SHADOWED))


def decided_light(settings: Settings, columns: Collection[str] = RADIANCE_FEATURES) -> Settings:
    """``settings`` with the light of ``columns`` path-traced, by numbers that differ from pixel to pixel."""
    light = {
        "light": "path-traced", "indirect": "auto", "pattern": "independent", "bidirectional": True,
        "bounces": MAX_BOUNCES if set(columns) - {"direct"} else 1,
    }  # fmt: skip
    picture = {"columns": RADIANCE_FEATURES, "pairs": "all", "samples_per_pixel": 1, "storage": "float", "exact": False}
    return settings.replace(**light, **picture, spp=1)


@dataclass(frozen=True, slots=True)
class PreviewPair:
    """Channels of a pair under preview light, which decide all of its masks but those of light.

    Images: row 0 at the top.  A color is that of the display, which the background keeps.
    """

    frame: int  # the later one
    words: Array  # (h, w) uint32 reason words
    distances: Mapping[str, Array]  # light column -> (h, w)
    at_px: Array  # (h, w, 2) float64 previous coordinates, y down
    surface: tuple[Array, Array]  # (h, w) bool, of the previous and the current frame
    emission: tuple[Array, Array] | None  # (h, w, 3)
    color: tuple[Array, Array] | None  # (h, w, 3)

    def shared(self, before: PreviewPair) -> PreviewPair:
        """This pair with those images of its first frame that are the same in ``before``, where that is the second."""
        images = {name: (getattr(self, name), getattr(before, name)) for name in ("surface", "emission", "color")}
        equal = {n: (b[1], a[1]) for n, (a, b) in images.items() if a and b and np.array_equal(a[0], b[1])}
        return replace(self, **equal)

    def differs(self, other: PreviewPair) -> Array:
        """Pixels that have another history or another word in ``other``, the same pair reprojected otherwise.

        (h, w) bool.  Places of still surfaces are equal up to the rounding of float32.
        """
        nearest = np.floor(self.at_px + 0.5) != np.floor(other.at_px + 0.5)
        moved = (nearest | (np.abs(self.at_px - other.at_px) > SAME_PX)).any(axis=-1)
        return (moved & (self.traced | other.traced)) | (self.words != other.words)

    @property
    def traced(self) -> Array:
        """Pixels whose masks depend on path-traced light: a comparison with a surface in either frame.  (h, w) bool."""
        sky = np.uint32(Reason.SKY | Reason.HISTORY_SKY)
        return ((self.words & NOT_COMPARABLE) == 0) & ((self.words & sky) != sky)


def read_preview(
    source: RasterSource,
    evaluator: PairEvaluator,
    frame: int,
    columns: Collection[str],
    same: PreviewPair | None = None,
) -> PreviewPair:
    """Read the pair that ``evaluator`` has submitted last; it writes images and distances.  ``columns``: of light.

    ``same``: the pair reprojected otherwise, whose images of surfaces and colors it shares.
    """
    motion, (width, height) = evaluator.motion(), source.size
    across, down = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    up = (height - 1 - down) - motion[..., 1]  # in float32, as the masks add it

    def both(name: str) -> tuple[Array, Array]:
        return source.read(name, previous=True), source.read(name)

    found = evaluator.distances().features
    distances = {name: found[name].copy() for name in columns}  # a view would hold the distances of all columns
    at_px = np.stack([across + motion[..., 0], (height - 1) - up.astype(np.float64)], axis=-1)
    if same is not None:
        return replace(same, words=evaluator.mask(), distances=distances, at_px=at_px)
    color = emission = None
    if "color" in columns:
        color = tuple(np.ascontiguousarray(image[..., :3]) for image in both("color"))
    if "emission" in source.channels:
        emission = tuple(np.ascontiguousarray(image[..., :3]) for image in both("emission"))
        emission = emission if any(np.any(image) for image in emission) else None
    surface = tuple(image[..., 3] > 0 for image in both("position"))
    return PreviewPair(frame, evaluator.mask(), distances, at_px, surface, emission, color)


def other_evaluator(owner: GpuOwner, source: RasterSource, settings: Settings) -> PairEvaluator | None:
    """What compares the pairs of ``source`` by its other reprojection, for ``read_preview``; None where it is equal."""
    if source.other != COUNTED:
        return None
    other = OTHER_REPROJECTION[source.reprojection]
    return owner.open_evaluator(source, settings, timed=False, images=True, distances=True, reprojection=other)


@dataclass(frozen=True, slots=True)
class Decisions:
    """What path-traced light says of n pixels of a pair, when each was decided and at the end."""

    first: PixelMasks  # with which they were decided, or that of the limit
    end: PixelMasks  # of the limit where they were audited or undecided, else ``first``
    luminance: Array  # (n,) float64, change of direct luminance x exposure; 0 where direct is no column
    samples: Array  # (n,) int64, of the current pixel and each tap of its history
    decided_samples: Array  # (n,) int64, when the pixel was decided
    undecided: Array  # (n,) bool: the limit came first
    audited: Array  # (n,) float64, probability with which a pixel was drawn for the audit, 0 where it was not


class DecidedPixels:
    """Draws the pairs of a scene and decides their pixels."""

    def __init__(
        self,
        variant: Callable[..., RasterSource],
        settings: Settings,
        columns: Collection[str],
        lobes: Collection[str] = (),
    ):
        """``variant``: opens a source of the scene (``Session.variant``); ``columns``: of light, to decide; ``lobes``
        (of ``measured_lobes``): whose distances are wanted too."""
        self._settings, self.columns = settings, tuple(columns)
        self._thresholds = {name: settings.metrics.threshold(name) for name in self.columns}
        traced = decided_light(settings, self.columns)
        # Neither needs the place of a point in another frame: ``PreviewPair.at_px`` tells where its history is.
        without = ("previous_pose",)
        self._sources = tuple(variant(traced, pixel_list=True, without=without) for _ in range(2))  # previous, current
        of_lobes = (name.split("_") for name in self._sources[0].listed_lobes)
        self._lobes = {
            place: (bounce, lobe_distance(bounce, lobe))
            for place, (bounce, lobe) in enumerate(of_lobes)
            if bounce in self.columns and lobe in lobes
        }  # place among the traced lobes -> column, distance
        self._pair: PreviewPair | None = None
        self._fresh: set[RasterSource] = set()  # whose frame has no light yet

    def draw(self, pair: PreviewPair) -> None:
        """Draw the frames of ``pair``, whose pixels ``decide`` decides from now on.

        The first one is not drawn again where it is the second one of the pair drawn before.
        """
        history, current = self._sources
        if self._pair is not None and self._pair.frame == pair.frame - 1 and current.eye is None:
            history, current = self._sources = current, history
        else:
            history.draw_history(pair.frame)
            self._fresh.add(history)
        current.draw(pair.frame)
        self._fresh.add(current)
        self._pair = pair

    def decide(
        self,
        at: Array,
        limit: int,
        audit: Array,
        *,
        halves: bool = False,
        pair: PreviewPair | None = None,
        known: dict[tuple[int, ...], Array] | None = None,
    ) -> Decisions:
        """Decide the pixels ``at`` (n, 2), column and row from the top, of ``PreviewPair.traced``; n can be 0.

        ``limit``: samples per pixel at most; ``audit`` (n,): random numbers in [0, 1) that choose what is audited;
        ``halves``: whether words and distances of halves of the samples are wanted; ``pair``: the same frames by
        another reprojection; ``known``: light of the current frame, as of ``_trace``, for calls with other histories.
        """
        listed, count, had = self._listed(pair or self._pair, at), len(at), 0
        names = (*self.columns, *(name for _, name in self._lobes.values()))
        first, end = (PixelMasks.blank(listed.words, names, len(HALVES) if halves else 0) for _ in range(2))
        luminance = np.zeros(count)
        samples, decided_samples = np.zeros(count, np.int64), np.zeros(count, np.int64)
        decided, audited = np.zeros(count, bool), np.zeros(count)
        active, light, floor = np.arange(count), np.zeros(0), None
        # Invariant: ``active`` has the pixels that are undecided or audited.  Each has had the same number ``had`` of
        # samples, and ``light`` has their mean by parts, row by row.  All other pixels have their final masks.
        while len(active):
            # As many new samples as there were, so that the mean of both is that of all.
            new = self._trace(listed.at[active], listed.taps[active], range(had, 2 * had or LEAST), known)
            light = 0.5 * (light + new) if had else new
            had = 2 * had or LEAST
            compared = listed.take(active)
            found, error, _, luminance[active] = self._compare(compared, light)
            if floor is None:
                floor = self._floor(compared, light)
            samples[active] = had
            margin = self._margin(found, error, floor, had)
            now = ~decided[active] & (margin > 1.0)
            ends = np.flatnonzero(now | (had >= limit))
            masks = self._masks(compared.take(ends), light[ends], halves)
            end.put(active[ends], masks)
            fresh = ~decided[active[ends]]
            first.put(active[ends[fresh]], _with_one_word(masks, now[ends]).take(fresh))
            decided[active[now]] = True
            decided_samples[active[~decided[active] | now]] = had
            if had < limit:
                share = np.where(margin[now] < 2.0, AUDITED[1], AUDITED[0])
                audited[active[now]] = np.where(audit[active[now]] < share, share, 0.0)
            if had >= limit:
                break
            kept = ~decided[active] | (audited[active] > 0.0)
            active, light = active[kept], light[kept]
        return Decisions(first, end, luminance, samples, decided_samples, ~decided, audited)

    def _listed(self, pair: PreviewPair, at: Array) -> _Listed:
        """The pixels ``at`` (n, 2) with the taps of their history, and what the preview ``pair`` says of each."""
        rows = at[:, 1], at[:, 0]
        here, before = pair.surface[1][rows], pair.surface[0]
        taps, weights = history_taps(
            self._settings.metrics.sampling, pair.at_px[rows], here, before, np.ones_like(before)
        )
        every = np.concatenate([at[:, None], taps], axis=1)
        frame = np.minimum(np.arange(every.shape[1]), 1)  # 0: the current pixel, then its history

        def both(images: tuple[Array, Array] | None) -> Array | None:
            if images is None:
                return None
            return np.where(
                (frame == 0)[:, None], images[1][every[..., 1], every[..., 0]], images[0][every[..., 1], every[..., 0]]
            ).astype(np.float64)

        surface = np.where(
            frame == 0, pair.surface[1][every[..., 1], every[..., 0]], before[every[..., 1], every[..., 0]]
        )
        return _Listed(at, taps, weights, pair.words[rows], surface, both(pair.emission), both(pair.color))

    def _trace(self, at: Array, taps: Array, samples: range, known: dict[tuple[int, ...], Array] | None) -> Array:
        """Trace ``samples`` of the pixels ``at`` (m, 2) and of the taps of their history, with equal numbers in both.

        ``known``: light of the pixels in the current frame, by first sample, column and row, to which what is new is
        added; None: all is new.  Radiance by parts: (m, PARTS, 1 + taps, lobes, 3) float64.
        """
        history, current = self._sources
        keys, known = np.repeat(at, taps.shape[1], axis=0), {} if known is None else known
        pixels = [(samples.start, *pixel) for pixel in at.tolist()]
        new = [place for place, pixel in enumerate(pixels) if pixel not in known]
        if new:
            traced = self._parts(current, at[new], at[new], samples)
            known.update(zip((pixels[place] for place in new), traced, strict=True))
        before = self._parts(history, taps.reshape(-1, 2), keys, samples)
        now = np.stack([known[pixel] for pixel in pixels])
        every = np.concatenate([now[:, None], before.reshape(*taps.shape[:2], *before.shape[1:])], axis=1)
        return every.swapaxes(1, 2)

    def _parts(self, source: RasterSource, pixels: Array, keys: Array, samples: range) -> Array:
        """Radiance of ``pixels`` by parts, with the sample numbers of ``keys``: (n, PARTS, lobes, 3) float64."""
        fresh = source in self._fresh
        self._fresh.discard(source)
        light = source.listed_light(self._pair.frame, pixels, keys, samples, drawn=fresh, parts=True)
        return light.reshape(len(pixels), PARTS, -1, *light.shape[2:]).astype(np.float64).mean(axis=2)

    def _changes(self, listed: _Listed, light: Array) -> dict[str, Array]:
        """Column -> its value now less that in the history, (m, ..., 3), of radiance (m, ..., 1 + taps, lobes, 3)."""
        exposure, expand = self._settings.lighting.exposure_factor, (slice(None), *[None] * (light.ndim - 4))
        half = light.shape[-2] // 2
        direct, indirect = light[..., :half, :].sum(axis=-2), light[..., half:, :].sum(axis=-2)
        values = {"direct": direct * exposure, "indirect": indirect * exposure}
        if "color" in self.columns:
            emission = 0.0 if listed.emission is None else listed.emission[expand]
            shown = display_color(direct + indirect + emission, exposure, self._settings.lighting.tone_map)
            values["color"] = np.where(listed.surface[expand][..., None], shown, listed.color[expand])
        weights = listed.weights[expand]
        return {n: values[n][..., 0, :] - blend(values[n][..., 1:, :], weights) for n in self.columns}

    def _lobe_distances(self, listed: _Listed, light: Array) -> dict[str, Array]:
        """``lobe_distance`` -> distance (m,) of each wanted lobe, of parts ``light``."""
        out = {}
        for place, (bounce, name) in self._lobes.items():
            change = light[:, :, 0, place] - blend(light[:, :, 1:, place], listed.weights[:, None])
            variance = change.var(axis=1, ddof=1) / light.shape[1]
            out[name] = distance_of(bounce, change.mean(axis=1), variance)
        return {name: self._settings.lighting.exposure_factor * distance for name, distance in out.items()}

    def _masks(self, listed: _Listed, light: Array, halves: bool) -> PixelMasks:
        """Words and distances of parts ``light``, and by each of HALVES alone where they are wanted."""
        of_all = self._words_and_distances(listed, light)
        shape = len(light), len(HALVES) if halves else 0
        if not np.prod(shape):
            return PixelMasks(*of_all, np.zeros(shape, np.uint32), {name: np.zeros(shape) for name in of_all[1]})
        every = listed.take(np.repeat(np.arange(len(light)), len(HALVES)))
        parts = light[:, HALVES].reshape(len(every.at), HALVES.shape[1], *light.shape[2:])
        words, distances = self._words_and_distances(every, parts)
        by_half = {name: distance.reshape(shape) for name, distance in distances.items()}
        return PixelMasks(*of_all, words.reshape(shape), by_half)

    def _words_and_distances(self, listed: _Listed, light: Array) -> tuple[Array, dict[str, Array]]:
        """Reason words (m,) and distances (m,) by column and lobe, of parts ``light``."""
        found, _, bits, _ = self._compare(listed, light)
        return (listed.words & ~LIGHT_BITS) | bits, found | self._lobe_distances(listed, light)

    def _compare(self, listed: _Listed, light: Array) -> tuple[dict[str, Array], dict[str, Array], Array, Array]:
        """What parts ``light`` say: distances (m,) and their standard errors (m,) by column, light bits (m,), luminance
        (m,).

        Errors: the jackknife over parts (Efron and Tibshirani, *An Introduction to the Bootstrap*, 1993, Eq. 11.5).
        """
        mean = light.mean(axis=1)
        changes = self._changes(listed, mean)
        without = self._changes(listed, (light.sum(axis=1, keepdims=True) - light) / (light.shape[1] - 1))
        found = {name: distance_of(name, changes[name], _jackknife(each)) for name, each in without.items()}
        error = {name: np.sqrt(_jackknife(distance_of(name, each))) for name, each in without.items()}
        bits, luminance = np.zeros(len(mean), np.uint32), np.zeros(len(mean))
        for name, distance in found.items():
            bits[distance > self._thresholds[name]] |= np.uint32(FEATURE_BIT[name])
        if "direct" in found:
            luminance, over = changes["direct"] @ LUMINANCE, found["direct"] > self._thresholds["direct"]
            bits[over & (luminance > 0)] |= np.uint32(Reason.LIT)
            bits[over & (luminance < 0)] |= np.uint32(Reason.SHADOWED)
        return found, error, bits, luminance

    def _floor(self, listed: _Listed, light: Array) -> dict[str, float]:
        """Column -> quantile of how far a part's distance is from that of all parts."""
        mean = self._changes(listed, light.mean(axis=1))
        return {
            name: float(
                np.quantile(np.abs(distance_of(name, each) - distance_of(name, mean[name])[:, None]), FLOOR_QUANTILE)
            )
            for name, each in self._changes(listed, light).items()
        }

    def _margin(
        self, found: Mapping[str, Array], error: Mapping[str, Array], floor: Mapping[str, float], samples: int
    ) -> Array:
        """Least distance between a column and its threshold, in units of what CONFIDENCE asks for.  (m,)."""
        clear = clear_errors()
        out = np.full(len(next(iter(found.values()))), np.inf)
        for name, distance in found.items():
            bound = clear * np.maximum(error[name], floor[name] / (samples + 1))
            away = np.abs(distance - self._thresholds[name])
            out = np.minimum(out, np.where(bound > 0, away / np.where(bound > 0, bound, 1.0), np.inf))
        return out


@dataclass(frozen=True, slots=True)
class _Listed:
    """Pixels of one pair: of each the current pixel, then the taps of its history."""

    at: Array  # (n, 2)
    taps: Array  # (n, t, 2)
    weights: Array  # (n, t)
    words: Array  # (n,) uint32, of the preview
    surface: Array  # (n, 1 + t) bool
    emission: Array | None  # (n, 1 + t, 3)
    color: Array | None  # (n, 1 + t, 3), of the background

    def take(self, rows: Array) -> _Listed:
        """The pixels ``rows`` of these."""
        values = (getattr(self, name) for name in self.__slots__)
        return _Listed(*(None if v is None else v[rows] for v in values))


def _with_one_word(masks: PixelMasks, decided: Array) -> PixelMasks:
    """``masks`` with the word of all samples for each half of them, where a pixel is ``decided`` (n,)."""
    half_words = np.where(decided[:, None], masks.words[:, None], masks.half_words)
    return replace(masks, half_words=half_words)


def distance_of(column: str, change: Array, variance: Array | float = 0.0) -> Array:
    """Distance of a light column from ``change`` (..., 3), less what its noise adds: squares are too large by the
    ``variance`` (..., 3).  (...)."""
    squares = change * change - variance
    square = squares.sum(axis=-1) if column in RADIANCE_FEATURES else squares.max(axis=-1)
    return np.sqrt(np.maximum(square, 0.0))


def _jackknife(without: Array) -> Array:
    """Variance of a statistic from its values (m, parts, ...) without each part."""
    parts = without.shape[1]
    return (parts - 1) / parts * ((without - without.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)


@lru_cache
def clear_errors() -> float:
    """Standard errors between a distance and its threshold with which a pixel is decided."""
    from scipy.special import stdtrit  # imported late: 0.3 s

    return float(stdtrit(PARTS - 1, 0.5 + 0.5 * CONFIDENCE))
