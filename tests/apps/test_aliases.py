"""Former names of commands, options and values: they work, print one line and are listed nowhere."""

from __future__ import annotations

import ast
from collections.abc import Iterator

import click
import pytest
from click.shell_completion import ShellComplete
from click.testing import CliRunner

from taubench_gl.apps.aliases import Choice, Group, former_commands, former_option, former_options
from taubench_gl.apps.cli import cli
from taubench_gl.apps.options import Words


@pytest.fixture
def program() -> Group:
    @click.group(cls=Group)
    def program() -> None: ...

    @program.group()
    def reference() -> None: ...

    @reference.command()
    @click.argument("path", nargs=-1)
    @click.option("--samples", type=int, default=1)
    @click.option("--denoise/--no-denoise", default=True)
    @click.option("--method", type=Choice(("none", "rsm"), former={"off": "none"}), default="rsm")
    @click.option("--columns", type=Words("color", "normal", former={"colour": "color"}), default="normal")
    @click.option("--tag", multiple=True)
    @former_option("--draws", "--samples")
    @former_option("--rough", "--no-denoise")
    @former_option("--mark", "--tag")
    def render(**values) -> None:
        click.echo(repr(values))

    former_commands(program, {"truth": "reference", "draw": "reference render"})
    former_commands(reference, {"make": "render"})
    return program


DEFAULTS = {
    "path": (), "samples": 1, "denoise": True, "method": "rsm", "columns": ("normal",), "tag": (),
}  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "changed", "notes"),
    [
        (["reference", "render", "--samples", "4"], {"samples": 4}, 0),
        (["reference", "render", "--draws", "4"], {"samples": 4}, 1),
        (["reference", "render", "--draws=4", "--rough"], {"samples": 4, "denoise": False}, 2),
        (["reference", "render", "--tag", "a", "--mark", "b"], {"tag": ("a", "b")}, 1),
        (["reference", "render", "--method", "off"], {"method": "none"}, 1),
        (["reference", "render", "--columns", "colour,color"], {"columns": ("color",)}, 1),
        (["reference", "render", "--", "--draws"], {"path": ("--draws",)}, 0),
        (["reference", "make", "x"], {"path": ("x",)}, 1),
        (["truth", "render", "x"], {"path": ("x",)}, 1),
        (["truth", "make", "--draws", "2"], {"samples": 2}, 3),
        (["draw", "--draws", "2"], {"samples": 2}, 2),
    ],
)
def test_former_names_act_as_the_current_ones_and_print_a_line_each(program, arguments, changed, notes):
    result = CliRunner().invoke(program, arguments)
    assert result.exit_code == 0, result.output
    assert ast.literal_eval(result.stdout) == {**DEFAULTS, **changed}
    assert result.stderr.count("\n") == notes
    assert result.stderr.count(" is now ") == notes


def test_the_note_names_both(program):
    result = CliRunner().invoke(program, ["truth", "render", "--draws", "4"], prog_name="tb")
    assert result.stderr.splitlines() == [
        "taubench-gl: tb truth is now tb reference",
        "taubench-gl: --draws is now --samples",
    ]


@pytest.mark.parametrize("path", [[], ["reference"], ["reference", "render"], ["truth", "render"]])
def test_help_lists_no_former_name(program, path):
    result = CliRunner().invoke(program, [*path, "--help"])
    assert result.exit_code == 0
    for former in ("truth", "make", "--draws", "--rough", "--mark", "off", "colour"):
        assert former not in result.stdout.split()


@pytest.mark.parametrize(
    ("words", "start", "former"),
    [([], "t", "truth"), (["reference"], "m", "make"), (["reference", "render"], "--", "--draws")],
)
def test_completion_offers_no_former_name(program, words, start, former):
    shell = ShellComplete(program, {}, "tb", "_TB_COMPLETE")
    assert former not in [item.value for item in shell.get_completions(words, start)]


def test_completion_follows_former_commands_in_silence(program, capsys):
    shell = ShellComplete(program, {}, "tb", "_TB_COMPLETE")
    assert "--samples" in [item.value for item in shell.get_completions(["truth", "render"], "--")]
    assert capsys.readouterr().err == ""


def test_an_unknown_option_is_still_an_error(program):
    result = CliRunner().invoke(program, ["reference", "render", "--drows", "4"])
    assert result.exit_code == 2


def all_commands(command: click.Command = cli) -> Iterator[click.Command]:
    yield command
    if isinstance(command, click.Group):
        for member in command.commands.values():
            yield from all_commands(member)


def test_every_former_option_of_the_program_names_a_current_one():
    for command in all_commands():
        current = {
            opt for p in command.params if not getattr(p, "hidden", False) for opt in (*p.opts, *p.secondary_opts)
        }
        for old, new in former_options(command).items():
            assert new in current and old not in current, f"{command.name}: {old} -> {new}"


def test_every_former_command_of_the_program_names_a_current_one():
    for group in all_commands():
        if not isinstance(group, click.Group):
            continue
        assert isinstance(group, Group), f"{group.name}: former names of its commands' options are not resolved"
        for old, new in group.former_commands.items():
            found: click.Command = group
            for word in new:
                assert isinstance(found, click.Group)
                found = found.commands[word]
            assert old not in group.commands
