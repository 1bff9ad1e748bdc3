"""How much memory a process may fill with the content of files, and the sum that is checked before it is allocated.

A few kilobytes can declare gigabytes: instances, primitives that share one list of indices, images.  Readers add up
what the headers declare and refuse it in one line, before any of it exists.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
from functools import cache
from pathlib import Path

from taubench_gl.errors import SettingsError, TaubenchError

VARIABLE = "TAUBENCH_MAX_MEMORY"
"""Environment variable with the limit of each process, such as ``4GiB``; the option --max-memory sets it."""

LARGE_BLOCK = 4 << 20
"""Bytes from which a freed block goes back to the system at once (``return_freed``)."""

IMAGE_BLOCK = 32 << 20
"""``LARGE_BLOCK`` while images are decoded: the system clears what it gives again, which takes as long as decoding."""

_TEXT = re.compile(r"([0-9]{1,15}(?:\.[0-9]{1,6})?)\s*(?:([KMGT])(i?)B?|B)?", re.IGNORECASE)
_LEAST = 1 << 20


def parse_bytes(text: str) -> int:
    """``4GiB``, ``4GB``, ``4G`` (binary) or ``4294967296`` -> bytes.  Raises SettingsError."""
    parts = _TEXT.fullmatch(text.strip())
    if parts is not None:
        unit = " KMGT".index((parts[2] or " ").upper())
        value = float(parts[1]) * (1000 if parts[2] and not parts[3] and text.strip()[-1] in "bB" else 1024) ** unit
        if _LEAST <= value < 2**62:
            return int(value)
    raise SettingsError(f"max memory is {text!r:.60}", hint="give a size of at least 1MiB, such as 4GiB")


def limit() -> int:
    """Bytes that this process may fill with the content of files: ``VARIABLE``, else ``machine_bytes``.

    Raises SettingsError for a value that is no size.
    """
    size = os.environ.get(VARIABLE, "")
    return parse_bytes(size) if size else machine_bytes()


def require(count: int, subject: str, fault: type[TaubenchError], where: str, hint: str | None = None) -> None:
    """Raises ``fault`` if ``subject`` takes more than ``limit`` bytes."""
    if count > (most := limit()):
        raise fault(f"{subject} would take {shown_bytes(count)} of memory", where=where, hint=hint or over(most))


def over(most: int) -> str:
    """The hint of an error about more than ``most`` bytes."""
    return f"the limit is {shown_bytes(most)}; raise it with --max-memory or {VARIABLE}"


class Budget:
    """The sum of what the objects of one scene take: ``bytes`` by kind, such as images."""

    def __init__(self) -> None:
        self.limit = limit()
        self.bytes: dict[str, int] = {}

    @property
    def total(self) -> int:
        return sum(self.bytes.values())

    def add(self, kind: str, count: int) -> str | None:
        """Add bytes that are about to be allocated.  -> a message, where they do not fit; else None."""
        self.bytes[kind] = self.bytes.get(kind, 0) + count
        if self.total <= self.limit:
            return None
        largest = sorted(self.bytes.items(), key=lambda part: -part[1])
        parts = ", ".join(f"{name} {shown_bytes(n)}" for name, n in largest if n)
        return f"with it the scene would take {shown_bytes(self.total)} of memory ({parts})"


def shown_bytes(count: int) -> str:
    """A number of bytes for messages: 12 KiB, 1.5 GiB."""
    unit = max((u for u in range(4) if count >= 1024**u), default=0)
    return f"{count / 1024**unit:.4g} {('bytes', 'KiB', 'MiB', 'GiB')[unit]}"


def return_freed(large: int = LARGE_BLOCK) -> None:
    """Make the C library return freed memory to the system, and from now on blocks of at least ``large`` bytes at once.

    glibc otherwise keeps blocks of up to 32 MiB for later ones of the thread: 70 MB of each that decodes images.
    """
    with contextlib.suppress(AttributeError, OSError):  # a C library without it
        library = ctypes.CDLL(None)
        library.mallopt(-3, large)  # M_MMAP_THRESHOLD
        library.mallopt(-1, 8 * large)  # M_TRIM_THRESHOLD; 128 KiB would clear pages again and again
        library.malloc_trim(0)


@cache
def machine_bytes() -> int:
    """Memory of the machine, or of the container (cgroup) that the process is in, whichever is less."""
    sizes = [os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")]
    for file in _limit_files():
        try:
            text = file.read_text(encoding="ascii").strip()
        except (OSError, ValueError):
            continue
        if text.isdigit() and int(text) > 0:
            sizes.append(int(text))
    return min(sizes)


def _limit_files(groups: Path = Path("/proc/self/cgroup"), root: Path = Path("/sys/fs/cgroup")) -> list[Path]:
    """Files with the limits of the process's control groups and of those around them, version 2 and version 1."""
    files = [root / "memory.max", root / "memory" / "memory.limit_in_bytes"]
    try:
        lines = groups.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return files
    for line in lines:
        _, controllers, path = [*line.split(":", 2), "", ""][:3]
        if controllers not in ("", "memory") or ".." in path.split("/"):
            continue
        base, name = (root, "memory.max") if not controllers else (root / "memory", "memory.limit_in_bytes")
        parts = [part for part in path.split("/") if part]
        files += [base.joinpath(*parts[:depth]) / name for depth in range(1, len(parts) + 1)]
    return files
