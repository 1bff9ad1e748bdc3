"""How files may be meant: every convention that the check tries, its values, and what to set where one is wrong."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import make_dataclass, replace
from pathlib import Path

import numpy as np

from taubench_gl.data_files import read_toml
from taubench_gl.pathtraced.passes import PassMap

Array = np.ndarray

GEOMETRY = ("rows", "up", "positions", "meters", "matrix", "lens", "order", "depth")
MOTION = ("direction", "y", "components", "unit", "zero")
BACKWARDS = ("files backwards", "next")
"""Orders in which the frame before file i is file i + 1."""

TEXTS = read_toml(Path(__file__).with_name("readings.toml"), dict[str, dict[str, str]])
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
    """Readings with no, one and two corrections among ``values``, the simplest first."""
    single = [{name: value} for name, choices in values.items() for value in choices]
    pairs = [a | b for a, b in itertools.combinations(single, 2) if not a.keys() & b.keys()]
    return [Reading(**values) for values in ({}, *single, *pairs)]


def motion_readings(mapping: PassMap) -> list[Reading]:
    """Readings with all combinations of the values of MOTION, the simplest first."""
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
