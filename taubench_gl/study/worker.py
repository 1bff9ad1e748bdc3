"""Worker processes: they run units and return bytes, and write no files.

``python -m taubench_gl.study.worker CONNECTION LIFELINE`` (two inherited file descriptors) is a worker process.  It
receives units and sends events over the connection.  The lifeline is a pipe whose other end only the driver holds: when
the driver ends, in whatever way, the worker ends too.
"""

from __future__ import annotations

import importlib
import os
import sys
import threading
from multiprocessing.connection import Connection

from taubench_gl.errors import GraphicsError
from taubench_gl.gpu.context import Gpu, open_gpu
from taubench_gl.settings import Settings
from taubench_gl.study.unit import NoOpenGL, Worker


def open_context(settings: Settings) -> Gpu:
    """The GL context of this worker process.  Raises NoOpenGL; GraphicsError if settings name a backend or device."""
    try:
        return open_gpu(settings.device.backend, settings.device.device)
    except GraphicsError as error:
        if settings.device.backend != "auto" or settings.device.device is not None:
            raise
        raise NoOpenGL(error.what, where=error.where, hint=error.hint) from None


def warm_up() -> None:
    """Import what most units need, before the first one arrives.  Opens no context: units choose their device."""
    importlib.import_module("taubench_gl.evaluation")


def main(arguments: list[str]) -> None:
    """Receive units and send events until the connection ends.  ``arguments``: CONNECTION and LIFELINE."""
    connection, lifeline = Connection(int(arguments[0])), int(arguments[1])
    threading.Thread(target=_exit_with_the_driver, args=(lifeline,), daemon=True).start()
    warm_up()
    worker = Worker(connection.send, limited=True)
    while True:
        try:
            unit = connection.recv()
        except EOFError:
            return
        try:
            event = worker.attempt(unit)
        except NoOpenGL as error:
            connection.send(error)
            return
        connection.send(event)


def _exit_with_the_driver(lifeline: int) -> None:
    os.read(lifeline, 1)
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1:])
