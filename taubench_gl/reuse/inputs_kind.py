"""``--input``: what a method is given to reuse, as text and as a checked record."""

from __future__ import annotations

from dataclasses import dataclass

from taubench_gl.errors import SettingsError
from taubench_gl.frame.shading import Shading
from taubench_gl.metrics.shading_rate import RATES
from taubench_gl.pathtraced.sequence import PREFIX, is_sequence

PARTIAL = RATES[1:]
WORDS = ("full", "jittered", "noisy", *PARTIAL)


@dataclass(frozen=True, slots=True)
class InputKind:
    """What the radiance of a frame is made of.

    ``jitter``: samples off the pixel centres, Halton (2, 3); ``rate`` of ``metrics.shading_rate``; ``light_samples``,
    ``indirect_samples``: lights and virtual lights drawn at random per pixel, 0: exact light; ``seed`` of the random
    numbers; ``files``: ``exr:DIR`` of path-traced frames instead, which excludes all the others.
    """

    jitter: bool = False
    rate: str = "full"
    light_samples: int = 0
    indirect_samples: int = 0
    seed: int = 0
    files: str | None = None

    @property
    def noisy(self) -> bool:
        return self.light_samples > 0

    @property
    def exact(self) -> bool:
        """Whether this is the noise-free picture itself, every pixel of it, at its centre."""
        return not self.jitter and self.rate == "full" and not self.noisy and self.files is None

    @property
    def text(self) -> str:
        """As ``parse_input`` reads it."""
        if self.files is not None:
            return self.files
        words = ["noisy"] * self.noisy + ([self.rate] if self.rate != "full" else []) + ["jittered"] * self.jitter
        return "+".join(words) or "full"

    def shading(self) -> Shading:
        """What the light stage is told."""
        return Shading(self.rate, self.light_samples, self.indirect_samples, self.seed, gather_each=self.noisy)


def parse_input(text: str, *, light_samples: int = 1, indirect_samples: int = 4, seed: int = 0) -> InputKind:
    """``full``, ``exr:DIR``, or some of ``jittered noisy half checkerboard quarter`` joined by ``+``.

    The numbers count for ``noisy`` alone.  Raises SettingsError.
    """
    if is_sequence(text):
        if "+" in text and text.removeprefix(PREFIX).rpartition("+")[2] in WORDS:
            raise SettingsError(f"input {text!r} adds to files", hint="what the files hold cannot be shaded otherwise")
        return InputKind(files=text)
    words = [word.strip() for word in text.split("+")]
    for word in words:
        if word not in WORDS:
            hint = f"choose from {', '.join(WORDS)}, joined by +, or exr:DIR"
            raise SettingsError(f"no input is named {word!r}", hint=hint)
    if len(set(words)) < len(words) or ("full" in words and len(words) > 1):
        raise SettingsError(f"input {text!r} contradicts itself", hint="name each once, and full alone")
    rates = [word for word in words if word in PARTIAL]
    if len(rates) > 1:
        raise SettingsError(f"input {text!r} has two shading rates", hint=f"give one of {', '.join(rates)}")
    noisy = "noisy" in words
    if noisy and min(light_samples, indirect_samples) < 1:
        raise SettingsError("noisy light needs at least one sample of lights and of virtual lights")
    kind = InputKind(
        jitter="jittered" in words,
        rate=rates[0] if rates else "full",
        light_samples=light_samples if noisy else 0,
        indirect_samples=indirect_samples if noisy else 0,
        seed=seed,
    )
    kind.shading()  # its numbers are checked there
    return kind
