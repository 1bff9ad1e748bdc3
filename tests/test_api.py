"""The main job as a person calls it, on the scene the project ships."""

from __future__ import annotations

import json

import numpy as np
import pytest

import taubench_gl as tb
from taubench_gl.errors import SettingsError
from taubench_gl.paths import ASSETS

DEMO = ASSETS / "demo.glb"
SMALL = {"width": 96, "height": 54, "frames": (0, 4), "indirect": "none"}


def test_everything_lies_in_the_folder(tmp_path):
    run = tb.evaluate(DEMO, out=tmp_path, save=("masks", "channels"), **SMALL)
    names = {str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file()}
    assert {"summary.json", "frames.csv", "mask.png", "tables.md", "thresholds.png", "frames.svg"} <= names
    assert {f"masks/mask_0000{i}.png" for i in (1, 2, 3)} <= names
    with np.load(tmp_path / "channels/channels_00002.npz") as saved:
        assert saved["position"].shape == (54, 96, 4) and saved["mask"].shape == (54, 96)
    again = tb.load_run(tmp_path)
    assert again.summary == json.loads(json.dumps(run.summary)) and len(again.frames) == 3


def test_counts_without_a_folder_are_the_same(tmp_path):
    kept = tb.evaluate(DEMO, out=tmp_path, **SMALL)
    bare = tb.evaluate(DEMO, **SMALL)
    assert bare.summary["discard"] == kept.summary["discard"] and bare.frames == kept.frames


def test_overrides_replace_fields_of_settings():
    run = tb.evaluate(DEMO, tb.Settings.of(**SMALL), frames=(0, 2))
    assert run.summary["pairs"] == 1
    assert "Table 4" in str(run.table())


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"save": ("masks",)}, "nowhere to save"),
        ({"save": ("all",), "out": "x"}, "cannot save all"),
        ({"hue": 1}, "hue"),
    ],
)
def test_wrong_arguments_are_named(arguments, complaint):
    with pytest.raises(SettingsError, match=complaint):
        tb.evaluate(DEMO, **SMALL, **arguments)
