"""Command lines in README, docs and help are accepted by the commands; options and Python examples name what exists."""

from __future__ import annotations

import ast
import json
import re
import shlex
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import click
import pytest

import taubench_gl
from taubench_gl.apps.cli import cli

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted(ROOT.glob("docs/**/*.md"))]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
PLACEHOLDER = re.compile(r"\b[A-Z]{3,}\b|\.\.\.|\[")


def blocks(page: Path, language: str) -> list[str]:
    return [text for found, text in FENCE.findall(page.read_text(encoding="utf-8")) if found == language]


def prose(page: Path) -> str:
    return FENCE.sub("", page.read_text(encoding="utf-8"))


def command_lines(page: Path) -> Iterator[str]:
    """Lines of blocks and examples of help texts that start the program, continued lines joined."""
    for _, text in FENCE.findall(page.read_text(encoding="utf-8")):
        for line in text.replace("\\\n", " ").splitlines():
            if line.strip().startswith("taubench-gl "):
                yield line.strip()


def words_of(line: str) -> list[str]:
    """The arguments, up to a redirection or the next command of the shell."""
    words = shlex.split(line, comments=True)[1:]
    ends = [i for i, word in enumerate(words) if word in (">", ">>", "|", "&&", ";")]
    return words[: min(ends, default=len(words))]


def parse(words: list[str]) -> None:
    """What the program does before a command runs.  Raises click.UsageError."""
    command: click.Command = cli
    context = click.Context(
        cli, info_name="taubench-gl", **cli.context_settings
    )  # -h too: click keeps the first help option
    try:
        while isinstance(command, click.Group) and words:
            if "run" in command.commands and words[0] not in command.commands:
                words = ["run", *words]  # batch SPEC.toml
            name, command, words = command.resolve_command(context, words)
            if isinstance(command, click.Group):
                context = click.Context(command, info_name=name, parent=context)
        if not isinstance(command, click.Group):
            command.make_context(command.name, list(words), parent=context).close()
    except click.exceptions.Exit:
        pass  # --help


@cache
def all_options() -> set[str]:
    """Long options of every command, hidden ones too, and those that the programs of tools/ and pytest name."""

    def below(command: click.Command) -> Iterator[click.Command]:
        yield command
        context = click.Context(command, **cli.context_settings)
        for name in command.list_commands(context) if isinstance(command, click.Group) else ():
            yield from below(command.get_command(context, name))

    found = {"--help", "--version"}
    for command in below(cli):
        found |= {name for p in command.params for name in (*p.opts, *p.secondary_opts) if name.startswith("--")}
    for tool in (ROOT / "tools").rglob("*"):
        if tool.is_file() and "__pycache__" not in tool.parts:
            found |= set(re.findall(r"--[a-z][\w-]+", tool.read_text(encoding="utf-8")))
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_command_lines_are_accepted(page: Path):
    refused = {}
    for line in command_lines(page):
        try:
            parse(words_of(line))
        except Exception as error:  # click's errors, and those of our own types of values
            refused[line] = str(error)
    assert not refused


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_command_lines_and_options_in_sentences_exist(page: Path):
    """Arguments may be left out there, and stand for others: SCENE."""
    refused = {}
    for line in re.findall(r"`(taubench-gl [^`]+)`", prose(page)):
        if PLACEHOLDER.search(line.replace("SCENE", "")):
            continue
        try:
            parse(words_of(line.replace("\n", " ")))
        except click.MissingParameter:
            pass
        except Exception as error:
            refused[line] = str(error)
    assert not refused
    codes = re.findall(r"`([^`]+)`", prose(page))
    named = {name for code in codes for name in re.findall(r"(?<!\S)--[a-z][\w-]+", code)}
    assert not named - all_options()


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_blocks_of_data_and_code_parse(page: Path):
    """Blocks of a page parse, and every name that an example imports from the package exists."""
    for text in blocks(page, "toml"):
        tomllib.loads(text)
    for text in blocks(page, "json"):
        json.loads(text)
    # The signatures of api.md are no code, and tests/test_api.py runs its examples.
    examples = [] if page.name == "api.md" else blocks(page, "python")
    for text in examples:
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("taubench_gl"):
                module = __import__(node.module, fromlist=["_"])
                assert [alias.name for alias in node.names if not hasattr(module, alias.name)] == []
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "tb":
                assert hasattr(taubench_gl, node.attr), node.attr
