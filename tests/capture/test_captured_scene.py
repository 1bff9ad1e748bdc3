"""Captured scenes, read back by the scene reader: camera, players, missiles, light, and the commands."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest
from demo_encoder import entity_state, game, player_state
from game_files import game_files, room, write_pak

from taubench_gl.animation import Poser, choose_camera
from taubench_gl.apps import cli
from taubench_gl.capture import light
from taubench_gl.capture.arena import arena_scenes
from taubench_gl.capture.games import read_recording
from taubench_gl.capture.quake3 import demo as wire
from taubench_gl.capture.quake3 import record as recorder
from taubench_gl.capture.quake3.timeline import (
    FIRE,
    FIRST_EVENT,
    ITEM_KIND,
    LINEAR,
    MISSILE_KIND,
    MOVER_KIND,
    PLAYER_KIND,
)
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.scene import load_scene

LIGHTS = '{"classname" "worldspawn"}\n{"classname" "light" "origin" "0 0 64" "light" "320" "_color" "1 .5 0"}'


def states(seconds=8.0, step=50):
    """A player who walks and turns, teleports at 3 s; another who stands; a rocket from 1 to 2 s, which bursts; a
    shot at 4 s; an item; a door that opens."""
    out = []
    for i in range(int(seconds * 1000 / step) + 1):
        t = i * step / 1000
        late = t >= 3
        player = player_state(
            x=(500.0 if late else 0.0) + 96 * t, yaw=(20 * t + 290) % 360 - 180, vx=96.0, weapon=5, client=0,
            flags=wire.TELEPORT if late else 0,
        )  # fmt: skip
        entities = {
            1: entity_state(kind=PLAYER_KIND, client=1, x=100.0, y=0.0, yaw=30.0, weapon=5, torso=11, legs=22, path=1,
                            turn_path=1, event=FIRE | 0x100 if 4 <= t < 4.3 else 0),
            90: entity_state(kind=ITEM_KIND, model=1, x=-50.0, z=10.0),
            91: entity_state(kind=MOVER_KIND, model=1, path=3, vz=40.0, time=3000, duration=2000),
        }  # fmt: skip
        if 1 <= t < 2:
            entities[70] = entity_state(kind=MISSILE_KIND, weapon=5, path=LINEAR, vx=900.0, z=40.0, time=2000)
        elif 2 <= t < 2.3:
            entities[70] = entity_state(kind=FIRST_EVENT + 51, weapon=5, x=900.0, z=40.0)
        out.append((1000 + i * step, player, entities))
    return out


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folder with ``game.dm_71`` and ``tiny.pk3``."""
    folder = tmp_path_factory.mktemp("game")
    config = {545: "n\\Other\\model\\sarge\\hmodel\\sarge"}
    (folder / "game.dm_71").write_bytes(game(states(), config=config))
    write_pak(folder / "tiny.pk3", game_files(room(entities=LIGHTS)))
    return folder


def run(*arguments):
    """Exit code of the command line."""
    with pytest.raises(SystemExit) as caught:
        cli.main([str(argument) for argument in arguments])
    return caught.value.code


@pytest.fixture(scope="module")
def scene(made):
    out = made / "scene.glb"
    assert run("capture", made / "game.dm_71", "--data", made, "--start", 0.5, "--out", out) == 0
    return load_scene(out)


def node(scene, start):
    return next(i for i, name in enumerate(scene.nodes.names) if name.startswith(start))


def poses(scene, rate, seconds=6):
    poser = Poser(scene, rate)
    return [poser.sample(i / rate) for i in range(int(seconds * rate) + 1)]


@pytest.mark.parametrize("rate", [24.0, 60.0])
def test_the_camera_is_the_eye_at_every_frame(scene, rate):
    camera = choose_camera(scene)
    views = [camera.view_at(pose) for pose in poses(scene, rate)]
    t = 0.5 + np.arange(len(views)) / rate
    x = np.where(t >= 3 - 1e-6, 500, 0) + 96 * t
    # In the snapshot before the teleport, the player stays where the snapshot has it.
    held = (t > 2.95) & (t < 3 - 1e-6)
    x[held] = 96 * 2.95
    places = np.array([view.position for view in views])
    assert np.abs(places[:, 0] - x / 32).max() < 1e-4
    assert np.abs(places[:, 2]).max() < 1e-6
    bob = places[:, 1] * 32
    assert bob.min() > 25.9 and bob.max() < 33
    forward = np.array([-view.world_from_view[:3, 2] for view in views])
    yaw = np.degrees(np.arctan2(-forward[:, 2], forward[:, 0]))
    expected = 20 * np.where(held, 2.95, t) + 110  # +-180 degrees at 3.5 s
    assert np.abs((yaw - expected + 180) % 360 - 180).max() < 0.01


def test_nothing_lies_between_the_two_sides_of_a_jump(scene):
    poser, camera = Poser(scene, 1000.0), choose_camera(scene)
    places = np.array([camera.view_at(poser.sample(2.48 + i / 10000)).position[0] * 32 for i in range(300)])
    between = (places > 96 * 2.96) & (places < 500 + 96 * 2.99)
    assert not between.any()


def test_what_is_in_the_scene(scene):
    names = set(scene.nodes.names)
    assert {"world", "player camera", "sun", "light", "missile 70", "missile light 70", "explosion 70", "muzzle 1",
            "item 90 shard", "mover 91", "player 1 Other lower", "player 1 Other upper", "player 1 Other head",
            "player 1 Other rocketl", "view weapon rocketl"} <= names  # fmt: skip
    at = {light_.name: light_ for light_ in scene.lights}
    assert at["sun"].kind == "directional" and np.isclose(at["sun"].intensity, light.sun_lux(100))
    notes = " ".join(str(line) for line in scene.notes)
    assert "view weapon" in notes and "normal maps" in notes and "sprites of shots" in notes


def test_a_missile_is_there_while_it_flies(scene):
    missile = node(scene, "missile 70")
    for pose, t in zip(poses(scene, 60.0), 0.5 + np.arange(361) / 60, strict=True):
        shown = 1 <= round(t, 6) < 2
        assert bool(pose.visible[missile]) == shown
        if shown:
            assert np.allclose(pose.world[missile][:3, 3], [900 * (t - 1) / 32, 40 / 32, 0], atol=1e-3)


def test_a_player_stands_where_the_snapshots_say(scene):
    lower, head = node(scene, "player 1 Other lower"), node(scene, "player 1 Other head")
    pose = poses(scene, 24.0, 1)[12]
    assert np.allclose(pose.world[lower][:3, 3], [100 / 32, 0, 0], atol=1e-5)
    assert np.allclose(pose.world[head][:3, 3], [100 / 32, 48 / 32, 0], atol=1e-5)  # two tags of 24 units
    forward = pose.world[head][:3, :3] @ [1, 0, 0]
    assert np.allclose(forward, [np.cos(np.pi / 6), 0, -np.sin(np.pi / 6)], atol=1e-5)


def test_the_choices(made, tmp_path, capsys):
    out = tmp_path / "plain.glb"
    code = run("capture", made / "game.dm_71", "--data", made, "--start", "best", "--seconds", 2, "--fps", 24,
               "--no-view-weapon", "--no-roll", "--lights", "none", "--out", out)  # fmt: skip
    assert code == 0
    plain = load_scene(out)
    assert not plain.lights and not any(name.startswith("view weapon") for name in plain.nodes.names)
    assert np.isclose(plain.duration, 2)
    views = [choose_camera(plain).view_at(pose) for pose in poses(plain, 24.0, 2)]
    assert max(abs(view.world_from_view[1, 0]) for view in views) < 1e-6  # level


def test_a_scene_in_which_nothing_moves_lasts_as_long(made, tmp_path):
    (tmp_path / "still.dm_71").write_bytes(game([(1000 + 50 * i, player_state(), {}) for i in range(61)]))
    out = tmp_path / "still.glb"
    assert (
        run("capture", tmp_path / "still.dm_71", "--data", made, "--seconds", 2, "--no-view-weapon", "--out", out) == 0
    )
    assert load_scene(out).duration == 2.0


def test_info(made, capsys):
    assert run("capture", "info", made / "game.dm_71", "--data", made, "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["map"], facts["map in"], facts["players"]) == ("tiny", "tiny.pk3", "Other")
    assert (facts["shots"], facts["missiles"], facts["explosions"], facts["lights"]) == (1, 1, 1, 3)
    assert [window["start"] for window in facts["windows"]] and facts["windows"][0]["alive"]
    assert run("capture", "info", made / "game.dm_71") == 0


def test_errors_are_one_line_and_leave_no_file(made, tmp_path, capsys):
    out = tmp_path / "scene.glb"
    other = tmp_path / "other.dm_71"
    other.write_bytes(game(states(2.0), map_name="elsewhere"))
    wrong = (
        (made / "game.dm_71", "--data", made, "--start", "7", "--out", out),
        (made / "game.dm_71", "--data", made, "--start", "soon", "--out", out),
        (made / "game.dm_71", "--data", tmp_path, "--out", out),
        (made / "game.dm_71", "--data", made, "--out", tmp_path / "scene.gltf"),
        (other, "--data", made, "--seconds", 1, "--out", out),
        (made / "tiny.pk3", "--data", made, "--out", out),
    )
    for arguments in wrong:
        capsys.readouterr()
        assert run("capture", *arguments) == 2
        lines = capsys.readouterr().err.strip().splitlines()
        assert len([line for line in lines if "error" in line]) == 1
        assert not list(tmp_path.glob("*.gl*"))


# -------------------------------------------------------------------------------------------------------- recordings
def fake_engine(folder, body):
    path = folder / "ioquake3"
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)


@pytest.fixture
def engine(tmp_path, monkeypatch):
    """A folder for a program in the place of the engine, and a folder of game data."""
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    (tmp_path / "data" / "baseoa").mkdir(parents=True)
    monkeypatch.setattr(recorder, "FOLDERS", (tmp_path / "data",))
    return tmp_path


@pytest.mark.parametrize("rockets", [0, 1])
def test_a_recording_is_what_the_engine_writes(engine, made, tmp_path, taubench, rockets):
    demos = '"$HOME/.openarena/baseoa/demos"'
    game_file, config = made / "game.dm_71", '"$HOME"/.openarena/baseoa/record.cfg'
    copies = f'cp "{game_file}" {demos}/made.dm_71; cp {config} "{tmp_path}/seen.cfg"'
    fake_engine(engine, f"echo $* > '{tmp_path}/asked'; mkdir -p {demos}; {copies}")
    words = f"capture record --map tiny --bots 3 --seconds 7 --out {tmp_path / 'out.dm_71'}".split()
    code, out, err = taubench(*words, *rockets * ["--rockets"])
    assert code == 0 and "tiny, 8.0 s" in out, err
    assert (tmp_path / "out.dm_71").read_bytes() == game_file.read_bytes()
    assert f"+set g_rockets {rockets} " in (tmp_path / "asked").read_text()
    lines = (tmp_path / "seen.cfg").read_text().splitlines()
    assert sum(line.startswith("addbot") for line in lines) == 3 and lines[-1] == "quit"


def test_an_engine_that_hangs_is_killed(engine, tmp_path, monkeypatch):
    monkeypatch.setattr(recorder, "TRIES", 2)
    fake_engine(engine, f'trap "" TERM; echo $$ >> "{tmp_path}/pids"; while :; do sleep 1000; done')
    with pytest.raises(SceneError):
        recorder.record("tiny", 1, 1.0, tmp_path / "out.dm_71", limit=2.0)
    pids = [int(line) for line in (tmp_path / "pids").read_text().split()]
    assert pids and len(pids) <= recorder.TRIES
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    assert not (tmp_path / "out.dm_71").exists()


def test_without_the_engine_one_line_installs_it(monkeypatch, tmp_path):
    monkeypatch.setattr(recorder, "FOLDERS", (tmp_path,))
    with pytest.raises(SettingsError) as caught:
        recorder.record("tiny", 1, 1.0, tmp_path / "out.dm_71")
    assert caught.value.hint == recorder.INSTALL


# ---------------------------------------------------------------------------------------------------- the game's own
@pytest.mark.long
def test_the_registrys_recorded_games(game_demos, tmp_path, monkeypatch):
    from taubench_gl.apps.named_scenes import resolve
    from taubench_gl.apps.scenes_command import ARENA_NAMES

    assert set(ARENA_NAMES) == set(arena_scenes())
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path))
    path, settings = resolve("arena-oa-dm6")
    assert settings["fps"] == 24.0 and load_scene(path).duration == 6.0
    before = os.stat(path).st_mtime_ns
    assert resolve("arena-oa-dm6")[0] == path and os.stat(path).st_mtime_ns == before  # made once


def test_a_benchmark_without_the_game_is_not_run_there(monkeypatch, tmp_path):
    from taubench_gl.benchmark.run import runnable
    from taubench_gl.benchmark.suite import read_suite
    from taubench_gl.capture import arena

    def missing(name):
        raise SceneError("holds no .pk3 file", where=name)

    monkeypatch.setattr("taubench_gl.benchmark.scenes.arena_file", missing)
    said = []
    suite = read_suite("full")
    left = runnable(suite, said.append)
    recorded = [case for case in suite.cases if case.scene.source in arena.arena_scenes()]
    assert len(said) == len(recorded) == 2 and all("not run" in line for line in said)
    assert len(left.cases) == len(suite.cases) - len(recorded)


def test_items_lie_where_the_map_has_them_and_everything_is_inside_it(game_demos, game_folder):
    from taubench_gl.capture.quake3.paks import Paks
    from taubench_gl.capture.quake3.scene import read_map

    demo = read_recording(game_demos["demos/demo088-test1.dm_71"])[1]
    bsp = read_map(demo, Paks(game_folder))
    names = "armor_shard armor_combat armor_body health_small health health_large health_mega"
    classes = dict(enumerate((f"item_{name}" for name in names.split()), start=1)) | {12: "weapon_rocketlauncher"}
    places: dict[str, list] = {}
    for entity in bsp.entities:
        if "origin" in entity:
            places.setdefault(entity["classname"], []).append([float(word) for word in entity["origin"].split()])
    x = wire.ENTITY["x"]
    found, states_ = {}, []
    for snapshot in demo.snapshots:
        for number, state in snapshot.entities.items():
            kind = state[wire.ENTITY["kind"]]
            if kind in (PLAYER_KIND, ITEM_KIND, MISSILE_KIND):
                states_.append([state[wire.ENTITY[name]] for name in ("x", "y", "z")])
            if kind == ITEM_KIND and not state[wire.ENTITY["model2"]]:  # 1: dropped by a player
                found[number] = int(state[wire.ENTITY["model"]]), state[x], state[wire.ENTITY["y"]]
    checked = [
        min(np.hypot(a - place[0], b - place[1]) for place in places[classes[item]])
        for item, a, b in found.values()
        if item in classes and classes[item] in places
    ]
    assert len(checked) >= 15 and max(checked) == 0
    states_ = np.array(states_)
    low, high = bsp.models[0]["low"], bsp.models[0]["high"]
    assert len(states_) > 50_000 and ((states_ >= low) & (states_ <= high)).all()


@pytest.mark.parametrize("rate, least", [(60.0, 1), (24.0, 0)])
def test_a_muzzle_flash_lasts_20_ms_and_is_on_a_frame_at_60_fps(scene, rate, least):
    flash = next(i for i, light_ in enumerate(scene.lights) if light_.name == "muzzle 1")
    on = [pose.lights[flash].intensity > 0 for pose in poses(scene, rate)]
    frames = 0.5 + np.flatnonzero(on) / rate
    assert len(frames) >= least and all(4 - 1e-6 <= t <= 4.02 + 1e-6 for t in frames)
