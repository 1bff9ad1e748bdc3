"""Provenance of a result: version, command, driver, clock and commit."""

from __future__ import annotations

import platform
import shlex
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any

from taubench_gl import __version__
from taubench_gl.conventions import DEFINITIONS
from taubench_gl.gpu.context import Gpu
from taubench_gl.paths import PACKAGE


def provenance(gpu: Gpu, clock: str) -> dict[str, Any]:
    """The ``provenance`` block of summary.json."""
    return {
        "version": __version__,
        "definitions": DEFINITIONS,
        "command": shlex.join(sys.argv),
        "backend": gpu.backend,
        "renderer": gpu.renderer,
        "driver": gpu.version,
        "clock": clock,
        "git": git_commit(),
        "python": platform.python_version(),
        "machine": platform.machine(),
    }


def combined(provenances: Sequence[Mapping[str, Any]], names: Iterable[str]) -> dict[str, str]:
    """Entries of several blocks: where they differ, every value, sorted."""
    values_of = {name: sorted({str(provenance.get(name)) for provenance in provenances}) for name in names}
    return {name: " + ".join(values) for name, values in values_of.items()}


@lru_cache(maxsize=1)
def git_commit() -> str | None:
    """Commit of the checkout that the package runs from, ``+`` appended if modified; None for an installed wheel."""
    if not (PACKAGE.parent / ".git").exists():
        return None
    try:
        head = _git("rev-parse", "--short=12", "HEAD")
        return head + ("+" if _git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.SubprocessError):
        return None


def _git(*arguments: str) -> str:
    result = subprocess.run(
        ["git", "-C", str(PACKAGE.parent), *arguments], capture_output=True, text=True, timeout=10, check=True
    )
    return result.stdout.strip()
