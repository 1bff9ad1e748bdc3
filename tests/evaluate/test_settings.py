"""Settings: groups, flat names, validation, and one serialization."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from taubench_gl.conventions import DEFAULT_THRESHOLD
from taubench_gl.errors import SettingsError
from taubench_gl.features import FEATURES
from taubench_gl.settings import FIELDS, GROUPS, SELECTING, Settings

CHANGED = {
    "width": 320, "height": 200, "fps": 30.0, "frames": (3, None), "camera": "Top", "scene": 1,
    "animation": ("Walk", 2),
    "reprojection": "motion", "sampling": "bilinear", "thresholds": {"color": 0.5}, "unit_scale": 100.0,
    "culling": "none", "blend": "stochastic", "strict": True, "textures": "finest",
    "columns": ("frustum", "color"), "effects": "all",
    "light_unit": "watt", "exposure": 2.0, "environment": (0.1, 0.2, 0.3),
    "light": "preview", "light_within": 0.5, "light_time": 9.0, "spp": 3, "bounces": 2, "bidirectional": True,
    "pattern": "independent", "seed": 7,
    "tone_map": "aces", "shadow_size": 64, "shadow_lights": 2, "shadow_filter": "hard",
    "indirect": "rsm", "indirect_samples": 16, "probes": 27, "light_error": 0.0, "storage": "half",
    "samples_per_pixel": 4, "pairs": "every:3", "exact": True, "backend": "egl",
    "history": "eye", "eyes": 0.07, "eye": "right", "convergence": 2.0, "other_eye": "Right", "device": 0,
    "camera_path": "head.csv", "camera_path_axes": "unity", "camera_path_up": "-x", "camera_path_fps": 30.0,
    "camera_path_order": "ZXY", "camera_path_body": "sensor.yaml", "camera_path_gaps": "hold",
    "camera_path_place": "node:car", "camera_path_scale": 0.01, "camera_path_speed": 2.0,
}  # fmt: skip

WRONG = {
    "width": 0, "height": 16385, "fps": 0.0, "reprojection": "no", "sampling": "no", "thresholds": {"color": -1.0},
    "unit_scale": float("nan"), "culling": "no", "blend": "no", "textures": "no",
    "columns": ("no",), "effects": "no",
    "light_unit": "lux", "environment": (1.0, 2.0), "exposure": float("inf"), "tone_map": "no",
    "light": "traced", "light_within": 0.0, "light_time": -1.0, "spp": 0, "bounces": 13, "pattern": "no", "seed": -1,
    "shadow_size": 15, "shadow_lights": -1,
    "shadow_filter": "no", "indirect": "no", "indirect_samples": 0, "probes": 7, "light_error": -1.0, "storage": "no",
    "samples_per_pixel": 65, "pairs": "every:0", "backend": "no",
    "history": "no", "eyes": 0.0, "eye": "no", "convergence": -1.0,
    "camera_path_axes": "no", "camera_path_up": "y", "camera_path_fps": 0.0, "camera_path_gaps": "no",
    "camera_path_scale": 0.0, "camera_path_speed": float("inf"),
}  # fmt: skip


def test_no_two_groups_share_a_field_name():
    names = [field.name for group in GROUPS.values() for field in dataclasses.fields(group)]
    assert len(set(names)) == len(names)
    assert set(CHANGED) == set(FIELDS)


@pytest.mark.parametrize("name", FIELDS)
def test_flat_name_reaches_its_field_and_no_other(name):
    settings, default = Settings(**{name: CHANGED[name]}), Settings()
    different = {one for one in FIELDS if settings.get(one) != default.get(one)}
    assert different == {name}
    assert FIELDS[name].meaning


@pytest.mark.parametrize("method", ["none", "rsm", "probes"])
def test_indirect_refines_the_raster_method_only(method):
    assert Settings(light="auto", indirect=method).lighting.indirect == method
    assert Settings(light="path-traced", indirect="auto").lighting.light == "path-traced"
    with pytest.raises(SettingsError) as caught:
        Settings(light="path-traced").replace(indirect=method)
    assert caught.value.setting == "indirect" and caught.value.hint


def test_samples_of_path_traced_light():
    assert [Settings(light=light).lighting.path_samples for light in ("auto", "preview", "path-traced")] == [4, 4, 256]
    assert Settings(light="path-traced", spp="3").lighting.path_samples == 3
    assert Settings.from_dict(Settings(light="auto").to_dict()).lighting.spp is None


def test_serialization_round_trip_through_json():
    for settings in (Settings(), Settings(**CHANGED)):
        stored = json.loads(json.dumps(settings.to_dict()))
        assert list(stored) == list(FIELDS)
        assert Settings.from_dict(stored) == settings


def test_omitted_thresholds_get_the_default():
    thresholds = Settings(thresholds={"normal": 0.25}).metrics.thresholds
    assert thresholds == {name: 0.25 if name == "normal" else DEFAULT_THRESHOLD for name in FEATURES}


def test_summary_block_is_the_serialization_without_selecting_fields():
    settings = Settings(**CHANGED)
    block = settings.as_summary(range(3, 9))
    assert set(block) == set(FIELDS) - set(SELECTING) | {"first_frame", "last_frame"}
    assert (block["first_frame"], block["last_frame"], block["width"]) == (3, 8, 320)


def test_whole_groups_and_flat_names_go_together():
    changed = Settings(**CHANGED)
    settings = Settings(metrics=changed.metrics, device=changed.device, width=3)
    assert settings == Settings().replace(metrics=changed.metrics, device=changed.device, width=3)
    assert (settings.metrics, settings.device, settings.sequence.width) == (changed.metrics, changed.device, 3)
    assert Settings(device=1).device.device == 1
    assert changed.replace(exposure=3.0).sequence == changed.sequence


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"size": "640x360"}, {"width": 640, "height": 360}),
        ({"size": (640, np.int64(360))}, {"width": 640, "height": 360}),
        ({"frames": range(24)}, {"frames": (0, 24)}),
        ({"frames": slice(2, None)}, {"frames": (2, None)}),
        ({"frames": [0, 24]}, {"frames": (0, 24)}),
        ({"frames": ":-1"}, {"frames": (None, -1)}),
        ({"columns": "normal, frustum"}, {"columns": ("normal", "frustum")}),
        ({"columns": {"color", "frustum"}}, {"columns": ("frustum", "color")}),
        ({"thresholds": "normal=0.1,color=1"}, {"thresholds": {"normal": 0.1, "color": 1.0}}),
        ({"animation": "Walk"}, {"animation": ("Walk",)}),
        ({"camera": "1"}, {"camera": "1"}),
        ({"fps": "30", "width": "64"}, {"fps": 30.0, "width": 64}),
        ({"exposure": np.float32(2)}, {"exposure": 2.0}),
        ({"environment": 0.5}, {"environment": (0.5, 0.5, 0.5)}),
        ({"environment": "0.1,0.2,0.3"}, {"environment": (0.1, 0.2, 0.3)}),
        ({"environment": Path("sky.hdr")}, {"environment": "sky.hdr"}),
    ],
)
def test_values_are_accepted_as_the_command_line_spells_them(given, expected):
    assert Settings(**given) == Settings(**expected) == Settings().replace(**given)


@pytest.mark.parametrize(
    ("given", "near"),
    [
        ({"widht": 3}, "width"),
        ({"siz": "3x3"}, "size"),
        ({"threshold": "normal=1"}, "thresholds"),
        ({"reprojection": "motoin"}, "motion"),
        ({"columns": "positon"}, "position"),
        ({"thresholds": {"nrmal": 1}}, "normal"),
    ],
)
def test_wrong_name_answers_with_the_nearest(given, near):
    with pytest.raises(SettingsError) as caught:
        Settings(**given)
    assert caught.value.hint == f"did you mean {near}?"


INVALID = [
    *({name: value} for name, value in WRONG.items()),
    *({"exposure": value} for value in (0, -1.0, float("nan"), 1e300, 1e-300, "bright", None)),
    *({"environment": value} for value in ("", "room.png", (0.1, 0.2), (0.1, float("nan"), 0.2), (1e39, 0.0, 0.0),
                                           (1, "x", 2), True)),
    {"size": "640"}, {"size": 4}, {"size": (1.5, 2)}, {"frames": range(0, 9, 2)}, {"frames": 3}, {"frames": "3"},
    {"frames": True}, {"frames": "1" * 5000 + ":"}, {"columns": ""}, {"columns": 3}, {"columns": [None]},
    {"thresholds": "normal"}, {"thresholds": {3: 3}}, {"thresholds": 3}, {"sequence": 3}, {"fps": "nan"},
    {"width": True}, {"width": "wide"}, {"fps": print}, {"camera": 1.5}, {"device": "x"}, {"animation": 3.5},
    {"pairs": 7}, {"widht": 3},
]  # fmt: skip


@pytest.mark.parametrize("given", INVALID)
def test_an_invalid_value_is_one_short_line(given):
    for make in (Settings, Settings().replace):
        with pytest.raises(SettingsError) as caught:
            make(**given)
        assert caught.value.setting == next(iter(given))
        assert "\n" not in str(caught.value) and len(str(caught.value)) < 250


JUNK = (
    object(), b"x", [], {}, (), None, float("nan"), float("inf"), 10**400, -1, 1.5, True, "", "\n", "\ud800", "1e999",
    "x" * 9999, print, {1, 2}, 1j, [[]], [None], {"a": []}, {None: 1}, {"normal": 10**400}, ("a", "b", "c"),
    range(3), slice(1, "x"), Path("x"), ..., np.array(3), np.array([1, 2]), np.array(["a"]), np.float64("nan"),
    np.datetime64("2020"),
)  # fmt: skip


@pytest.mark.parametrize("name", [*FIELDS, "size", "sequence", "metrics", "lighting"])
def test_any_value_is_accepted_or_answered_in_one_short_line(name):
    for value in JUNK:
        try:
            Settings(**{name: value}).to_dict()
        except SettingsError as error:
            assert "\n" not in str(error) and len(str(error)) < 250
