"""Path-traced frames to hold the rasterizer's picture against."""

from __future__ import annotations

import moderngl

from taubench_gl.errors import SettingsError, TaubenchError
from taubench_gl.viewer.feeds import PathTracedFeed


class PathTracedComparison:
    """Frame n of the scene against the files' frame n, or n + 1 where those count from 1."""

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
