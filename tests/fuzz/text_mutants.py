"""Damaged AFF and OBJ files: words, numbers, lines and bytes changed, generated from a seed number."""

from __future__ import annotations

import random
from pathlib import Path

AFF = """v from 0 1 6 at 0 0 0 up 0 1 0 angle 45 hither 0.1 resolution 24 16
am .2 .2 .2
l 2 4 3 .5 .5 .5
fm 0 0 0 .6 .5 .4 .1 .1 .1 20 .1 1
p 4 -3 -1 3 3 -1 3 3 -1 -3 -3 -1 -3
f 1 .5 .2 .8 .2 30 0 1
xs 1 2 1 0 1 0 30 -1 0 0 { m vertices 3 0 0 0 1 0 0 0 1 0 normals 1 0 0 1 triangles 1 0 1 2 0 0 0 }
x ball { s 0 0 0 .7 c 0 0 0 .3 1.5 0 0 .1 }
pp 3 0 0 0 0 0 1 1 0 0 0 0 1 0 1 0 0 0 1
tt none.ppm 0 0 0 0 0 1 0 0 1 0 0 1 0 0 1
tpa 2 0 1 -1 0 0 0 1 2 -1 0 0 0 1 1 1 0 0 0 1 1 1 -1 0 0 0 1 2 0 0 0 0 1 1 1 0 0 0 1
a 0 2 8
k ball { transl 4 -1 0 0 0 0 0 0 0 0 0 0 .1 .2 .3 1 1 0 0 0 0 0 2 1 1 0 0 0 0
rot 5 -1 0 1 0 0 0 0 0 0 0 1 0 0 0 0 0 1 0 1 0 90 0 0 0 2 0 1 0 400 0 0 0 3 0 1 0 400 0 0 0
visibility 2 0 1 1.6 0 }
la lamp 0 3 0 .4 .4 .4
i 0 part.aff
i 9 other.aff
"""
PART = "s 1 1 1 .3\nxs 1 1 1 0 1 0 0 1 0 0 { p 3 0 0 0 1 0 0 0 1 0 }\n"
OBJ = """mtllib a.mtl
o sheet
v -1 -1 0
v 1 -1 0
v 1 1 .5 1
v -1 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 1
vn 0 .1 1
usemtl red
f 1/1/1 2/2/1 3/3/2 4/4/2
o other
v 2 0 0
v 3 0 0 .5 .5 .5
v 2 1 0
g part
usemtl blue
f -3 -2 -1
f 5//1 6//2 7//1
l 1 2
s off
"""
MTL = "newmtl red\nKd 1 0 0\nKs .5 .5 .5\nNs 30\nd .9\nmap_Kd -o 0 0 none.png\nnewmtl blue\nKd 0 0 1\nKe 1 1 2\nTr .1\n"
WORDS = ["nan", "inf", "-1", "0", "1e30", "1e39", "-1e308", "1e-45", "99999999999", "2147483648", "{", "}", "#", "x",
         "f", "v", "../..", "%", "1/1", "//", "-0", "\\", "1_0", "0x10", "½", "٣", ""]  # fmt: skip
NUMBERS = ["0", "-0", "1", "-1", "2", "3", "7", "0.5", "-1.5", "1e-45", "1e-20", "1e15", "1e29", "-1e29", "360"]


def write_text_mutants(folder: Path, kind: str, count: int, seed: int) -> None:
    """``count`` mutants of an AFF or OBJ file, the undamaged file as number 0, and the files that they refer to.

    Every third OBJ mutant is a sequence: a folder of two undamaged files and the mutant.
    """
    rng = random.Random(seed)
    text = {"aff": AFF, "obj": OBJ}[kind]
    (folder / "part.aff").write_text(PART) if kind == "aff" else (folder / "a.mtl").write_text(MTL)
    (folder / f"000000.{kind}").write_text(text)
    for number in range(1, count + 1):
        data = damaged_text(text, rng)
        if kind == "obj" and number % 3 == 0:
            frames = folder / f"{number:06d}.seq"
            frames.mkdir()
            for name, content in (("a0.obj", text.encode()), ("a1.obj", data), ("a2.obj", text.encode())):
                (frames / name).write_bytes(content)
            (frames / "a.mtl").write_bytes(damaged_text(MTL, rng))
        else:
            (folder / f"{number:06d}.{kind}").write_bytes(data)


def damaged_text(text: str, rng: random.Random) -> bytes:
    """A few words, numbers, lines and bytes of a text changed."""
    lines = [line.split(" ") for line in text.split("\n")]
    for _ in range(rng.choice((1, 1, 2, 4))):
        line = rng.choice(lines)
        at, action = rng.randrange(len(line)), rng.random()
        numbers = [i for i, word in enumerate(line) if word.lstrip("-").replace(".", "").isdigit()]
        if numbers and rng.random() < 0.6:  # still a number: a file that is rejected at once tests little
            line[rng.choice(numbers)] = rng.choice(NUMBERS)
        elif action < 0.45:
            line[at] = rng.choice(WORDS)
        elif action < 0.6:
            line.insert(at, rng.choice(WORDS))
        elif action < 0.75 and len(line) > 1:
            del line[at]
        elif action < 0.85:
            other = rng.choice(lines)
            line[at] = rng.choice(other)
        elif action < 0.93:
            lines.remove(line)
        else:
            lines.insert(rng.randrange(len(lines)), list(line))
        lines = lines or [[""]]
    data = bytearray("\n".join(" ".join(line) for line in lines).encode())
    if rng.random() < 0.15 and data:
        data[rng.randrange(len(data))] = rng.randrange(256)
    if rng.random() < 0.1:
        del data[rng.randrange(len(data) + 1) :]
    return bytes(data)
