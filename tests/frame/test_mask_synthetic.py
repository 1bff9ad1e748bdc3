"""The mask pass on synthetic channels that a file may contain but a rasterizer never writes; all features at once.

NaN and infinity in any channel, sky anywhere, surfaces behind the previous camera, radiance: against the float64
reference.  Away from every threshold the two must agree bit for bit.  Within a stated band around one (a distance at
its threshold, a sample position half-way between two pixels, the edge of the screen) float32 and float64 may decide
differently: few.  tests/frame/test_goldens.py has masks of real scenes.
"""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from frame_tools import THRESHOLDS, rotation_about

from taubench_gl.animation import View
from taubench_gl.animation.pairs import reprojection as pair_matrices
from taubench_gl.channels import CHANNELS
from taubench_gl.conventions import HISTOGRAM_BINS, NO_HISTORY, NOT_COMPARABLE, Reason
from taubench_gl.features import FEATURE_BIT, FEATURES, LIGHT_FEATURES, MASK_WORDS
from taubench_gl.frame.passes.masks import MaskOptions, MaskPass
from taubench_gl.frame.targets import read_channel, write_channel
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.metrics.counts import bin_of, counts_of
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.scene.model import Camera

SIZE = (131, 77)
LENS = Camera(yfov=1.1, znear=0.5, zfar=50.0)
FLIPS = 2e-3
BAND_PX = 2e-3  # sample positions and screen edges, pixels: float32 of coordinates up to 500
BAND = 2e-4  # distances, relative to 1 + threshold


def views(turn: float = 7.0, step=(0.3, -0.1, 0.6)) -> tuple[View, View]:
    then = View(np.array([10.0, 2.0, -3.0]), rotation_about("y", 30), LENS)
    now = View(then.position + step, then.world_from_view @ rotation_about("y", turn) @ rotation_about("z", 3), LENS)
    return now, then


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def frame(rng, view: View, broken: float, smooth: bool = True) -> dict[str, np.ndarray]:
    """Channels of one frame: surfaces at random depths along the pixels' own rays, a fifth of it sky."""
    w, h = SIZE
    x, y = np.meshgrid((np.arange(w) - (w - 1) / 2) * 2 / h, ((h - 1) / 2 - np.arange(h)) * 2 / h)
    rays = np.stack([x, y, np.full_like(x, -1 / np.tan(LENS.yfov / 2))], axis=-1) * np.tan(LENS.yfov / 2)
    depth = 3 + np.sin(x * 3) + np.cos(y * 5) + (rng.uniform(-0.3, 0.3, (h, w)) if not smooth else 0)
    depth[(x - 0.4) ** 2 + y**2 < 0.2] = 1.2
    depth[rng.random((h, w)) < 0.2] = 0
    position = np.concatenate([(rays * depth[..., None]) @ view.world_from_view.T, depth[..., None]], axis=-1)
    out = {
        "position": position,
        "normal": unit(rng.normal([0, 0, 2], 0.2, (h, w, 3))),
        "prev_position": position[..., :3] + rng.normal(0, 0.1, (h, w, 3)),
        "direct": rng.exponential(0.1, (h, w, 3)),
        "indirect": rng.exponential(0.1, (h, w, 3)),
        "color": rng.random((h, w, 3)) * 0.3,
    }
    for values in out.values():
        where = rng.random((h, w)) < broken
        which = rng.integers(0, values.shape[-1], (h, w))
        bad = rng.choice([np.nan, np.inf, -np.inf], (h, w))
        rows, columns = np.nonzero(where)
        values[rows, columns, which[rows, columns]] = bad[rows, columns]
    return out


def near_half(x: np.ndarray, sampling: str) -> np.ndarray:
    """Pixels whose history tap (or set of taps) hangs on the last digit of the coordinate."""
    shifted = x + 0.5 if sampling == "nearest" else x
    return np.abs(shifted - np.round(shifted)) < BAND_PX


def in_band(reference, result, sampling: str, thresholds) -> np.ndarray:
    h, w = result.mask.shape
    at = np.nan_to_num(reference.at_px, nan=-1e9)
    band = near_half(at[..., 0], sampling) | near_half(at[..., 1], sampling)
    band |= (np.abs(at[..., 0]) < 1) & (np.abs(at[..., 0] + 1 / 256) < BAND_PX)
    for k, last in ((0, w - 1), (1, h - 1)):
        for edge in (-1 / 256, last + 1 / 256):
            band |= np.abs(at[..., k] - edge) < BAND_PX
    for feature, distance in reference.distances.items():
        t = thresholds[feature]
        band |= np.abs(np.nan_to_num(distance, nan=1e9, posinf=1e9) - t) < BAND * (1 + t)
    # DISOCCLUDED and OCCLUDING hang on a difference of ranges; its sign cannot be near its threshold by less.
    reach = np.linalg.norm(result.current["position"][..., :3], axis=-1)
    return band | (reach > 1e4)


def evaluate(gpu, now, then, pair, *, reprojection="camera", sampling="nearest", radiance=LIGHT_FEATURES, declared=0,
             distances=False):  # fmt: skip
    """Upload, run, read back; the channels come back as the GPU held them (some are half floats)."""
    textures = []
    for channels in (now, then):
        textures.append({})
        for name, values in channels.items():
            info = CHANNELS[name]
            texture = gpu.ctx.texture(SIZE, info.components, dtype=info.dtype)
            write_channel(texture, name, values)
            textures[-1][name] = texture
    context = GpuContext(gpu)
    options = MaskOptions(reprojection, sampling, radiance, cuts="ids" in now, write_mask=True, write_motion=True)
    masks = MaskPass(context, SIZE, dataclasses.replace(options, write_distances=distances))
    masks.run(pair, THRESHOLDS, *textures, declared=declared)
    counts = masks.read()
    result = SimpleNamespace(
        mask_histogram=counts.mask_histogram.astype(np.int64),
        histograms=counts.histograms.astype(np.int64),
        mask=read_channel(masks.mask, "mask")[..., 0],
        motion=read_channel(masks.motion, "motion"),
        distances=read_channel(masks.distances, "distances") if distances else None,
        changes=read_channel(masks.changes, "changes") if distances else None,
        current={n: read_channel(t, n) for n, t in textures[0].items()},
        history={n: read_channel(t, n) for n, t in textures[1].items()},
    )
    masks.release()
    context.release()
    for texture in (*textures[0].values(), *textures[1].values()):
        texture.release()
    return result


@pytest.mark.parametrize("broken", [0.0, 0.02])
@pytest.mark.parametrize("sampling", ["nearest", "bilinear"])
@pytest.mark.parametrize("reprojection", ["camera", "motion"])
@pytest.mark.parametrize("seed", [1, 2])
def test_every_feature_and_every_fault(gpu, broken: float, sampling: str, reprojection: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    now_view, then_view = views()
    now, then = frame(rng, now_view, broken), frame(rng, then_view, broken)
    pair = pair_matrices(now_view, then_view, *SIZE)
    got = evaluate(gpu, now, then, pair, reprojection=reprojection, sampling=sampling)
    reference = pair_masks(got.current, got.history, pair, THRESHOLDS, sampling=sampling, reprojection=reprojection)
    differ = got.mask != reference.mask
    ranges = np.uint32(Reason.DISOCCLUDED | Reason.OCCLUDING)
    hard = differ & ~in_band(reference, got, sampling, THRESHOLDS) & ((got.mask ^ reference.mask) & ~ranges > 0)
    assert not hard.any(), f"{hard.sum()} differ, first at {np.argwhere(hard)[0]}"
    assert differ.mean() <= FLIPS
    np.testing.assert_array_equal(got.mask_histogram, np.bincount(got.mask.ravel(), minlength=MASK_WORDS))
    counts = counts_of(got.mask_histogram)
    assert (counts["invalid"] > 0) == (broken > 0)
    # Every reason there is takes part, or the comparison above shows nothing.
    for name in ("sky", "history_sky", "outside", "position", "normal", "direct", "indirect", "color", "disoccluded",
                 "occluding", "lit", "shadowed"):  # fmt: skip
        assert counts[name] > 0, name
    for i, feature in enumerate(FEATURES):
        tail, expected = (np.cumsum(x[:0:-1]) for x in (got.histograms[i], reference.histogram(feature)))
        assert np.abs(tail - expected).max() <= FLIPS * got.mask.size


@pytest.mark.parametrize("sampling", ["nearest", "bilinear"])
def test_distances_of_every_pixel(gpu, sampling: str) -> None:
    """Distances are those of the reference and give the recorded counts at the thresholds and edges of the curve."""
    rng = np.random.default_rng(3)
    now_view, then_view = views()
    now, then = frame(rng, now_view, 0.02), frame(rng, then_view, 0.02)
    pair = pair_matrices(now_view, then_view, *SIZE)
    plain = evaluate(gpu, now, then, pair, sampling=sampling)
    got = evaluate(gpu, now, then, pair, sampling=sampling, distances=True)
    np.testing.assert_array_equal(got.mask, plain.mask)
    np.testing.assert_array_equal(got.histograms, plain.histograms)
    features = dict(zip(("position", "normal", "direct", "indirect"), np.moveaxis(got.distances, -1, 0), strict=True))
    features["color"] = got.changes[..., 0]
    reference = pair_masks(got.current, got.history, pair, THRESHOLDS, sampling=sampling)
    comparable = (got.mask & np.uint32(NOT_COMPARABLE)) == 0
    for i, name in enumerate(FEATURES):
        assert not features[name][~comparable].any()
        over = features[name] > np.float32(THRESHOLDS[name])
        np.testing.assert_array_equal(over, (got.mask & np.uint32(FEATURE_BIT[name])) != 0)
        counted = np.bincount(bin_of(features[name][comparable]), minlength=HISTOGRAM_BINS)
        np.testing.assert_array_equal(counted[1:], got.histograms[i][1:])
        _close(features[name], reference.distances[name], comparable)
    depth, luminance = got.changes[..., 1], got.changes[..., 2]
    _close(depth, reference.changes["depth"], comparable)
    _close(luminance, reference.changes["luminance"], comparable)
    position = features["position"] > np.float32(THRESHOLDS["position"])
    for bit, farther in ((Reason.DISOCCLUDED, depth), (Reason.OCCLUDING, -depth)):
        np.testing.assert_array_equal((got.mask & bit) != 0, position & (farther > np.float32(THRESHOLDS["position"])))
    direct = features["direct"] > np.float32(THRESHOLDS["direct"])
    for bit, sign in ((Reason.LIT, 1), (Reason.SHADOWED, -1)):
        np.testing.assert_array_equal((got.mask & bit) != 0, direct & (sign * luminance > 0))


def _close(values, expected, comparable) -> None:
    """Equal within rounding, but for pixels in which rounding chooses another history sample."""
    expected = np.nan_to_num(expected, nan=0.0, posinf=np.inf, neginf=-np.inf)
    differ = comparable & ~np.isclose(values, expected, rtol=1e-4, atol=1e-4)
    assert differ.mean() <= FLIPS


@pytest.mark.parametrize("sampling", ["nearest", "bilinear"])
def test_surfaces_without_history_are_cut_alone(gpu, sampling: str) -> None:
    """Marked surfaces are CUT and nothing else; marks on sky and on broken pixels mean nothing; the rest is as ever."""
    rng = np.random.default_rng(9)
    now_view, then_view = views()
    now, then = frame(rng, now_view, 0.02), frame(rng, then_view, 0.02)
    pair = pair_matrices(now_view, then_view, *SIZE)
    plain = evaluate(gpu, now, then, pair, sampling=sampling)
    marked = rng.random(plain.mask.shape) < 0.3
    ids = np.stack([rng.integers(1, 99, plain.mask.shape), np.where(marked, NO_HISTORY, 0) | 7], axis=-1)
    got = evaluate(gpu, now | {"ids": ids.astype(np.uint32)}, then, pair, sampling=sampling)
    reference = pair_masks(got.current, got.history, pair, THRESHOLDS, sampling=sampling)
    broken = np.logical_or.reduce(
        [~np.isfinite(got.current[n]).all(axis=-1) for n in ("position", "normal", *LIGHT_FEATURES)]
    )
    cut = marked & (got.current["position"][..., 3] > 0) & ~broken
    assert 0.1 < cut.mean() < 0.3
    np.testing.assert_array_equal(got.mask[cut], int(Reason.CUT))
    np.testing.assert_array_equal(got.mask[~cut], plain.mask[~cut])
    np.testing.assert_array_equal(reference.mask & Reason.CUT > 0, cut)
    counts = counts_of(got.mask_histogram)
    assert counts["cut"] == cut.sum() and not got.motion[cut].any()
    assert sum(counts[name] for name in ("cut", "invalid", "frustum", "comparable")) == counts["pixels"]
    assert (got.mask != reference.mask).mean() <= FLIPS


def test_an_invalid_pixel_is_sky_where_its_position_is_known(gpu) -> None:
    """A share of surface pixels has no sky in it, and loses no pixel whose position is broken."""
    view = views()[1]
    clean = frame(np.random.default_rng(9), view, 0)
    clean["position"][40, 60] = 0
    for name, at, sky in (("direct", (40, 60), True), ("normal", (40, 60), True), ("position", (40, 60), False),
                          ("direct", (20, 30), False)):  # fmt: skip
        spoiled = {n: v.copy() for n, v in clean.items()}
        spoiled["position"][20, 30] = (0, 0, -2, 2)
        spoiled[name][at][1] = np.nan
        mask = evaluate(gpu, spoiled, clean, pair_matrices(view, view, *SIZE)).mask
        assert mask[at] == (Reason.INVALID | Reason.SKY if sky else Reason.INVALID)


def test_features_not_given_are_not_judged(gpu) -> None:
    rng = np.random.default_rng(8)
    now_view, then_view = views()
    now, then = frame(rng, now_view, 0), frame(rng, then_view, 0)
    pair = pair_matrices(now_view, then_view, *SIZE)
    full = evaluate(gpu, now, then, pair)
    lean = evaluate(gpu, now, then, pair, radiance=())
    radiance = np.uint32(Reason.DIRECT | Reason.INDIRECT | Reason.COLOR | Reason.LIT | Reason.SHADOWED)
    assert not (lean.mask & radiance).any()
    np.testing.assert_array_equal(lean.mask, full.mask & ~radiance)
