"""Former names of commands, options and option values.

A former name works for one release.  It prints one line on standard error ("--old is now --new") and appears neither
in the help nor in shell completion.

    former_option("--old", "--new")                       decorator of a command: an option or a flag
    former_commands(cli, {"agree": "reference compare"})  commands, relative to a group
    Choice(("none", "rsm"), former={"off": "none"})       values of an option; also Words(..., former=...)

Groups of class ``Group`` resolve former names of their commands and of their commands' options.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import click

from taubench_gl.errors import note_renamed


def former_option(old: str, new: str) -> Callable[[Any], Any]:
    """Decorator of a command: the option or flag ``new`` also answers to ``old``."""
    name = "former_" + old.lstrip("-").replace("-", "_")
    return click.option(old, name, cls=_FormerOption, new=new)


def former_commands(group: click.Group, names: Mapping[str, str]) -> None:
    """Run the command that a value of ``names`` spells when its key is given.

    A value is relative to ``group``; several words name a command of a subgroup.
    """
    assert isinstance(group, Group), group
    group.former_commands.update({old: tuple(new.split()) for old, new in names.items()})


class Group(click.Group):
    """A group that resolves former names of its commands and of their options."""

    group_class = type

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.former_commands: dict[str, tuple[str, ...]] = {}

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args[0] in self.former_commands:
            new = self.former_commands[args[0]]
            if not ctx.resilient_parsing:
                note_renamed(f"{ctx.command_path} {args[0]}", " ".join((ctx.command_path, *new)))
            args = [*new, *args[1:]]
        name, command, rest = super().resolve_command(ctx, args)
        if command is not None:
            rest = _with_current_names(command, rest, quiet=ctx.resilient_parsing)
        return name, command, rest


class Choice(click.Choice):
    """``click.Choice`` that also accepts ``former`` values: former value -> current value."""

    def __init__(self, choices: Iterable[str], former: Mapping[str, str]):
        super().__init__(tuple(choices))
        self.former = dict(former)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return super().convert(current_value(value, self.former, param), param, ctx)


def current_value(value: Any, former: Mapping[str, str], param: click.Parameter | None) -> Any:
    """The value that replaces ``value`` if it is a former one, with a note; otherwise ``value``."""
    if not isinstance(value, str) or value not in former:
        return value
    option = f"{param.opts[-1]} " if param is not None else ""
    note_renamed(f"{option}{value}", f"{option}{former[value]}")
    return former[value]


class _FormerOption(click.Option):
    """Declares a former option; ``Group`` replaces it by the current one before the command parses its arguments."""

    def __init__(self, *args: Any, new: str, **kwargs: Any):
        super().__init__(*args, hidden=True, expose_value=False, **kwargs)
        self.new = new

    def add_to_parser(self, *_: Any) -> None:
        """The parser never sees the former option."""


def former_options(command: click.Command) -> dict[str, str]:
    """Former option or flag -> current one."""
    return {param.opts[0]: param.new for param in command.params if isinstance(param, _FormerOption)}


def _with_current_names(command: click.Command, args: list[str], *, quiet: bool) -> list[str]:
    """``args`` with the former options of ``command`` replaced, up to a ``--``."""
    former = former_options(command)
    out = list(args)
    for i, arg in enumerate(args):
        if arg == "--":
            break
        old, equals, value = arg.partition("=")
        if old in former:
            if not quiet:
                note_renamed(old, former[old])
            out[i] = former[old] + equals + value
    return out
