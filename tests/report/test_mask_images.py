"""Mask images: colors of reasons, stripes of several reasons, legend."""

from __future__ import annotations

import imageio.v3 as iio
import numpy as np
import pytest

from taubench_gl.conventions import FRUSTUM, Reason
from taubench_gl.glossary import key_of
from taubench_gl.report.mask_images import STRIPE_PX, legend, legend_strip, mask_overlay, save_mask_image
from taubench_gl.report.palette import DEFAULT_REASONS, color_of


def one_reason(reason: Reason, shape=(6, 8)) -> np.ndarray:
    return np.full(shape, int(reason), dtype=np.uint32)


def nearest(pixel: np.ndarray) -> Reason:
    return min(DEFAULT_REASONS, key=lambda r: float(np.abs(np.subtract(color_of(r), pixel, dtype=float)).sum()))


@pytest.mark.parametrize("reason", DEFAULT_REASONS, ids=key_of)
def test_each_reason_shows_its_own_color(reason):
    bit = Reason.OUTSIDE if reason == FRUSTUM else reason
    pixel = mask_overlay(one_reason(bit))[0, 0]
    assert nearest(pixel) == reason


def test_behind_and_outside_are_frustum():
    assert np.array_equal(mask_overlay(one_reason(Reason.BEHIND)), mask_overlay(one_reason(Reason.OUTSIDE)))


def test_only_masked_pixels_are_tinted_and_row_order_is_kept():
    mask = np.zeros((4, 4), np.uint32)
    mask[0, 3] = int(Reason.NORMAL)
    image = mask_overlay(mask)
    assert image.shape == (4, 4, 3) and image.dtype == np.uint8
    tinted = np.ptp(image.astype(int), axis=-1) > 0
    assert np.argwhere(tinted).tolist() == [[0, 3]]


def test_stripes_of_overlapping_reasons_have_equal_shares():
    both = Reason.POSITION | Reason.DIRECT | Reason.COLOR
    image = mask_overlay(one_reason(both, (STRIPE_PX * 6, STRIPE_PX * 6)))
    shares = {}
    for pixel in image.reshape(-1, 3):
        shares[nearest(pixel)] = shares.get(nearest(pixel), 0) + 1
    assert set(shares) == {Reason.POSITION, Reason.DIRECT, Reason.COLOR}
    assert max(shares.values()) - min(shares.values()) <= image.shape[0] * STRIPE_PX


def test_only_requested_reasons_are_shown():
    plain = mask_overlay(one_reason(Reason(0)))
    assert np.array_equal(mask_overlay(one_reason(Reason.SKY | Reason.LIT)), plain)
    assert not np.array_equal(mask_overlay(one_reason(Reason.LIT), reasons=(Reason.LIT,)), plain)
    assert np.array_equal(mask_overlay(one_reason(Reason.LIT), reasons=()), plain)


def test_base_is_gray_and_non_finite_values_stay_local():
    base = np.random.default_rng(0).random((6, 8, 3))
    base[0, 0], base[1, 1] = np.nan, np.inf
    image = mask_overlay(one_reason(Reason(0)), base)
    assert np.ptp(image.astype(int), axis=-1).max() == 0
    assert image[0, 0, 0] < image[1, 1, 0]


@pytest.mark.parametrize(("mask", "base"), [((4,), None), ((4, 4), (4, 5, 3)), ((4, 4), (4, 4))])
def test_shapes_that_differ_raise(mask, base):
    with pytest.raises(ValueError):
        mask_overlay(np.zeros(mask, np.uint32), None if base is None else np.zeros(base))


def test_legend_counts_every_reason_of_a_pixel():
    mask = np.zeros((2, 2), np.uint32)
    mask[0, 0] = int(Reason.POSITION | Reason.NORMAL)
    mask[0, 1] = int(Reason.BEHIND)
    percents = {name: percent for name, _, percent in legend(mask)}
    assert percents["position"] == percents["normal"] == percents["frustum"] == 25.0
    assert percents["color"] == 0.0


def test_legend_strip_wraps_instead_of_cutting():
    entries = legend(one_reason(Reason.NORMAL))
    wide, narrow = legend_strip(entries, 2000), legend_strip(entries, 300)
    assert wide.shape[1] == 2000 and narrow.shape[1] == 300
    for _, color, _ in entries:
        assert np.any(np.all(narrow == color, axis=-1)), "a swatch is missing"


def test_image_file_holds_overlay_and_legend(tmp_path):
    mask = one_reason(Reason.POSITION, (300, 500))
    path = save_mask_image(tmp_path / "mask.png", mask, title="frame 1")
    image = iio.imread(path)
    assert np.array_equal(image[:300], mask_overlay(mask))
    assert image.shape[0] > 300 and image.shape[1] == 500


def test_small_masks_are_enlarged(tmp_path):
    mask = one_reason(Reason.POSITION, (2, 4))
    image = iio.imread(save_mask_image(tmp_path / "mask.png", mask))
    assert image.shape[1] == 480
