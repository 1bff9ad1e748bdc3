"""Exported motion against float64 references, signs, masks, cameras, first and last frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from export_tools import DEMO, HEIGHT, WIDTH, drawn, settings

from taubench_gl.animation import Poser, choose_camera, pose_vertices
from taubench_gl.conventions import Reason
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.features import MASK_WORDS
from taubench_gl.metrics.counts import counts_of
from taubench_gl.scene import load_scene

pytestmark = pytest.mark.usefixtures("coarse_light")

FPS = 24.0


@pytest.fixture(scope="module")
def scene():
    return load_scene(DEMO)


def vertices_of(scene, poser, time: float) -> np.ndarray:
    """World positions of every drawn vertex at ``time``, float64, in a fixed order."""
    state = poser.sample(time)
    parts = [
        pose_vertices(scene, state, int(node), primitive)
        for node in scene.mesh_nodes
        for primitive in scene.meshes[scene.nodes.mesh[node]].primitives
    ]
    return np.concatenate(parts)


def project(view, points: np.ndarray) -> np.ndarray:
    """Pixel-index coordinates, +y down; NaN behind.  Independent of the package's own reprojection."""
    relative = (points - view.position) @ view.world_from_view
    f = 0.5 * HEIGHT / np.tan(0.5 * view.camera.yfov)
    depth = np.where(-relative[:, 2] > view.camera.znear, -relative[:, 2], np.nan)
    x = f * relative[:, 0] / depth + 0.5 * (WIDTH - 1)
    return np.column_stack([x, 0.5 * (HEIGHT - 1) - f * relative[:, 1] / depth])


@pytest.mark.parametrize(("name", "step"), [("motion", -1), ("motion_forward", 1)])
def test_motion_follows_vertices(scene, frames, name, step):
    """The motion of a pixel is the float64 motion of the vertex it shows: skinned, rigid or static."""
    poser, camera = Poser(scene), choose_camera(scene)
    compared = 0
    for number, frame in frames.items():
        now, then = vertices_of(scene, poser, number / FPS), vertices_of(scene, poser, (number + step) / FPS)
        before = camera.view_at(poser.sample((number + step) / FPS))
        here, there = project(frame.view, now), project(before, then)
        at = np.rint(here)
        inside = np.isfinite(at).all(axis=1) & (at >= 0).all(axis=1) & (at < [WIDTH, HEIGHT]).all(axis=1)
        x, y = at[inside].astype(int).T
        seen = frame.channels["position"][y, x] + frame.view.position
        # A vertex is compared if its pixel shows it: within a tenth of the pixel's footprint.
        near = np.linalg.norm(seen - now[inside], axis=1) < 0.02
        got, expected = frame.channels[name][y, x][near], (there - here)[inside][near]
        compared += near.sum()
        assert np.nanmax(np.abs(got - expected)) < 0.25
        assert np.nanmedian(np.abs(got - expected)) < 0.02
    assert compared > 20


def drawn_moves(scene, frame, step) -> np.ndarray:
    """(h, w) bool: pixels of nodes that move or deform between the two times."""
    poser = Poser(scene)
    now, then = poser.sample(frame.number / FPS), poser.sample((frame.number + step) / FPS)
    still = []
    for node in scene.mesh_nodes:
        primitives = scene.meshes[scene.nodes.mesh[node]].primitives
        fixed = scene.nodes.skin[node] < 0 and np.array_equal(now.world[node], then.world[node])
        still += [fixed and not primitive.targets for primitive in primitives if len(primitive.triangles)]
    ids = frame.channels["ids"][..., 0]
    return ~np.array([True, *still])[ids]


@pytest.mark.parametrize("mode", ["camera", "motion"])
def test_masks_equal_those_of_evaluate(mode):
    """Every count of every pair, radiance included; the first frame of a slice is compared with the one before it."""
    run = evaluate_scene(DEMO, settings(frames=(7, 11), reprojection=mode))
    for frame, row in zip(drawn(range(8, 11), ("mask",), reprojection=mode), run.frames, strict=True):
        counts = counts_of(np.bincount(frame.channels["mask"].ravel(), minlength=MASK_WORDS))
        assert {k: row[k] for k in counts} == counts and row["frame"] == frame.number


def test_first_and_last_frame():
    """The first frame has no backward motion, the last no forward motion: NaN, and the mask is FIRST."""
    first, last = drawn([0, 60], ("motion", "motion_forward", "mask", "mask_forward"))
    assert np.isnan(first.channels["motion"]).all() and np.isfinite(first.channels["motion_forward"]).any()
    assert (first.channels["mask"] & Reason.FIRST).all() and not (first.channels["mask_forward"] & Reason.FIRST).any()
    assert np.isnan(last.channels["motion_forward"]).all() and np.isfinite(last.channels["motion"]).any()
    assert (last.channels["mask_forward"] & Reason.FIRST).all() and not (last.channels["mask"] & Reason.FIRST).any()


def test_frames_do_not_depend_on_earlier_frames(frames):
    """A resumed export requires this."""
    (alone,) = drawn([10])
    for name, values in frames[10].channels.items():
        assert alone.channels[name].tobytes() == values.tobytes(), name


def test_motion_excludes_jitter(scene):
    """Jitter moves the samples within their pixels; motion is that of the points they show."""
    names = ("position", "depth", "motion", "motion_forward", "ids")
    for frame in drawn(range(8, 11), names, "halton"):
        assert np.any(frame.camera["jitter_px"])
        assert frame.camera["jitter_px"][1] == -frame.view.jitter_px[1]
        # The position rendered at pixel i projects, without jitter, to i + jitter.
        points = frame.channels["position"].reshape(-1, 3) + frame.view.position
        y, x = np.mgrid[:HEIGHT, :WIDTH]
        surface = frame.channels["depth"].ravel() > 0
        offset = project(frame.view, points) - np.column_stack([x.ravel(), y.ravel()])
        np.testing.assert_allclose(np.median(offset[surface], axis=0), frame.camera["jitter_px"], atol=2e-3)
        poser, camera = Poser(scene), choose_camera(scene)
        for name, step in (("motion", -1), ("motion_forward", 1)):
            other = camera.view_at(poser.sample((frame.number + step) / FPS))
            there = project(other, points) - project(replace(frame.view, jitter_px=np.zeros(2)), points)
            still = surface & ~drawn_moves(scene, frame, step).ravel()
            assert np.nanmax(np.abs(frame.channels[name].reshape(-1, 2) - there)[still]) < 0.01


def test_camera_matrices(frames):
    """Every surface point projects to the center of its pixel, with K and with the two matrices."""
    for frame in frames.values():
        y, x = np.mgrid[:HEIGHT, :WIDTH]
        surface = frame.channels["depth"][..., 0] > 0
        relative = frame.channels["position"][surface].astype(np.float64)
        rotation = frame.camera["world_from_view"][:3, :3]
        vision = relative @ rotation * [1, -1, -1]
        np.testing.assert_allclose(vision[:, 2], frame.channels["depth"][surface][:, 0], rtol=1e-5)
        pixel = (vision / vision[:, 2:]) @ frame.camera["intrinsics"].T
        np.testing.assert_allclose(pixel[:, 0], x[surface], atol=5e-3)
        np.testing.assert_allclose(pixel[:, 1], y[surface], atol=5e-3)
        clip = np.column_stack([relative @ rotation, np.ones(len(relative))]) @ frame.camera["clip_from_view"].T
        np.testing.assert_allclose((clip[:, 0] / clip[:, 3] + 1) * WIDTH / 2 - 0.5, x[surface], atol=5e-3)
        np.testing.assert_allclose((1 - clip[:, 1] / clip[:, 3]) * HEIGHT / 2 - 0.5, y[surface], atol=5e-3)
