"""Channels as pictures: what each is made from, how it is coloured, and in which range."""

from __future__ import annotations

from dataclasses import dataclass

from taubench_gl.effects.decide import Effect
from taubench_gl.metrics.display import KINDS


@dataclass(frozen=True, slots=True)
class Picture:
    """``channel`` is read by the shader as ``kind`` (``metrics.display``); ``needs``: channels it takes besides."""

    channel: str
    kind: str
    doc: str
    needs: tuple[str, ...] = ()
    fixed: tuple[float, float] | None = (0.0, 1.0)  # range when automatic; None: least and largest value there are

    def __post_init__(self) -> None:
        assert self.kind in KINDS, self.kind

    @property
    def channels(self) -> tuple[str, ...]:
        """What a source must have: position and normal always are there, motion is the mask pass's."""
        return tuple(n for n in (self.channel, *self.needs) if n not in ("position", "normal", "motion"))


PICTURES: dict[str, Picture] = {
    "color": Picture("color", "encoded", "as a screen shows it"),
    "direct": Picture("direct", "radiance", "light after one bounce", fixed=None),
    "indirect": Picture("indirect", "radiance", "light after two bounces or more", fixed=None),
    "direct_diffuse": Picture("direct_diffuse", "radiance", "its diffuse lobe", fixed=None),
    "direct_glossy": Picture("direct_glossy", "radiance", "its glossy lobe", fixed=None),
    "emission": Picture("emission", "radiance", "emitted light", fixed=None),
    "shape": Picture("normal", "shape", "a light at the camera"),
    "base_color": Picture("base_color", "radiance", "base colour"),
    "normal": Picture("normal", "unit", "shading normal: x red, y green, z blue"),
    "geometric_normal": Picture("geometric_normal", "unit", "normal of the triangle"),
    "material": Picture("material", "vector", "metallic red, roughness green, occlusion blue"),
    "depth": Picture("position", "depth", "planar depth", fixed=None),
    "position": Picture("position", "vector", "place relative to the camera", fixed=None),
    "ids": Picture("ids", "ids", "one colour per object"),
    "motion": Picture("motion", "motion", "direction as hue, pixels as brightness", fixed=None),
    "motion_error": Picture(
        "prev_position",
        "motion_error",
        "supplied against expected motion, pixels",
        needs=("prev_position",),
        fixed=None,
    ),
}

LIGHT = {"color": "color", "direct": "direct", "indirect": "indirect", "direct_diffuse": "direct",
         "direct_glossy": "direct", "emission": "emission"}  # fmt: skip
"""Pictures that exist only where an effect is on."""


def of_scene(effects: dict[str, Effect]) -> tuple[str, ...]:
    """Names of the pictures that a scene with these effects can give."""
    return tuple(n for n in PICTURES if n not in LIGHT or effects[LIGHT[n]].enabled)


def of_channels(channels: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the pictures that a source with fixed channels can give."""
    return tuple(n for n, p in PICTURES.items() if set(p.channels) <= set(channels))
