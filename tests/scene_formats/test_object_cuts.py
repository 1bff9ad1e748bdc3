"""A surface that replaces another has no history: its pixels are cut and are no position discards."""

from __future__ import annotations

import numpy as np
import obj_files
import pytest
from fixed import fixed_settings
from frame_tools import still_camera

from taubench_gl.conventions import NO_HISTORY, Reason
from taubench_gl.effects.decide import decide
from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Camera

FACES = ("f 1 2 3 4\n", "f 1 2 3 4\n", "f 1 2 3 4\nf 4 3 2 1\n", "f 1 2 3 4\nf 4 3 2 1\n")
"""Faces of the left object per frame: different from frame 2 on."""

SETTINGS = fixed_settings(width=96, height=54, fps=24.0, columns=("frustum", "position", "normal"))


def sequence(folder, faces=FACES):
    """Two squares side by side; the left one approaches by 0.5 m a frame."""
    right = "o right\nv 0 -1 0\nv 2 -1 0\nv 2 1 0\nv 0 1 0\nf 5 6 7 8\n"
    for i, left in enumerate(faces):
        corners = "".join(f"v {x} {y} {0.5 * i}\n" for x, y in ((-2, -1), (0, -1), (0, 1), (-2, 1)))
        obj_files.write(folder, f"o left\n{corners}{left}{right}", f"s{i}.obj")
    return load_scene(folder)


def pairs_of(scene, settings=SETTINGS):
    seen = []

    def keep(pair) -> None:
        read = {n: pair.source.read(n) for n in pair.source.channels}
        seen.append((pair.row, pair.mask, read))

    camera = still_camera(Camera(yfov=0.8), (0, 0, 6.0))
    run = evaluate_scene(scene, settings, Observers(on_pair=keep), camera=camera)
    return run, seen


@pytest.mark.parametrize("reprojection", ["camera", "motion"])
def test_changed_faces_are_cut_in_one_pair(gpu, tmp_path, reprojection):
    scene = sequence(tmp_path)
    assert len(scene.replacements) == 1
    run, seen = pairs_of(scene, SETTINGS.replace(reprojection=reprojection))
    assert run.summary["effects"]["cuts"]["on"]
    assert any("left" in note for note in run.summary["notes"])
    half = SETTINGS.sequence.width // 2
    for row, mask, read in seen:
        cut, ids = mask & Reason.CUT > 0, read["ids"]
        left = (ids[..., 0] > 0) & (np.arange(SETTINGS.sequence.width) < half)
        if row["frame"] == 2:
            assert left.sum() > 500 and not np.any(mask[left] & ~np.uint32(Reason.CUT))
            np.testing.assert_array_equal(cut, left)
            assert row["cut"] == left.sum() and row["position"] < 60, "only disocclusions are position discards"
        else:
            # It moves by more than the threshold: a discard in camera reprojection, none in motion reprojection.
            assert row["cut"] == 0 and not cut.any() and not np.any(ids[..., 1] & np.uint32(NO_HISTORY))
            assert (row["position"] > 500) == (reprojection == "camera")
        classes = ("first", "cut", "invalid", "frustum", "comparable")
        assert sum(row[name] for name in classes) == row["pixels"] == mask.size


def test_cut_at_half_the_frame_rate(gpu, tmp_path):
    """At half the rate the change is in exactly one pair."""
    run, _ = pairs_of(sequence(tmp_path, (*FACES, FACES[-1])), SETTINGS.replace(fps=12.0))
    assert [row["cut"] > 0 for row in run.frames] == [True, False]


def test_no_cost_without_replaced_surfaces(gpu, tmp_path):
    scene = sequence(tmp_path, FACES[:1] * 3)
    assert not scene.replacements and not decide(scene, SETTINGS)["cuts"].enabled
    run, seen = pairs_of(scene)
    assert all("ids" not in read for _, _, read in seen) and all(row["cut"] == 0 for row in run.frames)
