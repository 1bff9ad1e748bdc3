"""What a run without options draws: its size, and the pairs that ``auto`` stands for."""

from __future__ import annotations

import pytest

from taubench_gl.evaluation.lighting import LEAST_PAIRS, MOST_FRAMES, SAMPLE_BUDGET, with_pairs
from taubench_gl.evaluation.schedule import sampled_pairs
from taubench_gl.selftest.scenes import busy_room
from taubench_gl.settings import Settings

pytestmark = pytest.mark.usefixtures("coarse_light")

SKY = {"light": "auto", "environment": (1.0, 1.0, 1.0)}


def pairs(frames: int, *, lamps: int = 0, **settings) -> int:
    """Number of evaluated pairs of an animation of ``frames`` frames."""
    chosen = with_pairs(busy_room(lamps=lamps), Settings(**settings), range(frames))
    assert chosen.metrics.pairs != "auto"
    return len(sampled_pairs(range(frames), chosen).positions)


def test_the_size_of_the_paper():
    paper = Settings(size="paper").sequence
    assert (paper.width, paper.height) == (1920, 1080)


@pytest.mark.parametrize("frames", [1, 2, MOST_FRAMES])
def test_all_pairs_of_an_animation_as_long_as_the_papers(frames):
    assert pairs(frames, light="auto") == frames - 1


@pytest.mark.parametrize("frames", [MOST_FRAMES + 1, 1000, 12345])
def test_a_longer_animation_draws_no_more_frames(frames):
    found = pairs(frames, light="auto")
    assert MOST_FRAMES // 4 <= found <= MOST_FRAMES // 2
    assert pairs(frames, light="auto", pairs="all") == frames - 1
    named = Settings(pairs="every:100")
    assert with_pairs(busy_room(lamps=1), named, range(frames)) == named


@pytest.mark.parametrize("size", ["64x36", "160x90", "320x180", "640x360", "paper"])
@pytest.mark.parametrize(("spp", "places"), [(4, 1), (16, 1), (4, 4)])
def test_path_traced_samples_stay_within_the_budget(size, spp, places):
    found = pairs(100, size=size, spp=spp, samples_per_pixel=places, **SKY)
    width, height = Settings(size=size).sequence.width, Settings(size=size).sequence.height
    frames = 100 if found == 99 else 2 * found
    assert found >= LEAST_PAIRS
    assert frames * width * height * spp * places <= SAMPLE_BUDGET or found <= LEAST_PAIRS


def test_what_the_user_names_is_evaluated():
    assert pairs(100, size="paper", spp=16, **SKY | {"light": "path-traced"}) == 99
    assert pairs(100, size="paper", spp=16, columns=("position",), **SKY) == 99


def test_a_sky_beside_a_lamp_is_not_path_traced_by_the_preview():
    assert pairs(100, size="paper", spp=16, lamps=1, **SKY) == 99
