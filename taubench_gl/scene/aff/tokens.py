"""The words of one AFF file, each knowing its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from taubench_gl.errors import SceneError
from taubench_gl.scene.beside import read_bytes

Array = np.ndarray

LARGEST = 1e30
"""Magnitude above which a number cannot be meant; squares of what is below still fit a float64, values a float32."""


class Tokens:
    """Whitespace-separated words; ``#`` and ``%`` comment to the end of the line; braces stand for themselves."""

    def __init__(self, path: Path, data: bytes):
        self.path = path
        self.words: list[str] = []
        ends = []
        text = data.decode("utf-8", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
        for line in text.split("\n"):
            line = line.partition("#")[0].partition("%")[0]
            if "{" in line or "}" in line:
                line = line.replace("{", " { ").replace("}", " } ")
            self.words += line.split()
            ends.append(len(self.words))
        self._ends = np.array(ends, dtype=np.int64)
        self.at = 0

    def line(self, at: int | None = None) -> int:
        """Line number, from 1, of word ``at``; by default of the word read last."""
        at = max(self.at - 1, 0) if at is None else min(at, max(len(self.words) - 1, 0))
        return int(np.searchsorted(self._ends, at, side="right")) + 1

    def where(self, at: int | None = None) -> str:
        return f"{self.path.name}:{self.line(at)}"

    def error(self, what: str, hint: str | None = None, at: int | None = None) -> SceneError:
        """A SceneError that names file and line.  Returned, so that the caller raises it."""
        return SceneError(what, where=self.where(at), hint=hint)

    def done(self) -> bool:
        return self.at >= len(self.words)

    def word(self, what: str) -> str:
        if self.done():
            raise self.error(f"the file ends where {what} should follow", "is it cut off?")
        self.at += 1
        return self.words[self.at - 1]

    def expect(self, word: str, what: str) -> None:
        found = self.word(f"{word!r} of {what}")
        if found != word:
            raise self.error(f"{_short(found)} instead of {word!r} in {what}")

    def number_follows(self) -> bool:
        if self.done():
            return False
        try:
            float(self.words[self.at])
        except ValueError:
            return False
        return True

    def floats(self, count: int, what: str) -> Array:
        """The next ``count`` words as numbers.  (count,) float64, finite."""
        taken = self.words[self.at : self.at + count]
        if len(taken) < count:
            raise self.error(f"{what} needs {count} numbers, the file has {len(taken)} more words", "is it cut off?")
        try:
            out = np.fromiter(map(float, taken), dtype=np.float64, count=count)
        except ValueError:
            for i, word in enumerate(taken):
                try:
                    float(word)
                except ValueError:
                    raise self.error(f"{_short(word)} where {what} needs a number", at=self.at + i) from None
            raise
        bad = ~(np.abs(out) < LARGEST)
        if np.any(bad):
            i = int(np.argmax(bad))
            raise self.error(f"{_short(taken[i])} in {what} is not a usable number", at=self.at + i)
        self.at += count
        return out

    def table(self, rows: int, columns: int, what: str) -> Array:
        """(rows, columns) float64."""
        return self.floats(rows * columns, what).reshape(rows, columns)

    def integer(self, what: str, low: int, high: int) -> int:
        word = self.word(what)
        try:
            value = int(word)
        except ValueError:
            raise self.error(f"{_short(word)} where {what} should be a whole number") from None
        if not low <= value <= high:
            raise self.error(f"{what} is {_short(word)}, must lie in {low}..{high}")
        return value

    def indices(self, rows: int, columns: int, what: str) -> Array:
        """(rows, columns) int64."""
        start = self.at
        values = self.floats(rows * columns, what)
        bad = values != np.floor(values)
        if np.any(bad):
            at = start + int(np.argmax(bad))
            raise self.error(f"{_short(self.words[at])} where {what} needs a whole number", at=at)
        return np.clip(values, -(2.0**53), 2.0**53).astype(np.int64).reshape(rows, columns)


def read_tokens(path: Path, where: str | None = None) -> tuple[Tokens, bytes]:
    """Words and raw bytes of one file.  Raises SceneError."""
    data = read_bytes(path, where)
    return Tokens(path, data), data


def _short(word: str) -> str:
    return repr(word if len(word) <= 40 else word[:37] + "...")
