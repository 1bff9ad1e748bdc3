"""Memory barriers, issued only where something is read or written again that a pass wrote before."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import moderngl

IMAGE_ACCESS, FETCH = moderngl.SHADER_IMAGE_ACCESS_BARRIER_BIT, moderngl.TEXTURE_FETCH_BARRIER_BIT
STORAGE, ATTRIBUTES = moderngl.SHADER_STORAGE_BARRIER_BIT, moderngl.VERTEX_ATTRIB_ARRAY_BARRIER_BIT
UPDATE = moderngl.TEXTURE_UPDATE_BARRIER_BIT | moderngl.BUFFER_UPDATE_BARRIER_BIT
_EVERY = IMAGE_ACCESS | FETCH | STORAGE | ATTRIBUTES | UPDATE | moderngl.FRAMEBUFFER_BARRIER_BIT


class Hazards:
    """Follows of every texture and buffer which ways of reading it do not see the last write yet.

    Nothing sees what a shader stores before a barrier.  Everything but an image load sees what is drawn into an
    attachment; an image load needs a barrier on llvmpipe.
    """

    def __init__(self, ctx: moderngl.Context):
        self._ctx = ctx
        self._unseen: dict[tuple[type, int], int] = {}

    def wrote(self, resources: Iterable[Any], *, drawn: bool = False) -> None:
        """Textures and buffers that the last pass stored into, or drew into if ``drawn``."""
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
            self._barrier(moderngl.ALL_BARRIER_BITS)

    def _barrier(self, bits: int) -> None:
        self._ctx.memory_barrier(bits)
        left = {key: ways & ~bits for key, ways in self._unseen.items()}
        self._unseen = {key: ways for key, ways in left.items() if ways}
