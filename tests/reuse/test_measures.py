"""Further measures: trimmed relMSE, percentiles of FLIP, HDR-FLIP, warping error, black images, optional packages."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from reuse_scenes import passing_box, still
from reuse_tools import evaluate, truth_of, with_weight

from taubench_gl.errors import SettingsError
from taubench_gl.reuse import perceptual, quality
from taubench_gl.reuse.perceptual import Perceptual, open_perceptual
from taubench_gl.reuse.scores import BLACK, MethodRecord

H, W = 40, 50
RNG = np.random.default_rng(4)


def record_of(pairs, metrics=("flip",), **more) -> MethodRecord:
    """Scores of images against references, (h, w, 3) each."""
    record = MethodRecord("a", frozenset(metrics), True, **more)
    record.begin(0)
    previous = None
    for index, (image, reference) in enumerate(pairs):
        frame = truth_of(reference, index, previous, gain=quality.fixed_gain(reference))
        previous = frame.image
        record.add(frame, with_weight(image), "linear", None)
    record.end()
    return record


def test_trimmed_error_leaves_out_fireflies_and_no_more():
    reference = np.full((H, W, 3), 0.5)
    image = reference + 0.1
    plain = quality.trimmed_relative_error(image, reference, 1.0)
    assert plain == pytest.approx(0.01 / 0.26)
    image[3, 4] = image[20, 7] = 1e6  # 2 of 2000 pixels are the largest 0.1 %
    assert quality.trimmed_relative_error(image, reference, 1.0) == pytest.approx(plain)
    image[30, 1] = 1e6  # a third one is not left out
    assert quality.trimmed_relative_error(image, reference, 1.0) > 1e3


def test_trimmed_error_does_not_depend_on_the_exposure():
    reference, image = 0.1 + RNG.random((2, H, W, 3))
    found = [
        quality.trimmed_relative_error(k * image, k * reference, quality.fixed_gain(k * reference))
        for k in (0.001, 1.0, 500.0)
    ]
    assert found == pytest.approx([found[0]] * 3)
    assert quality.fixed_gain(np.full((H, W, 3), 0.36)) == pytest.approx(0.5)
    assert quality.fixed_gain(np.zeros((H, W, 3))) is None


def test_percentiles_of_flip_are_those_of_its_map():
    reference = RNG.random((H, W, 3))
    image = np.clip(reference + 0.1 * RNG.standard_normal((H, W, 3)), 0, 1)
    row = record_of([(image, reference)]).rows[0]
    error = quality.flip_map(quality.display(image), quality.display(reference))
    for p in quality.FLIP_PERCENTILES:
        assert row[f"flip_p{p}"] == pytest.approx(np.percentile(error, p))
    assert row["flip_p50"] < row["flip_p95"] < row["flip_p99"]


def test_hdr_flip_sees_what_the_display_clips():
    reference = np.full((H, W, 3), 4.0)
    reference[: H // 2] = 16.0
    image = np.full((H, W, 3), 4.0)  # both white on the display
    assert quality.flip_map(quality.display(image), quality.display(reference)).max() == 0.0
    assert quality.hdr_flip(image, reference) > 0.05 and quality.hdr_flip(reference, reference) == 0.0
    image[3, 4] = np.inf
    with pytest.raises(ValueError, match="finite"):
        quality.hdr_flip(image, reference)


def test_hdr_flip_computes_its_exposures():
    """The two radiances that ACES maps to 0.85, by bisection of the tone map."""
    low, high = 0.0, 100.0
    for _ in range(100):
        x = 0.6 * 0.5 * (low + high)
        low, high = (0.5 * (low + high), high) if x * (2.51 * x + 0.03) < 0.85 * (x * (2.43 * x + 0.59) + 0.14) else (
            low, 0.5 * (low + high))  # fmt: skip
    reference = np.full((H, W, 3), 0.5)
    reference[0, 0] = 8.0
    found = quality.flip_exposures(reference)
    assert found == pytest.approx((np.log2(low / 8.0), np.log2(low / 0.5)), abs=1e-9)
    mostly_black = np.zeros((H, W, 3))
    mostly_black[0, 0] = 1e-9  # less than the least median of FLIP
    first, last = quality.flip_exposures(mostly_black)
    assert first == last == pytest.approx(np.log2(low / 1e-9))
    assert quality.flip_exposures(np.zeros((H, W, 3))) is quality.flip_exposures(np.full((H, W, 3), 1e-42)) is None


def test_a_frame_whose_reference_has_no_light_has_no_hdr_flip(monkeypatch):
    """FLIP's package is not asked: it ends the process."""
    black, gray = np.zeros((H, W, 3)), np.full((H, W, 3), 0.3)
    asked, flip = [], quality._flip()

    class Asked:
        @staticmethod
        def evaluate(reference, *rest, **how):
            asked.append(reference)
            return flip.evaluate(reference, *rest, **how)

    monkeypatch.setattr(quality, "_flip", lambda: Asked)
    record = record_of([(gray, gray), (gray, black), (gray, 2.0 * gray)], metrics=("hdr_flip",))
    assert [row["hdr_flip"] is None for row in record.rows] == [False, True, False]
    assert record.summary()["mean"]["hdr_flip"] > 0.0 and all(reference.any() for reference in asked)
    summary = record_of([(gray, black)] * 3, metrics=("hdr_flip",)).summary()
    assert summary["mean"]["hdr_flip"] is None and summary["reasons"]["hdr_flip"]


def test_warping_error_of_still_and_changing_images():
    before, everywhere, still_px = RNG.random((H, W, 3)), np.ones((H, W), bool), np.zeros((H, W, 2))
    assert quality.warp_error(before, before, still_px, everywhere) == 0.0
    assert quality.warp_error(before + 0.1, before, still_px, everywhere) == pytest.approx(0.01)
    assert quality.warp_error(before, before, still_px, ~everywhere) is None
    moved = np.roll(before, 2, axis=1)
    inner = everywhere.copy()
    inner[:, :2] = False
    assert quality.warp_error(moved, before, still_px + [-2.0, 0.0], inner) == 0.0


def test_black_against_black_is_not_measured():
    black, gray = np.zeros((H, W, 3)), np.full((H, W, 3), 0.3)
    summary = record_of([(black, black)] * 3, metrics=("flip", "ssim", "tpsnr", "flicker")).summary()
    assert set(summary["mean"].values()) == {None} and summary["black_frames"] == 3
    assert summary["reasons"]["flip"] == summary["reasons"]["psnr_db"] == summary["reasons"]["relmse"] == BLACK
    mixed = record_of([(black, black), (black, black), (gray, black), (black, gray)])
    display = quality.display(gray)[0, 0, 0]
    assert mixed.summary()["mean"]["psnr_db"] == pytest.approx(-20.0 * np.log10(display))
    assert [row["relmse"] is None for row in mixed.rows] == [True, True, False, False]
    assert mixed.summary()["mean"]["linear_mse"] == pytest.approx(0.09)  # over the frames with an image
    assert mixed.summary()["black_frames"] == 2


def test_measures_in_an_evaluation():
    done = evaluate(passing_box(), ["none", "accumulate"], (8, 12), metrics=("flip", "hdr_flip", "warp_error"))
    mean = {name: m["mean"] for name, m in done.summary["methods"].items()}
    assert mean["none"]["hdr_flip"] == 0.0 < mean["accumulate"]["hdr_flip"]
    assert mean["none"]["warp_error"] == pytest.approx(done.summary["reference"]["warp_error"])
    assert mean["accumulate"]["flip_p99"] > mean["accumulate"]["flip_p50"]
    assert done.summary["methods"]["none"]["reasons"]["cvvdp_jod"] == "not requested"


def test_sequence_measure_gets_the_counted_frames_of_every_seed():
    seen = []

    def cvvdp(test: np.ndarray, reference: np.ndarray) -> float:
        seen.append((test.shape, reference.dtype))
        return 10.0 - float(np.abs(test.astype(float) - reference).mean())

    gray = np.full((H, W, 3), 0.3)
    record = record_of([(gray, gray)] * 4, metrics=("cvvdp",), warmup=2, perceptual=Perceptual(cvvdp=cvvdp))
    assert seen == [((2, H, W, 3), np.uint8)]
    assert [row["cvvdp_jod"] for row in record.rows] == [None, None, 10.0, 10.0]
    assert record.summary()["mean"]["cvvdp_jod"] == 10.0


def test_image_too_small_for_lpips_says_so():
    gray = np.full((H, W, 3), 0.3)
    small = Perceptual(lpips=lambda shown, reference: None)
    reasons = record_of([(gray, gray)] * 3, metrics=("lpips",), perceptual=small).summary()["reasons"]
    assert str(perceptual.LPIPS_SIDE) in reasons["lpips"]


def test_missing_packages_and_weights_are_refused(monkeypatch, tmp_path):
    monkeypatch.setattr(perceptual, "find_spec", lambda name: None)
    for metric in ("lpips", "cvvdp"):
        with pytest.raises(SettingsError, match=metric):
            evaluate(still(), ["none"], (0, 3), metrics=(metric,))
    monkeypatch.setattr(perceptual, "find_spec", lambda name: name)
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(hub=SimpleNamespace(get_dir=lambda: str(tmp_path))))
    with pytest.raises(SettingsError, match=perceptual.ALEXNET):
        open_perceptual(("lpips",), 24.0)
    monkeypatch.setitem(sys.modules, "pycvvdp", SimpleNamespace())  # a broken installation
    with pytest.raises(SettingsError) as caught:
        open_perceptual(("cvvdp",), 24.0)
    assert "\n" not in str(caught.value)
    assert open_perceptual(("flip",), 24.0) == Perceptual()


def test_color_video_vdp_of_equal_and_noisy_sequences():
    pytest.importorskip("pycvvdp")  # first: torch takes long to import
    pytest.importorskip("torch")
    try:
        measure = open_perceptual(("cvvdp",), 24.0).cvvdp
    except SettingsError as error:  # installed, but of other versions than its parts need
        pytest.skip(str(error))
    image = np.full((4, 64, 96, 3), 128, np.uint8)
    noisy = np.clip(image + RNG.normal(0.0, 20.0, image.shape), 0, 255).astype(np.uint8)
    assert measure(image, image) == pytest.approx(10.0) and measure(noisy, image) < 9.0
