"""Demo 2, the paper's figure 2: which change shows in which feature, the letters put there by the masks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.demos import theory
from taubench_gl.demos.demo import Expected, Figure, Finding, Result, demo
from taubench_gl.demos.lessons import feature_scenes as scenes
from taubench_gl.demos.sheet import Sheet, letter, overlay, reason_entries, rgb
from taubench_gl.demos.stage import LitPair, Stage

Array = np.ndarray
LEAST = 8  # pixels of a region that deserves a letter

MEANING = {
    "a": "disoccluded: hidden by the ball in the last frame",
    "b": "occluded: now hidden by the ball",
    "c": "normals changed",
    "d": "new direct light",
    "e": "previously lit",
    "f": "previously shadowed",
    "g": "newly shadowed",
    "h": "new indirect light",
}


@dataclass(frozen=True, slots=True)
class Column:
    """One column of the figure: its scene, the reasons shown, where each letter is found, and where theory has it."""

    title: str
    pair: LitPair
    reasons: tuple[Reason, ...]
    found: Mapping[str, Array]
    expected: Mapping[str, Array]
    source: str


def _position(stage: Stage, size: dict[str, int]) -> Column:
    pair = stage.pair(scenes.moving_ball(), columns=("frustum", "position", "color"), **size)
    found = {"a": pair.has(Reason.DISOCCLUDED), "b": pair.has(Reason.OCCLUDING)}
    expected = scenes.expected_ball(pair.mask.shape[::-1])
    source = "rays against the ball and the wall behind it, float64"
    return Column("a ball moves", pair, (Reason.DISOCCLUDED, Reason.OCCLUDING), found, expected, source)


def _normal(stage: Stage, size: dict[str, int]) -> Column:
    pair = stage.pair(scenes.turning_fan(), columns=("frustum", "normal", "color"), **size)
    expected = {"c": scenes.expected_fan(pair.mask.shape[::-1])}
    source = "half of the fan: a turn by half a blade puts each blade over half of its neighbour"
    return Column("a fan turns", pair, (Reason.NORMAL,), {"c": pair.has(Reason.NORMAL)}, expected, source)


def _direct(stage: Stage, size: dict[str, int]) -> Column:
    columns = ("frustum", "direct", "color")
    pair = stage.pair(scenes.moving_sun(), columns=columns, **size)
    # The same pair without shadows: light that came or went there is a matter of angle, the rest is shadow.
    bare = stage.pair(scenes.moving_sun(), columns=columns, shadow_lights=0, **size)
    lit, dark = pair.has(Reason.LIT), pair.has(Reason.SHADOWED)
    found = {
        "d": lit & bare.has(Reason.LIT),
        "e": dark & bare.has(Reason.SHADOWED),
        "f": lit & ~bare.has(Reason.LIT),
        "g": dark & ~bare.has(Reason.SHADOWED),
    }
    expected = scenes.expected_sun(pair.mask.shape[::-1])
    source = "Lambert's cosine and one shadow ray per pixel, float64"
    return Column("a light moves", pair, (Reason.LIT, Reason.SHADOWED), found, expected, source)


def _indirect(stage: Stage, size: dict[str, int]) -> Column:
    pair = stage.pair(
        scenes.appearing_wall(), columns=("frustum", "position", "indirect", "color"), indirect="rsm",
        indirect_samples=4096, **size,
    )  # fmt: skip
    found = {"h": pair.has(Reason.INDIRECT) & ~pair.has(Reason.POSITION)}
    expected = {"h": scenes.expected_wall(pair.mask.shape[::-1])}
    return Column(
        "a red wall appears", pair, (Reason.INDIRECT,), found, expected, "Lambert's contour formula, one bounce"
    )


COLUMNS: tuple[Callable[[Stage, dict[str, int]], Column], ...] = (_position, _normal, _direct, _indirect)


@demo(
    2,
    "features",
    "Which change shows in which feature",
    idea="Reuse fails for different reasons, and each needs its own test. Positions tell what became visible and "
    "what was covered, normals tell turned surfaces, direct light tells moving lights and shadows, indirect "
    "light tells a change somewhere else in the scene. A mask compares one feature of this frame with the last "
    "one, pixel by pixel.",
    look_for=(
        "a and b: behind the ball history must be forgotten; where it is now, the wall's history is worthless.",
        "c: not one point moved out of its plane, yet half of the fan shades differently.",
        "d to g: light that came and went on the ball, and the same for its shadow on the floor.",
        "h: red light on a floor that did not change at all.",
    ),
    scene=lambda: scenes.moving_ball(),
    see_also=(("what the masks compare", "conventions.md"),),
)
def run(stage: Stage, out: Path) -> Result:
    width = 4 * stage.size[1] // 3
    columns = [make(stage, {"width": width}) for make in COLUMNS]
    sheet = Sheet(4, 3, width / stage.size[1])
    findings = []
    for place, column in enumerate(columns):
        sheet.panel(place, 0, column.pair.before["color"][..., :3], f"last frame: {column.title}")
        sheet.panel(place, 1, column.pair.now["color"][..., :3], "this frame")
        axes = sheet.panel(place, 2, overlay(column.pair.mask, column.pair.now["color"], *column.reasons), "its mask")
        for name, region in column.found.items():
            if region.sum() >= LEAST:
                letter(axes, theory.inmost(region), name)
            findings.append(_finding(name, region, column))
    reasons = [reason for column in columns for reason in column.reasons]
    sheet.legend(reason_entries(*reasons))
    path = sheet.save(out / "02-features.png")
    caption = "The paper's figure 2: " + "; ".join(f"({name}) {text}" for name, text in MEANING.items()) + "."
    return Result(tuple(findings), (Figure(path, caption, {r.name.lower(): rgb(r) for r in reasons}),))


def _finding(name: str, region: Array, column: Column) -> Finding:
    """Share of the picture that a letter stands for, against theory; off by half of the pixels on the edges at most."""
    there = column.expected[name]
    slack = 50.0 * theory.rim(there) / there.size
    share = 100.0 * float(there.mean())
    source = f"{column.source}; ± half of the pixels along its edge"
    return Finding(
        100.0 * float(region.mean()), "%", f"is ({name}) {MEANING[name]}", Expected.near(share, slack, source)
    )
