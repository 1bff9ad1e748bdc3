"""Memory barriers, issued only where something is read or written again that a pass wrote before."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import moderngl


# Bits of glMemoryBarrier.
ATTRIBUTES, FETCH, IMAGE_ACCESS, COMMAND, STORAGE = 0x1, 0x8, 0x20, 0x40, 0x2000
_TEXTURE_UPDATE, _BUFFER_UPDATE, _FRAMEBUFFER, _ALL = 0x100, 0x200, 0x400, 0xFFFFFFFF
_EVERY = ATTRIBUTES | FETCH | IMAGE_ACCESS | COMMAND | STORAGE | _TEXTURE_UPDATE | _BUFFER_UPDATE | _FRAMEBUFFER


class Hazards:
    """Follows of every texture and buffer which ways of reading it do not see the last write yet.

    Nothing sees what a shader stores before a barrier.  Everything but an image load sees what is drawn into an
    attachment; an image load needs a barrier on llvmpipe.
    """

    def __init__(self, ctx: moderngl.Context):
        self._ctx = ctx
        self._unseen: dict[tuple[type, int], int] = {}

    def wrote(self, resources: Iterable[Any], *, drawn: bool = False) -> None:
        """Note textures and buffers that the last pass stored into, or drew into if ``drawn``."""
        for resource in resources:
            key = type(resource), resource.glo
            self._unseen[key] = self._unseen.get(key, 0) | (IMAGE_ACCESS if drawn else _EVERY)

    def before(self, uses: Iterable[tuple[Any, int]]) -> None:
        """Issue the barrier that the next pass needs, if any.  ``uses``: (resource, barrier bit of the access)."""
        bits = 0
        for resource, way in uses:
            bits |= self._unseen.get((type(resource), resource.glo), 0) & way
        if bits:
            self._barrier(bits)

    def publish(self) -> None:
        """Make everything visible to readers that declare nothing: read-backs, other packages' passes."""
        if self._unseen:
            self._barrier(_ALL)

    def _barrier(self, bits: int) -> None:
        self._ctx.memory_barrier(bits)
        left = {key: ways & ~bits for key, ways in self._unseen.items()}
        self._unseen = {key: ways for key, ways in left.items() if ways}
