"""Training pairs: path-traced light of a few samples, with several seeds, and the light it converges to, per lobe."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from taubench_gl.effects.path_tracing import traced_sources
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.export.channels import PATH_INFO, clean_name, noisy_name
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.option_groups import TrainingOptions
from taubench_gl.pathtraced.references import LOBES, References, path_settings
from taubench_gl.settings import Settings

Array = np.ndarray

SEED_STEP = 1 << 24
"""Difference of the frame numbers of two seeds' sample patterns: more than a sequence has frames."""


def training_names(options: TrainingOptions) -> tuple[str, ...]:
    """Channels in order: clean lobes, then the lobes and ``path_info`` of each seed."""
    clean = [clean_name(lobe) for lobe in LOBES] if options.reference_spp else []
    seeds = range(options.seeds if options.noisy_spp else 0)
    return (*clean, *(noisy_name(k, name) for k in seeds for name in (*LOBES, PATH_INFO)))


class TrainingLight:
    """Noisy and clean light of the frames of a scene."""

    def __init__(self, owner: GpuOwner, animated: AnimatedScene, settings: Settings, options: TrainingOptions):
        """``owner``: frees it; ``settings``: resolved.  Raises SettingsError where nothing lights the scene."""
        self._options, self._references, self._noisy = options, None, None
        if not traced_sources(animated.scene, path_settings(settings)):
            raise SettingsError("no light to trace paths to", hint="give an --environment, or a scene with lights")
        if options.reference_spp:
            self._references = References.open(owner, animated, settings, options.reference_spp)
        if options.noisy_spp:
            noisy = path_settings(settings).replace(spp=options.noisy_spp)
            self._noisy = owner.open_source(animated, noisy, extra=(*LOBES, PATH_INFO))

    def announce(self, frames: Iterable[int], announce: Callable[[str], None]) -> None:
        """Report how long the references of ``frames`` take, if any are to be traced."""
        if self._references is not None:
            estimate = self._references.estimate(frames)
            if estimate.seconds is not None:
                announce(estimate.text)

    def channels(self, frame: int) -> dict[str, Array]:
        """By the names of ``training_names``: (h, w, 3), ``path_info`` (h, w, 4)."""
        out: dict[str, Array] = {}
        if self._references is not None:
            lobes = self._references.frame(frame).lobes
            out |= {clean_name(lobe): values for lobe, values in lobes.items()}
        if self._noisy is not None:
            self._noisy.draw(frame)
            for seed in range(self._options.seeds):
                self._noisy.trace(frame + seed * SEED_STEP, 0, self._options.noisy_spp)
                out |= {noisy_name(seed, lobe): self._lobe(lobe) for lobe in LOBES}
                out[noisy_name(seed, PATH_INFO)] = self._noisy.read(PATH_INFO)
        return {name: np.ascontiguousarray(values) for name, values in out.items()}

    def _lobe(self, name: str) -> Array:
        if name in self._noisy.channels:
            return self._noisy.read(name)[..., :3]
        width, height = self._noisy.size
        return np.zeros((height, width, 3), dtype=np.float32)

    def noise_note(self) -> str | None:
        """The noise of the clean light, once frames are traced."""
        noise = None if self._references is None else self._references.worst_noise
        if noise is None:
            return None
        return f"standard error of the clean light at {self._options.reference_spp} samples, worst frame: {noise.text}"
