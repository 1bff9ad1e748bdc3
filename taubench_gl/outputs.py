"""Writing files so that readers never see half of one, and saying in one line why it did not work."""

from __future__ import annotations

import contextlib
import io
import itertools
import os
import re
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping
from functools import cache, lru_cache
from hashlib import sha256
from pathlib import Path

import numpy as np

from taubench_gl.errors import OutputError

DAY = 86400.0
"""Seconds after which a partial file that nobody has written to is taken for left behind, wherever its writer was."""

_PARTIAL = re.compile(r"\.(?P<name>.+)\.(?P<pid>\d+)-\d+(-(?P<space>[0-9a-f]{8}))?\.partial(\.\w+)?", re.DOTALL)
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


def new_partial(path: Path, suffix: str = "") -> Path:
    """Where ``path`` is written to until it is whole: beside it, hidden, of no other writer.  Not made yet.

    What killed writers of the same file have left there goes (``_abandoned``).  ``suffix``: for libraries that tell
    a format by a name's end.
    """
    with contextlib.suppress(OSError):  # a folder that is not there or may not be read: told when ``path`` is written
        _sweep(path)
    return path.with_name(f".{path.name}.{os.getpid()}-{next(_writes)}{_process_space()}.partial{suffix}")


def is_partial_of(path: Path, other: Path) -> bool:
    """Whether ``other`` is named as what ``path`` is written to: where nobody writes it, a killed writer left it."""
    found = _PARTIAL.fullmatch(other.name)
    return found is not None and found["name"] == path.name


def _sweep(path: Path) -> None:
    """Remove partial files of ``path`` whose writers are gone.  Raises OSError."""
    for partial in _partials(os.path.abspath(path.parent)).get(path.name, ()):
        with contextlib.suppress(FileNotFoundError):  # finished or swept meanwhile
            if _abandoned(partial):
                partial.unlink()


@lru_cache(maxsize=256)
def _partials(folder: str) -> Mapping[str, list[Path]]:
    """Partial files of ``folder`` by the names they are to get.  Raises OSError.

    Looked for once by a process, as a folder of many thousand frames takes long to read: later ones are left to the
    next process.
    """
    out: dict[str, list[Path]] = defaultdict(list)
    for name in os.listdir(folder):
        if found := _PARTIAL.fullmatch(name):
            out[found["name"]].append(Path(folder, name))
    return out


def _abandoned(partial: Path) -> bool:
    """Is its writer gone?  Where its process number means something here, by that; else, as on other machines that
    share the folder, and where another process has the number now, by a day without a change.  Raises OSError."""
    found = _PARTIAL.fullmatch(partial.name)
    if found["space"] and f"-{found['space']}" == _process_space() and not _runs(int(found["pid"])):
        return True
    return time.time() - partial.stat().st_mtime > DAY


@cache
def _process_space() -> str:
    """Within what process numbers are unique, "-" and 8 hexadecimal digits: a running kernel, and a container on it.

    Not the machine's name, which two of a network or two containers may share.  Empty where the system does not tell.
    """
    try:
        kernel, container = Path("/proc/sys/kernel/random/boot_id").read_bytes(), os.stat("/proc/self/ns/pid").st_ino
    except OSError:
        return ""
    return f"-{sha256(kernel + str(container).encode()).hexdigest()[:8]}"


def _runs(pid: int) -> bool:
    """Is there a process of that number, be it another user's?"""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True


@contextlib.contextmanager
def replacing(path: Path, *, parents: bool = False, suffix: str = "") -> Iterator[Path]:
    """A file to write (``new_partial``) that takes the place of ``path`` in the end: readers see the old file or the
    new, whole.

    Writers of one path do not meet: the last to finish wins.  Whatever goes wrong, an interrupt too, leaves nothing
    behind.  ``parents``: make the folder where there is none.  Raises OutputError for system errors.
    """
    partial = new_partial(path, suffix)
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
