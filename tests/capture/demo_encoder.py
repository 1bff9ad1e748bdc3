"""Writes demos of the Quake 3 family from states, for tests: the inverse of ``capture.quake3.demo``."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping

from taubench_gl.capture.quake3 import demo as wire
from taubench_gl.capture.quake3.bits import CODES

NO_ENTITY_STATE = (0,) * len(wire.ENTITY_FIELDS)
NO_PLAYER_STATE = (0,) * (len(wire.PLAYER_FIELDS) + 64)


class BitWriter:
    """The fields of one message in order, lowest bit first."""

    def __init__(self) -> None:
        self._value = self._size = 0

    def raw(self, value: int, bits: int) -> BitWriter:
        self._value |= (value & (1 << bits) - 1) << self._size
        self._size += bits
        return self

    def integer(self, value: int, bits: int) -> BitWriter:
        """A field of ``bits``: the odd low bits as they are, whole bytes by the code."""
        odd = bits & 7
        self.raw(value, odd)
        for shift in range(odd, bits, 8):
            self.raw(*CODES[value >> shift & 255])
        return self

    def real(self, value: float) -> BitWriter:
        if float(value).is_integer() and -4096 <= value < 4096:
            return self.raw(0, 1).integer(int(value) + 4096, 13)
        return self.raw(1, 1).integer(struct.unpack("<I", struct.pack("<f", value))[0], 32)

    def text(self, text: str) -> BitWriter:
        for byte in text.encode("latin-1") + b"\0":
            self.integer(byte, 8)
        return self

    def message(self) -> bytes:
        self.integer(wire.END, 8)
        return self._value.to_bytes((self._size + 7) // 8, "little")


def entity_state(**fields: float) -> tuple:
    state = list(NO_ENTITY_STATE)
    for name, value in fields.items():
        state[wire.ENTITY[name]] = value
    return tuple(state)


def player_state(**fields: float) -> tuple:
    state = list(NO_PLAYER_STATE)
    for name, value in ({"health": 100, "view_height": 26} | fields).items():
        state[wire.PLAYER[name]] = value
    return tuple(state)


def put_entity(b: BitWriter, number: int, old: tuple, new: tuple | None) -> None:
    b.integer(number, 10)
    if new is None:
        b.raw(1, 1)
        return
    b.raw(0, 1)
    changed = [i for i in range(len(new)) if new[i] != old[i]]
    b.raw(bool(changed), 1)
    if not changed:
        return
    b.integer(changed[-1] + 1, 8)
    for i in range(changed[-1] + 1):
        b.raw(i in changed, 1)
        if i in changed:
            bits = wire.ENTITY_FIELDS[i][1]
            b.raw(new[i] != 0, 1)
            if new[i] != 0:
                b.real(new[i]) if bits == 0 else b.integer(int(new[i]), abs(bits))


def put_player(b: BitWriter, old: tuple, new: tuple) -> None:
    count = len(wire.PLAYER_FIELDS)
    changed = [i for i in range(count) if new[i] != old[i]]
    last = changed[-1] + 1 if changed else 0
    b.integer(last, 8)
    for i in range(last):
        b.raw(i in changed, 1)
        if i in changed:
            bits = wire.PLAYER_FIELDS[i][1]
            b.real(new[i]) if bits == 0 else b.integer(int(new[i]), abs(bits))
    b.raw(new[count:] != old[count:], 1)
    if new[count:] == old[count:]:
        return
    for array in range(4):
        part = range(count + 16 * array, count + 16 * array + 16)
        mask = sum(1 << i - part[0] for i in part if new[i] != old[i])
        b.raw(mask != 0, 1)
        if mask:
            b.integer(mask, 16)
            for i in part:
                if new[i] != old[i]:
                    b.integer(int(new[i]), 32 if array == 3 else 16)


def start_message(config: Mapping[int, str], baselines: Mapping[int, tuple], client: int = 0) -> bytes:
    b = BitWriter().integer(0, 32).integer(wire.START, 8).integer(0, 32)
    for number, text in config.items():
        b.integer(wire.CONFIG, 8).integer(number, 16).text(text)
    for number, state in baselines.items():
        b.integer(wire.BASELINE, 8)
        put_entity(b, number, NO_ENTITY_STATE, state)
    return b.integer(wire.END, 8).integer(client, 32).integer(0, 32).message()


def snapshot_message(
    time: int,
    player: tuple,
    entities: Mapping[int, tuple],
    old: tuple[tuple, Mapping[int, tuple]] | None = None,
    back: int = 0,
    baselines: Mapping[int, tuple] | None = None,
    commands: Iterable[tuple[int, str]] = (),
) -> bytes:
    """``old``: (player, entities) of the snapshot ``back`` messages before; None: from nothing and the baselines."""
    b = BitWriter().integer(0, 32)
    for number, text in commands:
        b.integer(wire.COMMAND, 8).integer(number, 32).text(text)
    old_player, old_entities = old or (NO_PLAYER_STATE, {})
    b.integer(wire.SNAPSHOT, 8).integer(time, 32).integer(back, 8).integer(0, 8).integer(1, 8).integer(255, 8)
    put_player(b, old_player, player)
    for number in sorted({*old_entities, *entities}):
        before = old_entities.get(number) or (baselines or {}).get(number, NO_ENTITY_STATE)
        if entities.get(number) != old_entities.get(number):
            put_entity(b, number, before, entities.get(number))
    return b.integer(wire.NO_ENTITY, 10).message()


def file_bytes(messages: Iterable[bytes], first: int = 1) -> bytes:
    out = b"".join(struct.pack("<ii", first + i, len(m)) + m for i, m in enumerate(messages))
    return out + struct.pack("<ii", -1, -1)


def game(
    states: Iterable[tuple[int, tuple, Mapping[int, tuple]]],
    map_name: str = "tiny",
    baselines: Mapping[int, tuple] | None = None,
    config: Mapping[int, str] | None = None,
) -> bytes:
    """A demo of (time in ms, player, entities); each snapshot is a difference from the one before."""
    baselines = baselines or {}
    messages = [start_message({0: f"\\mapname\\{map_name}\\sv_hostname\\test"} | dict(config or {}), baselines)]
    old, back = None, 0
    for time, player, entities in states:
        messages.append(snapshot_message(time, player, entities, old, back, baselines))
        old, back = (player, entities), 1
    return file_bytes(messages)
