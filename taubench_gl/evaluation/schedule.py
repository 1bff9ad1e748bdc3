"""Which frames of a scene are drawn, and which of them are judged against the one drawn before."""

from __future__ import annotations

from collections.abc import Sequence

from taubench_gl.animation import CameraTrack, FileCamera
from taubench_gl.errors import SettingsError
from taubench_gl.metrics.pair_sample import PairSample, sample_pairs
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

STILL_ORBIT_SECONDS = 2.0
"""What a still scene lasts, seen from the framing orbit or a caller's camera; seen from its own, it has one frame."""

Schedule = list[tuple[int, bool]]
"""Frames to draw, in order, and whether each is judged against the one drawn before it."""


def frame_total(scene: Scene, camera: CameraTrack, settings: Settings) -> int:
    """Frames of the whole sequence, whichever of them ``settings.frames`` asks for."""
    return settings.sequence.frame_count(_duration(scene, camera))


def frame_range(scene: Scene, camera: CameraTrack, settings: Settings) -> range:
    """Frame numbers of the evaluation.  Raises SettingsError for a slice that leaves none, or more than MAX_FRAMES."""
    frames = settings.sequence.frame_range(_duration(scene, camera))
    if not frames:
        count = frame_total(scene, camera, settings)
        first, stop = settings.sequence.frames
        given = f"{'' if first is None else first}:{'' if stop is None else stop}"
        raise SettingsError(f"frames {given} of {count} frames are none", hint=f"choose within 0:{count}")
    return frames


def _duration(scene: Scene, camera: CameraTrack) -> float:
    """Seconds; a still scene moves past a camera that is not its own."""
    if scene.duration == 0 and not isinstance(camera, FileCamera):
        return STILL_ORBIT_SECONDS
    return scene.duration


def sampled_pairs(frames: range, settings: Settings) -> PairSample:
    """Which of the pairs of ``frames`` the settings look at; position p is the pair (frames[p], frames[p + 1])."""
    return sample_pairs(max(len(frames) - 1, 0), *settings.metrics.pair_scheme)


def frame_schedule(frames: range, sample: PairSample) -> Schedule:
    """What ``sample`` needs; a sequence without a pair is drawn all the same."""
    if not sample.positions:
        return [(frame, False) for frame in frames]
    return pair_schedule(frames, sample.positions)


def pair_schedule(frames: range, positions: Sequence[int]) -> Schedule:
    """``frame_schedule`` of these pairs alone: ``positions`` as in ``sampled_pairs``, ascending."""
    drawn: dict[int, bool] = {}
    for position in positions:
        drawn.setdefault(frames[position], False)
        drawn[frames[position + 1]] = True
    return list(drawn.items())
