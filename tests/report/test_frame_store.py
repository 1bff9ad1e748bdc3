"""Images of frame pairs: recording during a run, and reading back."""

from __future__ import annotations

import numpy as np
import pytest
from page_tools import image_of
from PIL import Image

from taubench_gl.conventions import Reason
from taubench_gl.features import MASK_WORDS
from taubench_gl.report import frame_store
from taubench_gl.report.frame_store import spread
from taubench_gl.report.run_frames import FrameRecorder, file_name, reproject_image, stored_frames

RNG = np.random.default_rng(3)
MASK = RNG.integers(0, MASK_WORDS, (12, 20)).astype(np.uint32)
IMAGE = RNG.random((12, 20, 3))
STILL = np.zeros((12, 20, 2), np.float32)


def record(folder, count: int, discarded=lambda i: 0, mask=MASK, image=IMAGE):
    folder.mkdir(exist_ok=True)
    (folder / "frames.csv").write_text("frame\n1\n")
    recorder = FrameRecorder(folder)
    for i in range(count):
        motion = np.zeros((*mask.shape, 2), np.float32)
        recorder.add(i + 1, discarded(i), image, image, mask, motion)
    recorder.finish(folder / "frames.csv")
    return stored_frames(folder)


def unpacked(uri: str) -> np.ndarray:
    image = image_of(uri)
    return image[..., 0].astype(np.uint32) | image[..., 1].astype(np.uint32) << 8


def test_reason_words_survive_the_image_format(tmp_path):
    stored, why = record(tmp_path / "run", 3)
    assert why == "" and stored.index.frames == (1, 2, 3)
    assert (unpacked(stored.uri("mask", 2)) == MASK).all()
    (tmp_path / "run" / "frames.csv").write_text("frame\n1\n2\n")
    assert stored_frames(tmp_path / "run")[0] is None, "they are of another run"


def test_evenly_spaced_pairs_and_the_worst_frame_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(frame_store, "MAX_KEPT", 8)
    stored, _ = record(tmp_path / "run", 61, discarded=lambda i: 100 if i == 37 else i)
    grid = [f for f in stored.index.frames if (f - 1) % 8 == 0]
    assert grid == list(range(1, 62, 8))
    assert set(stored.index.frames) - set(grid) == {38} and stored.index.worst == 38
    files = {p.name for p in stored.folder.iterdir()}
    assert files == {"index.json"} | {
        file_name(p, f) for f in stored.index.frames for p in ("frame", "previous", "mask")
    }


def test_large_frames_are_downscaled(tmp_path, monkeypatch):
    monkeypatch.setattr(frame_store, "MAX_WIDTH", 8)
    flat = np.full((12, 20, 3), 0.5)
    stored, _ = record(tmp_path / "run", 1, image=flat)
    assert (stored.index.width, stored.index.height, stored.index.step) == (7, 4, 3)
    assert (unpacked(stored.uri("mask", 1)) == MASK[1::3, 1::3]).all()
    with Image.open(stored.folder / "frame_00001.webp") as image:
        assert image.size == (7, 4) and abs(int(np.asarray(image).mean()) - 128) < 3


def test_images_of_an_earlier_run_are_rehistory_and_other_files_kept(tmp_path):
    record(tmp_path / "run", 5)
    (tmp_path / "run" / frame_store.FOLDER / "mine.png").write_bytes(b"kept")
    FrameRecorder(tmp_path / "run")
    assert stored_frames(tmp_path / "run")[0].index.frames == (1, 2, 3, 4, 5)  # unchanged before the first pair
    stored, _ = record(tmp_path / "run", 2)
    assert stored.index.frames == (1, 2)
    assert len(list(stored.folder.iterdir())) == 1 + 2 * 3 + 1


@pytest.mark.parametrize("text", ["{", "", '{"schema": "taubench-gl/images/1", "frames": [1]}', "\x00\xff"])
def test_a_damaged_index_loses_no_image(tmp_path, monkeypatch, text):
    """Pairs are found by their files; one with an image that cannot be decoded or has another size is left out."""
    monkeypatch.setattr(frame_store, "MAX_WIDTH", 10)
    stored, _ = record(tmp_path / "run", 5)
    rows = "".join(f"{frame}\n" for frame in range(1, 7))  # pair 6 has no images
    (tmp_path / "run" / "frames.csv").write_text(f"frame\n{rows}")
    (tmp_path / "run" / "summary.json").write_text('{"settings": {"width": 20}}')
    (stored.folder / "index.json").write_text(text)
    found, why = stored_frames(tmp_path / "run")
    expected = stored.index.width, stored.index.height, stored.index.step
    assert why == "" and found.index.frames == (1, 2, 3, 4, 5) and found.index.worst is None
    assert (found.index.width, found.index.height, found.index.step) == expected and expected[2] == 2
    assert "index.json" in found.lost and "index.json" in found.no_planes
    mask, frame = (stored.folder / file_name(part, number) for part, number in (("mask", 3), ("frame", 5)))
    mask.write_bytes(mask.read_bytes()[:-40])
    Image.new("RGB", (3, 3)).save(frame)
    assert stored_frames(tmp_path / "run")[0].index.frames == (1, 2, 4)
    for path in stored.folder.glob("previous_*"):
        path.unlink()
    found, why = stored_frames(tmp_path / "run")
    assert found is None and "index.json" in why


@pytest.mark.parametrize("damage", ["removed", "cut off", "changed"])
def test_pairs_whose_images_are_missing_or_damaged_are_left_out(tmp_path, damage):
    """The other pairs stay, and the reason names the first such file and the number of pairs."""
    stored, _ = record(tmp_path / "run", 4, discarded=lambda i: i == 2)
    assert stored.index.worst == 3 and stored.lost == ""

    def spoil(name: str) -> None:
        path = stored.folder / name
        data = path.read_bytes()
        path.write_bytes({"cut off": data[: len(data) // 2], "changed": data[:-9] + b"?" + data[-8:]}.get(damage, b""))
        if damage == "removed":
            path.unlink()

    spoil("mask_00003.png")
    found, why = stored_frames(tmp_path / "run")
    assert found.index.frames == (1, 2, 4) and found.index.worst is None and why == ""
    assert "mask_00003.png" in found.lost and "1 pair " in found.lost
    for frame in (1, 2, 4):
        spoil(f"frame_{frame:05d}.webp")
    found, why = stored_frames(tmp_path / "run")
    assert found is None and "frame_00001.webp" in why and "4 pairs" in why


def test_reprojected_image_follows_motion_with_a_checkerboard_elsewhere():
    mask = np.zeros((12, 20), np.uint32)
    mask[:, -3:] = int(Reason.OUTSIDE)
    motion = STILL.copy()
    motion[..., 0] = 3.0
    history = reproject_image(IMAGE, mask, motion)
    assert (history[:, :-3] == IMAGE[:, 3:]).all()
    assert set(np.unique(history[:, -3:])) == {0.58, 0.82}


def test_spread_keeps_both_ends_and_always():
    assert spread(tuple(range(100)), 5, None) == [0, 25, 50, 74, 99]
    assert spread(tuple(range(100)), 4, 37) == [0, 37, 50, 99]
    assert spread((1, 2), 5, 2) == [1, 2]
