"""Checks the conventions of a path-traced sequence: axes, units, row order, pixel centers, motion, camera.

Common mistakes are tried in turn.  A mistake is reported only if correcting it explains the files and leaving it does
not.  What the files cannot show (the world's axes, without a camera to compare with) is reported as not checked.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from taubench_gl.animation import View
from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced.cameras import (
    MAX_MISMATCH_PX,
    FittedCamera,
    PathTracedCamera,
    in_world,
    mismatch_px,
    pixel_offsets,
)
from taubench_gl.pathtraced.motion_check import MotionVerdict, check_motion
from taubench_gl.pathtraced.passes import PathTracedFrame
from taubench_gl.pathtraced.sequence import PathTracedSequence

Array = np.ndarray
MAX_SHIFT_PX = 0.25
"""Largest accepted median offset of positions from the pixel centers, per axis."""

_UNITS = {"centimeters": 0.01, "millimeters": 0.001, "inches": 0.0254, "feet": 0.3048}


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of one check."""

    subject: str  # passes, camera or motion
    fault: str  # empty: none found
    detail: str
    absent: str = ""  # missing passes, which are no fault


def check_sequence(sequence: PathTracedSequence, camera: PathTracedCamera | None, frames: range) -> list[Finding]:
    """Check the first two of ``frames``.  ``camera`` None: estimate one from the position pass.

    Raises PathTracedError for files that cannot be read.
    """
    first = sequence.read(frames[0])
    findings = [_check_passes(sequence)]
    if first.relative:
        if camera is None:
            detail = "not checked: positions are relative to a camera that is not given"
            return [*findings, Finding("camera", "", detail)]
        first = in_world(first, camera.view(frames[0], first))
    if first.position is None:
        return [*findings, Finding("camera", "", "not checked: there is no position pass")]
    finding, camera = camera_finding(first, frames[0], camera)
    findings.append(finding)
    if finding.fault or first.motion is None or len(frames) < 2:
        why = "the camera is wrong" if finding.fault else "there is no motion pass or no second frame"
        return [*findings, Finding("motion", "", f"not checked: {why}")]
    second = sequence.read(frames[1])
    verdict = check_motion(second, first, camera.view(frames[1], second), camera.view(frames[0], first))
    return [*findings, motion_finding(verdict)]


def _check_passes(sequence: PathTracedSequence) -> Finding:
    names = sorted(name for name in sequence.mapping.passes if name in sequence.index)
    absent = "; ".join(f"{column}: {why}" for column, why in sequence.missing().items())
    detail = f"{len(names)} found with the mapping {sequence.mapping.name}: {', '.join(names)}"
    return Finding("passes", "", detail, absent)


def camera_finding(
    frame: PathTracedFrame, number: int, camera: PathTracedCamera | None
) -> tuple[Finding, PathTracedCamera]:
    """Whether ``camera`` rendered frame ``number``, or which mistake explains it; and the camera for further checks."""
    if camera is None:
        return _check_fit(frame, number)
    view = camera.view(number, frame)
    error = mismatch_px(view, frame)
    if error <= MAX_MISMATCH_PX:
        x, y = np.nanmedian(pixel_offsets(view, frame, most=None), axis=0) if (~frame.sky).any() else (0.0, 0.0)
        shifted = max(abs(x), abs(y)) > MAX_SHIFT_PX
        fault = f"positions are {x:+.2f}, {y:+.2f} px off the pixel centers" if shifted else ""
        return Finding("camera", fault, f"{camera.describe()}: median {error:.2g} px"), camera
    for fault, candidate, corrected in _mistakes(frame, number, view, camera):
        if mismatch_px(candidate, corrected) <= MAX_MISMATCH_PX:
            return Finding("camera", fault, f"median {error:.3g} px off, explained by this mistake"), camera
    return Finding("camera", "this camera did not render these files", f"median {error:.3g} px off"), camera


def _check_fit(frame: PathTracedFrame, number: int) -> tuple[Finding, PathTracedCamera]:
    fitted = FittedCamera()
    reason = ""
    for fault, corrected in (("", frame), ("rows are stored bottom first", flipped(frame))):
        try:
            fitted.view(number, corrected)
        except PathTracedError as error:
            reason = error.what
        else:
            note = "the axes and the unit of the world cannot be checked without a camera"
            return Finding("camera", fault, f"{fitted.describe()}; {note}"), fitted
    return Finding("camera", reason, "neither as stored nor with flipped rows"), fitted


def _mistakes(
    frame: PathTracedFrame, number: int, view: View, camera: PathTracedCamera
) -> list[tuple[str, View, PathTracedFrame]]:
    """Possible mistakes: description, the view to compare with, and the frame with the mistake corrected."""
    p = frame.position

    def moved(position: Array) -> PathTracedFrame:
        return replace(frame, position=position)

    out = [
        ("rows are stored bottom first", view, flipped(frame)),
        ("positions are +Y up already (up = 'y' in the mapping)", view, moved(p[..., [0, 2, 1]] * [1, -1, 1])),
        ("positions are +Z up (up = 'z' in the mapping)", view, moved(p[..., [0, 2, 1]] * [1, 1, -1])),
    ]
    for unit, factor in _UNITS.items():
        out.append((f"positions are in {unit}, the camera in meters", view, moved(p * factor)))
        out.append((f"the camera is in {unit}, positions in meters", view, moved(p / factor)))
    out.append(("positions are relative to the camera", view, moved(p + view.position)))
    out.append(("positions are in view space", view, moved(p @ view.world_from_view.T + view.position)))
    for step in (-1, 1):
        try:
            other = camera.view(number + step, frame)
        except PathTracedError:
            continue
        out.append((f"the camera is {'ahead' if step < 0 else 'behind'} by one frame", other, frame))
    return out


def motion_finding(verdict: MotionVerdict | str) -> Finding:
    """What ``check_motion`` found, as a finding."""
    if isinstance(verdict, str):
        return Finding("motion", "", f"not checked: {verdict}")
    if not verdict.known:
        # Without still surfaces (a single animated character), animation and a mistake look the same.
        why = "surfaces are animated, or the pass is no motion"
        return Finding("motion", "", f"not checked: {verdict.detail}; {why}")
    return Finding("motion", f"motion: {verdict.fault}" if verdict.fault else "", verdict.detail)


def flipped(frame: PathTracedFrame) -> PathTracedFrame:
    """The frame's geometry with its rows in reverse order."""
    depth = None if frame.depth is None else frame.depth[::-1]
    return replace(frame, position=frame.position[::-1], sky=frame.sky[::-1], depth=depth)
