"""Sequences of numbered files: numbers, gaps, sizes, several files per frame."""

from __future__ import annotations

import numpy as np
import pytest
from exr_files import HEIGHT, WIDTH, blender_frame, planes, write

from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced.sequence import PathTracedSequence, find_frames


def fill(folder, numbers, name="frame_{:04d}.exr", **options):
    folder.mkdir(exist_ok=True)
    for number in numbers:
        write(folder / name.format(number), blender_frame(seed=number, **options)[0])
    return folder


def test_frame_numbers_come_from_file_names(tmp_path):
    fill(tmp_path / "a", [2, 10, 9], "shot3_{}.exr")
    (tmp_path / "a" / ".shot3_11.exr").write_bytes(b"half")  # hidden: incomplete
    (tmp_path / "a" / "notes.exr").write_bytes(b"")
    assert list(find_frames(tmp_path / "a")) == [2, 9, 10]
    sequence = PathTracedSequence.open(f"exr:{tmp_path / 'a'}")
    assert (sequence.frames, sequence.size, sequence.name) == ((2, 9, 10), (WIDTH, HEIGHT), "a")


def test_a_pattern_chooses_among_several_sequences(tmp_path):
    fill(tmp_path / "a", [1, 2], "beauty.{:03d}.exr")
    fill(tmp_path / "a", [1], "other.{:03d}.exr")
    found = find_frames(f"exr:{tmp_path}/a/beauty*.exr")
    assert [p.name for (p,) in found.values()] == ["beauty.001.exr", "beauty.002.exr"]


@pytest.mark.parametrize(
    ("frames", "expected"),
    [
        ((None, None), range(3, 8)),
        ((4, None), range(4, 8)),
        ((None, 5), range(3, 5)),
        ((-2, None), range(6, 8)),
        ((0, 100), range(3, 8)),
    ],
)
def test_frames_are_chosen_by_number(tmp_path, frames, expected):
    assert PathTracedSequence.open(fill(tmp_path / "a", range(3, 8))).select(frames) == expected


def test_gaps_are_refused_and_the_longest_run_is_the_hint(tmp_path):
    sequence = PathTracedSequence.open(fill(tmp_path / "a", [1, 2, 4, 5, 6, 9]))
    with pytest.raises(PathTracedError) as error:
        sequence.select((None, None))
    assert "3, 7, 8" in error.value.what and "4:7" in error.value.hint
    assert sequence.select((4, 7)) == range(4, 7)
    with pytest.raises(PathTracedError) as error:
        sequence.select((20, None))
    assert "1:10" in error.value.hint


def test_several_files_of_one_frame(tmp_path):
    """Falcor writes one file per output: Mogwai.GBuffer.posW.12.exr, ..."""
    _, expected = blender_frame()
    outputs = {"GBuffer.posW": "position", "GBuffer.normW": "normal", "PT.color": "combined"}
    for name, values in ((name, expected[key]) for name, key in outputs.items()):
        write(tmp_path / f"Mogwai.{name}.12.exr", {k.lstrip("."): v for k, v in planes(values, "", "RGB").items()})
    sequence = PathTracedSequence.open(tmp_path, mapping="falcor")
    frame = sequence.read(12)
    np.testing.assert_allclose(frame.position, expected["position"], rtol=1e-6)
    np.testing.assert_array_equal(frame.normal, expected["normal"])


def test_a_later_frame_of_another_size_or_without_a_pass(tmp_path):
    folder = fill(tmp_path / "a", [1])
    channels = blender_frame()[0]
    write(folder / "frame_0002.exr", {k: np.ascontiguousarray(v[:, :-1]) for k, v in channels.items()})
    write(folder / "frame_0003.exr", {k: v for k, v in channels.items() if "Normal" not in k})
    sequence = PathTracedSequence.open(folder)
    for number, what in ((2, "11x8"), (3, "ViewLayer.Normal.X")):
        with pytest.raises(PathTracedError) as error:
            sequence.read(number)
        assert error.value.where == str(folder / f"frame_000{number}.exr") and what in error.value.what


def test_folders_without_numbered_files_are_refused(tmp_path):
    unnumbered = tmp_path / "unnumbered"
    unnumbered.mkdir()
    write(unnumbered / "beauty.exr", blender_frame()[0])
    for where in (tmp_path, tmp_path / "none", unnumbered):
        with pytest.raises(PathTracedError) as error:
            find_frames(where)
        assert error.value.where == str(where)


def test_the_hash_depends_on_every_byte(tmp_path):
    first = PathTracedSequence.open(fill(tmp_path / "a", [1, 2])).sha256()
    assert first == PathTracedSequence.open(fill(tmp_path / "b", [1, 2])).sha256()
    assert first != PathTracedSequence.open(fill(tmp_path / "b", [1, 2], view_position=(0, 1, 6))).sha256()
