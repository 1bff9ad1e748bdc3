"""The stage of the demos: a GL context, an image size, and the passes of the engine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import Pair, evaluate_scene
from taubench_gl.gpu.context import Gpu
from taubench_gl.run import Run
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.bench import Bench
from taubench_gl.settings import Settings

Array = np.ndarray
SIZE = (480, 270)
SMALLEST, LARGEST = (160, 90), (1920, 1080)
"""Smaller images have too few edge pixels for the theoretical values."""


@dataclass(frozen=True, slots=True)
class LitPair:
    """One evaluated pair as arrays, row 0 at the top.  ``now`` and ``before``: channels (h, w, n) of both frames."""

    mask: Array  # (h, w) uint32 reason masks
    motion: Array  # (h, w, 2) previous - current, pixels, +x right, +y down; 0 behind the camera
    now: Mapping[str, Array]
    before: Mapping[str, Array]
    row: Mapping[str, Any]  # row of frames.csv

    def has(self, bits: int) -> Array:
        """Pixels with any of ``bits``.  (h, w) bool."""
        return (self.mask & np.uint32(bits)) != 0

    def percent(self, bits: int) -> float:
        return 100.0 * float(self.has(bits).mean())


class Stage:
    """A GL context and an image size for the demos of one run.  The caller enters ``gpu``."""

    def __init__(self, gpu: Gpu, size: tuple[int, int] = SIZE, device: int | None = None):
        for side, least, most in zip(size, SMALLEST, LARGEST):
            if not least <= side <= most:
                allowed = f"{SMALLEST[0]}x{SMALLEST[1]} to {LARGEST[0]}x{LARGEST[1]}"
                raise SettingsError(f"size is {size[0]}x{size[1]}", hint=f"give a size from {allowed} pixels")
        self.gpu, self.size, self.device = gpu, size, device
        self.bench = Bench(gpu, size, device)

    @property
    def pixels(self) -> int:
        return self.size[0] * self.size[1]

    def settings(self, **given: Any) -> Settings:
        """Settings with the size and backend of the stage; defaults: one frame per second, no indirect light."""
        defaults = {"width": self.size[0], "height": self.size[1], "fps": 1.0, "indirect": "none"}
        return Settings.of(**(defaults | given | {"backend": self.gpu.backend, "device": self.device}))

    def evaluate(
        self, scene: Scene, *, camera: CameraTrack | None = None, extra: Sequence[str] = (), **settings: Any
    ) -> tuple[Run, list[LitPair]]:
        """Evaluate ``scene``: the run, and each pair with its channels.  ``settings``: fields of Settings.

        ``extra``: further channels beyond those that the columns need.
        """
        pairs: list[LitPair] = []
        chosen = self.settings(**settings)

        def keep(pair: Pair) -> None:
            names = [n for n in pair.source.channels if n in pair.source.current]
            now, before = ({n: pair.source.read(n, previous=old) for n in names} for old in (False, True))
            pairs.append(LitPair(pair.mask(), pair.motion(), now, before, dict(pair.row)))

        run = evaluate_scene(scene, chosen, on_pair=keep, channels=tuple(extra), camera=camera)
        return run, pairs

    def pair(self, scene: Scene, **settings: Any) -> LitPair:
        """The first pair of ``scene``: its frames at 0 and 1 second."""
        return self.evaluate(scene, frames=(0, 2), **settings)[1][0]

    def release(self) -> None:
        self.bench.release()
