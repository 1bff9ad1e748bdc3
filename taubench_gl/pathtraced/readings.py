"""How files may be meant: every convention that the check tries, its values, and what to set where one is wrong."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import make_dataclass, replace
from typing import get_args, get_type_hints

import numpy as np

from taubench_gl.pathtraced.passes import MotionMap, PassMap, Up

Array = np.ndarray

GEOMETRY = ("rows", "up", "positions", "meters", "matrix", "lens", "order", "depth")
MOTION = ("direction", "y", "components", "unit", "zero")
BACKWARDS = ("files backwards", "next")
"""Orders in which the frame before file i is file i + 1."""

_MOTION = {name: get_args(choices) for name, choices in get_type_hints(MotionMap).items()}
_UNITS = {"0.01": "centimeters", "0.001": "millimeters", "0.0254": "inches", "0.3048": "feet"}
TEXTS: dict[str, Mapping[str, str]] = {
    "rows": {"bottom first": "rows are stored in the other order: set rows = '{}'"},
    "up": {up: f"axes are those of up = '{up}': set up = '{up}'" for up in get_args(Up)},
    "positions": {
        "world": "positions are world positions: set positions = 'world'",
        "relative": "positions are relative to the camera: set positions = 'relative'",
        "view": "positions are in view space: write world positions",
    },
    "meters": {factor: f"positions are in {unit} where the camera is in meters" for factor, unit in _UNITS.items()}
    | {f"1/{factor}": f"the camera is in {unit} where positions are in meters" for factor, unit in _UNITS.items()},
    "matrix": {
        "transposed": "camera matrices are stored by columns: transpose them",
        "rotation transposed": "rotations of the camera are view_from_world: transpose their 3 x 3 part",
        "inverse": "camera matrices are view_from_world: invert them",
        "inverse transposed": "camera matrices are view_from_world, stored by columns: transpose and invert them",
        "y down, z forward": "the camera has +y down and +z forward: negate columns 2 and 3 of world_from_view",
    },
    "lens": {"horizontal": "yfov holds the horizontal field of view: give the vertical one"},
    "order": {
        "next": "motion leads to the next file: files and cameras are numbered backwards, or motion is forward",
        "ahead": "the camera is ahead by one frame: file i needs camera i - 1",
        "behind": "the camera is behind by one frame: file i needs camera i + 1",
        "files backwards": "files are numbered backwards",
        "camera backwards": "frames of the camera are numbered backwards",
    },
    "depth": {kind: f"depth is {kind}: set depth = '{kind}'" for kind in ("planar", "distance")},
    "direction": {
        d: f"motion is {d.replace('-', ' - ')}: set motion.direction = '{d}'" for d in _MOTION["direction"]
    },
    "y": {y: f"motion +y is {y}: set motion.y = '{y}'" for y in _MOTION["y"]},
    "components": {"yx": "x and y of motion are exchanged: name its channels in the mapping"},
    "unit": {
        "uv": "motion is in fractions of the image: set motion.unit = 'uv'",
        "ndc": "motion is in clip space, -1 to 1: set motion.unit = 'ndc'",
        "px": "motion is in pixels: set motion.unit = 'px'",
        "half": "motion is half as long as it should be: double it",
        "double": "motion is twice as long as it should be, as clip space for fractions of the image: halve it",
    },
    "zero": {zero: f"no motion is stored as {zero}: set motion.zero = '{zero}'" for zero in _MOTION["zero"]},
}  # fmt: skip
"""Convention -> value that corrects the files -> what is wrong and what to set."""


class Reading(make_dataclass("Reading", [(name, str, "") for name in TEXTS], frozen=True, slots=True)):
    """One way to mean the files: per convention the value that corrects them, a key of TEXTS; "": as the mapping.

    Its fields are the conventions: ``rows``, ``up``, ... ``zero``.
    """

    __slots__ = ()

    @property
    def values(self) -> dict[str, str]:
        """Convention -> value that is not the mapping's."""
        return {name: value for name in TEXTS if (value := getattr(self, name))}

    @property
    def factor(self) -> float:
        """Factor on positions and depth that gives meters of the camera."""
        over, _, under = (self.meters or "1").partition("/")
        return float(over) / float(under or 1.0)

    def without(self, *names: str) -> Reading:
        """This reading, but with the conventions ``names`` as the mapping has them."""
        return replace(self, **dict.fromkeys(names, ""))


def text_of(name: str, value: str, mapping: PassMap) -> str:
    """What is wrong if ``value`` corrects convention ``name``, and what to set."""
    if name != "meters":
        return TEXTS[name][value].format("bottom" if mapping.rows == "top" else "top")
    meters = mapping.meters * Reading(meters=value).factor
    return f"{TEXTS[name][value]}: set meters = {meters:.6g}, or scale the camera"


def value_in(mapping: PassMap, name: str) -> str:
    """What the mapping says of a convention."""
    fixed = {"rows": f"{mapping.rows} row first", "matrix": "world_from_view, rows", "lens": "yfov is vertical",
             "order": "as numbered", "components": "x, y"}  # fmt: skip
    if name == "depth":
        return "distance" if mapping.depth == "distance" else "planar"
    return fixed.get(name) or str(getattr(mapping.motion if name in MOTION else mapping, name))


def geometry_values(mapping: PassMap, positions: bool, camera: str) -> dict[str, tuple[str, ...]]:
    """Convention of GEOMETRY -> values to try.

    ``positions``: there is such a pass, else points come from depth; ``camera``: sidecar, scene or fitted, which shows
    neither axes nor units.
    """
    if camera == "fitted":
        return {"rows": tuple(TEXTS["rows"]), "order": ("next",)}
    names = ("rows", *(("up", "positions") if positions else ("depth",)), "meters", "order")
    names += ("matrix", "lens") if camera == "sidecar" else ()
    return {name: tuple(value for value in TEXTS[name] if value != value_in(mapping, name)) for name in names}


def geometry_readings(values: Mapping[str, Iterable[str]]) -> list[Reading]:
    """No, one and two corrections, the simplest first."""
    single = [{name: value} for name, choices in values.items() for value in choices]
    pairs = [a | b for a, b in itertools.combinations(single, 2) if not a.keys() & b.keys()]
    return [Reading(**values) for values in ({}, *single, *pairs)]


def motion_readings(mapping: PassMap) -> list[Reading]:
    """All combinations of the values of MOTION, the simplest first."""
    values = {name: ["", *(v for v in TEXTS[name] if v != value_in(mapping, name))] for name in MOTION}
    if mapping.motion.unit != "px":  # the same as half, and as double
        values["unit"].remove("ndc" if mapping.motion.unit == "uv" else "uv")
    combined = (Reading(**dict(zip(values, chosen, strict=True))) for chosen in itertools.product(*values.values()))
    # A stored value of no motion other than 0 is for values from 0 to 1.
    sensible = (r for r in combined if not r.zero or mapping.motion.unit != "px" or r.unit in ("uv", "ndc"))
    return sorted(sensible, key=lambda reading: len(reading.values))


def corrected_motion(motion: Array, readings: Iterable[Reading], mapping: PassMap, size: tuple[int, int]) -> Array:
    """(N, 2) motion as the mapping reads it, in pixels by each of ``readings``: (K, N, 2) float64."""
    pixels = np.array(size, dtype=np.float64)
    scale = {"": 1.0, "uv": pixels, "ndc": 0.5 * pixels, "px": 1.0 / pixels, "half": 2.0, "double": 0.5}
    if mapping.motion.unit == "ndc":
        scale["px"] = 2.0 / pixels
    stored = mapping.motion.factors(size).astype(np.float64)  # ``passes`` has subtracted the mapping's zero
    out = []
    for reading in readings:
        shifted = motion + (float(mapping.motion.zero) - float(reading.zero)) * stored if reading.zero else motion
        signs = np.array([1.0, -1.0 if reading.y else 1.0]) * (-1.0 if reading.direction else 1.0)
        out.append((shifted[:, ::-1] if reading.components else shifted) * (signs * scale[reading.unit]))
    return np.array(out)
