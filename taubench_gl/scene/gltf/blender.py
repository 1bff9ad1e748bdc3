"""What Blender's glTF exporter writes: its version, the unit of its lights, and keys of lights in other units.

The exporter writes animated lights since version 4.2 (KHR_animation_pointer).  Its keys are not in the units of the
lights themselves: intensities of points and spots lack the factor 1 / (4 pi) and those of suns 683 lm/W, inner cone
angles are Blender's ``spot_blend``, and pointers to cone angles have a dot for a slash.  Source: files of exporter
4.2.83, 4.5.51 and 5.0.21, and the sources of all releases (KhronosGroup/glTF-Blender-IO).
"""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np

from taubench_gl.scene.gltf.document import Document
from taubench_gl.scene.model import Channel, Light

LUMENS_PER_WATT = 683.0
"""Luminous efficacy at 555 nm, ``PBR_WATTS_TO_LUMENS`` of Blender's exporter."""

KEYS_SINCE = (4, 2)
"""First version of the exporter that writes keys of lights."""

KEYS_SEEN = (5, 3)
"""Last version whose intensity keys are known to differ from the light: its newest source, 5.3.18 of July 2026."""

BLEND_UNTIL = (5, 2)
"""Last version that writes ``spot_blend`` for the inner cone angle."""

_EXPORTER = re.compile(r"Khronos glTF Blender I/O v(\d+)\.(\d+)")


def exporter_version(generator: str) -> tuple[int, int] | None:
    """Version of Blender's exporter that wrote a file with this ``asset.generator``; None for other programs."""
    match = _EXPORTER.match(generator)
    return (int(match[1]), int(match[2])) if match else None


CONES = {"spot.innerConeAngle": "inner_cone", "spot.outerConeAngle": "outer_cone"}
"""Ends of the exporter's pointers to cone angles -> paths of channels; ``light_keys`` replaces the former."""


def means_blender(document: Document) -> bool:
    """Whether keys of lights are read as Blender means them.  A strict reader takes them as written."""
    version = exporter_version(document.root.asset.generator)
    return not document.strict and version is not None and version >= KEYS_SINCE


def intensity_factor(kind: str) -> float:
    """Factor on the exporter's intensity keys that gives the unit of such a light: W to lux, lm to candela."""
    return LUMENS_PER_WATT if kind == "directional" else 1.0 / (4.0 * math.pi)


def light_keys(document: Document, channels: tuple[Channel, ...], lights: tuple[Light, ...]) -> tuple[Channel, ...]:
    """The channels of one animation with keys of lights in the units of ``lights``."""
    if not means_blender(document):
        return channels
    extras = document.root.asset.extras
    converted = isinstance(extras, dict) and "taubench_gl" in extras  # by ``pathtraced.blender``, with the unit
    cones: dict[int, dict[str, Channel]] = {}
    out = []
    for c in channels:
        if c.path in CONES:
            if c.values.ndim == 3:
                c = replace(c, values=c.values[:, 1], interpolation="LINEAR")
            cones.setdefault(c.index, {})[CONES[c.path]] = replace(c, path=CONES[c.path])
        elif c.target == "light" and c.path == "intensity" and not converted:
            out.append(_intensity(document, c, lights[c.index]))
        else:
            out.append(c)
    for index, cone in cones.items():
        out += _cone(document, cone.get("inner_cone"), cone.get("outer_cone"), lights[index])
        document.remark("blender-cone", _pointer(index))
    return tuple(out)


def _intensity(document: Document, channel: Channel, light: Light) -> Channel:
    """The keys in the unit of the light.

    By version, except where the light's own intensity cannot be one of the keys then (lighting mode Raw, an exposure of
    the light, a later exporter): it is that of the first key, since the exporter goes to frame 0 to write it.
    """
    keys = channel.values[:, 1] if channel.values.ndim == 3 else channel.values
    low, high, first = float(keys.min()), float(keys.max()), float(keys[0, 0])
    likely = [intensity_factor(light.kind), 1.0]
    if exporter_version(document.root.asset.generator) > KEYS_SEEN:
        likely.reverse()
    fits = [f for f in likely if 0.99 * low * f <= light.intensity <= 1.01 * high * f]
    ratio = light.intensity / first if first > 0.0 else 0.0
    factor = fits[0] if fits else ratio if 0.0 < ratio < 1e6 else likely[0]
    if factor == 1.0:
        return channel
    document.remark("blender-intensity", _pointer(channel.index), detail=f"times {factor:.4g}")
    return replace(channel, values=channel.values * factor)


def _cone(document: Document, inner: Channel | None, outer: Channel | None, light: Light) -> list[Channel]:
    """Both angles of a cone; the inner one is (1 - blend) times the outer one."""
    if inner is None:  # the blend stands still
        share = light.inner_cone / light.outer_cone
        return [outer, replace(outer, path="inner_cone", values=outer.values * share)]
    if exporter_version(document.root.asset.generator) <= BLEND_UNTIL:
        angle = light.outer_cone
        if outer is not None:
            angle = np.interp(inner.times, outer.times, outer.values[:, 0])[:, None]
        inner = replace(inner, values=(1.0 - inner.values) * angle)
    return [inner] if outer is None else [inner, outer]


def _pointer(light: int) -> str:
    return f"/extensions/KHR_lights_punctual/lights/{light}"
