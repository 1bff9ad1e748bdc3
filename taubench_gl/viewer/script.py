"""Scripts that drive the viewer through the handlers of the window's callbacks, for tests and repeatable demos.

One command per line; ``#`` starts a comment.  The whole script is parsed before its first line runs.
"""

from __future__ import annotations

import inspect
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

OPERATORS: dict[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq, "!=": operator.ne, "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Line:
    """One command of a script."""

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
            hint = f"choose from {', '.join(COMMANDS)}"
            raise SettingsError(f"there is no command {command!r}", where=where, hint=hint)
        try:
            inspect.signature(COMMANDS[command]).bind(None, *arguments)
        except TypeError:
            hint = f"write {COMMANDS[command].__doc__}"
            raise SettingsError(f"{command} with {len(arguments)} arguments", where=where, hint=hint) from None
        lines.append(Line(where, command, arguments))
    return lines


class ScriptRunner:
    """Runs a script in a viewer.  ``present`` shows a frame in the window; ``resize`` requests a size and returns the
    actual one.
    """

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
                COMMANDS[line.command](self, *line.arguments)
                self._frame()
            except SettingsError as error:
                raise SettingsError(error.what, where=line.where, hint=error.hint) from None

    def _frame(self, seconds: float = 0.0) -> None:
        self._viewer.tick(seconds)
        self._present()

    # -- commands

    def do_key(self, text: str) -> None:
        """key CHORD: press and release a key, such as SPACE or SHIFT+N"""
        key, modifiers = _chord(text)
        held = {m.lower(): True for m in modifiers}
        self._viewer.input.key(key, True, **held)
        self._viewer.input.key(key, False, **held)

    def do_hold(self, text: str, count: str) -> None:
        """hold KEY N: hold a key for N frames"""
        key, modifiers = _chord(text)
        pressed = [*(["LEFT_SHIFT"] if "SHIFT" in modifiers else []), key]
        for name in pressed:
            self._viewer.input.key(name, True, shift="SHIFT" in modifiers)
        for _ in range(_whole(count)):
            self._frame(1.0 / self._viewer.state.fps)
        for name in pressed:
            self._viewer.input.key(name, False)

    def do_action(self, first: str, *words: str) -> None:
        """action NAME: run an action"""
        name = " ".join((first, *words))
        if name not in ACTIONS:
            raise SettingsError(f"there is no action {name!r}", hint=f"choose from {', '.join(ACTIONS)}")
        self._viewer.act(name)

    def do_set(self, name: str, value: str) -> None:
        """set NAME VALUE"""
        set_variable(self._viewer.state, name, value)

    def do_mouse(self, x: str, y: str) -> None:
        """mouse X Y: move to a window position; mouse @WIDGET F: along a control, F from 0 to 1"""
        self._viewer.input.mouse_move(*self._place(x, y))

    def do_press(self, button: str = "0") -> None:
        """press [BUTTON]: press a mouse button (0 left, 1 right)"""
        self._viewer.input.mouse_button(_whole(button), True)

    def do_release(self, button: str = "0") -> None:
        """release [BUTTON]"""
        self._viewer.input.mouse_button(_whole(button), False)

    def do_click(self, x: str | None = None, y: str = "0.5") -> None:
        """click [X Y]: press and release the left button; also click @WIDGET F"""
        if x is not None:
            self.do_mouse(x, y)
            self._frame()
        self.do_press()
        self._frame()
        self.do_release()
        self._frame()

    def do_drag(self, x: str, y: str) -> None:
        """drag X Y: press, move to X Y, release"""
        start, end = self._viewer.input.mouse, self._place(x, y)
        self.do_press()
        self._frame()
        for i in range(1, 5):
            self._viewer.input.mouse_move(*(a + (b - a) * i / 4 for a, b in zip(start, end)))
            self._frame()
        self.do_release()

    def do_scroll(self, steps: str) -> None:
        """scroll N: turn the wheel by N steps"""
        self._viewer.input.scroll(0.0, _number(steps))

    def do_resize(self, width: str, height: str) -> None:
        """resize W H: resize the window"""
        self._viewer.input.resize(*self._resize(_whole(width), _whole(height)))

    def do_minimize(self) -> None:
        """minimize: the window has no area until it is resized"""
        self._viewer.input.resize(0, 0)

    def do_drop(self, path: str) -> None:
        """drop PATH: drop a file on the window"""
        self._viewer.drop([path])

    def do_wait(self, count: str) -> None:
        """wait N: run N frames of 1/fps seconds"""
        for _ in range(_whole(count)):
            self._frame(1.0 / self._viewer.state.fps)

    def do_session(self, path: str) -> None:
        """session FILE: save a session file; its name ends with .session.json"""
        if not is_session(path):
            raise SettingsError(f"{path!r} is not a session file", hint=f"give a name that ends with {SUFFIX}")
        if not self._viewer.save_session(Path(path)):
            raise OutputError(self._viewer.state.message)

    def do_screenshot(self, path: str, part: str = "image") -> None:
        """screenshot FILE [window]: save the image, or the window, as PNG"""
        if part not in ("image", "window"):
            raise SettingsError(f"screenshot of {part!r}", hint="choose from image, window")
        save = self._viewer.window_screenshot if part == "window" else self._viewer.screenshot
        if not save(Path(path)):
            raise OutputError(self._viewer.state.message)

    def do_expect(self, name: str, sign: str, text: str, tolerance: str = "0") -> None:
        """expect NAME OP VALUE [TOLERANCE]: OP is one of == != < <= > >="""
        if sign not in OPERATORS:
            raise SettingsError(f"there is no comparison {sign!r}", hint=f"choose from {' '.join(OPERATORS)}")
        value = self._read(name)
        if isinstance(value, str) or value is None:
            got: Any = "none" if value is None else value
            good = OPERATORS[sign](got, text) if sign in ("==", "!=") else False
        elif sign == "==" and _number(tolerance):
            got, good = value, abs(value - _number(text)) <= _number(tolerance)
        else:
            got, good = value, OPERATORS[sign](value, _number(text))
        if not good:
            raise SettingsError(f"expected {name} {sign} {text}, got {got}")

    def do_print(self, name: str) -> None:
        """print NAME: print a variable"""
        self._report(f"{name} {self._read(name)}")

    def do_bench(self, count: str) -> None:
        """bench N: print the median frames per second over N played frames"""
        if (frames := _whole(count)) < 1:
            raise SettingsError(f"bench is {frames}", hint="give 1 frame or more")
        self._bench = self._viewer.bench(frames, self._present)
        self._report(f"{self._bench:.1f} frames/s, median of {frames}")

    def do_quit(self) -> None:
        """quit"""
        self._viewer.done = True

    def do_frame(self, number: str) -> None:
        """frame N: go to frame N"""
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
                  "light.quality": viewer.engine.lights.text(viewer.state),
                  "light.samples": viewer.engine.lights.samples,
                  "light.traced": viewer.engine.lights.traced}  # fmt: skip
        known |= {f"method.{n}": v for n, v in viewer.engine.method_scores(viewer.state).items()}
        if name not in known:
            choices = [*known, "overlay.NAME", "count.NAME"]
            raise SettingsError(f"there is no {name!r}", hint=f"choose from {', '.join(choices)}")
        return known[name]

    def _probed(self) -> dict[str, Any]:
        """Readings of the probed pixel; None for each that it does not have."""
        explained, names = self._viewer.probe(), self._viewer.probe_names()
        out: dict[str, Any] = {"probe.reason": None if explained is None else explained.reason}
        for name in ("object", "material"):
            out[f"probe.{name}"] = None if names is None else getattr(names, name)
        exact = explained is not None and self._viewer.state.exact
        out["probe.exact"] = self._viewer.engine.exact_words(*explained.pixel) if exact else None
        state, pixel = self._viewer.state, explained and explained.pixel
        out["probe.reservoir"] = None if pixel is None else self._viewer.engine.reservoir_words(state, *pixel)
        for feature in FEATURES:
            values = None if explained is None else explained.features.get(feature)
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


COMMANDS: dict[str, Callable[..., None]] = {
    name.removeprefix("do_"): method for name, method in vars(ScriptRunner).items() if name.startswith("do_")
}
"""Name -> method, whose docstring is the usage."""


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
