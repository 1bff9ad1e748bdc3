"""The one creator of output files: whole, never through a link, with system errors as one-line OutputErrors.

A file is created under a hidden name in the folder of its target, which must not exist, and renamed once its content is
on the disk.  The hidden name holds the process number of its writer, so that files left by killed writers can be found
and removed.  This is why ``tempfile`` does not choose the name; its files would also be unreadable for other users.
Output folders may hold links of others: a link in the place of a file is replaced or refused, never written through.
"""

from __future__ import annotations

import contextlib
import csv
import errno
import io
import itertools
import os
import re
import shutil
import stat
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache, lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any, BinaryIO, TextIO

import numpy as np

from taubench_gl.data_files import read_bytes
from taubench_gl.errors import OutputError

DAY = 86400.0
"""Seconds without a change after which a partial file counts as abandoned, regardless of its process number."""

_PARTIAL = re.compile(r"\.(?P<name>.+)\.(?P<pid>\d+)-\d+(-(?P<space>[0-9a-f]{8}))?\.partial(\.\w+)?", re.DOTALL)
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
_writes = itertools.count()  # distinguishes the partial files of the threads of one process


def cannot_write(path: str | Path, error: OSError) -> OutputError:
    """The OutputError for a system error that occurred while writing ``path``."""
    cause = "a link that is not followed" if error.errno == errno.ELOOP else error.strerror or error
    return OutputError(f"cannot be written: {cause}", where=str(path))


def text_bytes(text: str) -> bytes:
    """A text as UTF-8.

    A byte of a path that is not UTF-8 is a lone surrogate in Python; it becomes a literal ``\\udce9``.  In JSON this is
    the escape of the same surrogate, so that reading restores the path.
    """
    return text.encode("utf-8", "backslashreplace")


def plain_text(text: str) -> str:
    """A text without lone surrogates, for font renderers and file headers; the same escapes as ``text_bytes``."""
    return text_bytes(text).decode("utf-8")


def duration_text(seconds: float) -> str:
    """A duration for people: ``40 s``, ``12 min``, ``3.4 h``."""
    if seconds < 90:
        return f"{max(seconds, 1):.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


# -------------------------------------------------------------------------------------------------------------- writing


@contextlib.contextmanager
def replacing(path: Path, *, parents: bool = False, suffix: str = "") -> Iterator[Path]:
    """Yields a partial file (``new_partial``) that replaces ``path`` at the end: readers see the old or the new file.

    Concurrent writers of one path do not disturb each other; the last to finish wins.  An error or interrupt leaves no
    partial file.  ``parents``: create missing folders.  Raises OutputError for system errors.
    """
    partial = None
    try:
        if parents:
            path.parent.mkdir(parents=True, exist_ok=True)
        partial = new_partial(path, suffix)
        yield partial
        put_in_place(partial, path)
    except BaseException as error:
        if partial is not None:
            with contextlib.suppress(OSError):  # its folder is gone
                partial.unlink()
        if isinstance(error, OSError):
            raise cannot_write(path, error) from None
        raise


def put_in_place(partial: Path, path: Path) -> None:
    """Rename a complete partial file, in the folder of ``path``, once its content is on the disk.  Raises OSError."""
    with _opened(path.parent) as folder:
        file = os.open(partial.name, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC, dir_fd=folder)
        try:
            os.fsync(file)
        finally:
            os.close(file)
        os.replace(partial.name, path.name, src_dir_fd=folder, dst_dir_fd=folder)
        _sync(folder)


def write_atomically(path: Path, data: str | bytes, *, parents: bool = False) -> None:
    """Write ``data``, text by ``text_bytes``, completely or not at all.  Raises OutputError."""
    with replacing(path, parents=parents) as partial, open(partial, "wb", buffering=0) as file:
        unwritten = memoryview(text_bytes(data) if isinstance(data, str) else data)
        while unwritten:
            unwritten = unwritten[file.write(unwritten) :]


def write_parts(path: Path, parts: Iterable[bytes]) -> None:
    """Write bytes as they come, completely or not at all.  Raises OutputError."""
    with replacing(path) as partial, open(partial, "wb") as file:
        file.writelines(parts)


def copy_atomically(source: BinaryIO, path: Path) -> None:
    """Write the rest of an open file to ``path``, completely or not at all.  Raises OutputError."""
    with replacing(path) as partial, open(partial, "wb") as file:
        shutil.copyfileobj(source, file, 1 << 20)


def new_file(path: Path) -> io.FileIO:
    """A new file at ``path`` for writing without a buffer; an older one, or a link, is removed.  Raises OSError."""
    with _opened(path.parent) as folder:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(path.name, dir_fd=folder)
        file = os.open(path.name, os.O_WRONLY | _NEW, 0o666, dir_fd=folder)
        _sync(folder)
    return open(file, "wb", buffering=0)


def own_file(path: Path, *, append: bool = False) -> io.FileIO:
    """A file that grows or is locked in place, created if missing, for reading and writing or to ``append``.

    Without a buffer.  Raises OSError, also for a link and for what is not a regular file.
    """
    access = os.O_WRONLY | os.O_APPEND if append else os.O_RDWR
    with _opened(path.parent) as folder:
        flags = access | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
        file = os.open(path.name, flags, 0o666, dir_fd=folder)
    if not stat.S_ISREG(os.fstat(file).st_mode):
        os.close(file)
        raise OSError(errno.EINVAL, "not a regular file")
    return open(file, "ab" if append else "r+b", buffering=0)


def log_file(path: Path) -> TextIO:
    """A log to which whole lines are appended; a killed writer leaves whole lines.  Raises OutputError."""
    try:
        file = own_file(path, append=True)
    except OSError as error:
        raise cannot_write(path, error) from None
    return io.TextIOWrapper(io.BufferedWriter(file), encoding="utf-8", errors="replace", line_buffering=True)


# Flags of a file that must not exist yet.
_NEW = os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC


@contextlib.contextmanager
def _opened(folder: Path) -> Iterator[int]:
    """The descriptor of a folder, in which files are created whatever its path means later.  Raises OSError."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def _sync(folder: int) -> None:
    """Put the names in a folder on the disk, where its file system can."""
    try:
        os.fsync(folder)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.EBADF):
            raise


def image_bytes(image: np.ndarray, form: str = "png", **options: Any) -> bytes:
    """The bytes of an image file of ``image``, (h, w) or (h, w, 3 or 4) uint8.  ``form``: its suffix; ``options``: as
    Pillow has them.
    """
    import imageio.v3 as iio

    return iio.imwrite("<bytes>", np.ascontiguousarray(image), extension=f".{form}", plugin="pillow", **options)


def write_png(path: Path, image: np.ndarray) -> None:
    """Write ``image``, (h, w, 3) uint8, as PNG, completely or not at all.  Raises OutputError."""
    write_atomically(path, image_bytes(image))


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write named arrays as a compressed NumPy archive (.npz), completely or not at all.  Raises OutputError."""
    with replacing(path, suffix=path.suffix) as partial:
        np.savez_compressed(partial, **arrays)


def csv_text(rows: Iterable[Sequence[Any]]) -> str:
    """CSV with a line break after each row; None is an empty cell, numbers keep every digit.

    Text that a spreadsheet would take for a formula gets an apostrophe before it: names come from files.
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue()


def _cell(value: Any) -> Any:
    """A cell of CSV: nothing for None, formulas as text."""
    if not isinstance(value, str) or not value.startswith(_FORMULA):
        return "" if value is None else value
    try:
        float(value)
    except ValueError:
        return "'" + value
    return value


def output_folder(out: str | Path) -> Path:
    """Create the folder ``out`` of a command, with its parents, unless it exists.  Raises OutputError."""
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise OutputError("is not a folder", where=str(folder), hint="give --out another name") from None
    except OSError as error:
        raise cannot_write(folder, error) from None
    return folder


def folder_in(out: Path, name: str) -> Path:
    """The folder ``name`` in the output folder ``out``, created unless it exists; a link raises OutputError."""
    try:
        with _opened(out) as folder:
            with contextlib.suppress(FileExistsError):
                os.mkdir(name, dir_fd=folder)
            os.close(os.open(name, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC, dir_fd=folder))
    except NotADirectoryError:
        raise OutputError("is a link or a file, not a folder", where=str(out / name), hint="remove it") from None
    except OSError as error:
        raise cannot_write(out / name, error) from None
    return out / name


def remove_files(out: Path, patterns: Iterable[str]) -> None:
    """Remove files in the folder ``out`` or in folders of it, and the folders that this empties.  Raises OSError.

    ``patterns``: relative names, with ``*`` for any part of the last one.  Links to folders are not followed.
    """
    for pattern in patterns:
        name = Path(pattern)
        folder = out / name.parent
        if name.is_absolute() or ".." in name.parts or folder.is_symlink():
            continue
        found = list(folder.glob(name.name)) if "*" in name.name else [folder / name.name]
        for path in found:
            if path.is_file() or path.is_symlink():
                path.unlink(missing_ok=True)
        if found and folder != out:
            remove_folders([folder])


def make_folders(path: Path) -> list[Path]:
    """Create ``path`` and its missing parents.  -> the folders created, innermost first.  Raises OSError."""
    made = [folder for folder in (path, *path.parents) if not folder.exists()]
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError:
        remove_folders(made)
        raise
    return made


def remove_folders(made: list[Path]) -> None:
    """Remove the folders that ``make_folders`` created, innermost first, where they are empty."""
    for folder in made:
        with contextlib.suppress(OSError):  # not empty or missing
            folder.rmdir()


# -------------------------------------------------------------------------------------------------------- partial files


def new_partial(path: Path, suffix: str = "") -> Path:
    """The partial file of a new writer of ``path``: hidden, new and empty, in the same folder.  Raises OSError.

    Abandoned partial files of ``path`` are removed.  ``suffix``: for libraries that derive the format from the name.
    """
    with contextlib.suppress(OSError):
        _sweep(path)
    partial = path.with_name(f".{path.name}.{os.getpid()}-{next(_writes)}{_process_space()}.partial{suffix}")
    with _opened(path.parent) as folder:
        os.close(os.open(partial.name, os.O_WRONLY | _NEW, 0o666, dir_fd=folder))
    return partial


def is_partial_of(path: Path, other: Path) -> bool:
    """Whether ``other`` has the name of a partial file of ``path``."""
    parts = _PARTIAL.fullmatch(other.name)
    return parts is not None and parts["name"] == path.name


def _sweep(path: Path) -> None:
    """Remove abandoned partial files of ``path``.  Raises OSError."""
    for partial in _partials(os.path.abspath(path.parent)).get(path.name, ()):
        with contextlib.suppress(FileNotFoundError):  # renamed or removed in the meantime
            if _abandoned(partial):
                partial.unlink()


@lru_cache(maxsize=256)
def _partials(folder: str) -> Mapping[str, list[Path]]:
    """Partial files in ``folder`` by the name of their target.  Raises OSError.

    Cached for the life of the process, because listing a folder of many thousand frames is slow.
    """
    out: dict[str, list[Path]] = defaultdict(list)
    for name in os.listdir(folder):
        if parts := _PARTIAL.fullmatch(name):
            out[parts["name"]].append(Path(folder, name))
    return out


def _abandoned(partial: Path) -> bool:
    """Whether the writer of a partial file is gone.  Raises OSError.

    A process number of this machine decides.  One of another machine or container that shares the folder, and one that
    another process has since received, are inconclusive: then DAY decides.
    """
    parts = _PARTIAL.fullmatch(partial.name)
    if parts["space"] and f"-{parts['space']}" == _process_space() and not _runs(int(parts["pid"])):
        return True
    return time.time() - partial.stat().st_mtime > DAY


@cache
def _process_space() -> str:
    """The space in which process numbers are unique, as "-" and 8 hexadecimal digits; "" where it is unknown.

    A hash of the running kernel and of its PID namespace; host names may repeat in a network and in containers.
    """
    try:
        kernel, namespace = read_bytes("/proc/sys/kernel/random/boot_id"), os.stat("/proc/self/ns/pid").st_ino
    except (OSError, OutputError):
        return ""
    return f"-{sha256(kernel + str(namespace).encode()).hexdigest()[:8]}"


def _runs(pid: int) -> bool:
    """Whether a process with this number exists, of any user."""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True
