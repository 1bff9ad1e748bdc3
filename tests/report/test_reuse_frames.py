"""Stored images of a reuse evaluation: what is kept, the errors of classes, and what the page gets."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from page_tools import image_of

from taubench_gl.report import frame_store
from taubench_gl.report.reuse_frames import NO_IMAGES, ReuseRecorder, file_name, reuse_images

CLASSES = 4
HEIGHT, WIDTH = 12, 20


def frame(number: int, methods=("a", "b")):
    """Images, error maps and classes that depend on the number."""
    rng = np.random.default_rng(number)
    images = {name: rng.random((HEIGHT, WIDTH, 3)) for name in ("input", *methods, "reference")}
    errors = {name: rng.random((HEIGHT, WIDTH)) for name in methods}
    return images, errors, rng.integers(0, CLASSES - 1, (HEIGHT, WIDTH)).astype(np.int8)


def record(out: Path, count: int, seeds=(0,), methods=lambda n: ("a", "b"), worst: int | None = None):
    out.mkdir(exist_ok=True)
    (out / "frames.csv").write_text("frame\n1\n")
    recorder = ReuseRecorder(out, CLASSES)
    for seed in seeds:
        for n in range(count):
            images, errors, classes = frame(n + 100 * seed, methods(n))
            if n == worst:
                errors = {name: np.ones_like(e) for name, e in errors.items()}
            recorder.add(n, seed, images, errors, classes)
    recorder.finish(out / "frames.csv")
    return reuse_images(out)


def test_classes_survive_exactly_and_images_nearly(tmp_path):
    found = record(tmp_path / "run", 3, worst=0)
    assert found.data["worst"] != 0, "the first frame has no history"
    assert found.data["names"] == ["input", "a", "b", "reference"]
    assert [i["n"] for i in found.data["items"]] == [0, 1, 2]
    _, errors, classes = frame(1)
    item = found.data["items"][1]
    assert (image_of(item["classes"])[..., 0] == classes).all()
    assert item["errors"][0] is None and item["errors"][3] is None and item["images"][3] is not None
    stored = image_of(item["errors"][1]).astype(float)[..., 0] / 255
    assert np.abs(stored - errors["a"]).mean() < 0.15  # white noise is the worst case of a lossy format
    assert np.corrcoef(stored.ravel(), errors["a"].ravel())[0, 1] > 0.8


def test_class_errors_are_those_of_the_full_maps(tmp_path):
    found = record(tmp_path / "run", 2).data
    for n in range(2):
        _, errors, classes = frame(n)
        counts = [int((classes == k).sum()) for k in range(CLASSES)]
        assert found["class_pixels"][n] == counts and counts[-1] == 0
        for name, error in errors.items():
            expected = [error[classes == k].mean() for k in range(CLASSES - 1)]
            assert found["class_errors"][name][n][:-1] == pytest.approx(expected, rel=1e-5)
            assert found["class_errors"][name][n][-1] is None


def test_the_first_seed_is_recorded(tmp_path):
    assert record(tmp_path / "one", 3).data == record(tmp_path / "two", 3, seeds=(0, 1)).data


def test_a_method_that_failed_has_no_image_from_then_on(tmp_path):
    found = record(tmp_path / "run", 3, methods=lambda n: ("a", "b") if n < 2 else ("a",)).data
    assert found["items"][1]["images"][2] is not None and found["items"][2]["images"][2] is None
    assert found["class_errors"]["b"][2] is None and found["class_errors"]["a"][2] is not None


def test_the_worst_frame_is_kept_and_files_of_others_are_removed(tmp_path, monkeypatch):
    monkeypatch.setattr(frame_store, "MAX_KEPT", 4)
    out = tmp_path / "run"
    found = record(out, 17, worst=11).data
    kept = [i["n"] for i in found["items"]]
    assert found["worst"] == 11 and 11 in kept and len(kept) <= 5
    expected = {"index.json"} | {file_name("classes", None, n) for n in kept}
    expected |= {file_name("image", i, n) for n in kept for i in range(4)} | {
        file_name("error", i, n) for n in kept for i in (1, 2)
    }
    assert {p.name for p in (out / "images").iterdir()} == expected
    assert len(found["every_frame"]) == 17  # errors of classes are those of every frame
    record(out, 2, methods=lambda n: ("a",))
    assert len(list((out / "images").glob("image*.webp"))) == 2 * 3  # nothing of the earlier evaluation


def test_a_byte_budget_leaves_out_frames(tmp_path):
    record(tmp_path / "run", 12, worst=5)
    size = len(json.dumps(reuse_images(tmp_path / "run").data["items"]))
    found = reuse_images(tmp_path / "run", budget=size // 3)
    assert len(json.dumps(found.data["items"])) <= size // 3 + 200
    assert 2 <= len(found.data["items"]) <= 4 and 5 in [i["n"] for i in found.data["items"]]
    assert "of 12 frames" in found.text
    assert len(reuse_images(tmp_path / "run", most=3).data["items"]) == 3


def test_why_there_are_no_images(tmp_path):
    assert reuse_images(None).data is None and reuse_images(tmp_path).text == NO_IMAGES
    out = tmp_path / "run"
    record(out, 2)
    (out / "frames.csv").write_text("frame\n2\n")
    assert reuse_images(out).data is None and "another evaluation" in reuse_images(out).text
    (out / "images" / "index.json").write_text('{"schema": 3}')
    assert reuse_images(out).data is None
