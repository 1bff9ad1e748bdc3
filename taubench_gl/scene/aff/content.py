"""What AFF files say, before it becomes a Scene."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.scene.aff.surfaces import Collector
from taubench_gl.scene.build import NodeList
from taubench_gl.scene.identity import Identity
from taubench_gl.scene.model import Note

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class Fill:
    """A surface description: colours are linear coefficients, ``shine`` a Phong exponent."""

    ambient: tuple[float, ...]
    diffuse: tuple[float, ...]
    specular: tuple[float, ...]
    shine: float
    transmittance: float
    texture: Path | None = None


@dataclass(slots=True)
class Motion:
    """One ``k`` statement.  Rows: transl and scale (t, xyz, tcb), rot (t, axis, degrees, tcb), visibility (t, on)."""

    name: str
    where: str
    tracks: dict[str, Array] = field(default_factory=dict)


@dataclass(slots=True)
class AffFile:
    """Everything the files say, before it becomes a Scene."""

    nodes: NodeList = field(default_factory=NodeList)
    drawn: dict[int, Collector] = field(default_factory=dict)  # by node
    fills: dict[Fill, int] = field(default_factory=dict)
    movers: dict[str, list[int]] = field(default_factory=dict)  # animation name -> nodes
    motions: dict[str, Motion] = field(default_factory=dict)
    lights: list[tuple[int, Array, Array]] = field(default_factory=list)  # parent, position, colour
    camera: dict[str, Any] | None = None
    window: tuple[float, float, int] | None = None  # start, end, frames
    ambient: Array = field(default_factory=lambda: np.zeros(3))
    notes: dict[Note, None] = field(default_factory=dict)
    identity: Identity = field(default_factory=Identity)

    def note(self, message: str, where: str = "") -> None:
        self.notes[Note(message, where)] = None
