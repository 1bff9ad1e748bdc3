"""What every demo is given: a GL context, a picture size, and the engine's own passes."""

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
"""Below, edges have too few pixels for the laws that the numbers are held against."""


@dataclass(frozen=True, slots=True)
class LitPair:
    """One evaluated pair as arrays, row 0 at the top.  ``now`` and ``before`` hold channels (h, w, n) by name."""

    mask: Array  # (h, w) uint32 reason words
    motion: Array  # (h, w, 2) previous - current, pixels, +x right, +y down; 0 where behind
    now: Mapping[str, Array]
    before: Mapping[str, Array]
    row: Mapping[str, Any]  # of frames.csv

    def has(self, bits: int) -> Array:
        """(h, w) bool: pixels that carry any of ``bits``."""
        return (self.mask & np.uint32(bits)) != 0

    def percent(self, bits: int) -> float:
        return 100.0 * float(self.has(bits).mean())


class Stage:
    """A GL context and a picture size, shared by the demos of one run.  ``with gpu:`` is up to the caller."""

    def __init__(self, gpu: Gpu, size: tuple[int, int] = SIZE, device: int | None = None):
        for side, least, most in zip(size, SMALLEST, LARGEST):
            if not least <= side <= most:
                said = f"{SMALLEST[0]}x{SMALLEST[1]} to {LARGEST[0]}x{LARGEST[1]} pixels"
                raise SettingsError(f"size is {size[0]}x{size[1]}", hint=f"demos are drawn with {said}")
        self.gpu, self.size, self.device = gpu, size, device
        self.bench = Bench(gpu, size, device)

    @property
    def pixels(self) -> int:
        return self.size[0] * self.size[1]

    def settings(self, **given: Any) -> Settings:
        """Settings of this stage: its size and backend, one frame a second, no bounced light unless asked for."""
        mine = {"width": self.size[0], "height": self.size[1], "fps": 1.0, "indirect": "none"}
        return Settings.of(**(mine | given | {"backend": self.gpu.backend, "device": self.device}))

    def evaluate(
        self, scene: Scene, *, camera: CameraTrack | None = None, extra: Sequence[str] = (), **settings: Any
    ) -> tuple[Run, list[LitPair]]:
        """The whole evaluation of ``scene``, and every pair of it with its channels.  ``settings``: of Settings.

        ``extra``: channels besides those that the columns need.
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
