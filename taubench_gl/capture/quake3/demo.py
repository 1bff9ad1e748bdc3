"""Demos of the Quake 3 family (.dm_68, .dm_71): messages, the state at the start, snapshots.

A demo is a sequence of (int32 number, int32 bytes, message); both are -1 at the end.  A message is read by ``bits``.
Entities and players are sent as differences from an earlier snapshot or from the baselines of the start.  Order and
width of the fields are facts of the wire format, read in ioquake3 (``code/qcommon/msg.c``, ``code/client/cl_parse.c``);
the names are ours.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

from taubench_gl.capture.quake3.bits import BitReader
from taubench_gl.errors import SceneError
from taubench_gl.memory_budget import require

MAX_MESSAGE = 16384
NO_ENTITY = 1023
"""Entity number that ends a list."""
NOTHING, START, CONFIG, BASELINE, COMMAND, DOWNLOAD, SNAPSHOT, END = range(1, 9)
SERVER_INFO, GAME_VERSION, PLAYER_INFO = 0, 20, 544
"""Numbers of configuration strings: that of the server, of the game, and of the first player."""
MAX_PLAYERS = 64
KEPT = 32
"""Snapshots back to which a difference may refer."""
_ENTRY_BYTES = 120  # of one entity in a kept snapshot: its place in a dictionary, and its share of a changed state


def _fields(text: str) -> tuple[tuple[str, int], ...]:
    """(name, bits) of each word NAME:BITS; 0 bits: a real number, below 0: signed."""
    return tuple((word.partition(":")[0], int(word.partition(":")[2] or 0)) for word in text.split())


ENTITY_FIELDS = _fields(
    "time:-32 x y vx vy z yaw vz pitch event:10 aim_yaw kind:8 torso:8 event_value:8 legs:8 ground:10 path:8 flags:19 "
    "other:10 weapon:8 client:8 fixed_yaw duration:-32 turn_path:8 origin_x origin_y origin_z solid:24 powers:16 "
    "model:8 other2:10 sound:8 generic:8 to_z to_x to_y model2:8 fixed_pitch frame_time:-32 turn_time:-32 "
    "turn_duration:-32 roll turn_pitch turn_yaw turn_roll frame_time2:-32 fixed_roll aim_pitch aim_roll light:-32 "
    "frame:16"
)
PLAYER_FIELDS = _fields(
    "command_time:32 x y bob:8 vx vy yaw pitch weapon_time:-16 z vz legs_time:8 move_time:-16 events:16 torso:8 "
    "direction:4 event0:8 legs:8 event1:8 move_flags:16 ground:10 weapon_state:4 flags:16 outer_event:10 gravity:16 "
    "speed:16 add_yaw:16 outer_value:8 view_height:-8 hit_event:8 hit_yaw:8 hit_pitch:8 hit:8 generic:8 mode:8 "
    "add_pitch:16 add_roll:16 torso_time:12 value0:8 value1:8 client:8 weapon:5 roll hook_x hook_y hook_z pad:10 "
    "sound:16"
)
ENTITY = {name: i for i, (name, _) in enumerate(ENTITY_FIELDS)}
"""Column of each field in an entity's state."""
PLAYER = {name: i for i, (name, _) in enumerate(PLAYER_FIELDS)} | {
    "health": len(PLAYER_FIELDS),  # the first of 16 status numbers
    "team": len(PLAYER_FIELDS) + 16 + 3,  # of 16 lasting numbers; 16 of ammunition and 16 of power-ups follow
}
"""Column of each field in the recording player's state."""
_NO_ENTITY_STATE = (0,) * len(ENTITY_FIELDS)
_NO_PLAYER_STATE = (0,) * (len(PLAYER_FIELDS) + 4 * 16)
TELEPORT, DEAD, HIDDEN = 4, 1, 128
"""Bits of ``flags``: toggled by a teleport, a dead body, not drawn."""
SPECTATOR = 3
"""``team`` of a player who only watches."""

State = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The state of the game at one time.  ``time``: milliseconds of the server; ``entities``: number -> state."""

    time: int
    player: State
    entities: dict[int, State]


@dataclass
class Demo:
    """What a demo holds.  ``snapshots``: with increasing times, those after the last start of a map."""

    name: str
    config: dict[int, str] = field(default_factory=dict)
    baselines: dict[int, State] = field(default_factory=dict)
    snapshots: list[Snapshot] = field(default_factory=list)
    commands: int = 0
    messages: int = 0
    starts: int = 0
    invalid: int = 0  # snapshots that count from one that was not received
    unread: int = 0  # messages with two or more unread bytes after their end
    truncated: bool = False
    entries: int = 0  # entities in all snapshots

    @property
    def map_name(self) -> str:
        return info_values(self.config.get(SERVER_INFO, "")).get("mapname", "").lower()

    @property
    def seconds(self) -> float:
        """Seconds from the first snapshot to the last."""
        return (self.snapshots[-1].time - self.snapshots[0].time) / 1000

    @property
    def death_yaw(self) -> int:
        """Column of the yaw that a dead player looks at: OpenArena has one more status number before it."""
        return PLAYER["health"] + (5 if self.config.get(GAME_VERSION, "").startswith("baseoa") else 4)

    def player_info(self, client: int) -> dict[str, str]:
        """Name (``n``), model, head model (``hmodel``) and team (``t``) of a player; empty if there is none."""
        return info_values("\\" + self.config.get(PLAYER_INFO + client, ""))


def info_values(text: str) -> dict[str, str]:
    r"""``\key\value\key\value`` as a dictionary."""
    parts = text.split("\\")[1:]
    return dict(zip(parts[::2], parts[1::2], strict=False))


def decode(data: bytes, name: str) -> Demo:
    """Decode the bytes of a demo; ``name``: of the file, for errors.  One that ends early has ``truncated`` set.

    Raises SceneError for what is no demo or damaged.
    """
    demo, at, recent = Demo(name), 0, {}
    while True:
        number, size = struct.unpack_from("<ii", data, at) if at + 8 <= len(data) else (0, -2)
        if size == -1:
            break
        if at + 8 > len(data) or (0 <= size <= MAX_MESSAGE and at + 8 + size > len(data)):
            demo.truncated = True
            break
        if not 0 <= size <= MAX_MESSAGE:
            hint = "is it a demo of Quake 3 or OpenArena (.dm_68, .dm_71)?"
            raise SceneError(f"byte {at} declares a message of {size} bytes", where=name, hint=hint)
        reader = BitReader(data[at + 8 : at + 8 + size], f"{name}: message {number} at byte {at}")
        _read_message(demo, reader, number, recent)
        at += 8 + size
        demo.messages += 1
        if demo.messages % 256 == 0:
            require(demo.entries * _ENTRY_BYTES, "its snapshots", SceneError, name)
    if not demo.snapshots:
        raise SceneError("holds no snapshot of a game", where=name, hint="give a demo (.dm_68, .dm_71) that was played")
    return demo


def _read_message(demo: Demo, b: BitReader, number: int, recent: dict[int, Snapshot]) -> None:
    b.unsigned(32)  # acknowledges a command of the client
    while (kind := b.unsigned(8)) != END:
        if kind == COMMAND:
            _read_command(demo, b)
        elif kind == START:
            recent.clear()
            _read_start(demo, b)
        elif kind == SNAPSHOT:
            _read_snapshot(demo, b, number, recent)
        elif kind != NOTHING:
            raise b.bad(f"has a part of unknown kind {kind}")
    demo.unread += b.end - b.at >= 16


def _read_command(demo: Demo, b: BitReader) -> None:
    """A text of the server; ``cs N "TEXT"`` replaces a configuration string.  Each is repeated until acknowledged."""
    number, text = b.unsigned(32), b.text()
    if number <= demo.commands:
        return
    demo.commands = number
    words = text.split(" ", 2)
    if words[0] == "cs" and len(words) == 3 and words[1].isdecimal() and len(words[1]) < 6:
        demo.config[int(words[1])] = words[2].strip('"')


def _read_start(demo: Demo, b: BitReader) -> None:
    """The state at the start of a map: configuration strings and baselines.  What was before belongs to another map."""
    demo.config, demo.baselines, demo.snapshots = {}, {}, []
    demo.starts += 1
    demo.commands = b.unsigned(32)
    while (kind := b.unsigned(8)) != END:
        if kind == CONFIG:
            number = b.unsigned(16)
            demo.config[number] = b.text()
        elif kind == BASELINE:
            number = b.unsigned(10)
            demo.baselines[number] = _read_entity(b, _NO_ENTITY_STATE) or _NO_ENTITY_STATE
        else:
            raise b.bad(f"the start of the map has a part of unknown kind {kind}")
    b.unsigned(64)  # the number of the client, which is not always the recording player, and a checksum


def _read_snapshot(demo: Demo, b: BitReader, number: int, recent: dict[int, Snapshot]) -> None:
    time, back, _ = b.signed(32), b.unsigned(8), b.unsigned(8)
    for _ in range(b.unsigned(8)):
        b.unsigned(8)  # areas that the player cannot see
    old = recent.get(number - back) if back else None
    player = _read_player(b, old.player if old else _NO_PLAYER_STATE)
    entities = dict(old.entities) if old else {}
    while (n := b.unsigned(10)) != NO_ENTITY:
        state = _read_entity(b, entities.get(n) or demo.baselines.get(n, _NO_ENTITY_STATE))
        if state is None:
            entities.pop(n, None)
        else:
            entities[n] = state
    if back and old is None:
        demo.invalid += 1
        return
    snapshot = Snapshot(time, player, entities)
    recent[number] = snapshot
    recent.pop(number - KEPT, None)
    if demo.snapshots and time < demo.snapshots[-1].time:
        raise b.bad(f"time goes back from {demo.snapshots[-1].time} to {time} ms")
    if demo.snapshots and time == demo.snapshots[-1].time:
        demo.snapshots.pop()  # the later one counts
    demo.snapshots.append(snapshot)
    demo.entries += len(entities) + 8


def _read_entity(b: BitReader, old: State) -> State | None:
    """The state of an entity, which differs from ``old`` in some fields; None: it is removed."""
    if b.bit():
        return None
    return _read_fields(b, ENTITY_FIELDS, old) if b.bit() else old


def _read_player(b: BitReader, old: State) -> State:
    """The state of the recording player: the fields, then four arrays of 16 numbers."""
    new = list(_read_fields(b, PLAYER_FIELDS, old))
    if b.bit():
        for array in range(4):
            if b.bit():
                changed = b.unsigned(16)
                for k in range(16):
                    if changed >> k & 1:
                        new[len(PLAYER_FIELDS) + 16 * array + k] = b.signed(32 if array == 3 else 16)
    return tuple(new)


def _read_fields(b: BitReader, fields: tuple[tuple[str, int], ...], old: State) -> State:
    """``old`` with the fields that differ.  Those of entities have a flag for 0."""
    count = b.unsigned(8)
    if count > len(fields):
        raise b.bad(f"a state has {count} of {len(fields)} fields")
    new = list(old)
    for i in range(count):
        if b.bit():
            bits = fields[i][1]
            if fields is ENTITY_FIELDS and not b.bit():
                new[i] = 0
            else:
                new[i] = b.real() if bits == 0 else b.unsigned(bits) if bits > 0 else b.signed(-bits)
    return tuple(new)
