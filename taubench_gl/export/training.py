"""Training pairs: the light of a few samples that reuse methods get, with several seeds, and what it converges to."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from taubench_gl.errors import SettingsError
from taubench_gl.export.channels import PATH_INFO, RADIANCE_OF_ALL, clean_name, noisy_name
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import Gpu
from taubench_gl.option_groups import TrainingOptions
from taubench_gl.pathtraced.references import LOBES, reference_lobes
from taubench_gl.reuse.inputs import sample_offset
from taubench_gl.reuse.light_pairs import LightPairs, input_kind
from taubench_gl.reuse.references import PathTracedReference, reference_samples
from taubench_gl.settings import Settings

Array = np.ndarray


def training_names(options: TrainingOptions, lobes: tuple[str, ...] = LOBES) -> tuple[str, ...]:
    """Channels in order: the reference and its ``lobes``, then radiance, lobes and ``path_info`` of each seed."""
    kind, clean = input_kind(options, 0) if options.wanted else None, []
    if options.reference is not None:
        clean = [RADIANCE_OF_ALL, *(lobes if reference_samples(options.reference) else ())]
    noisy = () if kind is None else (RADIANCE_OF_ALL, *((*lobes, PATH_INFO) if kind.path_samples else ()))
    seeds = range(options.seeds)
    return (*map(clean_name, clean), *(noisy_name(k, name) for k in seeds for name in noisy))


def require_same_pixels(options: TrainingOptions, jitter: str) -> None:
    """Raises SettingsError for an input whose pixels are not those of the other channels.

    ``jitter``: as in ``ExportOptions``.
    """
    kind = input_kind(options, 0)
    if kind is None:
        return
    if kind.upscale != 1:
        raise SettingsError("the channels of an export have one size", hint="leave upscale@S out, and give its --size")
    if kind.jitter and kind.rate != "full":
        hint = "leave jittered out, or the shading rate"
        raise SettingsError("a partly shaded input has one offset for several frames", hint=hint)
    if kind.jitter != (jitter == "halton"):
        hint = "give jittered in --input and --jitter halton, or neither"
        raise SettingsError("the input and the other channels have different offsets", hint=hint)


def input_pixels(options: TrainingOptions, settings: Settings) -> tuple[Settings, Callable[[int], Array] | str]:
    """``settings`` with the size of the input, and its offsets, as of ``FrameSource``.  Raises SettingsError."""
    kind = input_kind(options, 0)
    width, height = kind.input_size((settings.sequence.width, settings.sequence.height))
    return settings.replace(width=width, height=height), sample_offset(kind) or "none"


class TrainingLight(LightPairs):
    """Noisy and clean light of the frames of a scene, by the names of files."""

    def __init__(self, gpu: Gpu, animated: AnimatedScene, settings: Settings, options: TrainingOptions):
        """Open input and reference of ``options``.  ``settings``: resolved for all columns.  Raises SettingsError."""
        kind = input_kind(options, settings.lighting.seed)
        every = reference_lobes(animated.scene)
        lobes = every if kind is not None and kind.path_samples else ()
        super().__init__(gpu, animated, settings, options, (*lobes, *((PATH_INFO,) if lobes else ())))
        self.names, self._lobes = training_names(options, every), lobes

    def announce(self, frames: Iterable[int], announce: Callable[[str], None]) -> None:
        """Report how long the references of ``frames`` take, if any are to be traced."""
        if isinstance(self.reference, PathTracedReference):
            estimate = self.reference.references.estimate(frames)
            if estimate.seconds is not None:
                announce(estimate.text)

    def files(self, frame: int) -> dict[str, Array]:
        """Images of ``frame`` by ``training_names``: radiance and ``path_info`` (h, w, 4), lobes (h, w, 3)."""
        out: dict[str, Array] = {}
        if self.reference is not None:
            out[clean_name(RADIANCE_OF_ALL)] = self.clean(frame)
        if isinstance(self.reference, PathTracedReference):
            lobes = self.reference.references.frame(frame).lobes
            out |= {clean_name(lobe): values for lobe, values in lobes.items()}
        for number, image in enumerate(self.images(frame)):
            out[noisy_name(number, RADIANCE_OF_ALL)] = image.radiance
            if self._lobes:
                black = np.zeros((*image.radiance.shape[:2], 3), dtype=np.float32)
                out |= {noisy_name(number, lobe): image.channels.get(lobe, black)[..., :3] for lobe in self._lobes}
                out[noisy_name(number, PATH_INFO)] = image.channels[PATH_INFO]
        return {name: np.ascontiguousarray(values) for name, values in out.items()}

    def noise_note(self) -> str | None:
        """The noise of the clean light, once frames are traced."""
        if not isinstance(self.reference, PathTracedReference) or self.reference.references.worst_noise is None:
            return None
        references = self.reference.references
        samples, noise = references.samples, references.worst_noise.text
        return f"standard error of the clean light at {samples} samples, worst frame: {noise}"
