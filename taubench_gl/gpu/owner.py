"""Owners: parts that are made on a GPU context and freed together."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any, Protocol, TypeVar


class Releasable(Protocol):
    def release(self) -> None: ...


Part = TypeVar("Part", bound=Releasable | None)


class Owner:
    """Frees the parts that it owns, the last first, with ``release`` or at the end of its with block.

    It can be used again.
    """

    def __init__(self) -> None:
        self._parts: list[Releasable] = []

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *exc: Any) -> None:
        self.release()

    def own(self, part: Part, *, instead_of: Releasable | None = None) -> Part:
        """``part``, owned from now on; ``instead_of``: a part that it replaces, which is freed."""
        if part is not None:
            self._parts.append(part)
        self.free_parts(instead_of)
        return part

    def free_parts(self, *parts: Releasable | None) -> None:
        """Free these parts now, and own them no longer; None is no part."""
        for part in parts:
            if part is not None:
                self._parts = [other for other in self._parts if other is not part]
                part.release()

    @contextlib.contextmanager
    def opening(self) -> Iterator[Any]:
        """Frees everything if the block raises: for what opens several parts."""
        try:
            yield self
        except BaseException:
            self.release()
            raise

    def release(self) -> None:
        while self._parts:
            self._parts.pop().release()
