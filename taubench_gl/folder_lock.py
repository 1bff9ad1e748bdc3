"""One writer per output folder: a lock that the system releases when its process ends, so that none is ever stale."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import platform
import time
from io import FileIO
from pathlib import Path

from taubench_gl.data_files import opened, parse_json
from taubench_gl.errors import OutputError
from taubench_gl.outputs import cannot_write, make_folders, own_file, remove_folders

LOCK_FILE = ".lock"
_MAX_BYTES = 1 << 16

ATTEMPTS = 8
"""Tries to take the lock: ``lock_holder`` takes a shared lock for a moment, and is no writer to report."""


class FolderLock:
    """A lock that the process which writes into ``out`` holds; ``out`` is created; a second lock raises OutputError.

    The file names its holder and is removed with the lock.  A killed holder leaves the file, without a lock on it.
    Forked children of the holder do not extend the lock.  ``wait``: wait until the holder is done, without an error.
    """

    def __init__(self, out: str | Path, *, wait: bool = False):
        self.path, self._wait = Path(out) / LOCK_FILE, wait
        self._file: FileIO | None = None
        self._made: list[Path] = []

    def __enter__(self) -> FolderLock:
        folder = self.path.parent
        try:
            self._file = self._locked()
            self._file.truncate(0)
            holder = {"pid": os.getpid(), "host": platform.node(), "since": time.time()}
            self._file.write(json.dumps(holder).encode())
        except (FileExistsError, NotADirectoryError):
            raise OutputError("is not a folder", where=str(folder), hint="give --out another name") from None
        except OSError as error:
            self.__exit__()
            raise cannot_write(folder, error) from None
        return self

    def __exit__(self, *exc: object) -> None:
        """Release the lock; remove the folders that were created for it if they are empty."""
        file, self._file = self._file, None
        if file is not None:
            with contextlib.suppress(OSError):
                self.path.unlink()
            with contextlib.suppress(OSError):  # a full disk: the name of the holder is still buffered
                fcntl.flock(file, fcntl.LOCK_UN)
                file.close()
        remove_folders(self._made)

    def _locked(self) -> FileIO:
        """The lock file, open and locked.  Raises OSError, and OutputError if another writer holds it."""
        waited = 0
        while True:
            self._made += make_folders(self.path.parent)
            file = own_file(self.path)  # locked as long as it is open
            try:
                fcntl.flock(file, fcntl.LOCK_EX if self._wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                file.close()
                holder, waited = lock_holder(self.path.parent), waited + 1
                if holder is None and waited < ATTEMPTS:
                    continue  # the other process only asked for the holder
                message = f"{holder or 'another process'} is writing here"
                hint = "wait for it, or give --out another folder"
                raise OutputError(message, where=str(self.path.parent), hint=hint) from None
            except OSError:
                return file  # a file system without locks
            if self._is_current(file):
                return file
            file.close()  # its holder has removed it in the meantime: it protects nothing

    def _is_current(self, file: FileIO) -> bool:
        """Whether the lock's path still leads to the open ``file``."""
        try:
            return os.path.samestat(os.stat(self.path), os.fstat(file.fileno()))
        except FileNotFoundError:
            return False


def lock_holder(out: Path) -> str | None:
    """The process that writes into ``out`` now, in words; None if there is none."""
    try:
        with opened(out / LOCK_FILE, links=False) as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except OSError:
                try:
                    holder = parse_json(file.read(_MAX_BYTES))
                    return f"process {holder['pid']} on {holder['host']}"
                except (ValueError, KeyError, TypeError, RecursionError):
                    return "another process"
    except OutputError:
        return None
    return None
