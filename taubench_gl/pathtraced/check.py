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
    project,
)
from taubench_gl.pathtraced.passes import PathTracedFrame
from taubench_gl.pathtraced.sequence import PathTracedSequence

Array = np.ndarray
MAX_SHIFT_PX = 0.25
"""Largest accepted median offset of positions from the pixel centers, per axis."""

MAX_MOTION_PX = 0.1
"""Motion is understood if its median difference from the reprojection of static surfaces is at most this."""

_MOTION_SIGNS = {
    (1, 1): "",
    (-1, -1): "motion is current - previous (set motion.direction in the mapping)",
    (1, -1): "motion has +y the other way (set motion.y in the mapping)",
    (-1, 1): "motion is current - previous with +y the other way (set motion.direction and motion.y in the mapping)",
}
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
    second = in_world(second, camera.view(frames[1], second))
    return [*findings, _check_motion(second, camera.view(frames[1], second), camera.view(frames[0], first))]


def _check_passes(sequence: PathTracedSequence) -> Finding:
    found = sorted(name for name in sequence.mapping.passes if name in sequence.index)
    absent = "; ".join(f"{column}: {why}" for column, why in sequence.missing().items())
    detail = f"{len(found)} found with the mapping {sequence.mapping.name}: {', '.join(found)}"
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


def _check_motion(frame: PathTracedFrame, view: View, previous: View) -> Finding:
    """Compare with the motion of static surfaces, which most surfaces are, under each sign and unit convention."""
    use = ~frame.sky & np.isfinite(frame.position).all(axis=-1) & np.isfinite(frame.motion).all(axis=-1)
    rows, columns = np.nonzero(use)
    expected = project(previous, frame.position[use], frame.size) - np.stack([columns, rows], axis=-1)
    given = frame.motion[use].astype(np.float64)
    visible = np.isfinite(expected).all(axis=-1)
    if not visible.any() or np.median(np.linalg.norm(expected[visible], axis=-1)) < 2 * MAX_MOTION_PX:
        return Finding("motion", "", "not checked: the camera hardly moves between these frames")
    expected, given = expected[visible], given[visible]
    errors = {}
    for signs, fault in _MOTION_SIGNS.items():
        for scale, unit in ((np.ones(2), ""), (np.array(frame.size), "motion is in fractions of the image size")):
            error = float(np.median(np.linalg.norm(given * signs * scale - expected, axis=-1)))
            errors["; ".join(text for text in (fault, unit) if text)] = error
    best = min(errors, key=errors.get)
    detail = f"median {errors['']:.3g} px from the motion of static surfaces"
    if errors[""] <= MAX_MOTION_PX:
        return Finding("motion", "", detail)
    if errors[best] > MAX_MOTION_PX:
        # Without static surfaces (a single animated character), animation and a mistake look the same.
        return Finding("motion", "", f"not checked: {detail}; surfaces are animated, or the pass is no motion")
    return Finding("motion", best, f"{detail}, {errors[best]:.3g} px when corrected")


def flipped(frame: PathTracedFrame) -> PathTracedFrame:
    """The frame's geometry with its rows in reverse order."""
    depth = None if frame.depth is None else frame.depth[::-1]
    return replace(frame, position=frame.position[::-1], sky=frame.sky[::-1], depth=depth)
