"""Damaged recordings, maps and configurations: each is refused in one line or makes a scene, in bounded memory."""

from __future__ import annotations

import gzip
import random

import pytest
from cube2_files import CONFIG, game_packets, hall, recording, write_game
from test_damaged_files import damaged, parts_of, refusals

from taubench_gl.capture.cube2.demo import decode
from taubench_gl.capture.cube2.scene import as_recording, build_scene
from taubench_gl.capture.cube2.world import Files
from taubench_gl.capture.recording import Choice

SEEDS = {
    "game.dmo": 100,
    "game.dmo unpacked": 60,
    "tiny.ogz": 30,
    "tiny.ogz unpacked": 90,
    "tiny.cfg": 10,
    "wall.png": 10,
}
"""Damaged files of each kind; unpacked: damaged before it is packed."""


@pytest.mark.parametrize(("name", "numbers"), parts_of(SEEDS))
def test_damaged_files(name, numbers, tmp_path, monkeypatch):
    monkeypatch.setenv("TAUBENCH_MAX_MEMORY", "256MiB")
    monkeypatch.setattr("os.fsync", lambda _: None)
    write_game(tmp_path)
    packets, out = game_packets(3.0), tmp_path / "scene.glb"
    whole = {"game.dmo": recording(packets), "tiny.ogz": hall(), "tiny.cfg": CONFIG.encode(),
             "wall.png": (tmp_path / "packages" / "wall.png").read_bytes()}  # fmt: skip
    file, _, unpacked = name.partition(" ")

    undamaged = decode(whole["game.dmo"], "game.dmo")

    def build(rng: random.Random) -> None:
        demo = undamaged
        data = (
            gzip.compress(damaged(gzip.decompress(whole[file]), rng), 1, mtime=0)
            if unpacked
            else damaged(whole[file], rng)
        )
        if file in ("tiny.ogz", "tiny.cfg"):
            (tmp_path / "packages" / "base" / file).write_bytes(data)
        elif file == "wall.png":
            (tmp_path / "packages" / file).write_bytes(data)
        if file == "game.dmo":
            demo = decode(data, file)
            as_recording(demo, None, 0.5)
        build_scene(demo, Files(tmp_path), Choice(1.5, 0.5, 12.0, player=3), out)

    assert refusals(name, numbers, out, build) or file in ("tiny.cfg", "wall.png")
