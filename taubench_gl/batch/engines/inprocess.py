"""The engine that needs nothing: units run here, one after another."""

from __future__ import annotations

import traceback
from collections.abc import Callable

from taubench_gl.batch.units import Event, Failed, Finished, PairDone, Slot, Unit
from taubench_gl.batch.work import NoOpenGL, Workbench
from taubench_gl.errors import TaubenchError


class InProcess:
    """``on_pair`` hears of every pair while a unit runs: ``wait`` returns only at its end."""

    def __init__(self, on_pair: Callable[[PairDone], None] = lambda event: None):
        self._bench = Workbench()
        self._on_pair = on_pair
        self._unit: Unit | None = None
        self._last: str | None = None

    def __enter__(self) -> InProcess:
        return self

    def __exit__(self, *exc: object) -> None:
        self._bench.release()

    def describe(self) -> str:
        return "this process"

    def width(self) -> int:
        return 1

    def idle(self) -> list[Slot]:
        return [] if self._unit is not None else [Slot(0, self._last)]

    def submit(self, slot: Slot, unit: Unit) -> None:
        self._unit, self._last = unit, unit.job

    def wait(self) -> list[Event]:
        unit, self._unit = self._unit, None
        return [attempt(self._bench, unit, lambda: self._on_pair(PairDone(unit)))]


def attempt(bench: Workbench, unit: Unit, on_pair: Callable[[], None] = lambda: None) -> Event:
    """Run a unit; what it raised becomes an event.  NoOpenGL is left to the caller, who knows what worker this is."""
    try:
        return Finished(unit, bench.run(unit, on_pair))
    except NoOpenGL:
        raise
    except TaubenchError as error:
        return _failed(bench, unit, str(error))
    except Exception as error:
        # A fault of ours or of a library's, in one scene: its log says all of it, and the other scenes still run.
        return _failed(bench, unit, f"{unit.scene}: internal error, {type(error).__name__}: {error}")


def _failed(bench: Workbench, unit: Unit, message: str) -> Failed:
    details = traceback.format_exc()
    bench.release()
    return Failed(unit, " ".join(message.split()), f"in {unit.name} of {unit.scene}\n\n{details}")
