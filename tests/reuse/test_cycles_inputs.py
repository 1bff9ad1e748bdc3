"""Frames of Cycles as inputs: moving surfaces are followed as in frames of the rasterizer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cycles_mover import FOLDER, FRAMES, SIZE, mover
from reuse_scenes import settings
from reuse_tools import arrays

from taubench_gl.animation import View, choose_camera
from taubench_gl.conventions import NOT_COMPARABLE, Reason
from taubench_gl.pathtraced.motion import position_from_motion, position_from_scene, still_position
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.reuse.evaluate import evaluate_methods
from taubench_gl.reuse.file_inputs import FileInputs
from taubench_gl.reuse.input_kind import InputKind, parse_input
from taubench_gl.reuse.inputs import FrameRequest, RasterInputs
from taubench_gl.scene.model import Camera

pytestmark = pytest.mark.usefixtures("fixed_light")

INPUT, REFERENCE = (f"exr:{FOLDER / name}" for name in ("input", "reference"))
REJECT = int(NOT_COMPARABLE | Reason.POSITION | Reason.NORMAL)
WITHOUT_VECTOR = """\
name = "without motion"
[passes]
combined = "Combined"
depth = "Depth"
normal = "Normal"
"""


def chosen(**more):
    return settings(width=SIZE[0], height=SIZE[1], light="auto", environment="none", exposure=1.0, **more)


def frames_of(gpu, made, numbers):
    out = [arrays(made.advance(number)) for number in numbers]
    facts = made.describe()
    made.release()
    gpu.collect()
    return out, facts


def rasterized(gpu, scene):
    request = FrameRequest(gpu, scene, choose_camera(scene), chosen(), parse_input("full"))
    return frames_of(gpu, RasterInputs(request, ("motion", "mask", "ids", "normal", "position")), FRAMES)[0]


def from_files(gpu, scene, mapping=None, **more):
    camera = None if scene is None else choose_camera(scene)
    request = FrameRequest(gpu, scene, camera, chosen(**more), InputKind(files=INPUT), mapping=mapping)
    reads = ("motion", "mask", "normal", "position", "base_color")
    return frames_of(gpu, FileInputs(request, reads), FRAMES)


def followed(files, ours):
    """Share of surface pixels with our motion within 0.3 px, and that of the box alone; frames after the first."""
    close, on_box = [], []
    for got, expected in zip(files[1:], ours[1:], strict=True):
        surface = (expected["position"][..., 3] > 0) & (got["position"][..., 3] > 0)
        near = np.linalg.norm(got["motion"] - expected["motion"], axis=-1) < 0.3
        close.append(near[surface].mean())
        on_box.append(near[surface & (expected["ids"][..., 0] == 3)].mean())
    return np.mean(close), np.mean(on_box)


def reusable_box(frames, ours):
    """Share of the box's pixels that the geometry masks keep."""
    pairs = list(zip(frames, ours, strict=True))[1:]
    return np.mean([((f["mask"][..., 0] & REJECT) == 0)[o["ids"][..., 0] == 3].mean() for f, o in pairs])


@pytest.fixture(scope="module")
def ours(session_gpu):
    with session_gpu as gpu:
        return rasterized(gpu, mover())


@pytest.mark.parametrize("known", ["motion pass", "scene"])
def test_moving_surfaces_are_followed(gpu, ours, tmp_path, known):
    """With motion vectors of the files, kept as they are also in the sky; and with the motion of the scene."""
    (tmp_path / "mapping.toml").write_text(WITHOUT_VECTOR)
    mapping = str(tmp_path / "mapping.toml") if known == "scene" else None
    files, facts = from_files(gpu, mover(), mapping)
    assert facts["motion_from"] == ("rasterized" if known == "scene" else "motion")
    assert facts["motion_pass"] == (None if known == "scene" else "Vector")
    if known == "motion pass":
        sequence = PathTracedSequence.open(INPUT)
        for number, got in list(zip(FRAMES, files, strict=True))[1:]:
            np.testing.assert_allclose(got["motion"], sequence.read(number).motion, atol=1e-5)
        box = ours[3]["ids"][..., 0] == 3
        albedo = np.median(files[3]["base_color"][box][:, :3], axis=0)
        np.testing.assert_allclose(albedo, (0.8, 0.25, 0.15), rtol=0.01)
        assert facts["base_color_from"] == "DiffCol"
    everywhere, on_box = followed(files, ours)
    assert everywhere > 0.98 and on_box > 0.9
    assert reusable_box(files, ours) == pytest.approx(reusable_box(ours, ours), abs=0.1)


def test_without_motion_the_box_is_not_followed(gpu, ours):
    """The test above can fail: with surfaces that count as still, the box has the motion of the camera."""
    files, facts = from_files(gpu, mover(), reprojection="camera")
    assert facts["motion_from"] == "camera"
    everywhere, on_box = followed(files, ours)
    assert on_box < 0.2 and everywhere < 0.98


def test_without_a_scene_the_motion_pass_is_enough(gpu, ours):
    """The camera is fitted to the passes."""
    request = FrameRequest(gpu, None, None, chosen(), InputKind(files=INPUT))
    facts = FileInputs(request, ("motion",), exact=None)
    described = facts.describe()
    facts.release()
    gpu.collect()
    assert described["motion_from"] == "motion"


def test_reuse_of_cycles_frames_on_the_moving_box(ours):
    """Accumulated frames are nearer to the reference than single ones, also on the box alone."""
    errors: dict[str, list[float]] = {"none": [], "accumulate": []}

    def keep(evaluated):
        box = ours[evaluated.frame - FRAMES[0]]["ids"][..., 0] == 3
        reference = evaluated.radiance["reference"]
        for label, values in errors.items():
            values.append(np.mean((evaluated.radiance[label] - reference)[box] ** 2))

    done = evaluate_methods(
        mover(), ["none", "accumulate"], chosen(frames=(FRAMES[0], FRAMES[-1] + 1)), input=INPUT, reference=REFERENCE,
        metrics=("psnr",), on_frame=keep,
    )  # fmt: skip
    assert not done.failed and done.summary["mask_source"] == "exact"
    assert done.summary["input"]["motion_from"] == "motion"
    assert np.mean(errors["accumulate"][3:]) < 0.5 * np.mean(errors["none"][3:])


# --------------------------------------------------------------------------------------------------------- closed forms
LENS = Camera(yfov=np.radians(50.0), znear=0.1, zfar=100.0)


def grid(depth=4.0, size=(16, 9)):
    """A plane across the view direction, (h, w, 4), relative to a camera without rotation."""
    w, h = size
    half = np.tan(LENS.yfov / 2) * depth
    x = (2 * (np.arange(w) + 0.5) / w - 1) * half * w / h
    y = (1 - 2 * (np.arange(h) + 0.5) / h) * half
    points = np.stack([*np.meshgrid(x, y), np.full((h, w), -depth)], axis=-1)
    return np.concatenate([points, np.full((h, w, 1), depth)], axis=-1)


def test_points_of_a_plane_that_slides_across_the_view():
    """Motion across the view direction is known exactly: here 0.2 m at 4 m, and 0.1 m of the camera."""
    view = View(np.array([1.0, 2.0, 3.0]), np.eye(3), LENS)
    previous = replace(view, position=view.position + [0.1, 0.0, 0.0])
    position, pixels = grid(), 9 / (2 * np.tan(LENS.yfov / 2) * 4.0)  # per meter
    motion = np.zeros((9, 16, 2)) + [-(0.2 + 0.1) * pixels, 0.0]
    found = position_from_motion(position, motion, view, previous)
    expected = position[..., :3] - [0.3, 0.0, 0.0]
    ray = expected / np.linalg.norm(expected, axis=-1, keepdims=True)
    across = np.linalg.norm(found - (found * ray).sum(-1, keepdims=True) * ray, axis=-1)
    np.testing.assert_allclose(across, 0.0, atol=1e-9)  # on the previous view ray of the true point
    assert np.linalg.norm(found - expected, axis=-1).max() < 0.2 * 0.7  # off by what the ray is inclined
    np.testing.assert_allclose(found[4, 7:9], expected[4, 7:9], atol=0.03)


def pixels_of(points):
    """Pixel coordinates, +y down, from the center of the image, of points relative to a camera without rotation."""
    scale = 9 / (2 * np.tan(LENS.yfov / 2))
    return scale * points[..., :2] * [1, -1] / -points[..., 2:3]


def test_still_surfaces_have_exactly_the_motion_of_the_camera():
    view = View(np.zeros(3), np.eye(3), LENS)
    previous = replace(view, position=np.array([0.3, -0.1, 0.2]))
    position = grid()
    still = position[..., :3] - previous.position
    motion = pixels_of(still) - pixels_of(position) + 0.05
    np.testing.assert_array_equal(
        position_from_motion(position, motion, view, previous), still_position(position, view, previous)
    )
    np.testing.assert_array_equal(position_from_motion(position, np.zeros((9, 16, 2)), view, view), position[..., :3])


def test_displacement_of_the_scene_where_both_see_the_same_surface():
    view, previous = (View(np.array([x, 0.0, 0.0]), np.eye(3), LENS) for x in (0.0, 0.5))
    position = grid()
    rasterized_previous = position[..., :3] + (view.position - previous.position) - [0.0, 0.2, 0.1]
    seen = position.copy()
    seen[:, :8, 2] -= 1.0  # the rasterizer sees another surface there
    seen[0, :, 3] = 0.0  # and sky there
    rasterized_previous[:, :8, 2] -= 1.0
    found = position_from_scene(position, seen, rasterized_previous, view, previous, 0.1)
    still = still_position(position, view, previous)
    np.testing.assert_allclose(found[1:, 8:], still[1:, 8:] - [0.0, 0.2, 0.1])
    np.testing.assert_array_equal(found[:, :8], still[:, :8])
    np.testing.assert_array_equal(found[0], still[0])
