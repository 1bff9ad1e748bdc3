"""All channels of a scene at one time, in a handful of array operations.

A game capture has thousands of channels (32 armatures x 52 bones x 3 paths), so nothing here loops over channels once
the timeline is made.  It is derived data only: sampling changes nothing, and the result depends on (channels, t) alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from taubench_gl.animation import curves
from taubench_gl.scene.model import Channel

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class Track:
    """Channels of one target, path, interpolation and width, their keys laid end to end."""

    target: str  # node | camera | light
    path: str
    interpolation: str
    index: Array  # (C,) int64: which node, camera or light
    clock: Array  # (C,) int64: which distinct time array
    start: Array  # (C,) int64: first row of each channel in ``keys``
    keys: Array  # (sum K, n) or (sum K, 3, n) float64

    @property
    def rotation(self) -> bool:
        return self.target == "node" and self.path == "rotation"


class Timeline:
    """Channels prepared for sampling.

    Of several channels on one property the last one counts, as if they were applied in file order.  ``visible`` is
    always STEP: there is nothing between on and off.
    """

    def __init__(self, channels: Iterable[Channel]):
        last = {(c.target, c.index, c.path): c for c in channels}
        clocks: dict[bytes, int] = {}
        times: list[Array] = []
        groups: dict[tuple[str, str, str, int], list[tuple[Channel, Array, int]]] = {}
        for channel in last.values():
            own = np.ascontiguousarray(channel.times, dtype=np.float64)
            clock = clocks.setdefault(own.tobytes(), len(clocks))
            if clock == len(times):
                times.append(own)
            keys = curves.prepare_keys(channel)
            interpolation = channel.interpolation
            if channel.path == "visible":
                interpolation, keys = curves.STEP, keys[:, 1] if keys.ndim == 3 else keys
            name = (channel.target, channel.path, interpolation, keys.shape[-1])
            groups.setdefault(name, []).append((channel, keys, clock))
        self._times = np.concatenate(times) if times else np.zeros(0)
        self._count = np.array([len(t) for t in times], dtype=np.int64)
        self._start = np.cumsum(self._count) - self._count
        self.tracks = tuple(_track(name, members) for name, members in groups.items())

    def sample(self, t: float) -> list[tuple[Track, Array]]:
        """Each track with its channels' values at ``t`` seconds, (C, n) float64; equals ``curves.sample_channel``."""
        if not self.tracks:
            return []
        first, second, u, dt = self._segments(t)
        out = []
        for track in self.tracks:
            c = track.clock
            a, b = track.keys[track.start + first[c]], track.keys[track.start + second[c]]
            out.append((track, curves.interpolate(track.interpolation, track.rotation, a, b, u[c], dt[c])))
        return out

    def _segments(self, t: float) -> tuple[Array, Array, Array, Array]:
        """``curves.segment`` for every clock at once: (i, j, u, dt), each (clocks,).

        One binary search over all time arrays together: invariant ``times[low - 1] <= t < times[high]``.
        """
        low, high = np.zeros_like(self._count), self._count.copy()
        for _ in range(int(self._count.max()).bit_length()):
            middle = (low + high) >> 1
            open_ = low < high
            at_or_before = self._times[self._start + np.minimum(middle, self._count - 1)] <= t
            low = np.where(open_ & at_or_before, middle + 1, low)
            high = np.where(open_ & ~at_or_before, middle, high)
        key = low - 1
        inside = (key >= 0) & (key < self._count - 1)
        first = np.clip(key, 0, self._count - 1)
        second = np.where(inside, first + 1, first)
        t0, t1 = self._times[self._start + first], self._times[self._start + second]
        dt = t1 - t0
        u = np.where(inside, (t - t0) / np.where(inside, dt, 1.0), 0.0)
        return first, second, u, dt


def _track(name: tuple[str, str, str, int], members: list[tuple[Channel, Array, int]]) -> Track:
    target, path, interpolation, _ = name
    rows = np.array([len(keys) for _, keys, _ in members], dtype=np.int64)
    return Track(
        target=target,
        path=path,
        interpolation=interpolation,
        index=np.array([channel.index for channel, _, _ in members], dtype=np.int64),
        clock=np.array([clock for _, _, clock in members], dtype=np.int64),
        start=np.cumsum(rows) - rows,
        keys=np.concatenate([keys for _, keys, _ in members]),
    )
