"""Images that the viewer compares with its own."""

from __future__ import annotations

from typing import Protocol

import moderngl

from taubench_gl.errors import SettingsError, TaubenchError
from taubench_gl.gpu.context import Gpu
from taubench_gl.viewer.feeds import Feed, OpenRequest, PathTracedFeed


class Comparison(Protocol):
    """Images of other frames than those of the viewer: a reference, another run, the result of a reuse method."""

    name: str

    def texture(self, channel: str, frame: int) -> moderngl.Texture | None:
        """The same channel of the same frame in the size of the image; None if it has none."""

    def release(self) -> None: ...


def open_comparisons(gpu: Gpu, request: OpenRequest, feed: Feed) -> dict[str, Comparison]:
    """The comparisons that ``request`` names for the frames of ``feed``.  Raises TaubenchError."""
    found: dict[str, Comparison] = {}
    if request.reference is not None:
        settings = feed.settings.replace(frames=(None, None))
        reference = PathTracedFeed(gpu, request.reference, settings, request.options)
        found["reference"] = PathTracedComparison(reference, feed.size, feed.frames[0])
    return found


class PathTracedComparison:
    """Path-traced frames to compare with: frame n, or n + 1 if the files count from 1.  Raises SettingsError."""

    def __init__(self, feed: PathTracedFeed, size: tuple[int, int], first: int):
        if feed.size != size:
            got = "x".join(map(str, feed.size))
            feed.release()
            raise SettingsError(f"the reference is {got} pixels", hint=f"give --size {got}")
        self._feed, self.name = feed, "reference"
        self._offset = 1 if feed.frames[0] == 1 and first == 0 else 0
        self._read: int | None = None

    def texture(self, channel: str, frame: int) -> moderngl.Texture | None:
        number = frame + self._offset
        if channel not in self._feed.source.channels or number not in self._feed.frames:
            return None
        if number != self._read:
            try:
                self._feed.source.advance(number)
            except TaubenchError:
                return None
            self._read = number
        return self._feed.source.current[channel]

    def release(self) -> None:
        self._feed.release()
