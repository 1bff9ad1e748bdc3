"""The cases of the suite: one scene and one property each."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from taubench_gl.animation.jitter import halton_jitter
from taubench_gl.data_files import read_toml
from taubench_gl.errors import SettingsError
from taubench_gl.paths import ASSETS
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene

Array = np.ndarray

FRAMES, FPS, CAMERA = 4, 24.0, "eye"
"""Frames that are scored, at frame / FPS seconds, and the name of the camera node."""


class Case(Struct, frozen=True, forbid_unknown_fields=True):
    """One scene.  ``about``: the classes of pixels that it must have; ``text``: what it shows, for its page."""

    text: str
    about: tuple[str, ...]
    name: str = ""
    extensions: tuple[str, ...] = ()  # names of the glTF extensions that the scene uses
    offset: tuple[float, float] = (0.0, 0.0)  # of the samples of every frame, shares of width and height, +y up
    jitter: bool = False  # each frame has an offset of its own within the pixel
    cut: int | None = None  # first frame of a new shot
    edges: bool = False  # the edge band is what is scored

    @property
    def file(self) -> Path:
        """The scene: a binary glTF file."""
        return ASSETS / "conformance" / f"{self.name}.glb"

    def offsets(self, size: tuple[int, int]) -> Array:
        """Where each frame is sampled: pixel i at i + offset.  (FRAMES, 2) pixels, +x right, +y up."""
        if self.jitter:
            return np.array([halton_jitter(frame) for frame in range(FRAMES)])
        return np.tile(np.array(self.offset) * size, (FRAMES, 1))


_FILE = read_toml(Path(__file__).with_name("cases.toml"), dict[str, Case])
CASES = {name: replace(case, name=name) for name, case in _FILE.items()}


@cache
def scene_of(name: str) -> Scene:
    """The scene of a case: what an engine reads."""
    return load_scene(CASES[name].file)


def select(names: tuple[str, ...]) -> list[Case]:
    """Cases whose names contain one of ``names``; all without names.  Raises SettingsError where one names none."""
    for name in names:
        if not any(name in case for case in CASES):
            raise SettingsError(f"no case is named {name!r}", hint="see 'taubench-gl conformance list'")
    return [case for case in CASES.values() if not names or any(name in case.name for name in names)]
