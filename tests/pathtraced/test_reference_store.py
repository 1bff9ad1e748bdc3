"""References: sums of samples are stored, resumed and extended; their noise is that of the mean."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner
from fixed import fixed_settings

from taubench_gl.animation import View
from taubench_gl.apps.cli import cli
from taubench_gl.camera_path_settings import CameraPathSettings
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.fields import declared
from taubench_gl.pathtraced import references
from taubench_gl.pathtraced.references import (
    FEWEST,
    IDENTITY,
    LOBES,
    PART,
    Accumulated,
    References,
    StoredReference,
    code_version,
    identity,
    listed,
)
from taubench_gl.scene.model import Camera
from taubench_gl.settings import STEREO, Settings

pytestmark = pytest.mark.usefixtures("fixed_light")

SIZE = (6, 4)
SIGMA = {"direct_diffuse": 0.5, "direct_glossy": 0.0, "indirect_diffuse": 0.25, "indirect_glossy": 0.0}


class Dice:
    """A tracer whose samples are independent normal numbers of mean 1 per lobe, equal in all colors."""

    def __init__(self, size=SIZE, interrupt_after=10**9):
        self.size, self.calls, self.left = size, [], interrupt_after

    def view(self, frame):
        camera = Camera(name="c", kind="perspective", yfov=1.0, aspect=None, xmag=1.0, ymag=1.0, znear=0.1, zfar=10.0)
        return View(np.array([float(frame), 0.0, 0.0]), np.eye(3), camera)

    def trace(self, frame, half, first, count):
        self.left -= 1
        if self.left < 0:
            raise KeyboardInterrupt
        self.calls.append((frame, half, first, count))
        shape = (self.size[1], self.size[0])
        drawn = np.stack([
            np.stack([np.random.default_rng([frame, half, k, lobe]).normal(size=shape) for lobe in range(4)])
            for k in range(first, first + count)
        ])  # fmt: skip
        mean = 1.0 + drawn.mean(axis=0) * np.array(list(SIGMA.values()))[:, None, None]
        return {n: np.repeat(mean[i, ..., None], 3, axis=-1).astype(np.float32) for i, n in enumerate(LOBES)}


def store(tmp_path, **changes):
    about = identity(fixed_settings(environment="none", exposure=1.0), {"sha256": "0" * 64}) | changes
    return StoredReference(about, "scene", tmp_path)


def expected(frame, samples, size=SIZE):
    """The reference of all samples at once."""
    sums = Accumulated.empty(size)
    for half, first, count in sums.missing(samples):
        sums.add(half, count, Dice(size).trace(frame, half, first, count))
    return sums


def test_parts_and_halves_give_the_mean_of_all_samples(tmp_path):
    tracer = Dice()
    found = References(tracer, store(tmp_path), 70).frame(3)
    assert found.samples == 70 and sum(count for *_, count in tracer.calls) == 70
    assert max(count for *_, count in tracer.calls) == PART
    assert [sum(c[3] for c in tracer.calls if c[1] == half) for half in (0, 1)] == [35, 35]
    for lobe, values in expected(3, 70).lobes().items():
        np.testing.assert_allclose(found.lobes[lobe], values, rtol=1e-6)
    np.testing.assert_array_equal(found.direct, found.lobes["direct_diffuse"] + found.lobes["direct_glossy"])


def test_stored_frames_are_extended_and_not_traced_again(tmp_path):
    References(Dice(), store(tmp_path), 20).frame(1)
    tracer = Dice()
    found = References(tracer, store(tmp_path), 20).frame(1)
    assert not tracer.calls and found.samples == 20
    more = References(tracer, store(tmp_path), 64).frame(1)
    assert sum(count for *_, count in tracer.calls) == 44 and {c[2] for c in tracer.calls} == {10, 26}
    np.testing.assert_allclose(more.direct, sum(list(expected(1, 64).lobes().values())[:2]), rtol=1e-6)
    assert References(tracer, store(tmp_path), 8).frame(1).samples == 64  # more than asked for


def test_an_interrupted_frame_keeps_its_samples(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        References(Dice(interrupt_after=3), store(tmp_path), 200).frame(1)
    tracer = Dice()
    found = References(tracer, store(tmp_path), 200).frame(1)
    assert sum(count for *_, count in tracer.calls) == 200 - 3 * PART
    np.testing.assert_allclose(found.direct, sum(list(expected(1, 200).lobes().values())[:2]), rtol=1e-6)
    assert not [p for p in tmp_path.rglob("*") if "partial" in p.name]


def test_halves_are_kept_apart(tmp_path):
    """Two interrupted writers have more samples of one half each: the stored halves have those of both."""
    view, all_samples = Dice().view(0), expected(0, 40)
    for counts in ((20, 3), (7, 20)):
        sums = Accumulated.empty(SIZE)
        for half, count in enumerate(counts):
            sums.add(half, count, Dice().trace(0, half, 0, count))
        store(tmp_path).save(0, view, SIZE, sums)
    stored = store(tmp_path).load(0, view, SIZE)
    assert stored.counts.tolist() == [20, 20]
    np.testing.assert_allclose(stored.sums, all_samples.sums, rtol=1e-6)


def test_samples_that_another_process_adds_are_not_traced_again(tmp_path, monkeypatch):
    monkeypatch.setattr(references, "SAVE_SECONDS", -1.0)

    class Interrupted(Dice):
        def trace(self, frame, half, first, count):
            if not self.calls:
                References(Dice(), store(tmp_path), 60).frame(frame)
            return super().trace(frame, half, first, count)

    tracer = Interrupted()
    found = References(tracer, store(tmp_path), 64).frame(0)
    assert found.samples == 64 and [c[1:] for c in tracer.calls] == [(0, 0, 16), (0, 30, 2), (1, 30, 2)]
    np.testing.assert_allclose(found.direct, sum(list(expected(0, 64).lobes().values())[:2]), rtol=1e-6)


WRITER = """
import json, sys
from pathlib import Path
from test_reference_store import Dice, References, StoredReference
made = References(Dice(), StoredReference(json.loads(sys.argv[3]), "scene", Path(sys.argv[1])), int(sys.argv[2]))
print("ready", flush=True)
sys.stdin.readline()
for frame in range(8):
    made.frame(frame)
"""


def test_two_processes_write_one_reference(tmp_path):
    made, environment = store(tmp_path), os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", WRITER, str(tmp_path)]
    writers = [
        subprocess.Popen([*command, str(n), json.dumps(made.about)], stdin=-1, stdout=-1, env=environment)
        for n in (24, 80)
    ]
    for writer in writers:
        assert writer.stdout.readline() == b"ready\n"
    for writer in writers:
        writer.stdin.close()
    for writer in writers:
        writer.stdout.close()
        assert writer.wait() == 0
    for frame in range(8):
        stored = made.load(frame, Dice().view(frame), SIZE)
        assert stored.samples == 80
        np.testing.assert_allclose(stored.sums, expected(frame, 80).sums, rtol=1e-5)


def test_the_noise_is_the_standard_error_of_the_mean(tmp_path):
    size = (200, 150)
    for samples in (9, 64):
        noise = References(Dice(size), store(tmp_path, width=samples), samples).frame(0).noise
        total = sum(s**2 for s in SIGMA.values())
        assert noise.rms == pytest.approx(np.sqrt(total / samples), rel=0.02)
        assert noise.typical == pytest.approx(noise.rms, rel=0.05) and noise.text
        assert noise.mean == pytest.approx(4.0, rel=0.01)
        assert noise.percent == pytest.approx(100 * noise.rms / noise.mean)
    assert References(Dice(), store(tmp_path, width=1), 1).frame(0).noise is None


def test_the_background_does_not_hide_the_noise():
    """Noisy pixels have one error alone and as a tenth of an image without light elsewhere."""
    drawn = 1.0 + 0.1 * np.random.default_rng(1).normal(size=(2, 10, 10, 1)).astype(np.float32)
    alone, framed = Accumulated.empty((10, 10)), Accumulated.empty((10, 100))
    for half in range(2):
        image = np.zeros((100, 10, 1), dtype=np.float32)
        image[40:50] = drawn[half]
        for sums, values in ((alone, drawn[half]), (framed, image)):
            sums.add(half, 4, dict.fromkeys(LOBES, np.repeat(values, 3, axis=-1)))
    assert dataclasses.astuple(framed.noise()) == pytest.approx(dataclasses.astuple(alone.noise()), rel=1e-6)
    assert alone.noise().typical == pytest.approx(alone.noise().rms, rel=0.25)


def test_the_estimate_counts_what_is_left(tmp_path):
    made = References(Dice(), store(tmp_path), 64)
    made.frame(2)
    tracer = Dice()
    again = References(tracer, store(tmp_path), 64)
    estimate = again.estimate(range(4))
    assert (estimate.frames, estimate.complete, estimate.samples) == (4, 1, 64) and estimate.seconds > 0
    before = len(tracer.calls)
    assert again.frame(0).samples == 64
    assert sum(c[3] for c in tracer.calls) == 64 and before == 2  # what was timed counts
    for frame in range(4):
        again.frame(frame)
    assert again.estimate(range(4)).seconds is None
    assert "about" in estimate.text and "about" not in again.estimate(range(4)).text


class Slow(Dice):
    """Half a second per sample, by the clock that it replaces."""

    def __init__(self, monkeypatch):
        super().__init__()
        self.now = 0.0
        monkeypatch.setattr("taubench_gl.pathtraced.references.time.perf_counter", lambda: self.now)

    def trace(self, frame, half, first, count):
        self.now += 0.5 * count
        return super().trace(frame, half, first, count)


def test_samples_are_fitted_to_a_time(tmp_path, monkeypatch):
    """Eight samples of the first frame are timed and count: 4 x 16 - 8 samples take 28 s, 4 x 32 - 8 take 60 s."""
    tracer = Slow(monkeypatch)
    made = References(tracer, store(tmp_path), 4)
    estimate = made.fit(range(4), 30.0)
    assert (made.samples, estimate.samples, estimate.complete) == (16, 16, 0)
    assert estimate.seconds == pytest.approx(28.0) and tracer.now == pytest.approx(4.0)
    assert [made.frame(n).samples for n in range(4)] == [16] * 4 and tracer.now == pytest.approx(32.0)


def test_no_more_samples_than_suffice(tmp_path, monkeypatch):
    made = References(Slow(monkeypatch), store(tmp_path), 4)
    estimate = made.fit(range(4), 1e6, lambda sums: 5.0 * sums.samples)
    assert made.samples == 64 and estimate.quiet  # the next power of two after 5 * 8
    assert not made.fit(range(4, 8), 30.0, lambda sums: 5.0 * sums.samples).quiet


def test_stored_references_are_used_as_they_are(tmp_path, monkeypatch):
    made = References(Slow(monkeypatch), store(tmp_path), 16)
    for frame in range(4):
        made.frame(frame)
    tracer = Slow(monkeypatch)
    again = References(tracer, store(tmp_path), 4)
    estimate = again.fit(range(4), 1e6)
    assert again.samples == 16 and estimate.seconds is None and estimate.complete == 4 and not tracer.calls


def test_the_fewest_samples_are_traced_where_none_fit(tmp_path, monkeypatch):
    made = References(Slow(monkeypatch), store(tmp_path), 4)
    estimate = made.fit(range(4), 1.0)
    assert made.samples == FEWEST and estimate.seconds == pytest.approx(0.5 * 3 * FEWEST)
    assert "--frames" in estimate.text and "--frames" not in made.fit(range(1), 1.0).text


def test_a_scene_without_file_is_not_stored(tmp_path):
    made = References(Dice(), store(tmp_path, sha256=None), 16)
    made.estimate(range(2))
    assert made.frame(0).samples == 16 and not list(tmp_path.iterdir())


@pytest.mark.parametrize("samples", [0, -1, (1 << 20) + 1])
def test_sample_counts_out_of_range(tmp_path, samples):
    with pytest.raises(SettingsError):
        References(Dice(), store(tmp_path), samples)


def test_damaged_files_are_named(tmp_path):
    made = store(tmp_path)
    References(Dice(), made, 4).frame(0)
    (path,) = made.folder.glob("*.npz")
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(OutputError) as caught:
        References(Dice(), made, 4).frame(0)
    assert str(path) in str(caught.value)


def test_what_the_radiance_depends_on_is_in_the_key(tmp_path):
    plain = fixed_settings(environment="none", exposure=1.0)
    key = StoredReference(identity(plain, {"sha256": "a"}), "s", tmp_path).folder
    for changes in ({"width": 8}, {"bounces": 2}, {"environment": (1, 1, 1)}, {"light_unit": "watt"},
                    {"culling": "none"}, {"fps": 30}, {"blend": "opaque"}):  # fmt: skip
        assert StoredReference(identity(plain.replace(**changes), {"sha256": "a"}), "s", tmp_path).folder != key
    for changes in ({"seed": 1}, {"exposure": 3.0}, {"tone_map": "aces"}, {"columns": ("color",)}, {"frames": (0, 3)}):
        assert StoredReference(identity(plain.replace(**changes), {"sha256": "a"}), "s", tmp_path).folder == key
    assert StoredReference(identity(plain, {"sha256": "b"}), "s", tmp_path).folder != key
    assert len(code_version()) == 16


def test_every_setting_is_in_the_key_or_known_not_to_matter():
    """A new setting must be decided on: a reference for another value of it must not be reused if radiance differs."""
    of_the_view = {"frames", "camera", *declared(CameraPathSettings), *STEREO}
    afterwards = {"exposure", "tone_map", "thresholds", "unit_scale", "sampling", "exact"}
    set_by_references = {
        "reprojection", "columns", "samples_per_pixel", "pairs", "effects", "light", "spp", "pattern", "indirect",
        "storage", "seed",
    }  # fmt: skip
    of_the_raster_method = {
        "shadow_size", "shadow_lights", "shadow_filter", "indirect_samples", "probes", "light_error",
    }  # fmt: skip
    of_sampled_light = {"light_within", "light_time"}
    without_effect = {"strict", "backend", "device"}
    known = of_the_view | afterwards | set_by_references | of_the_raster_method | of_sampled_light | without_effect
    assert set(Settings().to_dict()) == known | set(IDENTITY)


def test_other_views_have_other_files(tmp_path):
    made = store(tmp_path)
    tracer = Dice()
    sums = expected(0, 2)
    for view in (tracer.view(0), tracer.view(1), dataclasses.replace(tracer.view(0), jitter_px=np.array([0.25, 0.0]))):
        assert made.load(0, view, SIZE).samples == 0
        made.save(0, view, SIZE, sums)
        assert made.load(0, view, SIZE).samples == 2
    assert len(list(made.folder.glob("*.npz"))) == 3


def test_the_command_lists_what_is_stored(tmp_path, monkeypatch):
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path))
    made = store(tmp_path / "references")
    References(Dice(), made, 8).frame(0)
    References(Dice(), made, 4).frame(1)

    def invoke(*arguments: str):
        # Through the whole program: click keeps the help texts of a group that runs by itself, which pages are made of.
        return CliRunner().invoke(cli, ["reference", *arguments])

    assert made.folder.name in invoke("list").output
    (row,) = json.loads(invoke("list", "--json").output)
    assert (row["key"], row["frames"], row["samples"], row["current"]) == (made.folder.name, 2, 4, True)
    assert not listed(tmp_path / "missing")
    about = made.folder / "reference.json"
    about.write_text(json.dumps(json.loads(about.read_text()) | {"code": "old"}))
    assert not listed(tmp_path / "references")[0].current
    shutil.rmtree(made.folder)
    assert json.loads(invoke("list", "--json").output) == []
