"""Writes KTX 2 files of solid UASTC blocks (mode 8: prefix of five bits, then red, green, blue and alpha)."""

from __future__ import annotations

import struct
from collections.abc import Sequence

IDENTIFIER = b"\xabKTX 20\xbb\r\n\x1a\n"
UASTC, SRGB, LINEAR = 166, 2, 1
SOLID, PREFIX_BITS = 0x17, 5


def solid_block(color: Sequence[int]) -> bytes:
    """A 4 x 4 block of one RGBA color, 16 bytes; the hints for other formats are 0."""
    bits, at = SOLID, PREFIX_BITS
    for value in color:
        bits |= value << at
        at += 8
    return bits.to_bytes(16, "little")


def ktx2(size: tuple[int, int], colors: Sequence[Sequence[int]], srgb: bool = True) -> bytes:
    """One level of ``size`` pixels, one color for each 4 x 4 block, rows from the top."""
    width, height = size
    assert len(colors) == -(-width // 4) * -(-height // 4)
    blocks = b"".join(map(solid_block, colors))
    transfer = SRGB if srgb else LINEAR
    sample = struct.pack("<HBBIII", 0, 127, 3, 0, 0, 0xFFFFFFFF)  # RGBA
    basic = struct.pack("<IHHBBBB", 0, 2, 24 + len(sample), UASTC, 1, transfer, 0)
    basic += bytes([3, 3, 0, 0]) + bytes([16, 0, 0, 0, 0, 0, 0, 0]) + sample
    descriptor = struct.pack("<I", 4 + len(basic)) + basic
    header = struct.pack("<9I", 0, 1, width, height, 0, 0, 1, 1, 0)
    start = len(IDENTIFIER) + len(header) + 32 + 24
    data = start + len(descriptor)
    data += -data % 16
    index = struct.pack("<4I2Q", start, len(descriptor), 0, 0, 0, 0)
    level = struct.pack("<3Q", data, len(blocks), len(blocks))
    out = IDENTIFIER + header + index + level + descriptor
    return out.ljust(data, b"\0") + blocks
