"""Does a path-traced sequence follow our conventions?  Tries the usual mistakes and says which one it is.

A mistake is named only where undoing it explains the pictures and leaving it does not; what a sequence cannot tell
(the world's axes, without a camera to compare with) is said as such.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from taubench_gl.animation import View
from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced.cameras import MATCH_PX, FittedCamera, PathTracedCamera, in_world, mismatch_px
from taubench_gl.pathtraced.passes import PathTracedFrame
from taubench_gl.pathtraced.sequence import PathTracedSequence

Array = np.ndarray
MOTION_PX = 0.1
"""Motion that a still surface's own reprojection explains better than this (median) is taken to be understood."""

_MOTION_SIGNS = {
    (1, 1): "",
    (-1, -1): "motion is current - previous (set motion.direction in the mapping)",
    (1, -1): "motion has +y the other way (set motion.y in the mapping)",
    (-1, 1): "motion is current - previous with +y the other way (set motion.direction and motion.y in the mapping)",
}


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing looked at.  ``fault`` is empty where the files are as they should be.

    ``absent``: what the files do not have, which is no fault of what they have.
    """

    what: str
    fault: str
    detail: str
    absent: str = ""


def check_sequence(sequence: PathTracedSequence, camera: PathTracedCamera | None, frames: range) -> list[Finding]:
    """Look at the first two of ``frames``.  ``camera``: None if only the files themselves are there."""
    first = sequence.read(frames[0])
    findings = [_passes(sequence)]
    if first.relative:
        if camera is None:
            return [
                *findings,
                Finding("camera", "", "not checked: positions are relative to a camera that is not given"),
            ]
        first = in_world(first, camera.view(frames[0], first))
    if first.position is None:
        return [*findings, Finding("camera", "", "not checked: there is no position pass")]
    camera_finding, camera = check_camera(first, frames[0], camera)
    findings.append(camera_finding)
    if camera_finding.fault or first.motion is None or len(frames) < 2:
        why = "the camera is wrong" if camera_finding.fault else "there is no motion pass or no second frame"
        return [*findings, Finding("motion", "", f"not checked: {why}")]
    second = sequence.read(frames[1])
    second = in_world(second, camera.view(frames[1], second))
    return [*findings, _motion(second, camera.view(frames[1], second), camera.view(frames[0], first))]


def _passes(sequence: PathTracedSequence) -> Finding:
    there = sorted(name for name in sequence.mapping.passes if name in sequence.index)
    missing = sequence.missing()
    lost = "; ".join(f"{column}: {why}" for column, why in missing.items())
    found = f"{len(there)} found as {sequence.mapping.name} names them: {', '.join(there)}"
    return Finding("passes", "", found, absent=lost)


def check_camera(
    frame: PathTracedFrame, number: int, camera: PathTracedCamera | None
) -> tuple[Finding, PathTracedCamera]:
    """Whether ``camera`` took frame ``number``, else which mistake explains it; and the camera to go on with."""
    if camera is None:
        fitted = FittedCamera()
        for fault, changed in ((("", frame)), ("rows are stored bottom first", flipped(frame))):
            try:
                fitted.view(number, changed)
            except PathTracedError as error:
                reason = error.what
            else:
                note = "the world's axes and unit cannot be checked without a camera to compare with"
                return Finding("camera", fault, f"{fitted.describe()}; {note}"), fitted
        return Finding("camera", reason, "neither as it is nor with its rows flipped"), fitted
    view = camera.view(number, frame)
    error = mismatch_px(view, frame)
    if error <= MATCH_PX:
        half = _offset_px(view, frame)
        shifted = float(np.abs(half).max()) > 0.25
        fault = f"positions lie {half[0]:+.2f}, {half[1]:+.2f} px off the pixel centres" if shifted else ""
        return Finding("camera", fault, f"{camera.describe()}: median {error:.2g} px"), camera
    for fault, candidate, changed in _mistakes(frame, number, view, camera):
        if mismatch_px(candidate, changed) <= MATCH_PX:
            return Finding("camera", fault, f"median {error:.3g} px off as it is, explained so"), camera
    return Finding("camera", "the camera did not take these pictures", f"median {error:.3g} px off"), camera


def _mistakes(
    frame: PathTracedFrame, number: int, view: View, camera: PathTracedCamera
) -> list[tuple[str, View, PathTracedFrame]]:
    """What may have gone wrong, the view to take, and the frame with the mistake undone."""
    p = frame.position
    out = [
        ("rows are stored bottom first", view, flipped(frame)),
        ("positions are +Y up already (up = 'y' in the mapping)", view, _moved(frame, p[..., [0, 2, 1]] * [1, -1, 1])),
        ("positions are +Z up (up = 'z' in the mapping)", view, _moved(frame, p[..., [0, 2, 1]] * [1, 1, -1])),
    ]
    for factor, unit in ((0.01, "centimetres"), (0.001, "millimetres"), (0.0254, "inches"), (0.3048, "feet")):
        out.append((f"positions are in {unit}, the camera in metres", view, _moved(frame, p * factor)))
        out.append((f"the camera is in {unit}, positions in metres", view, _moved(frame, p / factor)))
    relative = p + view.position
    out.append(("positions are relative to the camera", view, _moved(frame, relative)))
    out.append(("positions are in view space", view, _moved(frame, p @ view.world_from_view.T + view.position)))
    for step in (-1, 1):
        try:
            other = camera.view(number + step, frame)
        except PathTracedError:
            continue
        out.append((f"the camera is {'ahead' if step < 0 else 'behind'} by one frame", other, frame))
    return out


def _motion(frame: PathTracedFrame, view: View, previous: View) -> Finding:
    """Most surfaces stand still: their motion is the camera's, whichever way the file writes it."""
    width, height = frame.size
    use = ~frame.sky & np.isfinite(frame.position).all(axis=-1) & np.isfinite(frame.motion).all(axis=-1)
    rows, columns = np.nonzero(use)
    expected = _project(previous, frame.position[use], width, height) - np.stack([columns, rows], axis=-1)
    given = frame.motion[use].astype(np.float64)
    moved = np.isfinite(expected).all(axis=-1)
    if not moved.any() or np.median(np.linalg.norm(expected[moved], axis=-1)) < 2 * MOTION_PX:
        return Finding("motion", "", "not checked: the camera hardly moves between these frames")
    expected, given = expected[moved], given[moved]
    errors = {}
    for signs, fault in _MOTION_SIGNS.items():
        for scale, unit in ((np.ones(2), ""), (np.array([width, height]), "motion is in fractions of the picture")):
            error = float(np.median(np.linalg.norm(given * signs * scale - expected, axis=-1)))
            errors["; ".join(text for text in (fault, unit) if text)] = error
    best = min(errors, key=errors.get)
    detail = f"median {errors['']:.3g} px from the camera's own motion"
    if errors[""] <= MOTION_PX:
        return Finding("motion", "", detail)
    if errors[best] > MOTION_PX:
        # A lone walking figure has no still surface to judge by: no mistake is claimed that could be an animation.
        return Finding("motion", "", f"cannot be told: {detail}, so surfaces move by themselves, or it is no motion")
    return Finding("motion", best, f"{detail}, {errors[best]:.3g} px once undone")


def flipped(frame: PathTracedFrame) -> PathTracedFrame:
    """The frame's geometry with its rows in the other order."""
    depth = None if frame.depth is None else frame.depth[::-1]
    return replace(frame, position=frame.position[::-1], sky=frame.sky[::-1], depth=depth)


def _moved(frame: PathTracedFrame, position: Array) -> PathTracedFrame:
    return replace(frame, position=position)


def _project(view: View, points: Array, width: int, height: int) -> Array:
    """Pixel-index coordinates (x, row) of world points; NaN behind the camera.  (N, 3) -> (N, 2)."""
    relative = points.astype(np.float64) - view.position
    clip = np.column_stack([relative, np.ones(len(relative))]) @ view.clip_from_relative(width, height).T
    w = np.where(clip[:, 3] > 0, clip[:, 3], np.nan)
    x = (clip[:, 0] / w + 1.0) * 0.5 * width - 0.5
    row = (1.0 - clip[:, 1] / w) * 0.5 * height - 0.5
    return np.stack([x, row], axis=-1)


def _offset_px(view: View, frame: PathTracedFrame) -> Array:
    """Median displacement of projected positions from their pixel centres, (x, row)."""
    rows, columns = np.nonzero(~frame.sky & np.isfinite(frame.position).all(axis=-1))
    apart = _project(view, frame.position[rows, columns], *frame.size) - np.stack([columns, rows], axis=-1)
    return np.nanmedian(apart, axis=0) if len(rows) else np.zeros(2)
