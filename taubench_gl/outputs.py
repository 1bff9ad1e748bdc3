"""Writing files so that readers never see half of one, and saying in one line why it did not work."""

from __future__ import annotations

import contextlib
import io
import os
from pathlib import Path

import numpy as np

from taubench_gl.errors import OutputError


def cannot_write(path: str | Path, error: OSError) -> OutputError:
    """The OutputError for a system error met while writing ``path``."""
    return OutputError(f"cannot be written: {error.strerror or error}", where=str(path))


def write_atomically(path: Path, data: str | bytes, *, parents: bool = False) -> None:
    """Write ``data`` (text as UTF-8) beside ``path`` and rename: readers see the old file or the new, whole.

    ``parents``: make the folder where there is none.  Raises OutputError.
    """
    partial = path.with_name(f".{path.name}.partial")
    try:
        if parents:
            path.parent.mkdir(parents=True, exist_ok=True)
        with open(partial, "wb") as file:
            file.write(data.encode("utf-8") if isinstance(data, str) else data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
    except OSError as error:
        with contextlib.suppress(OSError):  # where its folder is no folder either
            partial.unlink()
        raise cannot_write(path, error) from None


def write_png(path: Path, picture: np.ndarray) -> None:
    """(h, w, 3) uint8 as PNG, whole or not at all.  Raises OutputError."""
    import imageio.v3 as iio

    data = io.BytesIO()
    iio.imwrite(data, np.ascontiguousarray(picture), extension=".png")
    write_atomically(path, data.getvalue())
