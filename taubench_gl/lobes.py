"""The lobes of direct and indirect light: one record each, from which channels, sums of paths, columns, exports,
references, inputs of reuse methods, views and help are made.

A new lobe takes a record here, and its light in ``evaluate_brdf`` (shaders/common/brdf.glsl): ``Lobes`` has a field of
its name.  An effect that it needs is a row of ``effects.path_tracing.GLASS``.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

BOUNCES = ("direct", "indirect")


@dataclass(frozen=True, slots=True)
class Lobe:
    """One way in which the visible surface sends light to the camera."""

    name: str
    doc: str  # of its channels; {}: direct or indirect
    reuse_input: str  # of reuse methods that contains its light: diffuse or specular
    effect: str | None = ""  # without which a rendered scene lacks it; "": none; None: no rendered scene has it
    colored: bool = True  # path-traced files have its light without the color of the surface, and that color


TABLE: tuple[Lobe, ...] = (
    Lobe("diffuse", "diffuse lobe of {}, at the visible surface", "diffuse"),
    Lobe("glossy", "glossy lobe of {}, at the visible surface", "specular"),
    Lobe("transmission", "light of {} that comes through the visible surface", "specular", effect="transmission"),
    Lobe("volume", "light of {} that a volume scatters", "specular", effect=None, colored=False),
)

LOBES = tuple(lobe.name for lobe in TABLE)
"""Names of the lobes of direct and indirect that can be measured apart."""

FILE_COLORS = tuple(lobe.name for lobe in TABLE if lobe.colored)
"""Lobes whose color path-traced files store; without them direct and indirect of a file are null."""

SCENE_LOBES = tuple(lobe.name for lobe in TABLE if lobe.effect is not None)
"""Lobes that rendered scenes can have."""

COMMON_LOBES = tuple(lobe.name for lobe in TABLE if lobe.effect == "")
"""Lobes that every lit scene has, by raster light too: diffuse and glossy."""

LOBE_EFFECT = {lobe.name: lobe.effect for lobe in TABLE if lobe.effect}
"""Lobe -> the effect without which a rendered scene lacks it."""

REUSE_INPUTS: dict[str, tuple[str, ...]] = {
    name: tuple(lobe.name for lobe in TABLE if lobe.reuse_input == name) for name in ("diffuse", "specular")
}
"""Input of reuse methods -> lobes that it is the sum of."""


def lobes_with(effects: Collection[str]) -> tuple[str, ...]:
    """Lobes of a rendered scene with these ``effects``, in the order of the table."""
    return tuple(lobe for lobe in SCENE_LOBES if LOBE_EFFECT.get(lobe, "") in ("", *effects))


def lobe_channels(lobes: Sequence[str], bounces: Sequence[str] = BOUNCES) -> tuple[str, ...]:
    """Channels of ``lobes``: all of the first bounce, then all of the next."""
    return tuple(f"{bounce}_{lobe}" for bounce in bounces for lobe in lobes)


CHANNEL_EFFECT = {channel: effect for lobe, effect in LOBE_EFFECT.items() for channel in lobe_channels((lobe,))}
"""Channel of a lobe -> the effect without which a rendered scene lacks it."""


def lobe_macros(lobes: Sequence[str]) -> dict[str, object]:
    """GLSL macros of a pass with ``lobes``: their number, the place of each, and the list that brdf.glsl repeats."""
    further = " ".join(f"DO({lobe})" for lobe in lobes if lobe not in COMMON_LOBES)
    places = {f"LOBE_{lobe}": place for place, lobe in enumerate(lobes)}
    return {"LOBE_COUNT": len(lobes), **places, "EACH_FURTHER_LOBE(DO)": further}
