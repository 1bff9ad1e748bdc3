"""``taubench_gl.evaluate`` on the built-in demo scene."""

from __future__ import annotations

import json

import numpy as np
import pytest

import taubench_gl as tb
from taubench_gl.errors import SettingsError
from taubench_gl.paths import ASSETS

DEMO = ASSETS / "demo.glb"
SMALL = {"width": 96, "height": 54, "frames": (0, 4), "indirect": "none"}


def test_output_folder_holds_every_file(tmp_path):
    run = tb.evaluate(DEMO, out=tmp_path, save=("masks", "channels"), **SMALL)
    names = {str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file()}
    assert {"summary.json", "frames.csv", "mask.png", "tables.md", "thresholds.png", "frames.svg"} <= names
    assert {f"masks/mask_0000{i}.png" for i in (1, 2, 3)} <= names
    with np.load(tmp_path / "channels/channels_00002.npz") as saved:
        assert saved["position"].shape == (54, 96, 4) and saved["mask"].shape == (54, 96)
    again = tb.load_run(tmp_path)
    assert again.summary == json.loads(json.dumps(run.summary)) and len(again.frames) == 3


def test_results_without_an_output_folder_are_the_same(tmp_path):
    stored = tb.evaluate(DEMO, out=tmp_path, **SMALL)
    run = tb.evaluate(DEMO, **SMALL)
    assert run.summary["discard"] == stored.summary["discard"] and run.frames == stored.frames


def test_overrides_replace_fields_of_settings():
    run = tb.evaluate(DEMO, tb.Settings(**SMALL), frames=(0, 2))
    assert run.summary["pairs"] == 1
    assert "Table 4" in str(run.table())


@pytest.mark.parametrize(
    ("arguments", "setting"),
    [({"save": ("masks",)}, None), ({"save": ("all",), "out": "x"}, None), ({"hue": 1}, "hue")],
)
def test_wrong_argument_is_a_settings_error(arguments, setting):
    with pytest.raises(SettingsError) as caught:
        tb.evaluate(DEMO, **SMALL, **arguments)
    assert caught.value.setting == setting and caught.value.hint


def test_old_argument_truth_warns():
    with pytest.warns(DeprecationWarning), pytest.raises(tb.TaubenchError):
        tb.evaluate("nothing.glb", truth=None)
