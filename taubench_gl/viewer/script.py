"""Scripts that drive the viewer through the handlers of the window's callbacks, for tests and repeatable demos.

One command per line; ``#`` starts a comment.  The whole script is parsed before its first line runs.
"""

from __future__ import annotations

import operator
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taubench_gl.data_files import read_text
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.features import FEATURES
from taubench_gl.viewer.actions import ACTIONS, split_chord
from taubench_gl.viewer.app import Viewer
from taubench_gl.viewer.session_file import SUFFIX, is_session
from taubench_gl.viewer.state import set_variable, variables

COMMANDS: dict[str, tuple[int, int, str]] = {
    "frame": (1, 1, "frame N: go to frame N"),
    "key": (1, 1, "key CHORD: press and release a key, such as SPACE or SHIFT+N"),
    "hold": (2, 2, "hold KEY N: hold a key for N frames"),
    "action": (1, 9, "action NAME: run an action"),
    "set": (2, 2, "set NAME VALUE"),
    "mouse": (2, 2, "mouse X Y: move to a window position; mouse @WIDGET F: along a control, F from 0 to 1"),
    "press": (0, 1, "press [BUTTON]: press a mouse button (0 left, 1 right)"),
    "release": (0, 1, "release [BUTTON]"),
    "click": (0, 2, "click [X Y]: press and release the left button; also click @WIDGET F"),
    "drag": (2, 2, "drag X Y: press, move to X Y, release"),
    "scroll": (1, 1, "scroll N: turn the wheel by N steps"),
    "resize": (2, 2, "resize W H: resize the window"),
    "minimize": (0, 0, "minimize: the window has no area until it is resized"),
    "drop": (1, 1, "drop PATH: drop a file on the window"),
    "wait": (1, 1, "wait N: run N frames of 1/fps seconds"),
    "session": (1, 1, "session FILE: save a session file; its name ends with .session.json"),
    "screenshot": (1, 2, "screenshot FILE [window]: save the image, or the window, as PNG"),
    "expect": (3, 4, "expect NAME OP VALUE [TOLERANCE]: OP is one of == != < <= > >="),
    "print": (1, 1, "print NAME: print a variable"),
    "bench": (1, 1, "bench N: print the median frames per second over N played frames"),
    "quit": (0, 0, "quit"),
}
"""Name -> smallest and largest number of arguments, and usage."""

OPERATORS: dict[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq, "!=": operator.ne, "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Line:
    where: str  # file:line
    command: str
    arguments: tuple[str, ...]


def parse(path: Path) -> list[Line]:
    """The commands of a script.  Raises SettingsError at ``file:line`` for an invalid command."""
    text = read_text(path, SettingsError)
    lines = []
    for number, raw in enumerate(text.splitlines(), start=1):
        where = f"{path}:{number}"
        try:
            words = shlex.split(raw, comments=True)
        except ValueError as error:
            raise SettingsError(str(error), where=where) from None
        if not words:
            continue
        command, arguments = words[0], tuple(words[1:])
        if command not in COMMANDS:
            raise SettingsError(
                f"there is no command {command!r}", where=where, hint=f"choose from {', '.join(COMMANDS)}"
            )
        least, most, usage = COMMANDS[command]
        if not least <= len(arguments) <= most:
            raise SettingsError(f"{command} with {len(arguments)} arguments", where=where, hint=f"write {usage}")
        lines.append(Line(where, command, arguments))
    return lines


class ScriptRunner:
    """``present`` shows a frame in the window; ``resize`` requests a size and returns the actual one."""

    def __init__(
        self,
        viewer: Viewer,
        present: Callable[[], None],
        resize: Callable[[int, int], tuple[int, int]],
        report: Callable[[str], None] = print,
    ):
        self._viewer, self._present, self._resize, self._report = viewer, present, resize, report
        self._bench: float | None = None

    def run(self, lines: list[Line]) -> None:
        """Run to the end or to ``quit``.  Raises SettingsError at ``file:line`` for a failed command or expectation."""
        self._frame()
        for line in lines:
            if self._viewer.done:
                return
            try:
                getattr(self, f"do_{line.command}")(*line.arguments)
                self._frame()
            except SettingsError as error:
                raise SettingsError(error.what, where=line.where, hint=error.hint) from None

    def _frame(self, seconds: float = 0.0) -> None:
        self._viewer.tick(seconds)
        self._present()

    # -- commands

    def do_key(self, text: str) -> None:
        key, modifiers = _chord(text)
        held = {m.lower(): True for m in modifiers}
        self._viewer.input.key(key, True, **held)
        self._viewer.input.key(key, False, **held)

    def do_hold(self, text: str, count: str) -> None:
        key, modifiers = _chord(text)
        pressed = [*(["LEFT_SHIFT"] if "SHIFT" in modifiers else []), key]
        for name in pressed:
            self._viewer.input.key(name, True, shift="SHIFT" in modifiers)
        for _ in range(_whole(count)):
            self._frame(1.0 / self._viewer.state.fps)
        for name in pressed:
            self._viewer.input.key(name, False)

    def do_action(self, *words: str) -> None:
        name = " ".join(words)
        if name not in ACTIONS:
            raise SettingsError(f"there is no action {name!r}", hint=f"choose from {', '.join(ACTIONS)}")
        self._viewer.act(name)

    def do_set(self, name: str, value: str) -> None:
        set_variable(self._viewer.state, name, value)

    def do_mouse(self, x: str, y: str) -> None:
        self._viewer.input.mouse_move(*self._place(x, y))

    def do_press(self, button: str = "0") -> None:
        self._viewer.input.mouse_button(_whole(button), True)

    def do_release(self, button: str = "0") -> None:
        self._viewer.input.mouse_button(_whole(button), False)

    def do_click(self, *place: str) -> None:
        if place:
            self.do_mouse(*(place if len(place) == 2 else (*place, "0.5")))
            self._frame()
        self.do_press()
        self._frame()
        self.do_release()
        self._frame()

    def do_drag(self, x: str, y: str) -> None:
        start, end = self._viewer.input.mouse, self._place(x, y)
        self.do_press()
        self._frame()
        for i in range(1, 5):
            self._viewer.input.mouse_move(*(a + (b - a) * i / 4 for a, b in zip(start, end)))
            self._frame()
        self.do_release()

    def do_scroll(self, steps: str) -> None:
        self._viewer.input.scroll(0.0, _number(steps))

    def do_resize(self, width: str, height: str) -> None:
        self._viewer.input.resize(*self._resize(_whole(width), _whole(height)))

    def do_minimize(self) -> None:
        self._viewer.input.resize(0, 0)

    def do_drop(self, path: str) -> None:
        self._viewer.drop([path])

    def do_wait(self, count: str) -> None:
        for _ in range(_whole(count)):
            self._frame(1.0 / self._viewer.state.fps)

    def do_session(self, path: str) -> None:
        if not is_session(path):
            raise SettingsError(f"{path!r} is not a session file", hint=f"give a name that ends with {SUFFIX}")
        if not self._viewer.save_session(Path(path)):
            raise OutputError(self._viewer.state.message)

    def do_screenshot(self, path: str, what: str = "image") -> None:
        if what not in ("image", "window"):
            raise SettingsError(f"screenshot of {what!r}", hint="choose from image, window")
        save = self._viewer.window_screenshot if what == "window" else self._viewer.screenshot
        if not save(Path(path)):
            raise OutputError(self._viewer.state.message)

    def do_expect(self, name: str, sign: str, text: str, tolerance: str = "0") -> None:
        if sign not in OPERATORS:
            raise SettingsError(f"there is no comparison {sign!r}", hint=f"choose from {' '.join(OPERATORS)}")
        found = self._read(name)
        if isinstance(found, str) or found is None:
            got: Any = "none" if found is None else found
            good = OPERATORS[sign](got, text) if sign in ("==", "!=") else False
        elif sign == "==" and _number(tolerance):
            got, good = found, abs(found - _number(text)) <= _number(tolerance)
        else:
            got, good = found, OPERATORS[sign](found, _number(text))
        if not good:
            raise SettingsError(f"expected {name} {sign} {text}, got {got}")

    def do_print(self, name: str) -> None:
        self._report(f"{name} {self._read(name)}")

    def do_bench(self, count: str) -> None:
        self._bench = self._viewer.bench(max(_whole(count), 1), self._present)
        self._report(f"{self._bench:.1f} frames/s, median of {count}")

    def do_quit(self) -> None:
        self._viewer.done = True

    def do_frame(self, number: str) -> None:
        self.do_set("frame", number)

    # -- reading

    def _read(self, name: str) -> Any:
        viewer, group, member = self._viewer, *name.partition(".")[::2]
        known = variables(viewer.state)
        percentages = viewer.engine.percentages()
        if group == "overlay" and member in percentages:
            return percentages[member]
        if group == "count" and member in viewer.engine.counts:
            return viewer.engine.counts[member]
        known |= self._probed() | {"bench": self._bench,
                  "window.width": viewer.window_size[0], "window.height": viewer.window_size[1],
                  "image.width": viewer.engine.feed.size[0], "image.height": viewer.engine.feed.size[1],
                  "scene": viewer.engine.feed.name,
                  "pairs.drawn": viewer.engine.drawn.pairs, "images.drawn": viewer.engine.drawn.images,
                  "light.quality": viewer.engine.light_text(viewer.state),
                  "light.samples": viewer.engine.light_samples(viewer.state)}  # fmt: skip
        if name not in known:
            more = ["overlay.NAME", "count.NAME"]
            raise SettingsError(f"there is no {name!r}", hint=f"choose from {', '.join([*known, *more])}")
        return known[name]

    def _probed(self) -> dict[str, Any]:
        """Readings of the probed pixel; None for each that it does not have."""
        found, names = self._viewer.probe(), self._viewer.probe_names()
        out: dict[str, Any] = {"probe.reason": None if found is None else found.reason}
        for name in ("object", "material"):
            out[f"probe.{name}"] = None if names is None else getattr(names, name)
        exact = found is not None and self._viewer.state.exact
        out["probe.exact"] = self._viewer.engine.exact_words(*found.pixel) if exact else None
        out["probe.lights"] = None if names is None else names.lights_text
        for feature in FEATURES:
            values = None if found is None else found.features.get(feature)
            out[f"probe.{feature}"] = None if values is None else values.distance
        return out

    def _place(self, x: str, y: str) -> tuple[float, float]:
        if not x.startswith("@"):
            return _number(x), _number(y)
        if x[1:] not in self._viewer.panels.widgets:
            shown = ", ".join(self._viewer.panels.widgets) or "none"
            raise SettingsError(f"no control {x[1:]!r} is visible", hint=f"choose from {shown}")
        self._viewer.panels.reveal(x[1:])
        self._frame()
        self._frame()  # scrolling takes effect one frame later
        left, top, width, height = self._viewer.panels.widgets[x[1:]]
        return left + _number(y) * width, top + height / 2


def _chord(text: str) -> tuple[str, set[str]]:
    try:
        return split_chord(text)
    except ValueError as error:
        raise SettingsError(str(error)) from None


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise SettingsError(f"{text!r} is not a number") from None


def _whole(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise SettingsError(f"{text!r} is not a whole number") from None
