"""Commands and Python examples of the pages run, with the demo scene in place of scene.glb and at a small size."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import click
import pytest
from test_docs_examples import PAGES, ROOT, blocks, command_lines, words_of

from taubench_gl.apps.cli import cli, main

NAMES = {page: str(page.relative_to(ROOT)) for page in PAGES}

LEFT_OUT = {
    r"^view|--view": "opens a window: tests/viewer",
    r"exr:|^reference (render|check|compare)|-file renders": "reads renderings of other programs: tests/pathtraced",
    r"\.(blend|fbx|usdc|zip|csv|gltf)\b": "needs a file that is not shipped: tests/scene_formats, tests/datasets",
    r"museum|zero-day|my-scene|mine\.toml|valley": "needs a scene that is not shipped: tests/datasets",
    r"dask|--workers|^batch|^benchmark (?!compare)|^paper": "takes minutes: tests/batch, benchmark, paper",
    r"^demo --all|^selftest( --json.*)?$": "takes minutes: tests/demos, tests/selftest",
    r"^reference clear": "removes references of the cache: tests/pathtraced",
    r"--preset|^cost .*--(parameters|for|time-limit)": "needs minutes of a study: tests/cost, tests/test_tour.py",
    r"path-traced@": "takes minutes: tests/reuse",
    r"osmesa": "a driver that may be missing: tools/test --driver",
    r"my.method|my_test|methods/reject": "a method of the reader: tests/reuse, tests/reject",
    r"^(report|compare) .*(reuse|out/|both)": "runs of the reader: tests/report",
}
"""Command lines that do not run here (regular expressions), and what tests them."""

SMALL = {
    "--size": "64x36", "--frames": "0:3", "--seconds": "0.25", "--reference-spp": "4", "--time-limit": "5s",
    "--reference-samples": "4", "--repeats": "1",
}  # fmt: skip
"""Values of options in place of those of the page and of the defaults."""

PYTHON = {
    "README.md": [
        ('out="results")', 'out="results", size="64x36", frames=range(3))'),
        ('size="640x360", frames=range(0, 24)', 'size="64x36", frames=range(3)'),
        ("pair.explain(320, 180)", "pair.explain(32, 18)"),
    ],
}
"""Pages whose Python examples run, and what is replaced in them."""

QUICK = ("docs/commands/inspect.md", "docs/commands/completion.md", "docs/reuse.md")
LONG = ("README.md", "docs/commands/report.md", "docs/commands/scenes.md", "docs/commands/stress.md")
"""Pages whose examples run; tests/test_tour.py runs those of the tour."""


def reason_of(words: list[str]) -> str | None:
    """Why a command line does not run here."""
    return next((why for pattern, why in LEFT_OUT.items() if re.search(pattern, " ".join(words))), None)


def lines_of(page: Path) -> list[list[str]]:
    return [words for words in map(words_of, command_lines(page)) if reason_of(words) is None]


def reduced(words: list[str]) -> list[str]:
    """The arguments with the values of SMALL for the options that the command has."""
    command: click.Command = cli
    for word in words:
        if not isinstance(command, click.Group) or word not in command.commands:
            break
        command = command.commands[word]
    known = {name for parameter in command.params for name in parameter.opts}
    if words[0] == "selftest":
        return words  # its cases need their sizes
    small = SMALL | ({"--size": "160x90"} if words[0] == "demo" else {})
    return words + [text for name, value in small.items() if name in known for text in (name, value)]


def run(words: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(reduced(words))
    assert ended.value.code in (0, None), " ".join(words)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder: the demo scene under the names of the pages, two runs, and a recorded benchmark."""
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("TAUBENCH_SCENES", str(tmp_path / "scenes"))
    shutil.copytree(ROOT / "assets", tmp_path / "assets")
    shutil.copy(ROOT / "assets" / "demo.glb", tmp_path / "scene.glb")
    for name in ("mine", "theirs"):
        (tmp_path / name).mkdir()
        shutil.copy(ROOT / "docs" / "benchmark-quick.json", tmp_path / name / "benchmark.json")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def check(page: Path) -> None:
    lines = lines_of(page)
    if any({"results", "other-results"} & set(words) for words in lines):
        for name in ("results", "other-results"):
            run(["evaluate", "scene.glb", "--out", name])
    for words in lines:
        if "--out" in words and words[0] != "report":  # lines of a page may stand for each other
            shutil.rmtree(words[words.index("--out") + 1], ignore_errors=True)
        run(words)
    if NAMES[page] in PYTHON:
        names: dict[str, object] = {"__name__": "example"}
        for text in blocks(page, "python"):
            for old, new in PYTHON[NAMES[page]]:
                text = text.replace(old, new)
            exec(compile(text, NAMES[page], "exec"), names)


@pytest.mark.parametrize("name", QUICK)
def test_examples_run(name: str, folder: Path):
    check(ROOT / name)


@pytest.mark.long
@pytest.mark.parametrize("name", LONG)
def test_more_examples_run(name: str, folder: Path):
    check(ROOT / name)


def test_what_is_left_out_exists_and_what_is_replaced_is_there():
    lines = [" ".join(words_of(line)) for page in PAGES for line in command_lines(page)]
    assert [pattern for pattern in LEFT_OUT if not any(re.search(pattern, line) for line in lines)] == []
    for name, replaced in PYTHON.items():
        text = "\n".join(blocks(ROOT / name, "python"))
        assert text and all(old in text for old, _ in replaced), name
