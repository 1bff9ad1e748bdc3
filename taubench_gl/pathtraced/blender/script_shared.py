"""What the scripts in Blender's Python share: their job, their events, the end of the process, animation curves."""

import contextlib
import ctypes
import json
import os
import signal
import sys
import threading

PR_SET_PDEATHSIG = 1  # linux/prctl.h


def read_job():
    """The job that the driver wrote to the file of the first argument.  From here on this process ends with it."""
    end_with_driver()
    with open(sys.argv[1], encoding="utf-8") as file:
        return json.load(file)


def report(**values):
    """Send an event to the driver: a line that starts with ``@tb `` and holds a JSON object."""
    print("@tb " + json.dumps(values), flush=True)


def stop(code):
    """End the process without the interpreter's shutdown, which Blender's threads can hang.  Files are written."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def end_with_driver():
    """End this process with its driver, which holds the other end of standard input and writes nothing: the end of
    input is the end of the driver.

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


def fcurves_of(action):
    """The animation curves of ``action``; Blender 4.4 and later keep them in slots of layers."""
    if getattr(action, "layers", None):
        for layer in action.layers:
            for strip in layer.strips:
                for bag in strip.channelbags:
                    yield from bag.fcurves
    elif hasattr(action, "fcurves"):
        yield from action.fcurves
