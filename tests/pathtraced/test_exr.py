"""Reading single EXR files: layouts, windows, types, and errors for broken files."""

from __future__ import annotations

import resource
import subprocess
import sys

import numpy as np
import OpenEXR
import pytest
from exr_files import HEIGHT, WIDTH, window, write

from taubench_gl import memory_budget
from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced import exr
from taubench_gl.pathtraced.exr import MAX_CHANNELS, read_exr, read_header

COMPRESSIONS = ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")


def ramp(dtype=np.float32):
    return (np.arange(HEIGHT * WIDTH).reshape(HEIGHT, WIDTH) % 64).astype(dtype)


@pytest.mark.parametrize(("name", "dtype"), [*((n, "f4") for n in COMPRESSIONS), ("ZIP", "f2"), ("ZIP", "u4")])
def test_every_compression_and_type_is_read_as_float32(tmp_path, name, dtype):
    compression = getattr(OpenEXR, f"{name}_COMPRESSION")
    image = read_exr(write(tmp_path / "a.exr", {"P.X": ramp(dtype)}, compression=compression))
    assert image.plane("P.X").dtype == np.float32
    np.testing.assert_allclose(image.plane("P.X"), ramp(), atol=0.01)


def test_multi_part_names_are_full_names(tmp_path):
    path = tmp_path / "a.exr"
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    parts = [
        OpenEXR.Part(dict(header), {"R": ramp()}, "View.Combined"),
        OpenEXR.Part(dict(header), {"View.Depth.Z": ramp() + 1}, "View.Depth"),
    ]
    OpenEXR.File(parts).write(str(path))
    image = read_exr(path)
    assert set(image.names) == {"View.Combined.R", "View.Depth.Z"} == set(read_header(path).names)
    np.testing.assert_array_equal(image.plane("View.Depth.Z"), ramp() + 1)


@pytest.mark.parametrize("start", [(0, 0), (-5, 7)], ids=["display at 0", "display elsewhere"])
@pytest.mark.parametrize("offset", [(0, 0), (3, 2), (-4, -3), (10, 6), (40, 40)])
def test_data_window_is_placed_in_the_display_window(tmp_path, offset, start):
    (x, y), (left, top) = offset, start
    header = {
        "dataWindow": window(left + x, top + y, left + x + WIDTH - 1, top + y + HEIGHT - 1),
        "displayWindow": window(left, top, left + WIDTH + 1, top + HEIGHT + 2),
    }
    image = read_exr(write(tmp_path / "a.exr", {"P.X": ramp()}, **header))
    assert image.size == (WIDTH + 2, HEIGHT + 3)
    got = image.plane("P.X")
    for row in range(HEIGHT + 3):
        for column in range(WIDTH + 2):
            inside = 0 <= row - y < HEIGHT and 0 <= column - x < WIDTH
            expected = ramp()[row - y, column - x] if inside else np.nan
            np.testing.assert_equal(got[row, column], np.float32(expected))


@pytest.mark.parametrize(
    "data", [0.1, 0.5, 0.9, 0.999, b"", b"GIF89a..", exr.MAGIC, exr.MAGIC + b"\2\0\0\0", "missing", "folder"]
)
def test_what_is_no_whole_exr_file_is_refused(tmp_path, data, capfd):
    """Numbers: the share of a file that is left."""
    path = tmp_path if data == "folder" else tmp_path / "a.exr"
    if isinstance(data, float):
        noise = np.random.default_rng(0).random((64, 64), dtype=np.float32)
        whole = write(path, {"P.X": noise, "P.Y": noise}).read_bytes()
        data = whole[: int(len(whole) * data)]
    if isinstance(data, bytes):
        path.write_bytes(data)
    with pytest.raises(PathTracedError) as error:
        read_exr(path)
    assert error.value.where == str(path)
    assert capfd.readouterr() == ("", "")  # the library's messages go to the error, not to the terminal


def test_huge_windows_are_refused_before_reading(tmp_path, monkeypatch):
    path = write(tmp_path / "a.exr", {"P.X": ramp()})
    monkeypatch.setattr(exr, "MAX_SIDE", WIDTH - 1)
    with pytest.raises(PathTracedError, match="12x8"):
        read_exr(path)
    monkeypatch.setattr(exr, "MAX_SIDE", 16384)
    monkeypatch.setattr(memory_budget, "limit", lambda: 4 * 12 * 8 - 1)
    with pytest.raises(PathTracedError) as caught:
        read_exr(path)
    assert caught.value.where == str(path)
    monkeypatch.setattr(memory_budget, "limit", lambda: 4 * 12 * 8)
    read_exr(path)


def test_deep_images_are_refused(data):
    with pytest.raises(PathTracedError, match="deep"):
        read_exr(data / "exr" / "deep" / "11.deep.exr")


def test_broken_files_are_refused_within_bounded_memory(data):
    """Each gives one line or an image; the process never uses more than 1 GiB."""
    code = """
import sys
from pathlib import Path
from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced.exr import MAX_CHANNELS, read_exr
read = 0
for path in sorted(p for p in Path(sys.argv[1]).rglob("*") if p.is_file()):
    try:
        image = read_exr(path)
        read += 1
        assert all(image.plane(n).shape == image.size[::-1] for n in image.names), path
    except PathTracedError as error:
        assert str(path) in str(error) and "\\n" not in str(error) and len(str(error)) < 600, error
print(read)
"""

    def bounded():
        resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))

    done = subprocess.run(
        [sys.executable, "-c", code, str(data / "bad_exr")],
        capture_output=True,
        text=True,
        timeout=120,
        preexec_fn=bounded,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) <= 3 and done.stderr == ""


def header(*attributes: tuple[bytes, bytes, bytes]) -> bytes:
    """A header of an EXR file: attributes (name, type, value)."""
    parts = [name + b"\0" + kind + b"\0" + len(value).to_bytes(4, "little") + value for name, kind, value in attributes]
    return b"".join(parts) + b"\0"


def channel_list(count: int) -> bytes:
    return b"".join(b"c%06d.R\0" % i + bytes(16) for i in range(count)) + b"\0"


@pytest.mark.parametrize("multipart", [False, True])
def test_files_with_too_many_channels_are_refused_before_they_are_opened(tmp_path, multipart):
    """The library needs time quadratic in the channels: 100,000 of them would take minutes."""
    path = tmp_path / "many.exr"
    if multipart:
        parts = [header((b"channels", b"chlist", channel_list(50)), (b"more", b"string", b"x" * 300))] * 200
        path.write_bytes(b"\x76\x2f\x31\x01" + (2 | 1 << 12).to_bytes(4, "little") + b"".join(parts) + b"\0")
    else:
        path.write_bytes(
            b"\x76\x2f\x31\x01\2\0\0\0"
            + header((b"channels", b"chlist", channel_list(100_000)), (b"x", b"int", bytes(4)))
        )
    for read in (read_exr, read_header):
        with pytest.raises(PathTracedError, match=f"{MAX_CHANNELS} channels"):
            read(path)
