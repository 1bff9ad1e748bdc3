"""Export of training pairs: noisy and clean light per lobe, with several seeds."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from export_tools import DEMO, settings

import taubench_gl as tb
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.export.channels import channel_named
from taubench_gl.export.run import ExportOptions, export_scene
from taubench_gl.export.training import training_names
from taubench_gl.option_groups import TrainingOptions
from taubench_gl.pathtraced.references import LOBES, listed

pytestmark = pytest.mark.usefixtures("fixed_light")

SMALL = {
    "width": 24,
    "height": 16,
    "light": "auto",
    "indirect": "auto",
    "bounces": 2,
    "exposure": 1.0,
    "frames": (0, 2),
}
TRAINING = TrainingOptions(input="path-traced@1+all-lights", seeds=3, reference="path-traced@32")


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
    training = dataclasses.replace(TRAINING, seeds=1, reference="path-traced@4")
    pairs(tmp_path / "one", training)
    (stored,) = listed()
    said = []
    pairs(tmp_path / "two", training, said=said)
    assert len(said) == 1  # nothing to trace: the noise alone
    assert listed() == [stored] and (stored.frames, stored.samples) == (2, 4)
    for name in ("frame_00000.npz", "frame_00001.npz"):
        with np.load(tmp_path / "one" / name) as one, np.load(tmp_path / "two" / name) as two:
            for key in one:
                np.testing.assert_array_equal(one[key], two[key], err_msg=key)


def test_an_export_with_other_samples_is_another(tmp_path):
    one, two = (TrainingOptions(input=f"path-traced@{spp}", reference="path-traced@4") for spp in (1, 2))
    pairs(tmp_path, one, frames=(0, 1))
    assert json.loads((tmp_path / "export.json").read_text())["training"] == dataclasses.asdict(one)
    with pytest.raises(OutputError):
        pairs(tmp_path, two, frames=(0, 1))


@pytest.mark.parametrize(
    ("word", "reference", "seeds", "more"),
    [
        ("path-traced@2", "path-traced@4", 2, {}),
        ("path-traced@1+all-lights", "path-traced@4", 2, {}),
        ("noisy", "max", 2, {"light_samples": 2, "vpl_samples": 3}),
        ("checkerboard", "max", 1, {}),
    ],
)
def test_the_light_of_an_export_is_that_of_reuse_methods(tmp_path, word, reference, seeds, more):
    given = {"frames": (2, 4), "seed": 5}
    training = TrainingOptions(input=word, reference=reference, seeds=seeds, reference_samples=4, **more)
    pairs(tmp_path / "out", training, **given)
    shown = []
    request = {"input": word, "reference": reference, "seeds": seeds, "reference_samples": 4, "metrics": (), **more}
    methods = settings(**(SMALL | given), reprojection="motion")
    tb.reuse_evaluate(DEMO, ["none"], methods, on_frame=shown.append, statistics=False, **request)
    assert [(one.repetition, one.frame) for one in shown] == [(k, n) for k in range(seeds) for n in (2, 3)]
    for one in shown:
        with np.load(tmp_path / "out" / f"frame_{one.frame:05d}.npz") as file:
            np.testing.assert_array_equal(file[f"noisy{one.repetition}_radiance"][..., :3], one.radiance["input"])
            np.testing.assert_array_equal(file["clean_radiance"][..., :3], one.radiance["reference"])
    assert not np.array_equal(shown[0].radiance["input"], shown[-1].radiance["input"])


def test_pairs_have_the_light_of_reuse_methods(tmp_path):
    words = {"input": "path-traced@1", "reference": "path-traced@4"}
    given = settings(**(SMALL | {"frames": (2, 4), "seed": 5, "columns": ("position", "direct", "indirect")}))
    (pair,) = tb.pairs(DEMO, given, **words)
    shown = []
    tb.reuse_evaluate(DEMO, ["none"], given.replace(reprojection="motion"), on_frame=shown.append, metrics=(), **words)
    np.testing.assert_array_equal(pair.noisy[..., :3], shown[-1].radiance["input"])
    np.testing.assert_array_equal(pair.reference, shown[-1].radiance["reference"])
    assert pair.radiance.shape == (16, 24, 3)
    # The preview has the light of the reference but for what it leaves out: the same scene, without noise.
    assert np.corrcoef(pair.radiance.ravel(), pair.reference.ravel())[0, 1] > 0.8


def test_pairs_without_words_have_no_light():
    (pair,) = tb.pairs(DEMO, settings(**(SMALL | {"frames": (2, 4), "columns": ("position",)})))
    assert pair.radiance is pair.noisy is pair.reference is None


@pytest.mark.parametrize(
    "options",
    [
        {"input": "no"}, {"input": "exr:frames"}, {"input": "path-traced@1", "reference": "max"}, {"reference": "no"},
        {"reference": "path-traced"}, {"input": "full", "seeds": 2}, {"input": "path-traced@1+upscale@2"},
        {"input": "path-traced@1+jittered"}, {"input": "half+jittered"}, {"input": "noisy", "seeds": 0}, {"seeds": 2},
        {"reference_samples": 0},
    ],
)  # fmt: skip
def test_options_that_an_export_does_not_have(tmp_path, options):
    with pytest.raises(SettingsError):
        pairs(tmp_path, TrainingOptions(**options))
    with pytest.raises(SettingsError):
        ExportOptions("sintel", training=TRAINING)


@pytest.mark.parametrize("words", [{"input": "exr:frames"}, {"input": "no"}, {"reference": "path-traced"}, {}])
def test_words_that_pairs_do_not_have(tmp_path, words):
    with pytest.raises(SettingsError):
        tb.pairs(DEMO if words else f"exr:{tmp_path}", **words or {"input": "path-traced@1"})


def test_names_of_files():
    assert channel_named("noisy2_path_info").exr[0] == "Noisy2.HitDistance"
    assert channel_named("clean_radiance").exr == tuple(f"Clean.{c}" for c in "RGBA")
    assert channel_named("clean_direct_glossy").exr == tuple(f"Clean.DirectGlossy.{c}" for c in "RGB")
    with pytest.raises(KeyError):
        channel_named("clean_no")
