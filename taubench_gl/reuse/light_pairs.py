"""Light of frames as reuse methods get it, with several seeds, and the reference that they are compared with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from taubench_gl.errors import SettingsError
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import Gpu
from taubench_gl.option_groups import TrainingOptions
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.reuse.evaluate import EvaluationRequest
from taubench_gl.reuse.input_kind import InputKind
from taubench_gl.reuse.inputs import FrameRequest, RasterInputs
from taubench_gl.reuse.references import FITTED, PathTracedReference, SupersampledReference, reference_samples
from taubench_gl.settings import Settings

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class LightPair:
    """One image of a frame: the seed, ``radiance`` (h, w, 4) as methods get it, and the channels asked for by name."""

    seed: int
    radiance: Array
    channels: dict[str, Array]


def input_kind(options: TrainingOptions, seed: int) -> InputKind | None:
    """The input of ``options``, whose first random numbers are those of ``seed``; None: none is wanted.

    Raises SettingsError for an input or a reference that a scene's frames do not have.
    """
    fields = {name: getattr(options, name) for name in ("light_samples", "vpl_samples", "seeds")}
    fields |= {name: text for name in ("input", "reference") if (text := getattr(options, name)) is not None}
    if options.input is None and options.reference is not None:
        fields["input"] = "path-traced@1" if reference_samples(options.reference) else "full"
    request = EvaluationRequest(**fields, metrics=())
    request.check(seed)
    for text in (options.input, options.reference):
        if text is not None and is_sequence(text):
            raise SettingsError(f"{text!r} is made of files already", hint="give light that is rendered")
    if options.reference == FITTED:
        message = "how many samples fit a time depends on the machine"
        raise SettingsError(message, hint="give path-traced@M with M samples per pixel")
    return None if options.input is None else request.kind(seed)


class LightPairs(GpuOwner):
    """Radiance of a scene's frames by the words of ``--input`` and the reference of ``--reference``.

    Equal bit for bit to what ``reuse evaluate`` gives to methods and compares them with, for equal words and seeds.
    ``reference``: None where none is wanted.
    """

    def __init__(
        self,
        gpu: Gpu,
        animated: AnimatedScene,
        settings: Settings,
        options: TrainingOptions,
        channels: tuple[str, ...] = (),
    ):
        """Open inputs and reference.  Raises SettingsError.

        ``settings``: resolved for all columns; ``channels``: names of the channels to read with every image.
        """
        super().__init__(gpu)
        seed = settings.lighting.seed
        kind = input_kind(options, seed)
        request = FrameRequest(
            gpu, animated.scene, animated.camera, settings, kind or InputKind(seed=seed), animated.poser
        )
        self._seeds, self._channels = range(seed, seed + options.seeds), channels
        with self.opening():
            self.inputs = None if kind is None else self.own(RasterInputs(request, (), extra=channels))
            self.reference: PathTracedReference | SupersampledReference | None = None
            if options.reference is not None:
                samples = reference_samples(options.reference)
                supersampled = SupersampledReference(request, options.reference_samples) if samples is None else None
                self.reference = self.own(supersampled or PathTracedReference(request, samples))

    def images(self, frame: int) -> Iterator[LightPair]:
        """The images of ``frame`` with every seed; none where no input is wanted."""
        if self.inputs is None:
            return
        self.inputs.advance(frame)
        source = self.inputs.source
        for seed in self._seeds:
            radiance = self.inputs.radiance(frame, seed)
            yield LightPair(seed, radiance, {n: source.read(n) for n in self._channels if n in source.channels})

    def clean(self, frame: int) -> Array | None:
        """The reference of ``frame``: linear radiance x exposure, (h, w, 4) float32; the last is 1 where finite."""
        if self.reference is None:
            return None
        image = self.reference.image(frame).radiance
        return np.concatenate([image, np.isfinite(image).all(axis=-1, keepdims=True)], axis=-1, dtype=np.float32)
