"""``--input``: the kind of frames that methods get, as text and as a validated record."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction

from taubench_gl.errors import SettingsError
from taubench_gl.frame.shading import Shading
from taubench_gl.metrics.shading_rate import RATES
from taubench_gl.option_groups import ReuseOptions
from taubench_gl.pathtraced.sequence import PREFIX, is_sequence

DEFAULT = ReuseOptions()
PARTIAL = RATES[1:]
WORDS = ("full", "jittered", "noisy", *PARTIAL)
ALL_LIGHTS = "all-lights"
UPSCALE = re.compile(r"upscale@([0-9]+(?:\.[0-9]{1,3})?)")
MAX_UPSCALE = 4
PATH_TRACED = re.compile(r"path-traced(@[1-9][0-9]{0,5})?")


@dataclass(frozen=True, slots=True)
class InputKind:
    """How the radiance of a frame is computed.

    ``jitter``: sub-pixel offsets, Halton (2, 3); ``rate`` of ``metrics.shading_rate``; ``light_samples``,
    ``indirect_samples``: random lights and VPLs per pixel, 0: exact light; ``path_samples``: samples per pixel of
    path-traced light, 0: none; ``all_lights``: its samples of a visible surface take the light of every punctual light
    where these are few, without noise, instead of one at random; ``seed`` of the random numbers; ``files``: ``exr:DIR``
    of path-traced frames, which excludes all other fields; ``upscale``: pixels of the output along a side of an input
    pixel.
    """

    jitter: bool = False
    rate: str = "full"
    light_samples: int = 0
    indirect_samples: int = 0
    path_samples: int = 0
    all_lights: bool = False
    seed: int = 0
    files: str | None = None
    upscale: Fraction = Fraction(1)

    @property
    def noisy(self) -> bool:
        return self.light_samples > 0

    @property
    def exact(self) -> bool:
        """Whether all pixels are noise-free and sampled at their centers."""
        noiseless = not self.noisy and not self.path_samples and self.files is None
        return not self.jitter and self.rate == "full" and self.upscale == 1 and noiseless

    @property
    def samples(self) -> int:
        """Samples of light in a shaded pixel."""
        return self.path_samples or self.light_samples or 1

    @property
    def jitter_period(self) -> int:
        """Frames after which the offsets repeat: 8 in every output pixel (AMD, FidelityFX Super Resolution 2)."""
        return math.ceil(8 * self.upscale**2)

    def input_size(self, size: tuple[int, int]) -> tuple[int, int]:
        """Pixels of the input for an output of ``size``.  Raises SettingsError where they are no whole number."""
        exact = [Fraction(n) / self.upscale for n in size]
        if any(n.denominator != 1 for n in exact):
            message = f"{size[0]}x{size[1]} is not {float(self.upscale):g} times a size in whole pixels"
            raise SettingsError(
                message, hint=f"give a --size whose width and height are multiples of {self.upscale.numerator}"
            )
        return int(exact[0]), int(exact[1])

    @property
    def text(self) -> str:
        """The text that ``parse_input`` reads as this kind."""
        if self.files is not None:
            return self.files
        words = ["noisy"] * self.noisy + ([f"path-traced@{self.path_samples}"] if self.path_samples else [])
        words += [ALL_LIGHTS] * self.all_lights
        words += ([self.rate] if self.rate != "full" else []) + ["jittered"] * self.jitter
        words += [f"upscale@{float(self.upscale):g}"] if self.upscale != 1 else []
        return "+".join(words) or "full"

    def shading(self) -> Shading:
        """The shading parameters of the renderer."""
        one_light = self.path_samples > 0 and not self.all_lights
        samples = self.light_samples, self.indirect_samples
        return Shading(self.rate, *samples, self.seed, gather_each=self.noisy, one_light=one_light)


def parse_input(
    text: str,
    *,
    light_samples: int = DEFAULT.light_samples,
    indirect_samples: int = DEFAULT.vpl_samples,
    seed: int = 0,
) -> InputKind:
    """The kind of frames that a text of ``--input`` names: ``full``, ``exr:DIR``, or words joined by ``+``.

    Words: ``jittered noisy path-traced@N all-lights half checkerboard quarter upscale@S``.

    ``light_samples`` and ``indirect_samples`` apply to ``noisy``; ``path-traced`` alone has one sample per pixel.
    Raises SettingsError.
    """
    if is_sequence(text):
        last = text.removeprefix(PREFIX).rpartition("+")[2] if "+" in text else ""
        if last in (*WORDS, ALL_LIGHTS) or UPSCALE.fullmatch(last) or PATH_TRACED.fullmatch(last):
            raise SettingsError(f"input {text!r} combines files with another kind", hint="give exr:DIR alone")
        return InputKind(files=text)
    words = [word.strip() for word in text.split("+")]
    traced = [word for word in words if PATH_TRACED.fullmatch(word)]
    scales = [word for word in words if UPSCALE.fullmatch(word)]
    for word in words:
        if word not in (*WORDS, ALL_LIGHTS, *traced, *scales):
            hint = f"choose from {', '.join(WORDS)}, path-traced@N, {ALL_LIGHTS}, upscale@S, joined by +, or exr:DIR"
            raise SettingsError(f"there is no input kind {word!r}", hint=hint)
    scale = Fraction(scales[0].partition("@")[2]) if scales else Fraction(1)
    if len(scales) > 1 or (scales and not 1 < scale <= MAX_UPSCALE):
        raise SettingsError(f"input {text!r} has no factor of upscaling", hint=f"above 1, at most {MAX_UPSCALE}, once")
    if len(set(words)) < len(words) or ("full" in words and len(words) - len(scales) > 1):
        raise SettingsError(f"input {text!r} is contradictory", hint="give each word once, and full alone")
    rates = [word for word in words if word in PARTIAL]
    if len(rates) > 1:
        raise SettingsError(f"input {text!r} has two shading rates", hint=f"give one of {', '.join(rates)}")
    noisy = "noisy" in words
    if len(traced) > 1 or (traced and (noisy or rates)):
        hint = "path-traced@N goes with all-lights, jittered and upscale@S"
        raise SettingsError(f"input {text!r} is contradictory", hint=hint)
    if ALL_LIGHTS in words and not traced:
        raise SettingsError(f"input {text!r} is contradictory", hint=f"{ALL_LIGHTS} goes with path-traced@N")
    if noisy and min(light_samples, indirect_samples) < 1:
        raise SettingsError("noisy light needs at least one light sample and one VPL sample")
    kind = InputKind(
        jitter="jittered" in words,
        rate=rates[0] if rates else "full",
        light_samples=light_samples if noisy else 0,
        indirect_samples=indirect_samples if noisy else 0,
        path_samples=int(traced[0].partition("@")[2] or 1) if traced else 0,
        all_lights=ALL_LIGHTS in words,
        seed=seed,
        upscale=scale,
    )
    kind.shading()  # checks the numbers
    return kind
