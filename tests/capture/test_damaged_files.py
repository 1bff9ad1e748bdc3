"""Damaged demos, maps, models and archives: each is refused in one line or makes a scene, in bounded memory."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from demo_encoder import game
from game_files import game_files, room, write_pak
from repeated import few
from test_captured_scene import LIGHTS, states

from taubench_gl.capture.quake3 import demo as wire
from taubench_gl.capture.quake3.paks import Paks
from taubench_gl.capture.quake3.scene import as_recording, build_scene
from taubench_gl.capture.recording import Choice
from taubench_gl.errors import TaubenchError
from taubench_gl.scene import load_scene

EXTREME = (0, 1, 0xFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7F800000, 0x7FC00000, 65536, 1 << 24)
SEEDS = {
    "game.dm_71": 90,
    "maps/tiny.bsp": 90,
    "models/players/sarge/lower.md3": 40,
    "models/weapons2/rocketl/rocketl.md3": 20,
    "scripts/tiny.shader": 15,
    "models/players/sarge/animation.cfg": 10,
    "textures/floor.tga": 10,
    "textures/wall.jpg": 10,
    "tiny.pk3": 15,
}
"""Damaged files of each kind."""


def parts_of(counts: dict[str, int]) -> list[Any]:
    """Parameters (name, numbers of damaged files): a quarter of each kind, and the others with --long."""
    return few([(n, range(k // 4)) for n, k in counts.items()] + [(n, range(k // 4, k)) for n, k in counts.items()],
               len(counts))  # fmt: skip


def damaged(data: bytes, rng: random.Random) -> bytes:
    """One fault: an end, flipped bits, a number that is extreme, or a part that is elsewhere."""
    out = bytearray(data)
    kind = rng.randrange(4)
    if kind == 0:
        return bytes(out[: rng.randrange(len(out))])
    if kind == 1:
        for _ in range(rng.choice((1, 4, 20))):
            out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    elif kind == 2:
        near = len(out) if rng.random() < 0.4 else 200
        at = rng.randrange(max(min(len(out), near) - 4, 1)) & ~3
        out[at : at + 4] = struct.pack("<I", rng.choice(EXTREME))
    else:
        size = rng.randrange(1, min(64, len(out)))
        a, b = rng.randrange(len(out) - size + 1), rng.randrange(len(out) - size + 1)
        out[a : a + size] = out[b : b + size]
    return bytes(out)


def refusals(name: str, numbers: range, out: Path, build: Callable[[random.Random], None]) -> int:
    """How many of the damaged files are refused; of all others ``build(rng)`` makes the scene ``out``."""
    refused = 0
    for seed in numbers:
        try:
            build(random.Random(f"{name} {seed}"))
        except TaubenchError as error:
            refused += 1
            assert "\n" not in str(error) and error.where
            assert not out.exists()
        else:
            load_scene(out)
            out.unlink()
    return refused


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Files of a game, the folder of their archive, and a demo with a missile that bursts."""
    files, folder = game_files(room(entities=LIGHTS)), tmp_path_factory.mktemp("whole")
    write_pak(folder / "tiny.pk3", files)
    return files, folder, game(states(2.4), config={545: "n\\Other\\model\\sarge"})


@pytest.mark.parametrize(("name", "numbers"), parts_of(SEEDS))
def test_damaged_files(name, numbers, whole, tmp_path, monkeypatch):
    monkeypatch.setenv("TAUBENCH_MAX_MEMORY", "256MiB")
    monkeypatch.setattr("os.fsync", lambda _: None)  # 300 files need not outlast a power cut
    files, folder, recorded = whole
    archive, out = (folder / "tiny.pk3").read_bytes(), tmp_path / "scene.glb"
    (tmp_path / "tiny.pk3").symlink_to(folder / "tiny.pk3")

    undamaged = wire.decode(recorded, "game.dm_71")

    def build(rng: random.Random) -> None:
        demo = undamaged
        if name in files:
            write_pak(tmp_path / "wins.pk3", {name: damaged(files[name], rng)})
        elif name == "tiny.pk3":
            (tmp_path / name).unlink()
            (tmp_path / name).write_bytes(damaged(archive, rng))
        if name == "game.dm_71":
            demo = wire.decode(damaged(recorded, rng), name)
            as_recording(demo)
        build_scene(demo, Paks(tmp_path), Choice(1.5, 0.8, 12.0), out)

    assert refusals(name, numbers, out, build) or name in (
        "scripts/tiny.shader",
        "textures/wall.jpg",
        "textures/floor.tga",
    )
