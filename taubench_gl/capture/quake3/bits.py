"""Fields of Quake 3 messages: bit streams whose whole bytes are Huffman-coded.

A field of n bits is first its n % 8 low bits as they are, then whole bytes by a fixed code.  The code is an adaptive
Huffman tree that id Software froze after counting the bytes of recorded games; it also has a leaf for "no byte so far",
which no message contains.  Facts of the wire format, read in ioquake3 (``code/qcommon/huffman.c``, ``msg.c``).
"""

from __future__ import annotations

import struct

from taubench_gl.errors import SceneError

_LEAVES = (
    "90d0b100b0f7a0f390469092707560c37006704170659047905aa0f1a02d9012707e70028069905ba0fba0f5707d80ed806c9011a0db"
    "a0f9805f90b090a880c7802fa0dfa0e3901370439022903e906b908d60ffa02ba0b990a09028a0d9a0d780c0801f7009808b9018902e"
    "806e80717082a0a3a0c99050900fa029a0b5700360688061903da0bba0b3704220008086908ea0d3a0bd8066a0dda0efa0a5a0b18044"
    "8004a0a9a0eb90378079800590e1a03ba0e7804590e0a0a7a0f4a09da0e990908035a0e5a02ca055a04b903990c870c470e87081700a"
    "8077a0e2a0b7903a7074800ea0d5a0fca09fa0d18073a099a0faa0a1a025a0f8a0ee905d8070a0caa09ba095a0aba0b4a0f2a0cda024"
    "7010707f50089036a0d4a026a0bfa0fda019a0da908fa0afa0cea0ada023a0d6a027600da0cfa0f6a0cca0a6a051a0bc904c80c2a0d2"
    "a0a4a014a0dea097a0b29048906aa0d8a0dc7083a0cba0ba90c18085801d8031a0e4a0eca03ca017807aa049a0bea091a01ba09aa0aa"
    "a056a0b6700c8034a021a0e6a054a0b8a02aa057a0a2a04f806f807b9060a03fa015700b8078a0aea059908ca094a016a09ca098a01a"
    "a04d9062a096a0aca052a053905ea01ca09e50019038a0eaa0c680878072905ca04ea0c5703080888089807690649033808aa058a04a"
    "a0f0a09360208084906d9063901e9067804070fe807c803260806007"
)
"""Leaves of the tree from left (0) to right (1), four hexadecimal digits each: depth, byte (100 is no byte)."""

LONGEST = 11
"""Bits of the longest code."""


def _codes() -> dict[int, tuple[int, int]]:
    """Byte -> (code, bits), the first bit of the stream lowest."""
    out, path, depth = {}, 0, 0
    for at in range(0, len(_LEAVES), 4):
        bits = int(_LEAVES[at], 16)
        path, depth = (path << bits - depth if bits >= depth else path >> depth - bits), bits
        out[int(_LEAVES[at + 1 : at + 4], 16)] = (int(format(path, f"0{bits}b")[::-1], 2), bits)
        path += 1
    return out


CODES = _codes()
_TABLE: list[tuple[int, int]] = [(0, 0)] * (1 << LONGEST)
"""Next LONGEST bits -> (byte, bits of its code)."""
for _symbol, (_code, _bits) in CODES.items():
    for _rest in range(_code, 1 << LONGEST, 1 << _bits):
        _TABLE[_rest] = (_symbol, _bits)


class BitReader:
    """The fields of one message in order.  ``where``: names the message in errors."""

    __slots__ = ("_value", "at", "end", "where")

    def __init__(self, data: bytes, where: str):
        self._value = int.from_bytes(data, "little")
        self.at, self.end, self.where = 0, 8 * len(data), where

    def bad(self, what: str) -> SceneError:
        return SceneError(what, where=self.where, hint="the recording is damaged, or of another game")

    def unsigned(self, bits: int) -> int:
        """The next ``bits`` bits as an unsigned number.  Raises SceneError past the end of the message."""
        rest, raw = self._value >> self.at, bits & 7
        out, used = rest & (1 << raw) - 1, raw
        for shift in range(raw, bits, 8):
            symbol, length = _TABLE[rest >> used & 2047]
            out |= symbol << shift
            used += length
        self.at += used
        if self.at > self.end or out >> bits:
            raise self.bad("the message ends inside a field" if self.at > self.end else "a code is no byte")
        return out

    def bit(self) -> int:
        """The next bit, a flag.  The end of the message is checked by the next ``unsigned``."""
        out = self._value >> self.at & 1
        self.at += 1
        return out

    def signed(self, bits: int) -> int:
        """The next ``bits`` bits as a number in two's complement."""
        out = self.unsigned(bits)
        return out - (out >> bits - 1 << bits)

    def real(self) -> float:
        """The next real number: 13 bits for whole ones from -4096 to 4095, else a float32."""
        if self.bit():
            return struct.unpack("<f", struct.pack("<I", self.unsigned(32)))[0]
        return float(self.unsigned(13) - 4096)

    def text(self) -> str:
        """The next text, up to a zero byte; characters outside ASCII and "%" are dots, as the engine reads them."""
        out = bytearray()
        while (character := self.unsigned(8)) != 0:
            out.append(character if character < 128 and character != 37 else 46)
        return out.decode("ascii")
