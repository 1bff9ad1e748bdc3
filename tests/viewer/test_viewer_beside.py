"""Images beside the image: history, another run and reuse methods, with their error map."""

from __future__ import annotations

import os

import numpy as np
import pytest
from click.testing import CliRunner
from fixed import fixed_settings
from references.display import color_scale
from viewer_tools import DEMO, QUIET, SIZE, pixels

from taubench_gl.apps.cli import cli
from taubench_gl.errors import MethodError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.frame.targets import read_channel
from taubench_gl.metrics.blending import blend, nearest_weight
from taubench_gl.reuse.evaluate import evaluate_methods
from taubench_gl.reuse.frame import read_result
from taubench_gl.reuse.input_kind import parse_input
from taubench_gl.reuse.inputs import FrameRequest, RasterInputs
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.quality import DISCARDS, display
from taubench_gl.reuse.references import emitting
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.viewer import comparisons

pytestmark = pytest.mark.usefixtures("coarse_light")

LIT = fixed_settings(width=48, height=28, indirect="none", exposure=1.0)
SMALL = LIT.replace(width=24, height=14)


def thirds(picture: np.ndarray) -> list[np.ndarray]:
    return [part.astype(int) for part in np.split(picture, 3, axis=1)]


def test_history_and_the_error_map_are_beside_the_image(drive, tmp_path):
    driven = drive(window=(1280, 720))
    driven.run("frame 8\nset overlays off\nset against history\nset gain 2")
    alone = driven.engine.image()
    driven.run(
        f"key Z\nexpect beside == 1\nscreenshot {tmp_path / 'three.png'}\nscreenshot {tmp_path / 'w.png'} window"
    )
    image, other, error = thirds(pixels(tmp_path / "three.png"))
    assert image.shape == (SIZE[1], SIZE[0], 3) and (image == alone).all() and (other != image).any()
    expected = color_scale(2.0 * np.abs(image - other).max(axis=-1) / 255.0)
    assert np.abs(error / 255.0 - expected).max() < 0.03
    layout, window = driven.viewer.layout, pixels(tmp_path / "w.png")
    assert len(layout.images) == 3
    x, y, width, height = (int(v) for v in layout.images[1])
    shown = window[y + 30 : y + height, x : x + width].reshape(-1, 3).mean(axis=0)  # below the title
    assert np.abs(shown - other[30 * SIZE[1] // height :].reshape(-1, 3).mean(axis=0)).max() < 4
    at = layout.place(20, 30, SIZE, 2)
    driven.run(f"mouse {at[0]} {at[1]}\nexpect probe == 20,30\nkey Z\nexpect beside == 0")
    assert len(driven.viewer.layout.images) == 1


def test_a_method_is_read_again_when_its_files_change(drive, tmp_path):
    """A mistake in the new text is a message; the corrected text is shown without a key."""
    folder = tmp_path / "mine"
    assert CliRunner().invoke(cli, ["reuse", "new", str(folder)]).exit_code == 0
    driven = drive(settings=LIT, light=True, method=str(folder))
    driven.run("frame 3\nset overlays off\nset channel color\nset method_input full")
    assert driven.state.against == "method" and driven.state.beside and driven.state.method == str(folder)
    before = thirds(driven.engine.picture())[1]
    (shader,) = folder.glob("*.glsl")
    text = shader.read_text()
    written(shader, text + "no GLSL\n")
    driven.run("wait 1")
    assert shader.name in driven.state.message
    written(shader, text.replace("write_result(p, vec4(color,", "write_result(p, vec4(0.1 * color,"))
    driven.run("wait 1")
    assert (thirds(driven.engine.picture())[1].mean() < 0.8 * before.mean()) and before.mean() > 10


def written(path, text: str) -> None:
    """Write a file with a time of its own: the clock of a file system may be coarse."""
    later = path.stat().st_mtime_ns + 1_000_000_000
    path.write_text(text)
    os.utime(path, ns=(later, later))


def test_a_reuse_method_is_beside_the_image(drive, monkeypatch):
    monkeypatch.setattr(comparisons, "WARM_UP", 2)
    driven = drive(settings=SMALL, light=True)
    driven.run("frame 10\nset overlays off\nset channel color\nset against method\nset method accumulate\nkey Z")
    shown = [thirds(driven.engine.picture())[1]]
    driven.run("key RIGHT")  # the next frame continues
    shown.append(thirds(driven.engine.picture())[1])
    results = expected(driven, "accumulate", "noisy", range(8, 12))
    for found, result in zip(shown, results[-2:], strict=True):
        assert np.abs(found - result).max() <= 2
    driven.run("set method none\nset method_input full\nset gain 1")
    image, none, _ = thirds(driven.engine.picture())
    assert np.abs(image - none).max() <= 2, "without noise and reuse the result is the image"
    driven.run("set channel headlight")
    assert "headlight" in driven.state.message and driven.engine.picture().shape[1] == 24


def expected(driven, method: str, kind: str, frames: range) -> list[np.ndarray]:
    """The results of a method for ``frames``, (h, w, 3) in 0 .. 255."""
    feed, gpu = driven.engine.feed, driven.viewer.gpu
    settings = feed.settings.replace(reprojection="motion")
    request = FrameRequest(gpu, feed.scene, feed.camera, settings, parse_input(kind))
    with RasterInputs(request, load_method(method).reads) as inputs, MethodRunner(gpu, method, feed.size) as runner:
        results = [read_result(runner.step(inputs.advance(frame))) for frame in frames]
    return [255.0 * display(result[..., :3], settings.lighting.tone_map) for result in results]


@pytest.fixture(scope="module")
def evaluated():
    """The last frame of an evaluation with the viewer's reference, its row, and its input, history, weight and mask."""
    settings = LIT.replace(frames=(3, 8), reprojection="motion")
    frames = []
    how = {"input": "noisy", "reference": "max", "reference_samples": 1, "metrics": ("tpsnr",)}
    done = evaluate_methods(DEMO, ["accumulate"], settings, on_frame=frames.append, **how)
    return frames[-1], done.rows[-1]


def blended_of(driven, frames: range) -> dict[str, np.ndarray]:
    """What ``accumulate`` blended in the last of ``frames``, its pixels that the exact mask discards, and emitters."""
    feed, gpu = driven.engine.feed, driven.viewer.gpu
    settings = feed.settings.replace(reprojection="motion")
    request = FrameRequest(gpu, feed.scene, feed.camera, settings, parse_input("noisy"))
    method = load_method("accumulate")
    with RasterInputs(request, method.reads, exact=True) as inputs, MethodRunner(gpu, method, feed.size) as runner:
        for frame in frames:
            now = inputs.advance(frame)
            weight = read_result(runner.step(now))[..., 3]
        history = runner.reported(now)["reprojected_history"]
        discarded = (read_channel(inputs.exact_mask, "mask")[..., 0] & np.uint32(DISCARDS)) != 0
        radiance = read_result(now.textures["radiance"])[..., :3]
        emitters = emitting(inputs.exact)
    return {"now": radiance, "history": history, "weight": weight, "discarded": discarded, "emitters": emitters}


def test_ghosts_and_bound_are_those_of_the_evaluation(drive, evaluated):
    frame, row = evaluated
    driven = drive(settings=LIT.replace(frames=(3, 8)), light=True)
    driven.run(
        "frame 7\nset overlays off\nset channel color\nset against method\nset method accumulate\nset gain 2\n"
        "set comparison ghost"
    )
    parts = blended_of(driven, range(3, 8))
    ghosts = (parts["weight"] > 0) & parts["discarded"]
    assert 20 < ghosts.sum() < ghosts.size / 2
    percent = driven.engine.method_scores(driven.state)["wrongly_reused_percent"]
    assert percent == row["wrongly_reused_percent"] == pytest.approx(100.0 * ghosts.mean())
    image, shown = driven.engine.image() / 255.0, frame.images["accumulate"]
    error = color_scale(2.0 * np.abs(frame.reference - shown).max(axis=-1))
    assert np.abs(image - error)[ghosts].max() < 0.03
    gray = 0.25 * (shown @ (0.2126, 0.7152, 0.0722))
    assert np.abs(image - gray[..., None])[~ghosts].max() < 0.01
    driven.run("set method_image bound\nset comparison error\nkey Z")
    for name in ("bound_linear_mse", "headroom_db"):
        driven.run(f"expect method.{name} == {row[name]} {1e-4 * abs(row[name])}")
    has = parts["history"][..., 3:] > 0.5
    fetched = np.where(has, parts["history"][..., :3], parts["now"])
    reference = frame.radiance["reference"]
    best = blend(parts["now"], fetched, nearest_weight(reference, parts["now"], fetched))
    assert np.mean((best - reference)[~parts["emitters"]] ** 2) == pytest.approx(row["bound_linear_mse"], rel=1e-4)
    exact, bound, _ = thirds(driven.engine.picture())
    assert np.abs(bound - 255.0 * display(best, driven.engine.feed.settings.lighting.tone_map)).max() <= 2
    assert np.abs(exact - 255.0 * frame.reference).max() <= 2, "the image is the reference"
    driven.run("set comparison ghost")
    best_ghosts = (np.abs(best - parts["now"]).max(axis=-1) > 0) & parts["discarded"]
    gray = np.ptp(thirds(driven.engine.picture())[2], axis=-1) == 0
    assert not gray[best_ghosts].any() and gray[~parts["discarded"]].all(), "ghosts of the bound are its own"
    driven.run("key Z\nset comparison off\nkey LEFT")
    assert not driven.engine.method_scores(driven.state), "scores of another frame are not shown"


@pytest.mark.long
def test_where_there_is_no_ghost_or_bound_a_message_says_so(drive, monkeypatch):
    monkeypatch.setattr(comparisons, "WARM_UP", 0)
    driven = drive(settings=SMALL, light=True)
    driven.run("frame 5\nset overlays off\nset channel color")
    alone = driven.engine.image()
    driven.run("set comparison ghost\nset against history")
    assert (driven.engine.image() == alone).all() and "method" in driven.state.message
    driven.run("set against method\nset method accumulate\nset method_input path-traced")
    assert (driven.engine.image() == alone).all() and "exact" in driven.state.message
    driven.run("set comparison error")
    assert (driven.engine.image() != alone).any(), "its result is still shown"


def test_a_method_that_fails_is_a_message(drive, monkeypatch):
    def fail(*_: object, **__: object) -> None:
        raise MethodError("does not compile", where="method 'accumulate'")

    monkeypatch.setattr(comparisons, "MethodRunner", fail)
    driven = drive(settings=SMALL, light=True)
    driven.run("frame 10\nset channel color\nset against method\nset method accumulate\nkey Z\nframe 11")
    assert "does not compile" in driven.state.message
    assert driven.engine.shots[1].frame == 11 and len(driven.engine.textures) == 1
    alone = driven.engine.image()
    driven.run("key Z")
    assert (driven.engine.image() == alone).all(), "the image alone is drawn although the method fails"


def test_another_run_is_compared(drive, tmp_path):
    evaluate_scene(DEMO, QUIET.replace(frames=(5, 9), culling="none"), out=tmp_path / "run")
    driven = drive(run=str(tmp_path / "run"))
    driven.run(
        "frame 8\nexpect against == run\nset overlays off\nset channel normal\nset split 0\nset comparison split"
    )
    assert np.abs(driven.engine.image()[:, 2:].astype(int) - reference(driven)[:, 2:]).max() <= 1
    driven.run("set channel motion")
    assert "motion" in driven.state.message


def reference(driven) -> np.ndarray:
    source = driven.engine.comparisons["run"]._feed.source
    assert source.renderer.culling == "none"
    normal, position = source.read("normal")[..., :3], source.read("position")
    return np.where(position[..., 3:] > 0, 255 * (0.5 + 0.5 * normal), 255 * 0.06).round().astype(int)


def test_a_clip_ends_where_its_images_change_size(drive, tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    driven = drive()
    driven.run("frame 8\nkey F9\nkey RIGHT\nkey Z\nwait 1")
    assert driven.viewer.clip is None and driven.state.message
    assert not list(tmp_path.glob(".*"))


def test_a_method_starts_with_light(drive):
    """A method needs light for its image; without a method, software rendering starts without light."""
    with_method, without = (drive(settings=SMALL, light=None, **how).viewer.state for how in ({"method": "none"}, {}))
    assert with_method.channel == "color" and not with_method.switched_off
    assert without.channel == "base_color" and "color" in without.switched_off
