"""Bytes of Cube 2's gzip files, and the values in them."""

from __future__ import annotations

import struct
import zlib
from typing import Any

from taubench_gl.errors import SceneError
from taubench_gl.memory_budget import limit, require


def unpacked(data: bytes, where: str, kind: str) -> tuple[bytes, bool]:
    """The content of a gzip file, and whether it is whole: one that was cut off gives what there is.

    ``kind``: what it should be, for errors.  Raises SceneError for anything else.
    """
    stream = zlib.decompressobj(31)
    try:
        out = stream.decompress(data, limit() + 1)
    except zlib.error as error:
        raise SceneError(f"is no {kind}: not gzip, or damaged ({error!s:.80})", where=where) from None
    require(len(out), "its content", SceneError, where)
    return out, stream.eof


class Reader:
    """Values of a file in its order.  Every method raises SceneError at the end."""

    def __init__(self, data: bytes, where: str, at: int = 0):
        self.data, self.where, self.at = data, where, at

    def bad(self, what: str) -> SceneError:
        return SceneError(f"{what}, at byte {self.at} of its content", where=self.where, hint="the file is damaged")

    def bytes(self, count: int) -> bytes:
        if count < 0 or self.at + count > len(self.data):
            raise self.bad("ends too early")
        self.at += count
        return self.data[self.at - count : self.at]

    def get(self, form: str) -> Any:
        """Values of a ``struct`` format, little-endian; one alone without its tuple."""
        values = struct.unpack("<" + form, self.bytes(struct.calcsize("<" + form)))
        return values if len(values) > 1 else values[0]

    def text(self, length: int) -> str:
        return self.bytes(length).decode("latin-1")
