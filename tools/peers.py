"""Other programs in separate processes, because two OpenGL contexts in one process interfere.

A peer answers one request at a time over its pipes, so that its frames can be interleaved with ours.
"""

from __future__ import annotations

import os
import pickle
import struct
import subprocess
import sys
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

PROGRAMS = Path(__file__).resolve().parent / "peer_programs"
TORCH_INTERPRETER = "TAUBENCH_TORCH_PYTHON"


def torch_python() -> str:
    """The interpreter that has PyTorch: ``TAUBENCH_TORCH_PYTHON``, else this one.  Not checked."""
    return os.environ.get(TORCH_INTERPRETER) or sys.executable


class Peer:
    """A running program of ``peer_programs``; ``missing``: why it cannot run, else None."""

    def __init__(self, process: subprocess.Popen | None, hello: dict[str, Any]):
        self._process, self.hello = process, hello
        self.missing: str | None = hello.get("missing")

    @classmethod
    def start(cls, program: str, *arguments: str, python: str | None = None, **variables: str) -> Peer:
        """Start a program and wait for its first message.  Never raises: ``missing`` has the reason of a failure."""
        command = [python or sys.executable, str(PROGRAMS / program), *arguments]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        try:
            process = subprocess.Popen(command, env=os.environ | variables, **pipes)
        except OSError as error:
            return cls(None, {"missing": f"{command[0]} does not run: {error.strerror}"})
        peer = cls(process, {})
        try:
            peer.hello = peer._receive()
        except EOFError:
            peer.hello = {"missing": f"{program} ended with code {process.wait()} before it was ready"}
        peer.missing = peer.hello.get("missing")
        if peer.missing is not None:
            peer.close()
        return peer

    def ask(self, **request: Any) -> dict[str, Any]:
        """Send a request and return the answer.  Dataclasses become dictionaries.  Raises RuntimeError if it ends."""
        plain = {name: asdict(v) if is_dataclass(v) else v for name, v in request.items()}
        payload = pickle.dumps(plain, protocol=5)
        try:
            self._process.stdin.write(struct.pack("<Q", len(payload)) + payload)
            self._process.stdin.flush()
            answer = self._receive()
        except (BrokenPipeError, EOFError):
            raise RuntimeError(f"{self._process.args[1]} ended with code {self._process.wait()}") from None
        if "missing" in answer:
            raise RuntimeError(answer["missing"])
        return answer

    def _receive(self) -> dict[str, Any]:
        head = self._process.stdout.read(8)
        if len(head) < 8:
            raise EOFError
        return pickle.loads(self._process.stdout.read(struct.unpack("<Q", head)[0]))

    def close(self) -> None:
        if self._process is not None and self._process.poll() is None:
            self._process.stdin.close()
            try:
                self._process.wait(timeout=20)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        if self._process is not None:
            self._process.stdout.close()
