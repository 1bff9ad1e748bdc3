"""Refusing in one line what would otherwise exhaust the machine."""

from __future__ import annotations

from pathlib import Path

from taubench_gl.errors import GraphicsError
from taubench_gl.gpu.context import Gpu

SHARE = 0.8
"""Of what is free: the rest is for the driver, the scene and everybody else."""


def available_bytes() -> int | None:
    """Memory a program may still take without swapping, or None where the system does not say."""
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        pass
    return None


def require_memory(gpu: Gpu, needed: int, what: str, hint: str) -> None:
    """Raise GraphicsError if ``needed`` bytes for ``what`` are not there.

    Known for software rendering alone, whose textures are the machine's own memory; a GPU says so when it allocates.
    """
    free = available_bytes() if gpu.software else None
    if free is not None and needed > SHARE * free:
        raise GraphicsError(f"{what} needs {needed / 1e9:.1f} GB, {free / 1e9:.1f} GB are free", hint=hint)
