"""The lecture: seven lessons in twenty minutes, with notes for the speaker.  Their order: docs/demos.md."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Part:
    """A lesson of the lecture: the name of its demo, planned minutes, and the notes on the steps of its page.

    Notes hold no number of the lesson: the page measures it.
    """

    demo: str
    minutes: int
    idea: str
    question: str
    figure: str
    parameter: str
    numbers: str = "Skip this step, unless somebody asks where a number comes from."


LECTURE = (
    Part("rotations", 3,
        "Say: temporal reuse takes the color of a pixel from the previous frame: its history.",
        "Flicker, and follow one column. Let everyone write down a percentage before you show the answer.",
        "Ask: why does roll discard so little? The image turns about its center, so only its corners leave it.",
        "Drag to the largest angle. At which frame rate would a fast turn of the head be harmless?"),
    Part("occlusion", 3,
        "Say: now the camera moves sideways, and almost all stays in the image. Still a part has no history.",
        "Ask: on which side of the board does the strip appear? Then its width. A hint: the wall moves too.",
        "Compare the middle and the right mask: motion vectors recover the board, never the strip.",
        "Stop at half of the step: the width is halved too. The slope of the line is the parallax."),
    Part("features", 3,
        "Say: a renderer knows more than positions. Every feature answers another question about the same pixel.",
        "Ask: how large is the region that the ball leaves, compared with the ball?",
        "Walk through the letters a to h. Ask for each: which other feature would have seen this change? Usually none.",
        "The curve is smooth, as the light meets many angles. The next lesson has a curve with steps."),
    Part("thresholds", 3,
        "Say: a mask is yes or no, a distance is a number. Between them is a threshold that somebody has chosen.",
        "Ask: which keys move by more than the threshold? Count them, then multiply.",
        "Point at the plateau: on it, the exact threshold does not matter. On a slope it does.",
        "Drag slowly through two steps of the curve and watch one key after the other go."),
    Part("ground", 3,
        "Say: a fixed threshold in meters also meets distances that no motion has caused.",
        "Ask: nothing is hidden here. How much should be discarded, and how much will be?",
        "The right image is correct. Rows are discarded because pixels far away are longer than the threshold.",
        "Find a threshold that keeps the ground. Ask what it would miss on a near object."),
    Part("noise", 2,
        "Say: the other way to discard too much is light that is only an estimate.",
        "Ask: how often do both frames choose different lamps? And do two lamps always differ by the threshold?",
        "Four times the samples, half the noise. The discard rate drops much faster.",
        "Only if there is time: raise the threshold until the noise is gone, and ask what is gone with it."),
    Part("ghosting", 3,
        "Say: so far we have discarded too much. This is a picture in which nothing is discarded.",
        "Ask: a weight of 10 % for the new frame. What is left of the old color after one frame, two, five?",
        "From left to right: no test, a clamp, tested positions, exact masks. Ask what the clamp costs: see the tiles.",
        "End here: a larger weight removes the ghost but keeps noise. Rejecting the right pixels has no such price."),
)  # fmt: skip


def minutes_text(parts: Sequence[Part]) -> str:
    """When the last of ``parts`` is due: ``minutes 3 to 6``."""
    end = sum(part.minutes for part in parts)
    return f"minutes {end - parts[-1].minutes} to {end}"
