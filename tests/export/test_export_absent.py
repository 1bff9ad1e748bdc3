"""Surfaces that are not there in the other frame have no motion: replaced, hidden, scaled to zero."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from export_tools import HEIGHT, WIDTH
from fixed import fixed_settings

from taubench_gl.conventions import Reason
from taubench_gl.export.channels import choose_channels
from taubench_gl.export.frames import ExportFrame, FrameSource
from taubench_gl.export.sintel import masks_of
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import MorphTarget, Scene, Skin
from taubench_gl.selftest.scenes import SceneBuilder, quad

GONE = 3
"""The frame from which the plate is not there, or until which; frames are 1 / 24 s."""

NAMES = ("motion", "motion_forward", "mask", "mask_forward", "ids")


def exported(gpu, scene: Scene, size=(WIDTH, HEIGHT), **changes) -> dict[int, ExportFrame]:
    own = fixed_settings(size=size, columns=("frustum",), environment="none", exposure=1.0, **changes)
    with FrameSource(gpu, AnimatedScene(scene), own, choose_channels(NAMES)) as source:
        return {frame.number: frame for frame in source.frames(range(5))}


def plate_scene(kind: str, back: bool = False) -> Scene:
    """A small plate that moves 0.1 m a frame before a wall, and goes (``back``: comes) at frame GONE.

    ``joints``: all three joints of its skin are scaled to zero; ``moving joints``: the two that move it.
    """
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(20.0, 20.0)), translation=(0.0, 0.0, -2.0))
    above = b.node()
    plate = quad(1.0, 1.0)
    if kind == "morph":
        plate = replace(plate, targets=(MorphTarget(np.zeros_like(plate.positions)),))
    if "joint" in kind:
        rows = np.zeros((len(plate.positions), 4))
        rows[:, :2] = 0.5
        plate = replace(plate, joints=np.tile([0, 1, 0, 0], (len(rows), 1)).astype(np.uint32), weights=np.float32(rows))
    node = b.node(parent=above, mesh=b.mesh(plate), **({"skin": 0} if "joint" in kind else {}))
    joints = [b.node(parent=above) for _ in range(3)] if "joint" in kind else []
    b.camera(translation=(0.0, 0.0, 5.0))
    times = [0.0, GONE / 24.0, 1.0]
    b.animate(above, "translation", [0.0, 1.0], [(0.0, 0.0, 0.0), (2.4, 0.0, 0.0)])
    there = [1.0, 0.0, 0.0] if not back else [0.0, 1.0, 1.0]
    switched = {
        "visible": (node, "visible"),
        "ancestor": (above, "visible"),
        "scale": (node, "scale"),
        "morph": (node, "scale"),
    }
    scaled = [(joint, "scale") for joint in joints[: 3 - ("moving" in kind)]]
    for target, path in scaled or [switched[kind]]:
        values = np.array(there)[:, None] * np.ones(1 if path == "visible" else 3)
        b.animate(target, path, times, values, "STEP")
    scene = b.build()
    if not joints:
        return scene
    return replace(scene, skins=(Skin("skin", np.array(joints, np.int32), np.tile(np.eye(4), (3, 1, 1))),))


KINDS = ("visible", "ancestor", "scale", "morph", "joints")


@pytest.mark.parametrize("mode", ["camera", "motion"])
@pytest.mark.parametrize("kind", [*KINDS, "moving joints"])
def test_what_goes_has_no_forward_motion(gpu, kind, mode):
    frames = exported(gpu, plate_scene(kind), reprojection=mode)
    for number in (1, GONE - 1):
        channels = frames[number].channels
        plate, none = channels["ids"][..., 0] == 2, np.isnan(channels["motion_forward"]).any(axis=-1)
        invalid = masks_of(channels["mask_forward"][..., 0])[1]
        assert plate.sum() > 20 and not np.isnan(channels["motion"]).any()
        if number == GONE - 1:
            assert np.array_equal(none, plate) and np.array_equal(invalid, plate)
        else:
            assert not none.any() and not invalid.any()
    assert not (frames[GONE].channels["ids"][..., 0] == 2).any()


@pytest.mark.parametrize("kind", KINDS)
def test_what_comes_has_no_backward_motion(gpu, kind):
    scene = plate_scene(kind, back=True)
    frames = exported(gpu, scene)
    for number in (GONE, GONE + 1):
        channels = frames[number].channels
        plate, none = channels["ids"][..., 0] == 2, np.isnan(channels["motion"]).any(axis=-1)
        assert plate.sum() > 20 and np.array_equal(none, plate & (number == GONE))
        assert not np.isnan(channels["motion_forward"]).any()


def test_a_part_of_a_skin_that_goes(gpu):
    """Only the triangles of joints that are scaled to zero have no forward motion; those of the third one have it."""
    scene = plate_scene("moving joints")
    moved = np.array([1.5, 0.0, 0.0], np.float32)
    (plate,) = scene.meshes[1].primitives
    other = replace(plate, positions=plate.positions + moved, joints=np.full_like(plate.joints, 2))
    mesh = replace(scene.meshes[1], primitives=(plate, other))
    frames = exported(gpu, replace(scene, meshes=(scene.meshes[0], mesh)))
    channels = frames[GONE - 1].channels
    none = np.isnan(channels["motion_forward"]).any(axis=-1)
    gone, stays = (channels["ids"][..., 0] == record for record in (2, 3))
    assert gone.sum() > 20 and stays.sum() > 20
    assert np.array_equal(none, gone)
    assert np.all(channels["mask_forward"][..., 0][gone] & int(Reason.INVALID))


# --- files that went wrong -------------------------------------------------------------------------------------------


def test_shapes_that_are_replaced_once(gpu, data):
    """Forward motion has no position before the faces change, and backward motion has none after it."""
    scene = load_scene(f"seq:{data}/reports4/objects/once")
    frames = exported(gpu, scene)
    for number, frame in frames.items():
        ids = frame.channels["ids"][..., 0]
        old, new = (ids == 1), (ids == 3)
        forward, backward = (np.isnan(frame.channels[n]).any(axis=-1) for n in ("motion_forward", "motion"))
        assert (old | new).sum() > 50
        if 0 < number < 4:
            assert np.array_equal(forward, old if number == 1 else np.zeros_like(old))
            assert np.array_equal(backward, new if number == 2 else np.zeros_like(new))
        assert frame.channels["ids"][..., 1].max() < 2**30, "marks stay inside"
