"""``--input``: the kind of frames that methods get, as text and as a validated record."""

from __future__ import annotations

import re
from dataclasses import dataclass

from taubench_gl.errors import SettingsError
from taubench_gl.frame.shading import Shading
from taubench_gl.metrics.shading_rate import RATES
from taubench_gl.pathtraced.sequence import PREFIX, is_sequence

PARTIAL = RATES[1:]
WORDS = ("full", "jittered", "noisy", *PARTIAL)
PATH_TRACED = re.compile(r"path-traced(@[1-9][0-9]{0,5})?")


@dataclass(frozen=True, slots=True)
class InputKind:
    """How the radiance of a frame is computed.

    ``jitter``: sub-pixel offsets, Halton (2, 3); ``rate`` of ``metrics.shading_rate``; ``light_samples``,
    ``indirect_samples``: random lights and VPLs per pixel, 0: exact light; ``path_samples``: samples per pixel of
    path-traced light, 0: none; ``seed`` of the random numbers; ``files``: ``exr:DIR`` of path-traced frames, which
    excludes all other fields.
    """

    jitter: bool = False
    rate: str = "full"
    light_samples: int = 0
    indirect_samples: int = 0
    path_samples: int = 0
    seed: int = 0
    files: str | None = None

    @property
    def noisy(self) -> bool:
        return self.light_samples > 0

    @property
    def exact(self) -> bool:
        """Whether all pixels are noise-free and sampled at their centers."""
        noiseless = not self.noisy and not self.path_samples and self.files is None
        return not self.jitter and self.rate == "full" and noiseless

    @property
    def text(self) -> str:
        """The text for ``parse_input``."""
        if self.files is not None:
            return self.files
        words = ["noisy"] * self.noisy + ([f"path-traced@{self.path_samples}"] if self.path_samples else [])
        words += ([self.rate] if self.rate != "full" else []) + ["jittered"] * self.jitter
        return "+".join(words) or "full"

    def shading(self) -> Shading:
        """The shading parameters of the renderer."""
        return Shading(self.rate, self.light_samples, self.indirect_samples, self.seed, gather_each=self.noisy)


def parse_input(text: str, *, light_samples: int = 1, indirect_samples: int = 4, seed: int = 0) -> InputKind:
    """``full``, ``exr:DIR``, or some of ``jittered noisy path-traced@N half checkerboard quarter`` joined by ``+``.

    ``light_samples`` and ``indirect_samples`` apply to ``noisy``; ``path-traced`` alone has one sample per pixel.
    Raises SettingsError.
    """
    if is_sequence(text):
        if "+" in text and text.removeprefix(PREFIX).rpartition("+")[2] in WORDS:
            raise SettingsError(f"input {text!r} combines files with another kind", hint="give exr:DIR alone")
        return InputKind(files=text)
    words = [word.strip() for word in text.split("+")]
    traced = [word for word in words if PATH_TRACED.fullmatch(word)]
    for word in words:
        if word not in WORDS and word not in traced:
            hint = f"choose from {', '.join(WORDS)}, path-traced@N, joined by +, or exr:DIR"
            raise SettingsError(f"there is no input kind {word!r}", hint=hint)
    if len(set(words)) < len(words) or ("full" in words and len(words) > 1):
        raise SettingsError(f"input {text!r} is contradictory", hint="give each word once, and full alone")
    rates = [word for word in words if word in PARTIAL]
    if len(rates) > 1:
        raise SettingsError(f"input {text!r} has two shading rates", hint=f"give one of {', '.join(rates)}")
    noisy = "noisy" in words
    if len(traced) > 1 or (traced and (noisy or rates)):
        raise SettingsError(f"input {text!r} is contradictory", hint="path-traced@N goes with jittered alone")
    if noisy and min(light_samples, indirect_samples) < 1:
        raise SettingsError("noisy light needs at least one light sample and one VPL sample")
    kind = InputKind(
        jitter="jittered" in words,
        rate=rates[0] if rates else "full",
        light_samples=light_samples if noisy else 0,
        indirect_samples=indirect_samples if noisy else 0,
        path_samples=int(traced[0].partition("@")[2] or 1) if traced else 0,
        seed=seed,
    )
    kind.shading()  # checks the numbers
    return kind
