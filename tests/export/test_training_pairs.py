"""Export of training pairs: noisy and clean light per lobe, with several seeds."""

from __future__ import annotations

import json

import numpy as np
import pytest
from export_tools import DEMO, settings

from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.export.channels import channel_named
from taubench_gl.export.run import ExportOptions, export_scene
from taubench_gl.export.training import training_names
from taubench_gl.option_groups import TrainingOptions
from taubench_gl.pathtraced.references import LOBES, listed

SMALL = {
    "width": 24,
    "height": 16,
    "light": "auto",
    "indirect": "auto",
    "bounces": 2,
    "exposure": 1.0,
    "frames": (0, 2),
}
TRAINING = TrainingOptions(noisy_spp=1, seeds=3, reference_spp=32)


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))


def pairs(out, training=TRAINING, said=None, **more):
    options = ExportOptions("npz", ("depth", "normal", "base_color", "motion"), training=training)
    announce = None if said is None else said.append
    return export_scene(DEMO, out, settings(**(SMALL | more)), options, announce=announce)


def test_noisy_images_converge_to_the_clean_one(tmp_path):
    said = []
    done = pairs(tmp_path / "out", said=said)
    assert done.written == 2 and len(said) == 2
    with np.load(tmp_path / "out" / "frame_00001.npz") as found:
        frame = dict(found)
    assert set(training_names(TRAINING)) <= set(frame) and {"depth", "motion", "base_color"} <= set(frame)
    for k in range(3):
        np.testing.assert_array_equal(frame[f"noisy{k}_path_info"][..., 1], 1.0)
    total = {name: sum(frame[f"{name}_{lobe}"] for lobe in LOBES) for name in ("clean", "noisy0", "noisy1", "noisy2")}
    assert not np.array_equal(total["noisy0"], total["noisy1"])
    mean = np.mean([total[f"noisy{k}"] for k in range(3)], axis=0)
    near = total["clean"] < np.percentile(total["clean"], 95)
    assert np.abs(mean - total["clean"])[near].mean() < np.abs(total["noisy0"] - total["clean"])[near].mean()
    # Direct light of six point lights has no noise, except where textures at hits are filtered stochastically.
    clean, noisy = frame["clean_direct_diffuse"], frame["noisy0_direct_diffuse"]
    assert np.isclose(clean, noisy, rtol=1e-3, atol=1e-3).mean() > 0.97 and clean.max() > 0


def test_references_are_shared_between_exports(tmp_path):
    pairs(tmp_path / "one")
    (stored,) = listed()
    said = []
    pairs(tmp_path / "two", said=said)
    assert len(said) == 1  # nothing to trace: the noise alone
    assert listed() == [stored] and (stored.frames, stored.samples) == (2, 32)
    for name in ("frame_00000.npz", "frame_00001.npz"):
        with np.load(tmp_path / "one" / name) as one, np.load(tmp_path / "two" / name) as two:
            for key in one:
                np.testing.assert_array_equal(one[key], two[key], err_msg=key)


def test_an_export_with_other_samples_is_another(tmp_path):
    pairs(tmp_path, TrainingOptions(noisy_spp=1), frames=(0, 1))
    text = json.loads((tmp_path / "export.json").read_text())
    assert text["training"] == {"noisy_spp": 1, "seeds": 1, "reference_spp": 0}
    with pytest.raises(OutputError):
        pairs(tmp_path, TrainingOptions(noisy_spp=2), frames=(0, 1))


@pytest.mark.parametrize(
    "given", [{"noisy_spp": -1}, {"seeds": 0, "noisy_spp": 1}, {"seeds": 2}, {"reference_spp": 1 << 21}]
)
def test_numbers_out_of_range(given):
    with pytest.raises(SettingsError):
        TrainingOptions(**given)


@pytest.mark.parametrize("given", [{"jitter": "halton"}, {"format": "sintel"}])
def test_what_training_pairs_do_not_go_with(given):
    with pytest.raises(SettingsError):
        ExportOptions(training=TRAINING, **given)


def test_names_of_files():
    assert channel_named("noisy2_path_info").exr[0] == "Noisy2.HitDistance"
    assert channel_named("clean_direct_glossy").exr == tuple(f"Clean.DirectGlossy.{c}" for c in "RGB")
    with pytest.raises(KeyError):
        channel_named("clean_no")
