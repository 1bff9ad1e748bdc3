"""Recordings of Cube 2 (.dmo, protocol 260): the places of all players, and what happens.

A server records them: packets of (milliseconds, channel, bytes, content).  Channel 0 has places of players, all others
have messages; one that a client sent is wrapped with its number.  Order and parts of the messages are facts of the
protocol (``src/fpsgame/game.h``, ``client.cpp``, ``server.cpp``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from taubench_gl.capture.cube2.packed import Reader, unpacked
from taubench_gl.errors import SceneError
from taubench_gl.memory_budget import require

Array = np.ndarray

_I12 = "i" * 12
MESSAGES = [word.partition(":") for word in f"""
CONNECT SERVINFO WELCOME: INITCLIENT:issi POS TEXT:s SOUND:i CDIS:i SHOOT EXPLODE SUICIDE DIED:iiii DAMAGE:iiiii
HITPUSH:iiiiii SHOTFX:iiiiiiiii EXPLODEFX:iii TRYSPAWN SPAWNSTATE:i{_I12} SPAWN:{_I12} FORCEDEATH:i GUNSELECT:i TAUNT:
MAPCHANGE:sii MAPVOTE TEAMINFO:*si ITEMSPAWN:i ITEMPICKUP ITEMACC:ii TELEPORT:iii JUMPPAD:ii PING PONG:i CLIENTPING:i
TIMEUP:i FORCEINTERMISSION SERVMSG:s ITEMLIST:*ii RESUME:*iiiiii{_I12} EDITMODE:i EDITENT EDITF EDITT EDITM FLIP COPY
PASTE ROTATE REPLACE DELCUBE REMIP: EDITVSLOT UNDO REDO NEWMAP:i GETMAP SENDMAP CLIPBOARD EDITVAR MASTERMODE:i KICK
CLEARBANS CURRENTMASTER:i*ii SPECTATOR:ii SETMASTER SETTEAM:isi BASES BASEINFO BASESCORE REPAMMO BASEREGEN ANNOUNCE:i
LISTDEMOS SENDDEMOLIST GETDEMO SENDDEMO DEMOPLAYBACK:ii RECORDDEMO STOPDEMO CLEARDEMOS TAKEFLAG:iii RETURNFLAG:iii
RESETFLAG:iiiii INVISFLAG:ii TRYDROPFLAG DROPFLAG:iiiiii SCOREFLAG:iiiiiiiii INITFLAGS SAYTEAM:is CLIENT:* AUTHTRY
AUTHKICK AUTHCHAL AUTHANS REQAUTH PAUSEGAME:ii GAMESPEED:ii ADDBOT DELBOT INITAI:iiiiiss FROMAI BOTLIMIT BOTBALANCE
MAPCRC CHECKMAPS SWITCHNAME:s SWITCHMODEL:i SWITCHTEAM INITTOKENS TAKETOKEN EXPIRETOKENS DROPTOKENS DEPOSITTOKENS
STEALTOKENS SERVCMD:s DEMOPACKET:""".split()]  # fmt: skip
"""Name and parts of each message, as the server sends it: i an integer, s a text, * a list that the next parts repeat;
no colon: it is not in a recording that we know."""
STEP = 1 / 16
"""Step of stored places in cubes: places are cut off to whole steps, angles to whole degrees."""
_ROW_BYTES, _EVENT_BYTES = 400, 400


@dataclass(frozen=True)
class Event:
    """A message.  ``ms``: milliseconds; ``sender``: number of the client that sent it, -1: the server."""

    ms: int
    sender: int
    name: str
    values: tuple


@dataclass(frozen=True)
class Demo:
    """A recording.  ``rows``: (n, 8) milliseconds, player, life, place of the feet in whole STEPs (3), yaw and
    pitch in whole degrees; yaw grows to the right, pitch upward; axes are the engine's.

    ``truncated``: the file ends early.
    """

    name: str
    rows: Array
    events: list[Event]
    ms: tuple[int, int]
    truncated: bool

    @property
    def map_name(self) -> str:
        return next((str(event.values[0]) for event in self.events if event.name == "MAPCHANGE"), "")

    @property
    def seconds(self) -> float:
        return (self.ms[1] - self.ms[0]) / 1000

    @property
    def names(self) -> dict[int, str]:
        """Number -> name of each player."""
        parts = {"INITCLIENT": 1, "INITAI": 5}
        return {e.values[0]: e.values[parts[e.name]] for e in self.events if e.name in parts}


class _Packet(Reader):
    def byte(self) -> int:
        return self.bytes(1)[0]

    def integer(self) -> int:
        """The next integer: one byte, of which -128 and -127 announce an integer of two and of four bytes."""
        first = self.get("b")
        return self.get("h") if first == -128 else self.get("i") if first == -127 else first

    def unsigned(self) -> int:
        """The next unsigned integer: seven bits a byte, at most four bytes."""
        value = 0
        for k in range(4):
            byte = self.byte()
            value |= (byte if k == 3 else byte & 127) << 7 * k
            if byte < 128:
                break
        return value

    def string(self) -> str:
        return bytes(value & 255 for value in iter(self.integer, 0)).decode("latin-1")

    def place(self) -> tuple[int, ...]:
        """The columns of ``Demo.rows`` after the time."""
        client, state, flags = self.unsigned(), self.byte(), self.unsigned()
        feet = []
        for axis in range(3):
            value = self.get("H")
            if flags >> axis & 1:
                value |= self.get("b") << 16
            feet.append(value)
        turn, _ = self.get("HB")  # the roll: the engine's camera that follows a player has none
        self.bytes(4 if flags & 8 else 3)  # speed and its direction
        if flags & 16:  # falling
            self.bytes((2 if flags & 32 else 1) + (2 if flags & 64 else 0))
        return client, state >> 3 & 1, *feet, turn % 360, min(turn // 360, 180) - 90


def decode(data: bytes, name: str) -> Demo:
    """Decode the bytes of a recording; ``name``: of the file, for errors.  Raises SceneError."""
    content, whole = unpacked(data, name, "recording of Cube 2 (.dmo)")
    reader = Reader(content, name, 24)
    if content[:16] != b"SAUERBRATEN_DEMO" or len(content) < 24:
        raise SceneError("is no recording of Cube 2 (.dmo)", where=name, hint="it does not begin with SAUERBRATEN_DEMO")
    rows: list[tuple[int, ...]] = []
    events: list[Event] = []
    stamps: list[int] = []
    while reader.at + 12 <= len(content):
        ms, channel, size = reader.get("3i")
        if not 0 <= size <= 1 << 24 or stamps[-1:] > [ms]:
            raise reader.bad(f"declares a packet of {size} bytes at {ms} ms")
        if reader.at + size > len(content):
            whole = False
            break
        packet = _Packet(reader.bytes(size), f"{name}: packet {len(stamps)} at {ms} ms")
        while packet.at < size:
            _message(packet, ms, -1, rows if channel == 0 else [], events)
        stamps.append(ms)
        if len(stamps) % 256 == 0:
            require(len(rows) * _ROW_BYTES + len(events) * _EVENT_BYTES, "its messages", SceneError, name)
    table = np.array(rows, np.int64).reshape(-1, 8)
    if not len(table):
        raise SceneError("holds no place of a player", where=name, hint="give a recording of a match that was played")
    return Demo(name, table, events, (stamps[0], stamps[-1]), not whole or reader.at < len(content))


def _message(p: _Packet, ms: int, sender: int, rows: list, events: list[Event]) -> None:
    number = p.integer()
    if not 0 <= number < len(MESSAGES):
        raise p.bad(f"has a message of unknown kind {number}")
    name, known, form = MESSAGES[number]
    if name == "POS":
        rows.append((ms, *p.place()))
        return
    if not known:
        raise p.bad(f"has a message {name}, which recordings of this protocol do not have")
    if name == "CLIENT" and sender < 0:
        client, size = p.integer(), p.unsigned()
        inner = _Packet(p.bytes(size), p.where)
        while inner.at < size:
            _message(inner, ms, client, rows, events)
        return
    read = {"i": p.integer, "s": p.string}
    fixed, _, repeated = form.partition("*")
    values = [read[part]() for part in fixed]
    if repeated:  # until a number below 0, or an empty text
        end = (lambda value: value == "") if repeated[0] == "s" else partial(int.__gt__, 0)
        while not end(first := read[repeated[0]]()):
            values.append((first, *(read[part]() for part in repeated[1:])))
    events.append(Event(ms, sender, name, tuple(values)))
