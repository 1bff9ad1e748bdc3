"""Re-shaded samples of the previous frame: no difference where the light is the same, whatever noise and camera do."""

from __future__ import annotations

import numpy as np
import pytest
from references.reshading import BLOCK, chosen_pixels, moved_positions
from reuse_scenes import SECONDS, lit_room, settings, still
from reuse_tools import arrays, open_inputs

from taubench_gl.conventions import NOT_COMPARABLE, Reason
from taubench_gl.reuse.evaluate import evaluate_methods
from taubench_gl.reuse.loading import MethodSpec
from taubench_gl.scene.builder import SceneBuilder, box, turn_x
from taubench_gl.srgb import LUMINANCE

pytestmark = pytest.mark.usefixtures("fixed_light")

SIZE = (42, 30)
READS = ("reshaded", "reshaded_before", "reshaded_direct", "radiance", "direct", "motion", "mask")
KINDS = ["path-traced@1", "noisy"]


def scene_of(camera=(0.0, 0.0, 0.0), light=(0.0, 0.0, 0.0), thing=(0.0, 0.0, 0.0)):
    """The lit room; what moves, by meters in SECONDS."""
    b = SceneBuilder()
    lit_room(b)
    gray = b.material(base_color=(0.5, 0.6, 0.7, 1.0), metallic=0.0, roughness=1.0, specular=0.0)
    lamp = b.light(translation=(0.5, 1.2, 1.4), intensity=9.0)
    b.animate(lamp, "translation", [0.0, SECONDS], [(0.5, 1.2, 1.4), tuple(np.add((0.5, 1.2, 1.4), light))])
    mover = b.node(mesh=b.mesh(box((0.4, 0.4, 0.4), material=gray)))
    b.animate(mover, "translation", [0.0, SECONDS], [(-0.9, 0.4, 0.9), tuple(np.add((-0.9, 0.4, 0.9), thing))])
    eye = (0.0, 1.5, 4.0)
    node = b.camera(translation=eye, rotation=turn_x(-12.0), yfov=np.radians(50.0), znear=0.1)
    b.animate(node, "translation", [0.0, SECONDS], [eye, tuple(np.add(eye, camera))])
    return b.build()


LIT = {"width": SIZE[0], "height": SIZE[1], "light": "auto", "environment": "none"}


def frames_of(gpu, scene, kind, count=3):
    changes = LIT | {"indirect": "auto", "bounces": 3, "exposure": 2.0, "shadow_size": 64}
    with open_inputs(gpu, scene, kind, READS, seed=5, settings=changes) as inputs:
        return [arrays(inputs.advance(k)) for k in range(count)]


def gradients(frame):
    """Relative difference of luminance at the samples, and where they are."""
    chosen = frame["reshaded"][..., 3] > 0.5
    now, before = (frame[name][..., :3][chosen].astype(np.float64) @ LUMINANCE for name in READS[:2])
    return (now - before) / np.maximum(np.maximum(now, before), 1e-3), chosen


@pytest.mark.parametrize("kind", KINDS)
def test_a_still_scene_has_exactly_no_gradient(gpu, kind):
    frames = frames_of(gpu, still(), kind)
    assert not frames[0]["reshaded"].any()  # no previous frame
    for frame in frames[1:]:
        _, chosen = gradients(frame)
        blocks = chosen.reshape(SIZE[1] // BLOCK, BLOCK, SIZE[0] // BLOCK, BLOCK).sum(axis=(1, 3))
        assert blocks.max() == 1 and blocks.mean() > 0.9
        np.testing.assert_array_equal(frame["reshaded"], frame["reshaded_before"])
        assert frame["reshaded"][chosen][:, :3].mean() > 0.01
    assert not np.array_equal(frames[1]["reshaded"][..., 3], frames[2]["reshaded"][..., 3])  # other pixels each frame
    # The light that the samples had is that of the previous frame: its radiance, as nothing here emits.
    _, chosen = gradients(frames[2])
    np.testing.assert_array_equal(frames[2]["reshaded_before"][chosen][:, :3], frames[1]["radiance"][chosen][:, :3])
    np.testing.assert_array_equal(frames[2]["reshaded_direct"][chosen][:, :3], frames[1]["direct"][chosen][:, :3])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("moves", ["camera", "thing"])
def test_gradients_without_a_change_of_light_are_small(gpu, kind, moves):
    """Difference to the noisy radiance of the pixel itself: as large as the noise."""
    frame = frames_of(gpu, scene_of(**{moves: (0.6, 0.1, -0.4)}), kind)[2]
    found, chosen = gradients(frame)
    itself = frame["radiance"][chosen][:, :3] @ LUMINANCE
    before = frame["reshaded_before"][chosen][:, :3] @ LUMINANCE
    noise = np.abs(itself - before) / np.maximum(np.maximum(itself, before), 1e-3)
    assert chosen.sum() > 100
    assert np.median(np.abs(found)) < 1e-3 and np.mean(np.abs(found) < 0.02) > 0.85
    assert np.mean(noise > 0.02) > 0.3


@pytest.mark.parametrize("kind", KINDS)
def test_a_moving_light_has_gradients(gpu, kind):
    found, chosen = gradients(frames_of(gpu, scene_of(light=(8.0, 0.0, 0.0)), kind)[2])
    assert chosen.sum() > 100 and np.mean(np.abs(found) > 0.02) > 0.2
    assert np.mean(found > 0.02) > 0.02 and np.mean(found < -0.02) > 0.02  # brighter here, darker there


def test_choice_and_motion_of_samples_equal_their_reference(gpu):
    scene, number = scene_of(camera=(0.6, 0.1, -0.4), thing=(1.2, 0.0, 0.4)), 2
    reads = ("reshaded", "motion", "mask", "position", "prev_position", "history_position")
    with open_inputs(gpu, scene, "noisy", reads, seed=5, settings=LIT | {"exposure": 1.0}) as inputs:
        for k in range(number + 1):
            frame = inputs.advance(k)
        a = {name: values.astype(np.float64) for name, values in arrays(frame).items()}
        link, position = inputs.reshade.samples()
        delta = frame.pair.camera_delta
    width, height = SIZE
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    column = np.floor(x + a["motion"][..., 0] + 0.5).astype(int)
    row = np.ceil(y + a["motion"][..., 1] - 0.5).astype(int)  # rows count from the bottom in GLSL
    seen = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    column, row = column.clip(0, width - 1), row.clip(0, height - 1)
    discarded = NOT_COMPARABLE | Reason.POSITION | Reason.NORMAL | Reason.SKY
    kept = (a["mask"][..., 0].astype(np.int64) & int(discarded)) == 0
    usable = seen & kept & (a["position"][..., 3] > 0) & (a["history_position"][row, column, 3] > 0)
    chosen = chosen_pixels(usable, number, 5)
    found = np.zeros_like(chosen)
    at = link[link >= 0]
    found[height - 1 - at // width, at % width] = True
    assert found.sum() > 100 and not (found & ~chosen).any()
    targets = (row * width + column)[chosen]
    assert (found == chosen)[chosen].sum() == len(np.unique(targets))  # one of those that share a sample
    for q in zip(*np.nonzero(link >= 0), strict=True):
        p = height - 1 - link[q] // width, link[q] % width
        expected = moved_positions(a["history_position"][q], a["position"][p], a["prev_position"][p], delta)
        np.testing.assert_allclose(position[q][:3], expected, atol=1e-4)


class ReadsReshaded:
    reads = ("radiance", "reshaded")

    def __init__(self, size, settings): ...

    def step(self, frame):
        return frame["radiance"]


def test_frames_without_re_shaded_samples_say_so():
    done = evaluate_methods(
        still(), ["none", MethodSpec("r", ReadsReshaded)], settings(width=20, height=15, frames=(0, 2)), input="full",
        metrics=("psnr",), reference_samples=1,
    )  # fmt: skip
    assert "reshaded" in done.failed["r"] and "noisy" in done.failed["r"]
