"""The parts without window or OpenGL: actions, keys, variables, layout, preferences."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fixed import fixed_settings

from taubench_gl.conventions import HISTOGRAM_BINS
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.paths import ASSETS
from taubench_gl.run import Run
from taubench_gl.viewer import prefs
from taubench_gl.viewer.actions import (
    ACTIONS,
    KEYS,
    MOVEMENT,
    help_lines,
    key_words,
    markdown,
    run_action,
    split_chord,
)
from taubench_gl.viewer.controls import Choice, Number
from taubench_gl.viewer.feeds import OpenRequest, scene_of, scene_path
from taubench_gl.viewer.layout import around, arrange, script_size, start_size
from taubench_gl.viewer.state import CONTROLS, ViewerState, set_variable, variables

DOC = Path(__file__).resolve().parents[2] / "docs" / "viewer.md"


def state(**more) -> ViewerState:
    return ViewerState(first=2, last=9, frame=2, effects=("shadows", "color"), effect="shadows", size=(64, 36), **more)


def test_every_action_has_a_key_and_every_key_an_action():
    assert set(KEYS.values()) == set(ACTIONS)
    assert not {f"{shift}{k}" for k in MOVEMENT for shift in ("", "SHIFT+")} & set(KEYS)


def test_help_names_every_action_once():
    assert sorted(doc for lines in help_lines().values() for _, doc in lines) == sorted(a.doc for a in ACTIONS.values())


def test_the_manual_lists_the_keys():
    assert markdown() in DOC.read_text(encoding="utf-8"), (
        "docs/viewer.md: replace the tables by taubench_gl.viewer.actions.markdown()"
    )


def test_the_manual_lists_every_script_command():
    pytest.importorskip("imgui_bundle")
    from taubench_gl.viewer.script import COMMANDS

    text = DOC.read_text(encoding="utf-8")
    assert not [usage for usage in (command.__doc__ for command in COMMANDS.values()) if usage not in text]


@pytest.mark.parametrize(("chord", "words"), [("SHIFT+SLASH", "?"), ("SHIFT+N", "Shift+N"), ("PAGE_UP", "Page Up")])
def test_key_words(chord, words):
    assert key_words(chord) == words


def test_split_chord():
    assert split_chord("shift+page_up") == ("PAGE_UP", {"SHIFT"})
    assert split_chord("?") == ("SLASH", {"SHIFT"})
    with pytest.raises(ValueError, match="HYPER"):
        split_chord("HYPER+X")


@pytest.mark.parametrize("name", sorted(ACTIONS))
def test_every_action_keeps_the_state_valid(name):
    s = state()
    for _ in range(40):
        run_action(name, s)
    assert s.first <= s.frame <= s.last and 0 <= s.opacity <= 1 and 0 <= s.split <= 1 and s.low < s.high
    assert s.loop is None or s.first <= s.loop[0] <= s.loop[1] <= s.last
    assert s.probe is None or (0 <= s.probe[0] < 64 and 0 <= s.probe[1] < 36)
    assert all(np.isfinite(v) and v >= 0 for v in s.thresholds.values())


@pytest.mark.parametrize(
    ("loop", "seconds", "speed", "frames"),
    [
        pytest.param((3, 5), 1 / 24, 1.0, [3, 4, 5, 3, 4, 5], id="every frame of a loop"),
        pytest.param((2, 9), 1.0, 1.0, [3, 4, 5, 6], id="a slow machine"),
        pytest.param((2, 9), 1 / 24, 0.5, [2, 3, 3, 4, 4, 5, 5, 6], id="half speed"),
    ],
)
def test_playback_skips_no_frame(loop, seconds, speed, frames):
    s = state(playing=True, speed=speed)
    s.set_loop(*loop)
    for frame in frames:
        s.advance(seconds)
        assert s.frame == frame


def test_flicker_changes_images_at_its_rate():
    s = state(comparison="flicker", flicker_hz=4.0)
    seen = []
    for _ in range(16):
        s.advance(1 / 16)
        seen.append(s.flicker_other)
    assert seen == [False] * 3 + [True] * 4 + [False] * 4 + [True] * 4 + [False] and s.busy
    s.comparison = "off"
    s.advance(1 / 16)
    assert not s.flicker_other and not s.busy


def test_loop_ends_cannot_cross():
    s = state()
    s.set_loop(low=7)
    s.set_loop(high=4)
    assert s.range == (4, 4)
    s.set_loop(2, 9)
    assert s.loop is None


def test_every_variable_can_be_set_and_read_back():
    """Each to another value than it has: what an action or a script stores, a session restores."""
    s = state(channels=("headlight", "normal"), nodes=("floor", "ball"))
    special = {"frame": 5, "loop.first": 3, "loop.last": 4, "range.low": 0.25, "range.high": 0.5, "probe": "3,4",
               "magnified": 9, "selection": "ball"}  # fmt: skip
    for control in CONTROLS.values():
        for name, before in control.read(s).items():
            kind = getattr(control, "kind", control)
            if isinstance(kind, Choice):
                value = next(c for c in kind.choices(s) if c != kind_text(before))
            elif isinstance(kind, Number):
                value = kind.low + 1 if kind.whole else kind.low + 0.3 * (min(kind.high, 3.0) - kind.low)
            else:
                value = special.get(name, 1 - before if isinstance(before, int) else None)
            set_variable(s, name, str(value))
            found = variables(s)[name]
            assert found != before and kind_text(found) == kind_text(value), name
    assert not s.auto_range, "an end of the display range was set"


def kind_text(value: object) -> str:
    """A value as a script spells it."""
    return value if isinstance(value, str) else f"{value:g}"


@pytest.mark.parametrize("kind", ["path-traced", "path-traced+jittered"])
def test_what_needs_exact_frames_is_not_offered_for_path_traced_input(kind):
    """Ghosts and the bound are compared with exact frames, of which path-traced input has none."""
    s = state(against="method", method_input="noisy")
    set_variable(s, "comparison", "ghost")
    set_variable(s, "method_image", "bound")
    s = state(against="method", method_input=kind)
    for name, text in (("comparison", "ghost"), ("method_image", "bound")):
        with pytest.raises(SettingsError):
            set_variable(s, name, text)
    seen = set()
    for _ in range(len(s.comparisons)):
        ACTIONS["compare"].run(s)
        seen.add(s.comparison)
    assert seen == set(s.comparisons) and "ghost" not in seen


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("opacity", "much"),
        ("frame", "nan"),
        ("camera", "mine"),
        ("show.position", "2"),
        ("nothing", "1"),
        ("show.x", "1"),
    ],
)
def test_invalid_values_are_errors(name, text):
    s = state()
    before = variables(s)
    with pytest.raises(SettingsError):
        set_variable(s, name, text)
    assert variables(s) == before


@pytest.mark.parametrize("panels", [True, False])
@pytest.mark.parametrize("tiles", [1, 3])
@pytest.mark.parametrize(
    "window", [(940, 424), (1280, 720), (1920, 1080), (480, 300), (300, 1000), (2000, 200), (320, 200), (1, 1)]
)
@pytest.mark.parametrize("size", [(640, 360), (16, 1000), (1000, 16)])
def test_panels_do_not_overlap_the_images(window, size, panels, tiles):
    layout = arrange(window, size, panels, tiles=tiles)
    assert len(layout.images) == tiles
    for i, (x, y, w, h) in enumerate(layout.images):
        others = [*layout.images[:i], *(p for p in (layout.left, layout.right, layout.bar) if p is not None)]
        for px, py, pw, ph in others:
            assert px >= x + w or py >= y + h or px + pw <= x or py + ph <= y
        if min(window) > 100:
            assert x >= 0 and y >= 0 and x + w <= window[0] and y + h <= window[1]
        assert abs(w * size[1] - h * size[0]) <= max(size) or min(w, h) == 1  # aspect ratio of the image, to the pixel


def test_side_panels_are_merged_in_narrow_windows():
    wide, narrow = (arrange((width, 500), (64, 36), True) for width in (1280, 700))
    assert wide.left is not None and wide.right is not None and not wide.merged
    assert narrow.left is None and narrow.right is not None and narrow.merged
    alone = arrange((1280, 720), (64, 36), True, bar=False)
    assert alone.bar is None and alone.left is not None and alone.right is not None
    assert arrange((1280, 720), (640, 360), True).image[2:] == (640, 360)  # exact pixels between both panels


@pytest.mark.parametrize("image", [(20, 10, 30, 15), (20, 10, 60, 40), (0, 0, 100, 50), (10, 0, 64, 50)])
def test_what_is_around_an_image_covers_the_rest_once(image):
    area, (x, y, width, height) = (0, 0, 100, 50), image
    painted = np.zeros((50, 100), dtype=int)
    painted[y : y + height, x : x + width] += 1
    for left, top, right, bottom in around(area, (image,)):
        painted[top:bottom, left:right] += 1
    assert (painted == 1).all()
    assert around(area, (image, image)) == [area]


@pytest.mark.parametrize(
    ("size", "times", "window"),
    [((480, 270), 2, (1560, 720)), ((640, 360), 2, (1880, 852)), ((64, 36), 20, (1880, 852)),
     ((1920, 1080), 1, (2520, 1212)), ((16, 1000), 1, (1280, 1132))],
)  # fmt: skip
def test_a_new_window_enlarges_small_images(size, times, window):
    assert start_size(size) == window
    shown = arrange(window, size, panels=True).image
    assert shown[2:] == (size[0] * times, size[1] * times)  # a whole multiple
    layout = arrange(script_size(size), size, panels=True)  # that of a script has room for all panels
    assert None not in (layout.left, layout.right, layout.bar) and not layout.merged


def test_columns_of_a_threshold_histogram_keep_every_pixel():
    pytest.importorskip("imgui_bundle")
    from taubench_gl.metrics.counts import bin_of
    from taubench_gl.viewer.panels import LEAST, columns

    distances = np.array([0.0, 1e-5, 0.011, 0.011, 0.5, 50.0])
    counts = np.bincount(bin_of(distances), minlength=HISTOGRAM_BINS)
    found = columns(counts, 10.0, 60)
    assert found.sum() == pytest.approx(6.0) and found[0] >= 2.0 and found[-1] >= 1.0
    at = int(np.log(0.011 / LEAST) / np.log(10.0 / LEAST) * 60)
    assert found[at - 1 : at + 2].sum() == pytest.approx(2.0)


def test_thescene_of_a_run_is_found_from_another_folder(tmp_path, monkeypatch):
    scene, out = tmp_path / "a" / "assets" / "s.glb", tmp_path / "a" / "runs" / "one"
    for folder in (scene.parent, out, tmp_path / "b"):
        folder.mkdir(parents=True)
    scene.touch()
    monkeypatch.chdir(tmp_path / "a")
    assert scene_path(Path("runs/one"), "assets/s.glb") == "assets/s.glb"
    monkeypatch.chdir(tmp_path / "b")
    assert scene_path(Path("../a/runs/one"), "assets/s.glb") == str(scene)
    assert scene_path(out, "folder/name*.obj@30") == "folder/name*.obj@30"
    for gone in ("assets/t.glb", str(tmp_path / "t.glb")):
        with pytest.raises(OutputError) as error:
            scene_path(out, gone)
        assert error.value.where == str(out)


def test_thresholds_of_a_run_are_in_meters_for_any_unit_scale(tmp_path):
    stored = {"unit_scale": 2.0, "thresholds": {"position": 0.25, "normal": 0.25}}
    run = Run({"scene": {"path": str(tmp_path)}, "settings": stored}, [], tmp_path)
    for given, scale in ((frozenset(), 2.0), (frozenset({"unit_scale"}), 100.0)):
        _, found = scene_of(run, OpenRequest("run", fixed_settings(unit_scale=100.0), given=given))
        assert found.metrics.unit_scale == scale
        assert (found.metrics.thresholds["position"], found.metrics.thresholds["normal"]) == (0.25, 0.25)
        assert found.metrics.threshold("position") == 0.25 * scale


def test_unit_of_thresholds():
    assert [state().unit(f) for f in ("position", "normal")] == [" m", ""]
    assert [state(unit_scale=100.0).unit(f) for f in ("position", "normal")] == [" units", ""]


def test_image_pixel_at_a_window_position():
    layout = arrange((640, 360), (64, 36), panels=False)
    assert layout.pixel(0, 0, (64, 36)) == (0, 0)
    assert layout.pixel(639.9, 359.9, (64, 36)) == (63, 35)
    assert layout.pixel(15, 15, (64, 36)) == (1, 1)
    assert layout.pixel(640, 10, (64, 36)) is None
    tiles = arrange((1280, 720), (64, 36), True, tiles=3)
    for tile in range(3):
        assert tiles.pixel(*tiles.place(10, 20, (64, 36), tile), (64, 36)) == (10, 20)
    assert arrange((0, 0), (64, 36), panels=True).pixel(0, 0, (64, 36)) is None


@pytest.mark.parametrize("text", ["", "{", "[]", '{"window": "big"}', '{"window": [1]}', '{"values": 3}', "\x00"])
def test_invalid_preferences_are_ignored_with_a_note(tmp_path, text):
    (tmp_path / prefs.FILE).write_text(text)
    stored, note = prefs.load(tmp_path)
    assert stored == prefs.Prefs() and prefs.FILE in note


def test_unknown_preferences_are_skipped(tmp_path):
    (tmp_path / prefs.FILE).write_text('{"values": {"opacity": "many", "frame": 7, "gone": 1, "show.sky": 1}}')
    s = state()
    prefs.load(tmp_path)[0].apply(s)
    assert s.opacity == 0.7 and s.frame == 2 and s.shown["sky"]
    assert prefs.save(tmp_path / prefs.FILE, s, None) != "", "a file is no folder"


def test_a_feed_of_the_viewer_resolves_its_lighting(gpu, coarse_metering):
    """As evaluate does; the observer camera shows the same light."""
    from taubench_gl.gpu.timing import PassTimer
    from taubench_gl.scene import load_scene
    from taubench_gl.viewer.feeds import SceneFeed

    demo = ASSETS / "demo.glb"

    auto = {"exposure": "auto", "light_unit": "auto", "environment": "auto"}
    feed = SceneFeed(gpu, load_scene(demo), fixed_settings(width=64, height=36, frames=(0, 3), **auto), PassTimer(gpu))
    lighting = feed.settings.lighting
    assert lighting.resolved and lighting.light_unit == "candela" and lighting.exposure != 1.0
    assert set(feed.lighting) == set(auto)
