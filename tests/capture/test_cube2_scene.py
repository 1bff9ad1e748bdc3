"""Recordings of Cube 2: messages, paths inside of the stored intervals, scenes, commands."""

from __future__ import annotations

import json

import numpy as np
import pytest
from cube2_files import client, game_packets, integer, message, position, recording, unsigned, write_game
from scipy.optimize import lsq_linear
from test_captured_scene import run

from taubench_gl.animation import Poser, choose_camera
from taubench_gl.capture import light
from taubench_gl.capture.arena import RECORDINGS
from taubench_gl.capture.cube2 import record as recorder
from taubench_gl.capture.cube2.demo import STEP, decode
from taubench_gl.capture.cube2.scene import as_recording
from taubench_gl.capture.cube2.timeline import EYE, Timeline, smooth_path
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.scene import load_scene

OURS = RECORDINGS / "two_towers.dmo"


def events(*messages):
    """Events of one packet with ``messages``, beside a place of a player."""
    return decode(recording([(5, 0, position(1, (1, 2, 3))), (6, 1, b"".join(messages))]), "x").events


# ------------------------------------------------------------------------------------------------------------ messages
@pytest.mark.parametrize("value", [0, 127, -126, 128, -127, -128, 32767, -32768, 32768, -(2**31), 2**31 - 1])
def test_integers(value):
    assert events(message("SOUND", value))[0].values == (value,)


def test_messages_of_clients_lists_and_texts():
    found = events(
        message("ITEMLIST", 4, 5, 6, 7, -1), message("TEAMINFO", "good", 3, "evil", 4, ""),
        client(130, message("SPAWN", *range(12)) + message("GUNSELECT", 3)), message("CURRENTMASTER", 2, 1, 5, -1),
        client(2, message("TEXT", "a" * 200)),
    )  # fmt: skip
    assert [(e.name, e.sender) for e in found] == [
        ("ITEMLIST", -1), ("TEAMINFO", -1), ("SPAWN", 130), ("GUNSELECT", 130), ("CURRENTMASTER", -1), ("TEXT", 2)
    ]  # fmt: skip
    assert found[0].values == ((4, 5), (6, 7)) and found[1].values == (("good", 3), ("evil", 4))
    assert found[2].values == tuple(range(12)) and found[4].values == (2, (1, 5)) and found[5].values == ("a" * 200,)


@pytest.mark.parametrize("place", [(0.0, 1.03, 4095.9), (4096.0, 70000.2, 1.0), (-1.0, -5000.0, 2.0)])
def test_places_and_angles_are_cut_off(place):
    for yaw, pitch in ((0.0, 0.0), (359.9, -89.5), (12.7, 88.9)):
        for player in (3, 128, 20000):
            rows = decode(recording([(7, 0, position(player, place, yaw, pitch, falling=True))]), "x").rows
            assert rows[0, :3].tolist() == [7, player, 1]
            low = rows[0, 3:6] * STEP
            assert (low <= np.array(place) + 1e-9).all() and (low > np.array(place) - STEP - 1e-9).all()
            assert rows[0, 6] == int(yaw) and rows[0, 7] == np.floor(pitch)


def test_a_cut_recording_is_used_as_far_as_it_goes():
    packets = game_packets()
    whole, cut = decode(recording(packets), "x"), decode(recording(packets, -700), "x")
    assert not whole.truncated and cut.truncated and 0 < len(cut.rows) < len(whole.rows)
    data = recording(packets)
    assert decode(data[:-20], "x").truncated


@pytest.mark.parametrize("packets", [
    [(5, 0, position(1, (1, 2, 3))), (4, 0, b"")],  # time goes back
    [(5, 0, position(1, (1, 2, 3))[:-3])],
    [(5, 0, position(1, (1, 2, 3))), (6, 1, integer(200))],
    [(5, 0, position(1, (1, 2, 3))), (6, 1, message("CONNECT"))],
    [(5, 0, position(1, (1, 2, 3))), (6, 1, client(1, client(2, b"")))],
    [(5, 0, position(1, (1, 2, 3))), (6, 1, integer(90) + unsigned(5))],
    [(6, 1, message("SOUND", 1))],
])  # fmt: skip
def test_damaged_recordings_are_one_line(packets):
    with pytest.raises(SceneError) as caught:
        decode(recording(packets), "x.dmo")
    assert "\n" not in str(caught.value) and "x.dmo" in str(caught.value.where)


# --------------------------------------------------------------------------------------------------------------- paths
def test_a_path_is_the_smoothest_inside_of_the_intervals():
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.008, 0.03, 40))
    low = np.floor(np.stack([30 * np.sin(6 * times), 5 * times, np.zeros(40)], 1))
    found = smooth_path(times, low)
    assert (found >= low).all() and (found < low + 1).all()
    step = np.diff(times)
    rows = np.zeros((38, 40))
    for i in range(38):  # second derivatives, weighted by the time that each stands for
        a, b = step[i : i + 2]
        rows[i, i : i + 3] = np.array([1 / a, -1 / a - 1 / b, 1 / b]) * 2 / (a + b) * np.sqrt((a + b) / 2)
    for k in range(3):
        best = lsq_linear(rows, np.zeros(38), (low[:, k], low[:, k] + 1), method="bvls").cost * 2
        energy = ((rows @ found[:, k]) ** 2).sum()
        assert energy <= best * (1 + 1e-4) + 1e-6 * ((rows @ (low[:, k] + rng.random(40))) ** 2).sum()


@pytest.fixture(scope="module")
def timeline():
    return Timeline(decode(recording(game_packets()), "x"))


def test_the_eye_looks_to_the_right_as_yaw_grows_and_up_with_pitch(timeline):
    times = np.array([2 / 3, 1.0, 4.0])  # the first one between 359 and 0 degrees
    eye = timeline.eye(3, times)
    yaw, pitch = np.radians(-350 - 15 * times), np.radians(10.5)  # 350 + 15 t, to the right
    forward = np.stack([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.full(3, np.sin(pitch))], 1)
    assert np.abs(eye.axes[:, 0] - forward).max() < 0.002
    assert np.abs(eye.axes[:, 1, 2]).max() < 1e-12  # no roll
    # +y of the engine is ahead, +x to the left: first and second axis.
    assert np.abs(eye.places[1:] - [[40, 12, 32 + EYE], [40, 18, 32 + EYE]]).max() < 1 / 16


def test_a_teleport_is_a_jump_and_a_death_an_end(timeline):
    times = np.arange(481) / 60
    walker, other = timeline.eye(3, times), timeline.eye(129, times)
    assert walker.alive.all() and walker.jumps.sum() == 1
    at = int(np.flatnonzero(walker.jumps)[0])
    assert abs(times[at] - 5) < 0.03
    steps = np.linalg.norm(np.diff(walker.places, axis=0), axis=1)
    assert steps[at - 1] > 19 and np.delete(steps, at - 1).max() < 0.2
    expected = (times <= 0.98 + 1e-9) | (times >= 2 - 1e-9)  # the last packet before the death
    assert (other.alive == expected).all()
    assert np.ptp(other.places[~expected], axis=0).max() == 0.0  # where it died
    with pytest.raises(SettingsError):
        timeline.eye(77, times)


def test_a_rocket_flies_320_cubes_a_second_until_it_explodes(timeline):
    rocket = next(shot for shot in timeline.shots if shot.gun == 3)
    assert (rocket.time, rocket.end) == (2.0, 3.0)
    assert np.allclose(rocket.at(np.array([2.0, 2.5, 3.0])), [[20, 30, 46], [180, 30, 46], [340, 30, 46]])


# -------------------------------------------------------------------------------------------------------------- scenes
@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folder of the game with ``game.dmo``."""
    folder = tmp_path_factory.mktemp("cube2")
    write_game(folder)
    (folder / "game.dmo").write_bytes(recording(game_packets()))
    return folder


@pytest.fixture(scope="module", params=["cube", "meters"])
def scene(request, made):
    out = made / f"{request.param}.glb"
    words = ("--data", made, "--player", "best", "--start", 1, "--unit", request.param, "--out", out)
    assert run("capture", made / "game.dmo", *words) == 0
    return load_scene(out), 1.0 if request.param == "cube" else 1 / 8


def sampled(scene, rate, seconds=6):
    poser = Poser(scene, rate)
    return [poser.sample(i / rate) for i in range(int(seconds * rate) + 1)]


def node(scene, name):
    return next(i for i, other in enumerate(scene.nodes.names) if other == name)


@pytest.mark.parametrize("rate", [24.0, 60.0])
def test_the_camera_is_the_player_with_most_rotation(scene, rate):
    file, unit = scene
    views = [choose_camera(file).view_at(pose) for pose in sampled(file, rate)]
    t = 1 + np.arange(len(views)) / rate
    moved = np.where(t >= 5.02 - 1e-6, 20, 0)
    expected = np.stack([np.full(len(t), 40), np.full(len(t), 46), -(10 + 2 * t + moved)], 1) * unit
    clear = np.abs(t - 5) > 0.03
    assert np.abs(np.array([view.position for view in views]) - expected)[clear].max() < unit / 16
    forward = np.array([-view.world_from_view[:3, 2] for view in views])
    yaw = np.degrees(np.arctan2(forward[:, 2], forward[:, 0]))  # to the right
    assert np.abs((yaw - 350 - 15 * t + 180) % 360 - 180).max() < 1.05


def test_lights_rise_and_fade_at_their_radius(scene):
    file, unit = scene
    at: dict[str, int] = {}
    for i, lamp in enumerate(file.lights):
        at.setdefault(lamp.name.rpartition(" ")[0] or lamp.name, i)
    assert {"light", "muzzle", "rocket light", "explosion"} <= set(at)
    levels = {name: [pose.lights[at[name]].intensity for pose in sampled(file, 60.0)] for name in at}
    t = 1 + np.arange(361) / 60
    ends = {"muzzle": ([4, 4.1, 4.2], [1, 1, 0], 30, 0.5), "explosion": ([3, 3.1, 3.8], [0, 1, 0], 46, 2.0)}
    for name, (times, values, radius, brightest) in ends.items():
        full = light.linear_candela(radius, 255 * brightest, unit)
        expected = full * np.interp(t, times, values, 0, 0)
        assert np.abs(np.array(levels[name]) - expected).max() < 1e-3 * full, name
        assert np.isclose(file.lights[at[name]].range, radius * unit)
    flying = np.array(levels["rocket light"]) > 0
    assert np.array_equal(flying, (t >= 2 - 1e-6) & (t < 3 - 1e-6))
    still = [lamp for lamp in file.lights if lamp.name == "light"]
    assert np.isclose(still[0].intensity, 255 / 2 * 32**2 * light.LUX * unit**2)
    # A light of radius 0 does not fall off: that of the map's size.
    assert np.isclose(still[1].range, 64 * unit)


def test_players_rockets_and_the_map(scene):
    file, unit = scene
    names = set(file.nodes.names)
    parts = {f"player 128 {part}" for part in ("head", "trunk", "arms", "weapon", "left leg", "right leg")}
    assert {"world", "player camera", "rocket 0", *parts} <= names and not any("player 3 " in name for name in names)
    pose = sampled(file, 24.0, 1)[24]
    trunk = pose.world[node(file, "player 128 trunk")]
    assert np.allclose(trunk[:3, 3], np.array([20, 38, -30]) * unit, atol=0.1 * unit)
    rocket = node(file, "rocket 0")
    for shown, t in zip(sampled(file, 60.0), 1 + np.arange(361) / 60, strict=True):
        assert bool(shown.visible[rocket]) == (2 - 1e-6 <= t < 3 - 1e-6)
    gone = node(file, "player 129 head")
    assert not sampled(file, 24.0, 0)[0].visible[gone] and sampled(file, 24.0, 2)[-1].visible[gone]
    notes = " ".join(str(line) for line in file.notes)
    assert "grenades" in notes and "sunlight" in notes and "whole degrees" in notes and "see-through" in notes


def test_the_maps_normal_map_points_up_the_image(made, scene):
    file, _ = scene
    greens = {int(np.asarray(image.decode())[0, 0, 1]) for image in file.images}
    assert 255 - 50 in greens  # written as 50


def test_best_and_info(made, capsys):
    assert as_recording(decode((made / "game.dmo").read_bytes(), "x")).player == 3
    assert run("capture", "info", made / "game.dmo", "--data", made, "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["game"], facts["map in"], facts["player"]) == ("Cube 2", "tiny.ogz", 3)
    assert (facts["shots"], facts["rockets"], facts["explosions"], facts["deaths"]) == (3, 1, 1, 1)
    assert facts["lights"] == 4 and "3 Walker" in facts["players"]  # two muzzles, a rocket, an explosion
    assert run("capture", "info", made / "game.dmo", "--player", 128) == 0


def test_errors_are_one_line_and_leave_no_file(made, tmp_path, capsys):
    game, out = made / "game.dmo", tmp_path / "scene.glb"
    other = tmp_path / "other.dmo"
    other.write_bytes(recording([(0, 1, message("MAPCHANGE", "../tiny", 5, 0)), *game_packets()[1:]]))
    for words in ((game, "--player", 77), (game, "--player", "x"), (game, "--start", 7), (other,), (made / "x.dmo",)):
        capsys.readouterr()
        assert run("capture", *words, "--data", made, "--out", out) == 2
        errors = [line for line in capsys.readouterr().err.splitlines() if "error" in line]
        assert len(errors) == 1 and not out.exists()


# ----------------------------------------------------------------------------------------------------------- recording
def test_a_recording_is_what_the_engine_writes(tmp_path, monkeypatch, made):
    client_ = tmp_path / "client"
    game = made / "game.dmo"
    script = 'for w; do case "$w" in -q*) home="${w#-q}";; esac; done\nmkdir -p "$home/demo"\n'
    script += f'cp "$home/record.cfg" "{tmp_path}/seen.cfg"; cp "{game}" "$home/demo/made.dmo"\n'
    client_.write_text("#!/bin/sh\n" + script)
    client_.chmod(0o755)
    monkeypatch.setattr(recorder, "CLIENT", client_)
    monkeypatch.setattr(recorder, "DEBIAN_DATA", made)
    out = tmp_path / "out.dmo"
    assert run("capture", "record", "--map", "tiny", "--bots", 5, "--seconds", 7, "--out", out) == 0
    assert out.read_bytes() == game.read_bytes()
    seen = (tmp_path / "seen.cfg").read_text()
    assert "loop i 5" in seen and "gamespeed 25" in seen and "map tiny" in seen
    with pytest.raises(SceneError):
        recorder.record("tiny", 5, 9.0, out)  # it lasts 8 s
    with pytest.raises(SettingsError):
        recorder.record("a; quit", 5, 1.0, out)


def test_without_the_engine_one_line_installs_it(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder, "CLIENT", tmp_path / "none")
    with pytest.raises(SettingsError) as caught:
        recorder.record("tiny", 1, 1.0, tmp_path / "out.dmo")
    assert caught.value.hint == recorder.INSTALL


# ------------------------------------------------------------------------------------------------------- our recording
def test_our_recording_is_decoded_whole():
    demo = decode(OURS.read_bytes(), "x")
    names = [event.name for event in demo.events]
    assert (demo.map_name, len(demo.rows), demo.truncated) == ("two_towers", 14430, False)
    assert (names.count("SHOTFX"), names.count("DIED"), names.count("INITAI")) == (1196, 107, 31)
