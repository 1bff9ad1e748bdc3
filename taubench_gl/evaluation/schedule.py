"""Schedule of an evaluation: the frames to draw, and the pairs to evaluate."""

from __future__ import annotations

from collections.abc import Sequence

from taubench_gl.animation import CameraTrack, FileCamera, OrbitCamera, RecordedCamera
from taubench_gl.animation.views import STILL_SECONDS
from taubench_gl.errors import SettingsError
from taubench_gl.metrics.pair_sample import PairSample, sample_pairs
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Schedule = list[tuple[int, bool]]
"""(frame to draw, whether its pair with the frame drawn before is evaluated), in order."""


def frame_total(scene: Scene, camera: CameraTrack, settings: Settings) -> int:
    """Number of frames of the whole sequence, regardless of ``sequence.frames``."""
    return settings.sequence.frame_count(duration_of(scene, camera))


def frame_range(scene: Scene, camera: CameraTrack, settings: Settings) -> range:
    """Frame numbers to evaluate.  Raises SettingsError if ``sequence.frames`` selects none, or more than MAX_FRAMES."""
    frames = settings.sequence.frame_range(duration_of(scene, camera))
    if not frames:
        count = frame_total(scene, camera, settings)
        first, stop = settings.sequence.frames
        bounds = f"{'' if first is None else first}:{'' if stop is None else stop}"
        message = f"frames {bounds} selects no frame of {count}"
        raise SettingsError(message, hint=f"choose within 0:{count}", setting="frames")
    return frames


def duration_of(scene: Scene, camera: CameraTrack) -> float:
    """Seconds of a recorded camera, or of the scene; of a still one STILL_SECONDS, with a camera of the file 0."""
    if isinstance(camera, OrbitCamera | RecordedCamera):
        return camera.duration
    if scene.duration == 0 and not isinstance(camera, FileCamera):
        return STILL_SECONDS
    return scene.duration


def sampled_pairs(frames: range, settings: Settings) -> PairSample:
    """The pairs of ``frames`` that ``metrics.pairs`` selects; position p is the pair (frames[p], frames[p + 1])."""
    return sample_pairs(max(len(frames) - 1, 0), *settings.metrics.pair_scheme)


def frame_schedule(frames: range, settings: Settings) -> Schedule:
    """The schedule of the pairs that ``settings`` select; a sequence without a pair is drawn without evaluation."""
    sample = sampled_pairs(frames, settings)
    if not sample.positions:
        return [(frame, False) for frame in frames]
    return pair_schedule(frames, sample.positions)


def first_middle_last(frames: Sequence[int]) -> tuple[int, ...]:
    """First, middle and last of ascending ``frames``, without duplicates; () of none."""
    return tuple(sorted({frames[0], frames[len(frames) // 2], frames[-1]})) if frames else ()


def pair_schedule(frames: range, positions: Sequence[int]) -> Schedule:
    """The schedule of the pairs at ``positions`` (as in ``sampled_pairs``, ascending)."""
    drawn: dict[int, bool] = {}
    for position in positions:
        drawn.setdefault(frames[position], False)
        drawn[frames[position + 1]] = True
    return list(drawn.items())
