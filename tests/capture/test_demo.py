"""Demos of the Quake 3 family, decoded from what the tests encode, from our recordings and from the game's own."""

from __future__ import annotations

import itertools
import struct

import demo_encoder as encoder
import numpy as np
import pytest
from demo_encoder import entity_state, file_bytes, game, player_state, snapshot_message, start_message

from taubench_gl.capture.games import read_recording
from taubench_gl.capture.quake3 import demo as wire
from taubench_gl.capture.quake3.bits import CODES, BitReader
from taubench_gl.errors import SceneError
from taubench_gl.paths import ASSETS

RECORDINGS = ASSETS / "recordings"


def test_the_codes_are_a_full_prefix_code_of_2_to_11_bits():
    assert len(CODES) == 257 and set(CODES) == set(range(257))
    lengths = [bits for _, bits in CODES.values()]
    assert (min(lengths), max(lengths)) == (2, 11)
    assert sum(2 ** (11 - bits) for bits in lengths) == 2**11
    words = sorted(format(code, f"0{bits}b")[::-1] for code, bits in CODES.values())
    assert not any(b.startswith(a) for a, b in itertools.pairwise(words))


@pytest.mark.parametrize("bits", [1, 3, 8, 10, 13, 16, 19, 24, 32])
def test_a_field_is_its_odd_low_bits_and_whole_bytes_by_the_code(bits):
    rng = np.random.default_rng(bits)
    values = [int(v) for v in rng.integers(0, 1 << bits, 50)]
    writer = encoder.BitWriter()
    for value in values:
        writer.integer(value, bits)
    reader = BitReader(writer.message(), "test")
    assert [reader.unsigned(bits) for _ in values] == values


def test_numbers_and_texts():
    values = [0.0, -4096.0, 4095.0, 4096.0, 0.5, -1234.56787109375]
    writer = encoder.BitWriter()
    for value in values:
        writer.real(value)
    writer.text("a%\xe9b").integer(-5 & 0xFFFF, 16)
    reader = BitReader(writer.message(), "test")
    assert [reader.real() for _ in values] == values
    assert reader.text() == "a..b" and reader.signed(16) == -5


def random_states(count, seed=0):
    """Snapshots with every field of every width, and entities that come and go."""
    rng = np.random.default_rng(seed)

    def value(bits):
        if bits == 0:
            return float(np.float32(rng.choice([rng.normal() * 1000, int(rng.integers(-4096, 4096))])))
        low, high = (-(1 << -bits - 1), 1 << -bits - 1) if bits < 0 else (0, 1 << min(bits, 31))
        return int(rng.integers(low, high))

    def changed(state, fields):
        state = list(state)
        for i in rng.choice(len(fields), rng.integers(0, 12), replace=False):
            state[i] = value(fields[i][1]) if rng.random() < 0.8 else 0
        return state

    out, player, entities = [], list(encoder.NO_PLAYER_STATE), {}
    for step in range(count):
        extra = list(player[len(wire.PLAYER_FIELDS) :])
        if rng.random() < 0.5:
            extra[int(rng.integers(64))] = int(rng.integers(-9, 9999))
        player = changed(player[: len(wire.PLAYER_FIELDS)], wire.PLAYER_FIELDS) + extra
        entities = {n: e for n, e in entities.items() if rng.random() < 0.9}
        for n in rng.choice(1023, 5, replace=False):
            base = entities.get(int(n), encoder.NO_ENTITY_STATE)
            entities[int(n)] = tuple(changed(base, wire.ENTITY_FIELDS))
        out.append((1000 + 50 * step, tuple(player), dict(entities)))
    return out


def test_every_field_of_snapshots_is_decoded_as_it_was_encoded():
    states = random_states(60)
    demo = wire.decode(game(states), "test")
    assert [(s.time, s.player, s.entities) for s in demo.snapshots] == states
    assert (demo.invalid, demo.unread, demo.truncated, demo.starts) == (0, 0, False, 1)
    assert demo.map_name == "tiny" and demo.seconds == 59 * 0.05


def test_a_difference_counts_from_the_snapshot_that_it_names_and_from_the_baseline():
    base = entity_state(x=100.0, kind=2, model=5)
    a, b, c = (player_state(x=float(x)) for x in (1, 2, 3))
    moved = entity_state(x=101.0, kind=2, model=5)
    messages = [
        start_message({0: "\\mapname\\m"}, {7: base}),
        snapshot_message(100, a, {7: base}, baselines={7: base}),
        snapshot_message(150, b, {7: moved}, (a, {7: base}), 1),
        snapshot_message(200, c, {7: base, 8: moved}, (a, {7: base}), 2),  # from the first, not the second
    ]
    demo = wire.decode(file_bytes(messages), "test")
    assert [s.entities for s in demo.snapshots] == [{7: base}, {7: moved}, {7: base, 8: moved}]
    assert [s.player for s in demo.snapshots] == [a, b, c]


def test_a_difference_from_what_was_not_received_is_left_out_and_counted():
    p = player_state()
    messages = [start_message({0: ""}, {}), snapshot_message(100, p, {}), snapshot_message(150, p, {}, (p, {}), 20)]
    demo = wire.decode(file_bytes(messages), "test")
    assert (len(demo.snapshots), demo.invalid) == (1, 1)


def test_commands_change_configuration_strings_once():
    p = player_state()
    messages = [
        start_message({0: "\\mapname\\m", 544: "n\\first"}, {}),
        snapshot_message(100, p, {}, commands=[(1, 'cs 544 "n\\second\\model\\sarge"'), (2, "print hello")]),
        snapshot_message(150, p, {}, commands=[(1, 'cs 544 "n\\repeated"')]),
    ]
    demo = wire.decode(file_bytes(messages), "test")
    assert demo.player_info(0) == {"n": "second", "model": "sarge"}


def test_the_later_of_two_snapshots_of_one_time_counts():
    states = [(100, player_state(x=1.0), {}), (100, player_state(x=2.0), {}), (150, player_state(x=3.0), {})]
    demo = wire.decode(game(states), "test")
    assert [s.player[wire.PLAYER["x"]] for s in demo.snapshots] == [2.0, 3.0]


def test_a_new_start_of_a_map_begins_again():
    p = player_state()
    first = [start_message({0: "\\mapname\\one"}, {}), snapshot_message(100, p, {})]
    second = [start_message({0: "\\mapname\\two"}, {}), snapshot_message(50, p, {})]
    demo = wire.decode(file_bytes(first + second), "test")
    assert (demo.map_name, [s.time for s in demo.snapshots], demo.starts) == ("two", [50], 2)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"glTF" + bytes(100),
        struct.pack("<ii", 1, -7) + bytes(20),
        struct.pack("<ii", 1, 17000) + bytes(17000),
        file_bytes([]),
        file_bytes([encoder.BitWriter().integer(0, 32).integer(99, 8).message()]),
        file_bytes([start_message({}, {}), snapshot_message(100, player_state(), {})[:12]]),
        game([(100, player_state(), {}), (50, player_state(x=1.0), {})]),
    ],
)  # fmt: skip
def test_what_is_no_demo_is_refused(data):
    with pytest.raises(SceneError) as caught:
        wire.decode(data, "file.dm_71")
    assert caught.value.where.startswith("file.dm_71") and "\n" not in str(caught.value)


def test_a_demo_that_ends_early_keeps_what_came_before():
    data = game(random_states(10))
    demo = wire.decode(data[:-20], "test")
    assert demo.truncated and len(demo.snapshots) == 9


def test_snapshots_have_a_budget(monkeypatch):
    player, crowd = player_state(), {n: entity_state(kind=2) for n in range(900)}
    states = [(50 * i, player_state(x=float(i)), crowd) for i in range(300)]
    monkeypatch.setenv("TAUBENCH_MAX_MEMORY", "8MiB")
    with pytest.raises(SceneError):
        wire.decode(game([(-50, player, {})] + states), "test")


def check_laws(demo, speed):
    """What holds in every recording of a game."""
    assert (demo.invalid, demo.unread, demo.truncated, demo.starts) == (0, 0, False, 1)
    times = np.array([s.time for s in demo.snapshots]) / 1000
    assert (np.diff(times) > 0).all()
    column = [wire.PLAYER[name] for name in ("x", "y", "z", "vx", "vy", "vz", "flags", "client")]
    states = np.array([[s.player[c] for c in column] for s in demo.snapshots])
    step = np.diff(states[:, :3], axis=0) / np.diff(times)[:, None]
    jump = np.diff(states[:, 6].astype(int) & wire.TELEPORT) != 0
    same = ~jump & (np.diff(states[:, 7]) == 0)
    assert np.linalg.norm(step[same], axis=1).max() < speed  # a jump of the camera is where the bit is toggled
    wrong = np.abs(step - (states[1:, 3:6] + states[:-1, 3:6]) / 2).max(axis=1)[same]
    assert np.median(wrong) < 15  # units per second: the velocities that are sent are those of the places
    for snapshot in demo.snapshots:  # the camera's player is not among the entities
        assert snapshot.player[wire.PLAYER["client"]] not in snapshot.entities


@pytest.mark.parametrize(
    "name, count, map_name, jumps", [("oa_dm6", 1499, "oa_dm6", 7), ("oa_shouse", 1499, "oa_shouse", 3)]
)
def test_our_recordings(name, count, map_name, jumps):
    demo = read_recording(RECORDINGS / f"{name}.dm_71")[1]
    assert (len(demo.snapshots), demo.map_name) == (count, map_name)
    assert {b.time - a.time for a, b in zip(demo.snapshots, demo.snapshots[1:])} == {16}
    flags = np.array([int(s.player[wire.PLAYER["flags"]]) & wire.TELEPORT for s in demo.snapshots])
    assert (np.diff(flags) != 0).sum() == jumps
    check_laws(demo, 1500)


def test_other_players_are_sent_in_whole_units_and_degrees():
    demo = read_recording(RECORDINGS / "oa_shouse.dm_71")[1]
    columns = [wire.ENTITY[name] for name in ("x", "y", "z", "yaw", "pitch")]
    states = np.array(
        [[e[c] for c in columns] for s in demo.snapshots for e in s.entities.values() if e[wire.ENTITY["kind"]] == 1]
    )
    assert len(states) > 10_000 and (states == np.round(states)).all()  # fmt: skip
    own = np.array([s.player[wire.PLAYER["x"]] for s in demo.snapshots])
    assert (own == np.round(own)).mean() < 0.1


def test_the_games_own_demos(game_demos):
    human = read_recording(game_demos["demos/demo088-test1.dm_71"])[1]
    assert (human.messages, len(human.snapshots), human.seconds) == (3389, 3388, 169.9)
    check_laws(human, 1500)
    at = {s.time: s.player for s in human.snapshots}
    # What the engine itself shows on its screen at these times: armor, and ammunition of the weapon in hand.
    seen = [
        (at[t][len(wire.PLAYER_FIELDS) + 4], at[t][len(wire.PLAYER_FIELDS) + 32 + int(at[t][wire.PLAYER["weapon"]])])
        for t in (191500, 192500, 193500, 194500)
    ]
    assert seen == [(105, 75), (104, 75), (103, 60), (102, 49)]
    heights = {s.player[wire.PLAYER["view_height"]] for s in human.snapshots}
    assert heights == {26}
    old = read_recording(game_demos["demos/boomtest.dm_68"])[1]
    assert (old.messages, old.starts, old.invalid, old.map_name) == (350, 1, 0, "cratere3")
