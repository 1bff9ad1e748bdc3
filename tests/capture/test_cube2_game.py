"""The game's own maps: all are read, and equal to what the engine writes of them."""

from __future__ import annotations

import os
import subprocess
from collections import defaultdict

import numpy as np
import pytest

from taubench_gl.apps.named_scenes import resolve
from taubench_gl.capture.cube2.level import drawn_triangles, read_level
from taubench_gl.capture.cube2.record import CLIENT
from taubench_gl.capture.cube2.world import DEBIAN_DATA, Files, read_textures, texture_coordinates
from taubench_gl.scene import load_scene

SMALL = ["cb", "cb2", "colos", "cyber1", "md2", "silly", "tt"]
LARGE = [
    "cave", "gk_cyber_world", "gk_cyber_world_no_glas", "gk_cyber_world_no_glas_small", "md", "md3", "two_towers",
    "gk_cyber_world_no_glas_small_aqua", "gk_cyber_world_no_glas_small_no_sky", "wake6", "zoom", "zoomin", "zoomout",
]  # fmt: skip
NAMES = [*SMALL, *(pytest.param(name, marks=pytest.mark.long) for name in LARGE)]


@pytest.fixture(scope="session")
def files() -> Files:
    if not (DEBIAN_DATA / "packages" / "base" / "two_towers.ogz").is_file():
        pytest.skip("Cube 2's data is not installed: apt-get install cube2-data")
    return Files(DEBIAN_DATA)


def level_of(files, name):
    path, inside = files.map_file(name)
    return read_level(files.read(inside), str(path))


@pytest.mark.parametrize("name", NAMES)
def test_every_map_is_read(files, name):
    level = level_of(files, name)
    cubes = level.cubes
    assert (cubes.sizes**3).sum() == cubes.size**3
    assert (cubes.slots < max(len(level.slots), 64)).all() and (cubes.edges[cubes.solid] == 0x80).all()
    places = level.entities["place"]
    assert np.isfinite(places).all() and len(places) > 1
    low, high = cubes.stored.min((0, 1), initial=0), cubes.stored.max((0, 1), initial=0)
    assert (low >= 0).all() and (high <= 8 * cubes.size).all()


def exported(folder, name):
    """Corners (t, 3, 3) in cubes but for a shift, slots and texture coordinates of the engine's triangles."""
    (folder / "run.cfg").write_text(
        f"vsync 0; shadowmap 0; maxparticles 0; hidehud 1\nsleep 300 [ writeobj {name}; quit ]\n"
    )
    display = {"SDL_VIDEODRIVER": "offscreen", "SDL_AUDIODRIVER": "dummy", "LIBGL_ALWAYS_SOFTWARE": "1"}
    command = [CLIENT, f"-q{folder}", f"-k{DEBIAN_DATA}", "-t0", "-w320", "-h240", f"-l{name}", "-xexec run.cfg"]
    quiet = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    subprocess.run(command, env={**os.environ, **display}, cwd=folder, timeout=300, check=False, **quiet)
    vertices, uvs, faces, slots, slot = [], [], [], [], 0
    for line in (folder / f"{name}.obj").read_text().splitlines():
        kind, *words = line.split() or [""]
        if kind == "v":
            vertices.append([float(word) for word in words])
        elif kind == "vt":
            uvs.append([float(word) for word in words])
        elif kind == "usemtl":
            slot = int(words[0][4:])
        elif kind == "f":
            faces.append([[int(part) - 1 for part in word.split("/")[:2]] for word in words])
            slots.append(slot)
    at, faces = np.array(vertices), np.array(faces)
    places = np.stack([at[:, 2], -at[:, 0], at[:, 1]], 1)[faces[..., 0]]
    return places, np.array(slots), np.array(uvs)[faces[..., 1]] * [1, -1] + [0, 1]


def areas(corners, slots):
    sizes = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    return np.bincount(slots, sizes, 256)


@pytest.mark.long
@pytest.mark.parametrize("name", [*SMALL, *LARGE])
def test_maps_are_those_that_the_engine_writes(files, name, tmp_path):
    if not CLIENT.is_file():
        pytest.skip("Cube 2 is not installed: apt-get install cube2")
    level = level_of(files, name)
    slots, sides, corners = drawn_triangles(level.cubes)
    theirs, their_slots, uvs = exported(tmp_path, name)
    low, high = corners.min((0, 1)), corners.max((0, 1))
    theirs += [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]]
    ours, other = ({tuple(v) for v in np.rint(8 * places.reshape(-1, 3)).astype(int)} for places in (corners, theirs))
    whole = level.version > 28
    assert ours == other if whole else len(ours ^ other) <= 1
    assert np.allclose(areas(corners, slots), areas(theirs, their_slots), rtol=1e-9 if whole else 1e-5)
    if name in ("cb", "colos", "md2", "two_towers", "zoom"):
        textures, known = read_textures(level, files, name), defaultdict(list)
        corner, number = np.rint(8 * theirs.reshape(-1, 3)).astype(int), np.repeat(their_slots, 3)
        for key, uv in zip(
            zip(number.tolist(), map(tuple, corner.tolist()), strict=True), uvs.reshape(-1, 2), strict=True
        ):
            known[key].append(uv)
        worst = 0.0
        for slot in np.unique(slots).tolist():
            own = corners[slots == slot].reshape(-1, 3)
            found = texture_coordinates(
                own, np.repeat(sides[slots == slot], 3), textures[slot], files.size(textures[slot].image)
            )
            for key, uv in zip(map(tuple, np.rint(8 * own).astype(int).tolist()), found, strict=True):
                worst = max(worst, min(np.abs(np.array(known[slot, key]) - uv).max(1)))
        assert worst < 1e-4


@pytest.mark.long
def test_the_registrys_recorded_game(files, tmp_path, monkeypatch):
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path))
    path, settings = resolve("cube2-two-towers")
    scene = load_scene(path)
    assert settings["fps"] == 24.0 and scene.duration == 6.0
    assert sum(light.name.startswith("muzzle") for light in scene.lights) > 700
