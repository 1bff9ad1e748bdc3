"""A worker process: ``python -m taubench_gl.batch.worker CONNECTION LIFELINE`` (two inherited file descriptors).

It receives units and sends events over the connection.  The lifeline is a pipe whose other end only the driver holds:
when the driver is gone, however it went, the worker ends at once and leaves nothing behind.
"""

from __future__ import annotations

import os
import sys
import threading
from multiprocessing.connection import Connection


def main(arguments: list[str]) -> None:
    connection, lifeline = Connection(int(arguments[0])), int(arguments[1])
    threading.Thread(target=_end_with_the_driver, args=(lifeline,), daemon=True).start()

    from taubench_gl.batch.engines.inprocess import attempt
    from taubench_gl.batch.units import NoGraphics, PairDone
    from taubench_gl.batch.work import NoOpenGL, Workbench, warm_up

    warm_up()  # beside the head of the first job, which one worker makes and the others wait for
    bench = Workbench()
    while True:
        try:
            unit = connection.recv()
        except EOFError:
            return
        try:
            event = attempt(bench, unit, lambda u=unit: connection.send(PairDone(u)))
        except NoOpenGL as error:
            connection.send(NoGraphics(f"worker process {os.getpid()}", str(error), unit))
            return
        connection.send(event)


def _end_with_the_driver(lifeline: int) -> None:
    os.read(lifeline, 1)
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1:])
