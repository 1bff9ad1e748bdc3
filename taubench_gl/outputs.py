"""Writing files so that readers never see half of one, and saying in one line why it did not work."""

from __future__ import annotations

import contextlib
import io
import itertools
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from taubench_gl.errors import OutputError

_writes = itertools.count()  # tells the partial files of one process's threads apart


def cannot_write(path: str | Path, error: OSError) -> OutputError:
    """The OutputError for a system error met while writing ``path``."""
    return OutputError(f"cannot be written: {error.strerror or error}", where=str(path))


def text_bytes(text: str) -> bytes:
    """``text`` as UTF-8.  A byte of a path that is no UTF-8 (a lone surrogate in Python) becomes a literal ``\\udce9``:
    in JSON that is the escape of the same surrogate, so that reading gives the path back; elsewhere it can be read.
    """
    return text.encode("utf-8", "backslashreplace")


def plain_text(text: str) -> str:
    """``text`` for those who take UTF-8 alone, such as font renderers and file headers: as ``text_bytes`` writes it."""
    return text_bytes(text).decode("utf-8")


def partial_name(path: Path, suffix: str = "") -> Path:
    """Where ``path`` is written to until it is whole: beside it, hidden, of no other writer.

    ``suffix``: for libraries that tell a format by a name's end.
    """
    return path.with_name(f".{path.name}.{os.getpid()}-{next(_writes)}.partial{suffix}")


def is_partial_of(path: Path, other: Path) -> bool:
    """Whether ``other`` is what a killed writer of ``path`` left behind."""
    return other.name.startswith(f".{path.name}.") and ".partial" in other.name


@contextlib.contextmanager
def replacing(path: Path, *, parents: bool = False, suffix: str = "") -> Iterator[Path]:
    """A file to write (``partial_name``) that takes the place of ``path`` in the end: readers see the old file or the
    new, whole.

    Writers of one path do not meet: the last to finish wins.  Whatever goes wrong, an interrupt too, leaves nothing
    behind.  ``parents``: make the folder where there is none.  Raises OutputError for system errors.
    """
    partial = partial_name(path, suffix)
    try:
        if parents:
            path.parent.mkdir(parents=True, exist_ok=True)
        yield partial
        with open(partial, "rb+") as file:
            os.fsync(file.fileno())
        os.replace(partial, path)
    except BaseException as error:
        with contextlib.suppress(OSError):  # where its folder is no folder either
            partial.unlink()
        if isinstance(error, OSError):
            raise cannot_write(path, error) from None
        raise


def write_atomically(path: Path, data: str | bytes, *, parents: bool = False) -> None:
    """Write ``data`` (text by ``text_bytes``), whole or not at all (``replacing``).  Raises OutputError."""
    with replacing(path, parents=parents) as partial:
        partial.write_bytes(text_bytes(data) if isinstance(data, str) else data)


def make_folders(path: Path) -> list[Path]:
    """Make ``path`` with all above it; those that were not there, the innermost first.  Raises OSError, with none."""
    made = [folder for folder in (path, *path.parents) if not folder.exists()]
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError:
        remove_folders(made)
        raise
    return made


def remove_folders(made: list[Path]) -> None:
    """Take away folders of ``make_folders``, innermost first, as far as they are empty."""
    for folder in made:
        with contextlib.suppress(OSError):  # not empty, or not there
            folder.rmdir()


def write_png(path: Path, picture: np.ndarray) -> None:
    """(h, w, 3) uint8 as PNG, whole or not at all.  Raises OutputError."""
    import imageio.v3 as iio

    data = io.BytesIO()
    iio.imwrite(data, np.ascontiguousarray(picture), extension=".png")
    write_atomically(path, data.getvalue())
