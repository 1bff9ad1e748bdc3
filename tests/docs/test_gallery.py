"""Numbers below the images of docs/gallery.md come out again, by the commands that it prints."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tools"))
import recorders  # noqa: E402

NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?")
MARKED = dict(re.findall(r"<!-- record: (.*?) -->\n\n(.*?)\n\n<!-- end -->", (ROOT / "docs/gallery.md").read_text()))


@pytest.mark.parametrize("image", ["mask.png", "report.png", "viewer.png", "reuse.jpg"])
def test_the_records_of_images_run_the_printed_commands(image):
    words = recorders.gallery_command(image, out="elsewhere")
    assert str(recorders.DEMO) in words and words[words.index("--out") + 1] == "elsewhere"
    assert words.count("--out") == 1 and "elsewhere" not in recorders.gallery_command(image)


@pytest.mark.long
def test_the_numbers_come_out_again(tmp_path):
    """To the digits of the page, but for a pixel in a thousand: another driver draws edges otherwise."""
    if shutil.which("xvfb-run") is None:
        pytest.skip("xvfb-run is not installed")
    found = recorders.gallery_numbers(tmp_path)
    assert found.keys() == MARKED.keys()
    for name, text in found.items():
        assert NUMBER.sub("", text) == NUMBER.sub("", MARKED[name])
        assert [float(n) for n in NUMBER.findall(text)] == pytest.approx(
            [float(n) for n in NUMBER.findall(MARKED[name])], abs=0.1
        ), name
