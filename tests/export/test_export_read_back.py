"""Reading through pixel buffers one frame late gives the bits of an immediate read; buffers are reused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from export_tools import RASTERIZED, drawn, same
from repeated import few

from taubench_gl.channels import CHANNELS
from taubench_gl.frame.read_back import ChannelReader
from taubench_gl.frame.targets import write_channel

pytestmark = pytest.mark.usefixtures("coarse_light")


@pytest.mark.parametrize("jitter", few(["halton", "none"]))
def test_buffered_frames_equal_immediate_ones(jitter: str) -> None:
    numbers = (0, 1, 2, 9, 10, 60)  # the first, a gap, and the last
    buffered_frames, immediate = (drawn(numbers, jitter=jitter, buffered=buffered) for buffered in (True, False))
    assert [frame.number for frame in buffered_frames] == [frame.number for frame in immediate] == list(numbers)
    for one, other in zip(buffered_frames, immediate, strict=True):
        assert set(one.channels) == set(other.channels) == set(RASTERIZED)
        for name in one.channels:
            same(one.channels[name], other.channels[name])
        for name in one.camera:
            same(one.camera[name], other.camera[name])
    assert not np.array_equal(immediate[1].channels["color"], immediate[2].channels["color"])


def test_an_image_holds_the_contents_at_its_start(gpu, monkeypatch) -> None:
    size = (7, 5)
    texture = gpu.ctx.texture(size, CHANNELS["normal"].components, dtype="f4")
    reader, rng = ChannelReader(gpu, buffered=True), np.random.default_rng(1)
    values = [rng.random((5, 7, 4), dtype=np.float32) for _ in range(4)]
    images = []
    for one in values[:2]:
        write_channel(texture, "normal", one)
        images.append(reader.start(texture, "normal"))
    write_channel(texture, "normal", values[2])
    for image, one in zip(images, values[:2], strict=True):
        assert np.array_equal(image.get(), one)
    monkeypatch.setattr(gpu.ctx, "buffer", lambda **_: pytest.fail("a buffer was created although two are free"))
    write_channel(texture, "normal", values[3])
    assert np.array_equal(reader.start(texture, "normal").get(), values[3])
    reader.release()
    texture.release()


def test_buffering_is_chosen_by_device(gpu) -> None:
    assert [ChannelReader(replace(gpu, software=software)).buffered for software in (False, True)] == [True, False]
