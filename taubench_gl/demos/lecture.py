"""The lecture: twenty minutes, seven lessons in order, with notes for the speaker.

The order follows history through a renderer: where it is outside the image, where it is hidden, which feature finds
which change, how a threshold decides, two ways in which a threshold discards too much, and what a picture looks like
if too little is discarded.  Each lesson uses the words of those before it.
"""

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
    Part(
        "rotations", 3,
        "Say: temporal reuse takes the color of a pixel from the previous frame. Flicker between the frames on the "
        "next step and follow one column with the pointer.",
        "Ask: which part of this image has the previous frame never seen? Let everyone write down a percentage. Show "
        "the answer, and name the word: history.",
        "Ask before you point: why does roll discard so little? The image turns about its center, so only its corners "
        "leave it.",
        "Drag to the largest angle. At which frame rate would a fast turn of the head be harmless?",
    ),
    Part(
        "occlusion", 3,
        "Say: now the camera moves sideways, and every point stays in the image. Still a part has no history.",
        "Ask: on which side of the board does the strip appear? Then its width. A hint: the wall moves too.",
        "Compare the middle and the right mask: motion vectors recover the board, never the strip.",
        "Stop at half of the step: the width is halved too. The slope of the line is the parallax.",
    ),
    Part(
        "features", 3,
        "Say: a renderer knows more than positions. Every feature answers another question about the same pixel.",
        "Ask: how large is the region that the ball leaves, compared with the ball?",
        "Walk through the letters a to h. Ask for each: which other feature would have seen this change? Usually none.",
        "Lower the threshold: first the shadow, then the whole lit side counts as changed. "
        "This leads to the next lesson.",
    ),
    Part(
        "thresholds", 3,
        "Say: a mask is yes or no, a distance is a number. Between them is a threshold that somebody has chosen.",
        "Ask: which keys move by more than the threshold? Count them, then multiply.",
        "Point at the plateau: on it, the exact threshold does not matter. On a slope it does.",
        "Drag slowly through two steps of the curve and watch one key after the other go.",
    ),
    Part(
        "ground", 3,
        "Say: a fixed threshold in meters also meets distances that no motion has caused.",
        "Ask: nothing is hidden here. How much should be discarded, and how much will be?",
        "The right image is the correct answer. Rows are discarded because pixels far away are longer than the "
        "threshold.",
        "Find a threshold that keeps the ground. Ask what it would miss on a near object.",
    ),
    Part(
        "noise", 2,
        "Say: the other way to discard too much is light that is only an estimate.",
        "Ask: nothing moves, one lamp of four is chosen at random. How often do both frames choose lamps that differ "
        "by more than the threshold? Not in three of four pixels: most are near one lamp or far from all.",
        "Four times the samples, half the noise. The discard rate drops much faster.",
        "Only if there is time: raise the threshold until the noise is gone, and ask what is gone with it.",
    ),
    Part(
        "ghosting", 3,
        "Say: so far we have discarded too much. This is a picture in which nothing is discarded.",
        "Ask: a weight of 10 % for the new frame. What is left of the old color after one frame, two, five?",
        "From left to right: no test, a clamp, tested positions, exact masks. Ask what the clamp costs: look at "
        "the tiles.",
        "End here: a larger weight removes the ghost and keeps the noise. Rejecting the right pixels removes only "
        "the ghost.",
    ),
)  # fmt: skip
"""Twenty minutes."""


def minutes_text(parts: Sequence[Part]) -> str:
    """When the last of ``parts`` is due: ``minutes 3 to 6``."""
    end = sum(part.minutes for part in parts)
    return f"minutes {end - parts[-1].minutes} to {end}"
