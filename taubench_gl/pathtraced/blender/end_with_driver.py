"""Runs in Blender's Python: ends this process when the driver that started it has ended, however that happened."""

import contextlib
import ctypes
import os
import signal
import threading

PR_SET_PDEATHSIG = 1  # linux/prctl.h


def end_with_driver():
    """The driver holds the other end of standard input and writes nothing: the end of input is the end of the driver.

    This also holds behind a wrapper script.  Where the driver is the parent, Linux kills this process at once, even if
    Blender keeps Python's threads from running.
    """
    threading.Thread(target=_exit_at_end_of_input, daemon=True).start()
    with contextlib.suppress(AttributeError, OSError):  # not Linux
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _exit_at_end_of_input():
    while os.read(0, 1):
        pass
    os._exit(1)
