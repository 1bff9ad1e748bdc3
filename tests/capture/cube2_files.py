"""Writes small maps and recordings of Cube 2, for tests: the inverse of ``capture.cube2``."""

from __future__ import annotations

import gzip
import io
import struct
from pathlib import Path

from PIL import Image

from taubench_gl.capture.cube2.demo import MESSAGES

NAMES = [name for name, _, _ in MESSAGES]
EMPTY, SOLID = "empty", "solid"
BYTES = {EMPTY: bytes(12), SOLID: b"\x80" * 12}


def cube(shape=EMPTY, slots=(1,) * 6, material=0, merged=0, polygons=None, boxes=None):
    """A leaf.  ``shape``: EMPTY, SOLID or 12 edges; ``polygons``: face -> (flags, count, values) of version 32 and
    later; ``boxes``: face -> four numbers of a merged face before it."""
    return {"shape": shape, "slots": slots, "material": material, "merged": merged, "polygons": polygons or {},
            "boxes": boxes or {}}  # fmt: skip


def slope(dim=2, low=0, high=8):
    """Edges of a cube whose faces across an axis are level at ``high`` for the first two edges and at ``low``."""
    edges = bytearray(b"\x80" * 12)
    for k in range(4):
        edges[4 * dim + k] = (high if k < 2 else low) << 4
    return bytes(edges)


def _leaf(leaf, version):
    kind = {EMPTY: 1, SOLID: 2}.get(leaf["shape"], 3)
    body = (b"" if kind < 3 else bytes(leaf["shape"])) + struct.pack("<6H", *leaf["slots"])
    material, polygons, boxes = leaf["material"], leaf["polygons"], leaf["boxes"]
    if version < 32:
        body += bytes([0x80, material]) if material else b"\0"
        if leaf["merged"] or boxes:
            kind |= 0x80
            body += bytes([leaf["merged"] | (0x80 if boxes else 0)])
            if boxes:
                body += bytes([sum(1 << face for face in boxes)])
                body += b"".join(struct.pack("<4H", *boxes[face]) for face in sorted(boxes))
    else:
        if material:
            kind |= 0x40
            body += struct.pack("<H" if version > 32 else "<B", material)
        if leaf["merged"]:
            kind |= 0x80
            body += bytes([leaf["merged"]])
        if polygons:
            kind |= 0x20
            body += bytes([sum(1 << face for face in polygons), 0])
            for face in sorted(polygons):
                flags, count, values = polygons[face]
                body += bytes([0, 0, flags, count]) + values
    return bytes([kind]) + body


def tree(parts, version):
    """Bytes of eight cubes; a list of eight stands for a cube with parts."""
    return b"".join(b"\0" + tree(part, version) if isinstance(part, list) else _leaf(part, version) for part in parts)


def map_bytes(parts, size, version=33, entities=(), variables=None, slots=None):
    """A map.  ``entities``: (place, kind, values); ``slots``: (previous, bits, bytes) of changed ones, or a number of
    unchanged ones."""
    variables, slots = variables or {}, slots or []
    table = b""
    for name, value in variables.items():
        kind = 0 if isinstance(value, int) else 1 if isinstance(value, float) else 2
        table += struct.pack("<BH", kind, len(name)) + name.encode()
        table += struct.pack("<i", value) if kind == 0 else struct.pack("<f", value) if kind == 1 else b""
        table += struct.pack("<H", len(value)) + value.encode() if kind == 2 else b""
    rows = b""
    for slot in slots:
        rows += struct.pack("<i", -slot) if isinstance(slot, int) else struct.pack("<2i", slot[1], slot[0]) + slot[2]
    count = sum(slot if isinstance(slot, int) else 1 for slot in slots)
    tail = {29: (0, len(variables))}.get(version, (0, len(variables), count))
    head = b"OCTA" + struct.pack("<6i", version, 0, size, len(entities), 0, 0)
    head += struct.pack(f"<{len(tail)}i", *tail) if version > 28 else b""
    if version < 29:
        head = head[:8] + struct.pack("<i", len(head)) + head[12:]
    head += table if version > 28 else b""
    head += b"\x03fps\0" + struct.pack("<2H", 0, 0) + struct.pack("<H", 0)
    for place, kind, values in entities:
        head += struct.pack("<3f5h2B", *place, *[*values, 0, 0, 0, 0, 0][:5], kind, 0)
    return gzip.compress(head + (rows if version > 29 else b"") + tree(parts, version) + b"lightmaps", 1, mtime=0)


# ------------------------------------------------------------------------------------------------------------ messages
def integer(value):
    if -127 < value < 128:
        return struct.pack("<b", value)
    if -32768 <= value < 32768:
        return b"\x80" + struct.pack("<h", value)
    return b"\x81" + struct.pack("<i", value)


def unsigned(value):
    out = b""
    for _ in range(3):
        if value < 128:
            return out + bytes([value])
        out += bytes([value & 127 | 128])
        value >>= 7
    return out + bytes([value])


def text(value):
    return b"".join(integer(ord(letter)) for letter in value) + b"\0"


def message(name, *values):
    """``values``: integers and texts in order, as they are written."""
    return integer(NAMES.index(name)) + b"".join(integer(v) if isinstance(v, int) else text(v) for v in values)


def position(player, place, yaw=0.0, pitch=0.0, life=1, falling=False):
    """A player's place in cubes and view in degrees, cut off as the engine does."""
    steps = [int(value * 16 // 1) for value in place]
    flags = sum(1 << axis for axis, value in enumerate(steps) if not 0 <= value < 65536) | (16 if falling else 0)
    out = unsigned(player) + bytes([life << 3 | 1]) + unsigned(flags)
    for value in steps:
        out += struct.pack("<H", value & 0xFFFF)
        out += struct.pack("<b", value >> 16) if not 0 <= value < 65536 else b""
    turn = int(yaw % 360) + 360 * int(pitch + 90)
    return integer(NAMES.index("POS")) + out + struct.pack("<HBBH", turn, 90, 20, 0) + (b"\x05" if falling else b"")


def client(number, content):
    """A message that a client sent."""
    return integer(NAMES.index("CLIENT")) + integer(number) + unsigned(len(content)) + content


def recording(packets, cut=None):
    """A file of (milliseconds, channel, content); ``cut``: bytes of its content."""
    body = b"SAUERBRATEN_DEMO" + struct.pack("<2i", 1, 260)
    for ms, channel, content in packets:
        body += struct.pack("<3i", ms, channel, len(content)) + content
    return gzip.compress(body[:cut], 1, mtime=0)


# --------------------------------------------------------------------------------------------------------- a small game
def hall():
    """A map of 64 cubes: a solid floor of 32, a hall over it, a see-through cube in it, two lights."""
    floor, air = cube(SOLID, (2,) * 6), cube()
    glass = [cube(SOLID, material=0x400), *[cube() for _ in range(7)]]
    lights = [((8.0, 8.0, 48.0), 1, (64, 255, 128, 0)), ((50.0, 50.0, 60.0), 1, (0, 10, 10, 10))]
    variables = {"sunlight": 0xFF8000, "sunlightyaw": 90, "sunlightpitch": 45, "skybox": "none", "fog": 16.0}
    slots, parts = [2, (1, 2, struct.pack("<f", 2.0))], [floor, floor, floor, floor, glass, air, air, air]
    return map_bytes(parts, 64, entities=lights, slots=slots, variables=variables)


def game_packets(seconds=8.0, step=20):
    """Player 3 turns and walks, and is set elsewhere at 5 s; player 128 stands and shoots a rocket at 2 s that explodes
    at 3 s, and a shotgun at 4 s; player 129 dies at 1 s, and is there again from 2 s on."""
    start = message("MAPCHANGE", "tiny", 5, 0) + message("INITCLIENT", 3, "Walker", "good", 0)
    start += message("ITEMLIST", 0, 1, 2, 3, -1)
    packets = [(0, 1, start)]
    for k in range(int(seconds * 1000 / step) + 1):
        ms, t = k * step, k * step / 1000
        places = position(3, (10 + 2 * t + (20 if t >= 5 else 0), 40.0, 32.0), 350 + 15 * t, 10.0)
        places += position(128, (30.0, 20.0, 32.0), 90)
        if t <= 1 or t >= 2:
            places += position(129, (5.0, 5.0, 32.0), life=1 if t <= 1 else 0, falling=True)
        packets.append((ms, 0, places))
        if ms == 2000:
            packets.append((ms, 1, message("SHOTFX", 128, 3, 7, *(16 * v for v in (30, 20, 46, 30, 2000, 46)))))
        events = {3000: message("EXPLODEFX", 128, 3, 7), 1000: message("DIED", 129, 128, 1, 1),
                  4000: message("SHOTFX", 128, 1, 9, *(16 * v for v in (30, 20, 46, 40, 20, 46))),
                  4500: message("SHOTFX", 128, 5, 11, *(16 * v for v in (30, 20, 46, 40, 20, 46)))}  # fmt: skip
        if ms in events:
            packets.append((ms, 1, events[ms]))
        if ms == 5000:
            packets.append((ms, 0, message("TELEPORT", 3, 0, 1)))
    return packets


CONFIG = """texturereset // the engine's defaults go
texture 0 "sky.png"
texture 0 "<dds>wall.png" 0 0 0 2
texture n wall_n.png
texture 0 floor.png 1 8 16 .5
texture water water.jpg
texture n not_a_normal_map.png
exec packages/base/none.cfg
if (something) [ texture ]
"""


def write_game(folder: Path, level: bytes | None = None) -> None:
    """The game's folder with the map ``tiny``."""
    base = folder / "packages" / "base"
    base.mkdir(parents=True, exist_ok=True)
    (base / "tiny.ogz").write_bytes(hall() if level is None else level)
    (base / "tiny.cfg").write_text(CONFIG)
    for name, color in (("wall", (200, 100, 50)), ("floor", (10, 20, 30)), ("wall_n", (100, 50, 255))):
        data = io.BytesIO()
        Image.new("RGB", (8, 4), color).save(data, "PNG")
        (folder / "packages" / f"{name}.png").write_bytes(data.getvalue())
    (folder / "packages" / "wall.dds").write_bytes(b"DDS " + struct.pack("<4I", 124, 0, 16, 32))
