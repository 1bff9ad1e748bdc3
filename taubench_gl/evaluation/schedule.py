"""Schedule of an evaluation: the frames to draw, and the pairs to evaluate."""

from __future__ import annotations

from collections.abc import Sequence

from taubench_gl.animation import CameraTrack, FileCamera, OrbitCamera
from taubench_gl.animation.views import STILL_SECONDS
from taubench_gl.effects.path_tracing import traced_sources
from taubench_gl.errors import SettingsError
from taubench_gl.metrics.pair_sample import PairSample, sample_pairs
from taubench_gl.scene.model import Scene
from taubench_gl.settings import AUTO, Settings

MOST_FRAMES = 145
"""Frames that ``auto`` draws at most: the paper's animations have 6 s at 24 fps."""

SAMPLE_BUDGET = 1 << 23
"""Samples of path-traced light that ``auto`` takes at most in a run: about half a minute of two CPU cores."""

LEAST_PAIRS = 4
"""Pairs that ``auto`` evaluates at least, whatever their light costs."""

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
        given = f"{'' if first is None else first}:{'' if stop is None else stop}"
        what = f"frames {given} selects no frame of {count}"
        raise SettingsError(what, hint=f"choose within 0:{count}", setting="frames")
    return frames


def duration_of(scene: Scene, camera: CameraTrack) -> float:
    """Duration in seconds; of a still scene STILL_SECONDS unless the camera is one of the file."""
    if isinstance(camera, OrbitCamera):
        return camera.duration
    if scene.duration == 0 and not isinstance(camera, FileCamera):
        return STILL_SECONDS
    return scene.duration


def sampled_pairs(frames: range, settings: Settings) -> PairSample:
    """The pairs of ``frames`` that ``metrics.pairs`` selects; position p is the pair (frames[p], frames[p + 1])."""
    return sample_pairs(max(len(frames) - 1, 0), *settings.metrics.pair_scheme)


def with_pairs(scene: Scene, settings: Settings, frames: range) -> Settings:
    """``settings``, whose lighting is resolved, with the pairs that ``auto`` stands for.

    All of at most MOST_FRAMES frames, else two from each of H strata.  Where light method ``auto`` traces paths, for
    emitters or an environment, at most SAMPLE_BUDGET samples are taken, but LEAST_PAIRS pairs evaluated.  Methods and
    pairs that the user names are kept.
    """
    if settings.metrics.pairs != AUTO:
        return settings
    most = MOST_FRAMES
    lighting, sequence = settings.lighting, settings.sequence
    if lighting.light == AUTO and settings.metrics.lit and traced_sources(scene, settings):
        samples = sequence.width * sequence.height * lighting.path_samples * settings.metrics.samples_per_pixel
        most = min(max(SAMPLE_BUDGET // samples, 2 * LEAST_PAIRS), MOST_FRAMES)
    if len(frames) <= most:
        return settings.replace(pairs="all")
    return settings.replace(pairs=f"strata:{most // 4}")  # two pairs of each, and each pair draws two frames


def frame_schedule(frames: range, settings: Settings) -> Schedule:
    """The schedule of ``sampled_pairs``; a sequence without a pair is drawn without evaluation."""
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
