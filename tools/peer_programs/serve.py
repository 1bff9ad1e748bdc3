"""The server side of tools/peers.py: answers pickled requests on stdin, one at a time.  Standard library only."""

from __future__ import annotations

import os
import pickle
import struct
import sys
from collections.abc import Callable


def serve(prepare: Callable[[], tuple[Callable[[dict], dict], dict]]) -> None:
    """``prepare`` returns the function that answers a request, and the first message; an exception is reported."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of libraries must not mix with the answers

    def send(value: dict) -> None:
        payload = pickle.dumps(value, protocol=5)
        out.write(struct.pack("<Q", len(payload)) + payload)
        out.flush()

    try:
        answer, hello = prepare()
    except ModuleNotFoundError as error:
        send({"missing": f"{error.name} is not installed for {sys.executable}"})
        return
    except Exception as error:
        send({"missing": f"{type(error).__name__}: {error}".splitlines()[0]})
        return
    send(hello)
    while len(head := sys.stdin.buffer.read(8)) == 8:
        request = pickle.loads(sys.stdin.buffer.read(struct.unpack("<Q", head)[0]))
        try:
            send(answer(request))
        except Exception as error:
            send({"missing": f"{type(error).__name__}: {error}".splitlines()[0]})
