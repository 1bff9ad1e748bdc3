"""The convention check reports each planted mistake, and nothing for correct files."""

from __future__ import annotations

import numpy as np
import pytest
from exr_files import HEIGHT, WIDTH, blender_frame, view_at, write

from taubench_gl.pathtraced.cameras import SidecarCamera, camera_file_text
from taubench_gl.pathtraced.check import camera_finding, check_sequence, flipped
from taubench_gl.pathtraced.sequence import PathTracedSequence

YFOV = np.radians(60.0)
STEP = 0.7


def sequence(tmp_path, spoil=lambda channels: None, cameras=(0, 1, 2)):
    """Frames 0 to 2 of a sideways camera over a floor, with its true motion; ``spoil`` changes what is written."""
    for frame in range(3):
        position = (STEP * frame, 1.0, 5.0)
        channels, expected = blender_frame(position, seed=frame)
        # A point at depth z moves by f STEP / z pixels to the right between these cameras.
        depth = np.where(expected["sky"], np.inf, expected["depth"])
        channels["ViewLayer.Vector.X"] = (0.5 * HEIGHT / np.tan(0.5 * YFOV) * STEP / depth).astype(np.float32)
        channels["ViewLayer.Vector.Y"] = np.zeros_like(channels["ViewLayer.Vector.X"])
        spoil(channels)
        write(tmp_path / f"f_{frame}.exr", {k: np.ascontiguousarray(v, np.float32) for k, v in channels.items()})
    views = {f: view_at(STEP * c) for f, c in enumerate(cameras)}
    (tmp_path / "camera.json").write_text(camera_file_text(views, 24.0, (WIDTH, HEIGHT)))
    return PathTracedSequence.open(tmp_path), SidecarCamera(tmp_path / "camera.json")


def faults(tmp_path, spoil=lambda channels: None, *, camera=True, **options):
    files, sidecar = sequence(tmp_path, spoil, **options)
    return {f.subject: f.fault for f in check_sequence(files, sidecar if camera else None, range(2)) if f.fault}


def scaled(factor):
    def spoil(channels):
        for c in "XYZ":
            channels[f"ViewLayer.Position.{c}"] = channels[f"ViewLayer.Position.{c}"] * factor

    return spoil


def flip(channels):
    for name in channels:
        channels[name] = channels[name][::-1]


def y_up(channels):
    y, z = channels["ViewLayer.Position.Y"], channels["ViewLayer.Position.Z"]
    channels["ViewLayer.Position.Y"], channels["ViewLayer.Position.Z"] = z, -y


def backwards(channels):
    channels["ViewLayer.Vector.X"] = -channels["ViewLayer.Vector.X"]


def fractions(channels):
    channels["ViewLayer.Vector.X"] = channels["ViewLayer.Vector.X"] / WIDTH


def unrelated(channels):
    channels["ViewLayer.Vector.X"] = channels["ViewLayer.Vector.X"][:, ::-1] * 3 + 5


def test_correct_files_have_no_fault(tmp_path):
    assert faults(tmp_path) == {}


@pytest.mark.parametrize(
    ("spoil", "what", "complaint"),
    [
        (flip, "camera", "bottom first"),
        (y_up, "camera", r"\+Y up already"),
        (scaled(100.0), "camera", "positions are in centimeters"),
        (scaled(1000.0), "camera", "positions are in millimeters"),
        (scaled(0.01), "camera", "camera is in centimeters"),
        (backwards, "motion", "current - previous"),
        (fractions, "motion", "fractions of the image"),
    ],
)
def test_a_planted_mistake_is_reported(tmp_path, spoil, what, complaint):
    import re

    found = faults(tmp_path, spoil)
    assert set(found) == {what} and re.search(complaint, found[what])


def test_unexplained_motion_is_no_fault(tmp_path):
    """A scene in which every surface is animated looks the same."""
    files, sidecar = sequence(tmp_path, unrelated)
    finding = check_sequence(files, sidecar, range(2))[2]
    assert finding.fault == "" and "not checked" in finding.detail


def test_a_camera_one_frame_off(tmp_path):
    files, sidecar = sequence(tmp_path, cameras=(1, 2, 3))
    assert "ahead by one frame" in check_sequence(files, sidecar, range(1, 3))[1].fault
    assert "behind by one frame" in faults(tmp_path, cameras=(-1, 0, 1))["camera"]


def test_an_unrelated_camera_is_a_fault(tmp_path):
    assert "did not render" in faults(tmp_path, cameras=(30, 40, 50))["camera"]


def test_missing_passes_are_absent_but_no_fault(tmp_path):
    def lose(channels):
        for name in [n for n in channels if "Gloss" in n]:
            del channels[name]

    files, sidecar = sequence(tmp_path, lose)
    passes, *others = check_sequence(files, sidecar, range(2))
    assert passes.subject == "passes" and "direct: the files lack the passes" in passes.absent
    assert not any(f.absent for f in others) and not any(f.fault for f in (passes, *others))


def test_a_mistake_is_reported_with_passes_missing(tmp_path):
    def lose_and_flip(channels):
        del channels["ViewLayer.Combined.R"]
        flip(channels)

    assert set(faults(tmp_path, lose_and_flip)) == {"camera"}


def test_without_a_camera_rows_are_still_checked(tmp_path, data):
    assert faults(tmp_path, camera=False) == {}
    # A flipped plane is a plane seen from below, so this needs a scene with depth.
    frame = PathTracedSequence.open(data / "cycles" / "sponza_man").read(12)
    assert camera_finding(frame, 12, None)[0].fault == ""
    assert "bottom first" in camera_finding(flipped(frame), 12, None)[0].fault


def test_real_cycles_files_have_no_fault(data):
    files = PathTracedSequence.open(data / "cycles" / "sponza_man")
    findings = check_sequence(files, None, range(12, 14))
    assert [f.fault for f in findings] == ["", "", ""] and "not checked" not in findings[2].detail
