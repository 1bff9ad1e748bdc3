"""The display shader against its float64 reference."""

from __future__ import annotations

import numpy as np
import pytest
from references.display import channel_rgb, color_scale, id_color, overlay_mask

from taubench_gl.channels import CHANNELS
from taubench_gl.conventions import Reason
from taubench_gl.features import MASK_WORDS
from taubench_gl.frame.targets import write_channel
from taubench_gl.metrics.display import BACKGROUND, KINDS
from taubench_gl.report.mask_images import mask_overlay
from taubench_gl.report.palette import color_of
from taubench_gl.viewer.display import VISUALIZATIONS, Content, Display, Other
from taubench_gl.viewer.state import OVERLAYS

SIZE = (37, 21)
SHOWN = ("frustum", "position", "normal", "lit")
ONE = 1.01 / 255


@pytest.fixture
def made(gpu):
    """made(channel, values) -> texture; made.display."""

    class Made:
        def __init__(self):
            self.display, self.items = Display(gpu, SIZE), []

        def __call__(self, channel: str, values: np.ndarray):
            info = CHANNELS[channel]
            texture = gpu.ctx.texture(SIZE, info.components, dtype=info.dtype)
            if info.dtype == "u4":
                full = np.ascontiguousarray(values[::-1], dtype=np.uint32)
                texture.write(full.tobytes())
            else:
                write_channel(texture, channel, values)
            self.items.append(texture)
            return texture

    made = Made()
    yield made
    made.display.release()
    for item in made.items:
        item.release()


def inputs(rng):
    h, w = SIZE[1], SIZE[0]
    position = rng.normal(size=(h, w, 4)).astype(np.float32)
    position[..., 3] = np.where(rng.random((h, w)) < 0.2, 0.0, np.abs(position[..., 3]) + 0.1)
    mask = rng.integers(0, MASK_WORDS, (h, w), dtype=np.uint32)
    return position, mask


@pytest.mark.parametrize("name", [n for n, p in VISUALIZATIONS.items() if p.kind != "object_motion"])
def test_visualizations_match_the_reference(made, name):
    rng = np.random.default_rng(3)
    position, mask = inputs(rng)
    visual = VISUALIZATIONS[name]
    stored = visual.channel if visual.channel in CHANNELS else "motion"  # vectors of files have the format of motion
    if visual.channel == "position":
        values = position
    elif visual.channel == "ids":
        values = rng.integers(0, 2**32, (SIZE[1], SIZE[0], 2), dtype=np.uint32)
        values[:4] = 0
    else:
        n = CHANNELS[stored].components
        values = rng.normal(size=(SIZE[1], SIZE[0], n)).astype(np.float32)
        if CHANNELS[stored].dtype == "f2":
            values = values.astype(np.float16).astype(np.float32)
        values[2, 3, :3] = np.nan
        values[4, 5, 0] = np.inf
    shown = values.copy()
    if stored == "motion":
        if visual.channel == "motion":  # that of the mask pass is finite
            values = np.nan_to_num(values, posinf=1.0)
        shown = values * np.float32([1, -1])  # the reference has +y up
    made.display.draw(
        Content(visual.kind, made(stored, values), made("position", position), made("mask", mask[..., None]),
                low=-0.5, high=1.5)
    )  # fmt: skip
    expected = channel_rgb(visual.kind, shown, -0.5, 1.5, position=position)
    assert np.abs(made.display.read() / 255.0 - expected).max() <= ONE
    assert np.ptp(expected) > 0.3


@pytest.mark.parametrize("opacity", [0.0, 0.4, 1.0])
def test_masks_match_the_reference(made, opacity):
    rng = np.random.default_rng(4)
    position, mask = inputs(rng)
    color = rng.random((SIZE[1], SIZE[0], 4)).astype(np.float32)
    made.display.draw(
        Content("encoded", made("color", color), made("position", position), made("mask", mask[..., None]),
                shown=SHOWN, opacity=opacity)
    )  # fmt: skip
    colors = np.array([color_of(OVERLAYS[n]) for n in SHOWN]) / 255.0
    expected = overlay_mask(color[..., :3], mask, np.array([int(OVERLAYS[n]) for n in SHOWN]), colors, opacity)
    assert np.abs(made.display.read() / 255.0 - expected).max() <= ONE


def test_stripes_match_the_report():
    rng = np.random.default_rng(5)
    mask = rng.integers(0, MASK_WORDS, (21, 37), dtype=np.uint32)
    reasons = (Reason.POSITION, Reason.NORMAL, Reason.LIT)
    colors = np.array([color_of(r) for r in reasons]) / 255.0
    ours = overlay_mask(np.zeros((21, 37, 3)), mask, np.array([int(r) for r in reasons]), colors, 1.0)
    theirs = mask_overlay(mask, None, reasons)
    discarded = (mask & np.uint32(int(reasons[0] | reasons[1] | reasons[2]))) != 0
    nearest = np.abs(ours[discarded][:, None] - colors).sum(-1).argmin(1)
    theirs = np.abs(theirs[discarded][:, None] / 255.0 - (0.22 * 0.45 + 0.78 * colors)).sum(-1).argmin(1)
    assert (nearest == theirs).all()


def test_split_and_difference(made):
    position, mask = inputs(np.random.default_rng(6))
    a, b = (np.full((SIZE[1], SIZE[0], 4), v, dtype=np.float32) for v in (0.25, 0.5))
    place = made("position", position)
    content = Content("encoded", made("color", a), place, made("mask", mask[..., None]),
                      comparison="split", other=Other(made("color", b), place), split=0.5, gain=2.0)  # fmt: skip
    made.display.draw(content)
    image = made.display.read()
    assert (image[:, :16] == 64).all() and (image[:, 21:] == 128).all()
    content.comparison = "other"
    made.display.draw(content)
    assert (made.display.read() == 128).all()
    content.comparison = "error"
    made.display.draw(content)
    assert np.abs(made.display.read() / 255.0 - color_scale(np.array(2 * (128 - 64) / 255.0))).max() <= ONE
    content.comparison = "difference"
    made.display.draw(content)
    assert (np.abs(made.display.read().astype(int) - 128) <= 1).all()


def test_reprojected_history_is_read_where_motion_leads(made):
    rng = np.random.default_rng(7)
    h, w = SIZE[1], SIZE[0]
    position, _ = inputs(rng)
    color, before = (rng.random((h, w, 4)).astype(np.float32) for _ in range(2))
    motion = rng.uniform(-6.0, 6.0, (h, w, 2)).astype(np.float32)
    mask = np.where(rng.random((h, w)) < 0.2, int(Reason.BEHIND), 0).astype(np.uint32)
    place = made("position", position)
    other = Other(made("color", before), place, made("motion", motion))
    made.display.draw(
        Content("encoded", made("color", color), place, made("mask", mask[..., None]), comparison="other", other=other)
    )
    rows, columns = np.indices((h, w))
    x = np.floor(columns + motion[..., 0] + 0.5).astype(int)
    up = np.floor(h - 1 - rows - motion[..., 1] + 0.5).astype(int)  # y up, where halves round up
    inside = (x >= 0) & (x < w) & (up >= 0) & (up < h) & (mask == 0)
    expected = np.full((h, w, 3), BACKGROUND)
    expected[inside] = before[h - 1 - up[inside], x[inside], :3]
    assert np.abs(made.display.read() / 255.0 - expected).max() <= ONE
    assert 0.2 < inside.mean() < 0.9


def test_a_part_of_an_image_is_drawn_anywhere(made):
    rng = np.random.default_rng(8)
    position, mask = inputs(rng)
    color = rng.random((SIZE[1], SIZE[0], 4)).astype(np.float32)
    content = Content("encoded", made("color", color), made("position", position), made("mask", mask[..., None]))
    made.display.draw(content)
    whole = made.display.read().copy()
    made.display.draw(content, (3, 4, 10, 6), first=(30, 2))  # y up; the image ends at column 36
    part = made.display.read()[SIZE[1] - 4 - 6 : SIZE[1] - 4, 3:13]
    assert (part[:, :7] == whole[SIZE[1] - 2 - 6 : SIZE[1] - 2, 30:37]).all()
    assert (part[:, 7:] == 0).all()


def test_known_colors():
    assert KINDS[0] == "encoded"
    assert np.allclose(color_scale(np.array([-1.0, 0.0]))[0], color_scale(np.array([0.0]))[0])
    lightness = color_scale(np.linspace(0, 1, 50)) @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(lightness) > 0).all(), "the scale must be readable in gray"
    assert (id_color(np.array([0], dtype=np.uint32)) == 0).all()
