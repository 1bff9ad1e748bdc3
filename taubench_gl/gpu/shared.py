"""GPU objects that several sources of one context use: each is made once, and freed after its last user."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

Value = TypeVar("Value")


@dataclass(slots=True)
class Held(Generic[Value]):
    """One user's hold on a shared object; ``release`` ends it."""

    value: Value
    release: Callable[[], None]


@dataclass(slots=True)
class _Entry:
    of: object  # kept alive, so that its id stays its own
    value: Any
    users: int = 0


@dataclass(slots=True)
class Shared:
    """The shared objects of one OpenGL context."""

    _entries: dict[tuple[int, Hashable], _Entry] = field(default_factory=dict)
    _keepers: int = 0

    def has(self, of: object, kind: Hashable) -> bool:
        """Whether ``hold`` would make nothing."""
        return (id(of), kind) in self._entries

    def hold(self, of: object, kind: Hashable, make: Callable[[], Value]) -> Held[Value]:
        """The object of ``kind`` that belongs to ``of``, by identity; ``make`` makes it, with a method ``release``."""
        key = id(of), kind
        if key not in self._entries:
            self._entries[key] = _Entry(of, make())
        entry = self._entries[key]
        entry.users += 1
        return Held(entry.value, lambda: self._drop(key))

    @contextlib.contextmanager
    def kept(self) -> Iterator[None]:
        """In this block objects without a user stay: one source closes before the next opens."""
        self._keepers += 1
        try:
            yield
        finally:
            self._keepers -= 1
            for key in [key for key, entry in self._entries.items() if not entry.users]:
                self._free(key)

    def _drop(self, key: tuple[int, Hashable]) -> None:
        self._entries[key].users -= 1
        self._free(key)

    def _free(self, key: tuple[int, Hashable]) -> None:
        if not self._keepers and not self._entries[key].users:
            self._entries.pop(key).value.release()
