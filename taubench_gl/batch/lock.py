"""One driver per folder."""

from __future__ import annotations

import fcntl
import json
import os
import platform
import time
from pathlib import Path
from typing import IO

from taubench_gl.errors import OutputError
from taubench_gl.outputs import cannot_write

LOCK_FILE = ".lock"
TRIES = 8
"""``holder`` takes a shared lock for a moment, which a driver that starts just then must not mistake for another."""


class FolderLock:
    """Held by the running driver.  The system lets go of it when the process ends, however it ends: no stale locks.

    The file says who holds it; what it says means something only while the lock is held.
    """

    def __init__(self, out: Path):
        self.path = out / LOCK_FILE
        self._file: IO[str] | None = None

    def __enter__(self) -> FolderLock:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = open(self.path, "a+", encoding="utf-8")
        except (FileExistsError, NotADirectoryError):
            raise OutputError("is not a folder", where=str(self.path.parent), hint="give --out another name") from None
        except OSError as error:
            raise cannot_write(self.path, error) from None
        for turn in range(TRIES):
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError:
                who = holder(self.path.parent)
                if who is None and turn < TRIES - 1:
                    continue  # it was but somebody's look at who is there
                self._file.close()
                hint = "wait for it, or give --out another folder"
                what = f"{who or 'another process'} is working here"
                raise OutputError(what, where=str(self.path.parent), hint=hint) from None
        self._file.truncate(0)
        self._file.write(json.dumps({"pid": os.getpid(), "host": platform.node(), "since": time.time()}))
        self._file.flush()
        return self

    def __exit__(self, *exc: object) -> None:
        if self._file is not None:
            self._file.truncate(0)
            self._file.close()
            self._file = None


def holder(out: Path) -> str | None:
    """Who drives the batch in ``out`` at this moment; None if nobody does."""
    try:
        with open(out / LOCK_FILE, encoding="utf-8") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except OSError:
                try:
                    told = json.loads(file.read())
                    return f"process {told['pid']} on {told['host']}"
                except (ValueError, KeyError):
                    return "another process"
    except OSError:
        return None
    return None
