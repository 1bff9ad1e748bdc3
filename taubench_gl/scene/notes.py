"""Notes of a reader: what it decided, ignored or repaired, one counted note for each kind of finding.

A *repair* is a departure from the format that other programs allow and that the reader corrects; ``strict`` readers
raise instead.  A *remark* is allowed by the format and noted by both.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from msgspec import Struct

from taubench_gl.data_files import read_toml
from taubench_gl.errors import SceneError
from taubench_gl.scene.model import Note

MAX_SHOWN = 8
"""Most names that one note lists."""


def listed(names: Iterable[str]) -> str:
    """The first ``MAX_SHOWN`` of ``names`` and how many more there are."""
    names = list(names)
    ending = f" and {len(names) - MAX_SHOWN} more" if len(names) > MAX_SHOWN else ""
    return ", ".join(names[:MAX_SHOWN]) + ending


class Kind(Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """A kind of finding: ``counted``, with ``{s}`` for the plural, and what the reader does about it."""

    counted: str
    consequence: str

    def message(self, count: int, details: tuple[str, ...] = ()) -> str:
        """``3 normals ...: normalized``, with the distinct ``details`` in parentheses."""
        named = f" ({listed(details)})" if details else ""
        return f"{count} {self.counted.replace('{s}', '' if count == 1 else 's')}{named}: {self.consequence}"


_FILE = read_toml(Path(__file__).with_name("notes.toml"), dict[str, dict[str, Kind]])

REPAIRS, REMARKS = _FILE["repairs"], _FILE["remarks"]
"""Kind of a repair, and of a remark -> its words."""


@dataclass(slots=True)
class _Tally:
    count: int
    where: str  # of the first
    keys: set[str]  # counted ones
    details: dict[str, None]


class Notes:
    """Collects the notes of one reader."""

    def __init__(self, strict: bool = False):
        self.strict = strict
        self._plain: dict[Note, None] = {}  # an ordered set
        self._tallies: dict[str, _Tally] = {}

    def add(self, message: str, where: str = "") -> None:
        """A decision that concerns the whole file; equal notes are recorded once."""
        self._plain[Note(message, where)] = None

    def remark(self, kind: str, where: str = "", count: int = 1, detail: str = "", key: str = "") -> None:
        """Count ``count`` findings of a kind of ``REMARKS``.

        ``detail``: a name shown in the note.  ``key``: findings of one kind with one key count once; '': ``where``.
        """
        assert kind in REMARKS, kind
        self._tally(kind, where, count, detail, key or where)

    def repair(self, kind: str, error: SceneError, count: int = 1, detail: str = "", where: str | None = None) -> None:
        """Count ``count`` departures of a kind of ``REPAIRS``; strict: raise ``error`` instead.

        ``where``: as in notes; None: that of the error.
        """
        assert kind in REPAIRS, kind
        if self.strict:
            raise error
        if where is None:
            where = error.where or ""
        self._tally(kind, where, count, detail, where)

    def _tally(self, kind: str, where: str, count: int, detail: str, key: str) -> None:
        tally = self._tallies.setdefault(kind, _Tally(0, where, set(), {}))
        if key and key in tally.keys:
            return
        tally.keys.add(key)
        tally.count += count
        if detail:
            tally.details[detail] = None

    def all(self) -> tuple[Note, ...]:
        """Plain notes in the order of recording, then the counted ones."""
        counted = (
            Note((REPAIRS.get(kind) or REMARKS[kind]).message(t.count, tuple(t.details)), t.where, kind, t.count)
            for kind, t in self._tallies.items()
        )
        return (*self._plain, *counted)
