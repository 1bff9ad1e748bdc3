"""The pinned pixel: clicks, magnified images, names, distance bars; and controls that no window cuts off."""

from __future__ import annotations

import numpy as np
import pytest
from fixed import fixed_settings
from references.display import channel_rgb
from viewer_tools import DEMO, SIZE

from taubench_gl.frame.targets import raw_image


def click(driven, x: int, row: int) -> None:
    at = driven.viewer.layout.place(x, row, driven.state.size)
    driven.run(f"click {at[0]} {at[1]}")


def tiles(driven) -> np.ndarray:
    """The magnified images, (3, side, side, 3) uint8, row 0 at the top."""
    texture = driven.engine.magnified
    out = raw_image(texture)
    texture.read_into(out)
    side = driven.state.magnified
    return out[::-1, :, :3].reshape(side, 3, side, 3).swapaxes(0, 1)


def around(image: np.ndarray, x: int, row: int, side: int) -> np.ndarray:
    return image[row - side // 2 : row + side // 2 + 1, x - side // 2 : x + side // 2 + 1]


def test_a_click_pins_a_pixel_and_a_drag_does_not(drive):
    driven = drive(window=(1280, 720))
    driven.run("frame 8")
    click(driven, 40, 30)
    driven.run("expect probe_pinned == 1\nexpect probe.x == 40\nexpect probe.y == 30\nmouse 5 5\nexpect probe.x == 40")
    click(driven, 41, 30)
    driven.run("expect probe.x == 41\nexpect probe_pinned == 1")
    click(driven, 41, 30)
    driven.run("expect probe_pinned == 0")
    x, y = driven.viewer.layout.place(20, 20, SIZE)
    driven.run(f"mouse {x} {y}\ndrag {x + 60} {y}\nexpect probe_pinned == 0")


def test_the_same_pixel_is_magnified_in_three_images(drive):
    driven = drive(window=(1280, 720))
    driven.run("frame 8\nset overlays off\nset channel headlight\nset magnified 9")
    engine = driven.engine
    inner = np.linalg.norm(engine.motion(), axis=-1)[20:34, 20:76]
    x, y = (int(v) + 20 for v in np.unravel_index(inner.argmax(), inner.shape)[::-1])
    click(driven, x, y)
    found = driven.viewer.probe()
    previous, reprojected, current = tiles(driven)
    assert (current == around(engine.image(), x, y, 9)).all()
    before = channel_rgb(
        "headlight", engine.feed.source.read("normal", previous=True), 0.0, 1.0,
        position=engine.feed.source.read("position", previous=True),
    )  # fmt: skip
    column, row = (int(np.floor(v + 0.5)) for v in found.at)
    assert (column, row) != (x, y)
    assert np.abs(previous / 255.0 - around(before, column, row, 9)).max() < 2 / 255
    assert (reprojected[4, 4] == previous[4, 4]).all()
    driven.run("set magnified 5")
    assert (tiles(driven)[2] == around(engine.image(), x, y, 5)).all()
    driven.run("set magnified 11")  # at the border of the image they end
    click(driven, 1, 1)
    current = tiles(driven)[2]
    assert (current[:4] == 0).all() and (current[:, :4] == 0).all()
    assert (current[4:, 4:] == driven.engine.image()[:7, :7]).all()


def test_names_of_a_pixel(drive):
    driven = drive(window=(1280, 720))
    driven.run("frame 8\nset probe_pinned on")
    source = driven.engine.feed.source
    ids = source.read("ids")
    scene, draws = source.renderer.scene, source.renderer.draws
    for record in np.unique(ids[..., 0])[1:6]:
        row, x = np.argwhere(ids[..., 0] == record)[0]
        driven.state.probe = int(x), int(row)
        names, draw = driven.viewer.probe_names(), draws[record - 1]
        assert names.object == scene.nodes.names[draw.node]
        assert names.material == scene.materials[draw.material].name
        driven.run(f"expect probe.object == {names.object!r}\nexpect probe.material == {names.material!r}")
    row, x = np.argwhere(ids[..., 0] == 0)[0]
    driven.state.probe = int(x), int(row)
    assert driven.viewer.probe_names() is None


def test_distance_bars():
    pytest.importorskip("imgui_bundle")
    from taubench_gl.viewer.pixel_panel import bar_share

    assert bar_share(0.0, 0.1) == 0.0 and bar_share(0.1, 0.1) == 0.5 and bar_share(9.0, 0.1) == 1.0
    assert bar_share(0.0, 0.0) == 0.0 and bar_share(1e-9, 0.0) == 1.0


def inside(layout, rect) -> bool:
    """Whether a control lies in one of the panels."""
    x, y, width, height = rect
    return any(
        px <= x and x + width <= px + pw and py <= y and y + height <= py + ph
        for px, py, pw, ph in (layout.left, layout.right, layout.bar)
    )


@pytest.mark.parametrize("window", [(1280, 720), (1920, 1080)])
def test_no_control_is_cut_off(drive, window):
    settings = fixed_settings(width=48, height=27, indirect="none")
    driven = drive(DEMO, settings, window=window, light=True)
    driven.run("frame 8\nset comparison split\nset section.time on\nset probe 20,14\nset probe_pinned on\nwait 1")
    panels, layout = driven.viewer.panels, driven.viewer.layout
    names = list(panels.widgets)
    assert len(names) > 40 and {"bar.direct", "threshold.direct", "section.time", "tile.current"} <= set(names)
    for name in names:
        if not inside(layout, panels.widgets[name]):
            panels.reveal(name)
            driven.run("wait 1\nwait 1")
        assert inside(layout, panels.widgets[name]), f"{name} at {panels.widgets[name]}"
