"""Refuses allocations that would exhaust the memory of the machine."""

from __future__ import annotations

from taubench_gl.data_files import read_text
from taubench_gl.errors import GraphicsError, OutputError
from taubench_gl.gpu.context import Gpu

SHARE = 0.8
"""Share of free memory that may be used; the rest is for the driver, the scene and other programs."""


def available_bytes() -> int | None:
    """Memory a program can still use without swapping; None where the system does not report it."""
    try:
        for line in read_text("/proc/meminfo").splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except (OutputError, ValueError, IndexError):
        pass
    return None


def require_memory(gpu: Gpu, needed: int, what: str, hint: str) -> None:
    """Raise GraphicsError if ``needed`` bytes for ``what`` are not available.

    Checked for software rendering only, whose textures are in the memory of the machine; a GPU fails when it allocates.
    """
    free = available_bytes() if gpu.software else None
    if free is not None and needed > SHARE * free:
        raise GraphicsError(f"{what} needs {needed / 1e9:.1f} GB, {free / 1e9:.1f} GB are free", hint=hint)
