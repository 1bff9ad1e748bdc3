"""The walks of docs/walks.md: every command, click and key of the page, and what it says one sees."""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from page_tools import opened

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs" / "walks.md").read_text(encoding="utf-8")
WALKS = dict(re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", TEXT, re.MULTILINE | re.DOTALL))
MARKED = re.compile(r"`(?P<code>[^`]+)`|(?P<drag>[Dd]rag )?\*\*(?P<bold>.+?)\*\*(?: is (?P<state>on|off)\b)?")
KEYS = {"Right": "ArrowRight", "Shift+Right": "Shift+ArrowRight", "Page Down": "PageDown", "N": "n"}
"""Keys as the pages write them -> names of Playwright."""
CONTROLS = ("button", "checkbox", "radio", "link", "slider")
SEEN = "(text) => document.body.innerText.replace(/\\s+/g, ' ').includes(text)"
ON = "(node) => (node.ariaPressed ?? String(node.checked)) === 'true'"


def steps(walk: str) -> list[tuple[str, str]]:
    """What one does and what one sees, in the order of the numbers."""
    rows = re.findall(r"^\| (\d+) \| (.+?) \| (.+?) \|$", WALKS[walk], re.MULTILINE)
    assert [int(number) for number, *_ in rows] == list(range(1, len(rows) + 1))
    return [(do, see) for _, do, see in rows]


@dataclass
class Walker:
    """Does the steps of one walk in a folder.  Steps in the viewer wait until it ends: it runs once, by a script."""

    folder: Path
    display: dict[str, str]
    open_page: Any
    page: Any = None
    viewer: list[str] = field(default_factory=list)
    script: list[str] = field(default_factory=list)
    printed: str = ""

    def step(self, do: str, see: str) -> None:
        self.printed = ""
        for mark in MARKED.finditer(do):
            self.act(mark)
        for mark in MARKED.finditer(see):
            self.check(mark)

    def act(self, mark: re.Match[str]) -> None:
        code, name = mark["code"], mark["bold"]
        if name:
            control = self.control(name)
            control.press("End") if mark["drag"] else control.click()
        elif code.startswith("taubench-gl "):
            self.run(shlex.split(code)[1:])
        elif code.endswith(".html"):
            self.leave_the_viewer()
            self.page = self.open_page(self.folder / code)
        elif self.viewer:
            self.script.append(f"key {code}")
        else:
            self.page.keyboard.press(KEYS[code])

    def check(self, mark: re.Match[str]) -> None:
        code, name = mark["code"], mark["bold"]
        if code and self.viewer:
            self.script.append(f"expect {code}")
        elif code:
            assert (self.folder / code).stat().st_size > 0, code
        elif mark["state"]:
            node = self.control(name).element_handle()
            self.page.wait_for_function(ON if mark["state"] == "on" else f"(node) => !({ON})(node)", arg=node)
        elif self.printed:
            assert name in self.printed, f"{name}: {self.printed}"
        else:
            self.page.wait_for_function(SEEN, arg=name)

    def control(self, name: str) -> Any:
        """The first visible control of that name; links also by how their name starts."""
        self.page.wait_for_load_state()
        for role in CONTROLS:
            found = self.page.get_by_role(role, name=re.compile(rf"^{re.escape(name)}:?(?=$|\s)"))
            if found.count():
                return found.first
        raise AssertionError(f"no control is named {name}")

    def run(self, words: list[str]) -> None:
        self.leave_the_viewer()
        if words[0] == "view":
            self.viewer = words
        elif words[-1] == "--view":
            self.viewer = ["view", str(self.lesson(words[1]))]
        else:
            self.page = None
            self.printed += " ".join(self.done(words).split())

    def lesson(self, name: str) -> Path:
        """The session that ``demo NAME --view`` opens; the command itself takes no script."""
        from taubench_gl.apps.demo_command import write_session
        from taubench_gl.datasets.gltf_from_scene import write_scene
        from taubench_gl.demos.lessons import find_demo

        demo, file = find_demo(name), self.folder / f"{name}-lesson.glb"
        write_scene(demo.scene(), file)
        return write_session(demo, file, None)

    def leave_the_viewer(self) -> None:
        if self.viewer:
            steps = self.folder / "steps.txt"
            steps.write_text("\n".join([*self.script, "quit", ""]))
            self.done([*self.viewer, "--script", steps.name])
            self.viewer, self.script = [], []

    def done(self, words: list[str]) -> str:
        run = [sys.executable, "-m", "taubench_gl", *words]
        variables = self.display | {"PYTHONPATH": str(ROOT)}
        done = subprocess.run(run, cwd=self.folder, env=variables, capture_output=True, text=True, timeout=900)
        assert done.returncode == 0, f"{words}: {done.stderr}"
        return done.stdout


@pytest.fixture
def walker(tmp_path: Path, browser, display) -> Iterator[Walker]:
    os.symlink(ROOT / "assets", tmp_path / "assets")
    with contextlib.ExitStack() as pages:
        open_one = contextlib.contextmanager(opened)
        yield Walker(
            tmp_path, display, lambda file: pages.enter_context(open_one(browser, file, reduced_motion="no-preference"))
        )


def test_each_walk_is_short_and_every_step_has_something_to_see():
    assert len(WALKS) == 3
    for walk in WALKS:
        rows = steps(walk)
        assert 6 <= len(rows) <= 10 and all(MARKED.search(do) and MARKED.search(see) for do, see in rows)


@pytest.mark.long
@pytest.mark.parametrize("walk", WALKS)
def test_walk(walk: str, walker: Walker):
    for do, see in steps(walk):
        walker.step(do, see)
    walker.leave_the_viewer()
