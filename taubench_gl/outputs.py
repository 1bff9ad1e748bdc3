"""Writing files so that readers never see half of one, and saying in one line why it did not work."""

from __future__ import annotations

import os
from pathlib import Path

from taubench_gl.errors import OutputError


def cannot_write(path: str | Path, error: OSError) -> OutputError:
    """The OutputError for a system error met while writing ``path``."""
    return OutputError(f"cannot be written: {error.strerror or error}", where=str(path))


def write_atomically(path: Path, text: str) -> None:
    """Write ``text`` beside ``path`` and rename: readers see the old file or the new, whole.  Raises OutputError."""
    partial = path.with_name(f".{path.name}.partial")
    try:
        with open(partial, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise cannot_write(path, error) from None
