"""Options of commands, derived from the fields that settings and commands declare, and the help in two lengths."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import os
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from taubench_gl.camera_path_settings import CameraPathSettings
from taubench_gl.errors import SettingsError
from taubench_gl.fields import NO_OPTION, REQUIRED, Setting, declared, setting
from taubench_gl.memory_budget import VARIABLE, parse_bytes
from taubench_gl.settings import (
    FIELDS,
    FILES,
    GROUPS,
    KEYS,
    LIGHT,
    MACHINE,
    MASKS,
    OUTPUT,
    PICTURE,
    SCENE,
    STEREO,
    Settings,
)

HEADINGS = ("", OUTPUT, SCENE, PICTURE, MASKS, LIGHT, FILES, MACHINE)
"""Groups of options in the complete help, in order; the first are the command's own."""

MOST_SHORT = 12
"""Options of a command up to which the short help shows all."""

CAMERA_PATH = tuple(declared(CameraPathSettings))
FRAMES = ("camera", *CAMERA_PATH, "scene", "animation", "strict", "fps", "frames", "size")
"""Settings of a recorded camera, and all that say what is rendered."""

GPU = ("backend", "device")

AS_JSON = setting(False, "Print JSON", flag="--json")
"""Option of commands whose output other programs may read."""

MAX_MEMORY = Setting(
    name="max_memory",
    kind=str | None,
    default=None,
    meaning="Refuse scenes that take more memory in one process, such as 4GiB; TAUBENCH_MAX_MEMORY is the same",
    group=SCENE,
    metavar="SIZE",
    shown="that of the machine or container, divided by the workers",
)
"""Option of every command that reads scenes."""


# One option


class _Text(click.ParamType):
    """Text as it is typed, which the option reads with the declaration of its field."""

    def __init__(self, field: Setting):
        self._field = field
        self.name = _metavar(field)

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        return self.name

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Complete the allowed words, or names of files."""
        if Path in (self._field.kind, *typing.get_args(self._field.kind)):
            return [CompletionItem(incomplete, type="file")]
        words = self._field.check.words if self._field.check else ()
        return [CompletionItem(word) for word in words if word.startswith(incomplete)]


def _metavar(field: Setting) -> str:
    """How the help shows the value of an option."""
    kinds = (field.kind, *typing.get_args(field.kind))
    if field.metavar:
        return field.metavar
    if any(typing.get_origin(kind) is tuple for kind in kinds) and not field.repeats:
        return "LIST"
    if field.check is not None and field.check.words:
        return f"[{'|'.join(field.check.words)}]"
    names = {int: "N", float: "NUMBER", Path: "PATH"}
    return next((name for kind, name in names.items() if kind in kinds), "TEXT")


class Option(click.Option):
    """The option of the command line that a field declares."""

    def __init__(self, field: Setting):
        self.field = field
        self.switch = bool in field.kinds
        kind: dict[str, Any] = {"is_flag": True} if self.switch else {"type": _Text(field), "multiple": field.repeats}
        if field.default is REQUIRED:
            kind["required"] = True
        elif not field.repeats:
            kind["default"] = field.default
        super().__init__(
            [*(field.flag or field.option).split("|"), field.name],
            help=field.help,
            envvar=field.variable or None,
            show_envvar=bool(field.variable),
            show_default=False,
            **kind,
        )

    def process_value(self, ctx: click.Context, value: Any) -> Any:
        """The value in the type of the field.  Raises UsageError for a value that is wrong or out of range."""
        value = super().process_value(ctx, value)
        if self.switch:
            return value
        if not given_options({self.name or ""}, ctx):  # a default has the field's type already
            return None if self.field.default is REQUIRED else self.field.default
        try:
            return self.field.checked(value, self.field.option)
        except SettingsError as error:
            named = error.what.startswith(self.field.option)
            message = SettingsError(error.what, where=None if named else self.field.option, hint=error.hint)
            raise click.UsageError(str(message), ctx) from None


def given_options(names: Iterable[str] | None = None, context: click.Context | None = None) -> frozenset[str]:
    """The parameters of the running command among ``names`` (None: all) whose value the user gave; no defaults."""
    context = context or click.get_current_context()
    default = (click.core.ParameterSource.DEFAULT, click.core.ParameterSource.DEFAULT_MAP, None)
    names = context.params if names is None else names
    return frozenset(name for name in names if context.get_parameter_source(name) not in default)


def _limit_memory(context: click.Context, _param: click.Parameter, value: str | None) -> None:
    """Set the limit for this process and its workers until the command ends.  Raises SettingsError."""
    if value is None:
        return
    before = os.environ.get(VARIABLE)

    def restore() -> None:
        os.environ.pop(VARIABLE)
        if before is not None:
            os.environ[VARIABLE] = before

    os.environ[VARIABLE] = str(parse_bytes(value))
    context.call_on_close(restore)


# Commands


@dataclasses.dataclass(frozen=True)
class OptionGroup:
    """The fields of one object that are options of a command."""

    kind: Any  # Settings, or a dataclass of fields
    fields: dict[str, Setting]
    changed: frozenset[str]  # fields whose default is the command's

    def build(self, values: dict[str, Any]) -> Any:
        """Make the object of the group; removes its options from ``values``.  Raises SettingsError."""
        # Values that nobody gave are left to the class, which has its own defaults.
        names = given_options(self.fields) | self.changed
        picked = {name: values.pop(name) for name in self.fields}
        settings = self.kind(**{name: value for name, value in picked.items() if name in names})
        if self.kind is Settings:
            require_used(settings)
        return settings


def option_group(
    kind: Any = Settings,
    *,
    only: Iterable[str] = (),
    without: Iterable[str] = (),
    shown: Mapping[str, str] | None = None,
    **defaults: Any,
) -> OptionGroup:
    """Options of a command for fields of ``kind``: ``only`` some, all ``without`` some, with other ``defaults``.

    A name in ``only`` may be that of a group of Settings.  ``shown``: defaults in words.
    """
    every = KEYS if kind is Settings else declared(kind)
    names = {
        field
        for name in only
        for field in (declared(GROUPS[name]) if name in GROUPS and name not in every else (name,))
    }
    fields = {}
    for name, field in every.items():
        if field.flag == NO_OPTION or name in without or (names and name not in names):
            continue
        if name in defaults:
            default = field.value_of(defaults[name])
            field = dataclasses.replace(field, default=default, shown=str(defaults[name]))
        if shown and name in shown:
            field = dataclasses.replace(field, shown=shown[name])
        fields[name] = field
    return OptionGroup(kind, fields, frozenset(defaults))


def require_used(settings: Settings) -> None:
    """Raises SettingsError for a given option that the others make useless: ``--spp`` with light of the raster method,
    options of the other eye with history ``frame``."""
    if settings.lighting.light == "raster" and given_options({"spp"}):
        message = f"spp is {settings.lighting.spp} and light is raster, which has no samples"
        raise SettingsError(message, hint="leave --spp out, or give --light path-traced", setting="spp")
    useless = given_options(STEREO[1:]) if settings.metrics.history == "frame" else ()
    for name in sorted(useless):
        option = FIELDS[name].option
        hint = f"leave {option} out, or give --history eye or both"
        raise SettingsError(f"{option} has no effect: history is frame", hint=hint, setting=name)


class Documented(click.Command):
    """A command whose help is a docstring; what it says from ``Examples:`` on follows the options, line by line."""

    def __init__(self, *args: Any, help: str | None = None, epilog: str | None = None, **attrs: Any):
        text, heading, examples = inspect.cleandoc(help or "").partition("Examples:\n")
        paragraphs = [f"\b\n{part}" for part in (heading + examples).split("\n\n") if part]
        super().__init__(*args, help=text.rstrip(), epilog="\n\n".join([*paragraphs, epilog or ""]), **attrs)


class Command(Documented):
    """A command with a short and a complete help."""

    def shown(self, ctx: click.Context) -> list[click.Option]:
        """The options that the short or the complete help shows, whichever is asked for."""
        options = [param for param in self.get_params(ctx) if isinstance(param, click.Option)]
        fields = [option for option in options if isinstance(option, Option)]
        if ctx.meta.get("complete help") or len(fields) <= MOST_SHORT:
            return options
        return [option for option in options if not isinstance(option, Option) or option.field.short]

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options as one list or, in the complete help, as a list for each heading."""
        records: dict[str, list[tuple[str, str]]] = {heading: [] for heading in (*HEADINGS, "Help")}
        for option in self.shown(ctx):
            heading = option.field.group if isinstance(option, Option) else "Help"
            record = option.get_help_record(ctx)
            if record is not None:
                records[heading if ctx.meta.get("complete help") else ""].append(record)
        for heading, rows in records.items():
            if rows:
                with formatter.section(heading or "Options"):
                    formatter.write_dl(rows)

    def get_complete_help(self, ctx: click.Context) -> str:
        """The help with every option."""
        ctx.meta["complete help"] = True
        return self.get_help(ctx)


def _show_complete_help(ctx: click.Context, _param: click.Parameter, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing:
        command = ctx.command
        click.echo(command.get_complete_help(ctx) if isinstance(command, Command) else command.get_help(ctx))
        ctx.exit()


def command(
    name: str | None = None, *, epilog: str | None = None, **groups: OptionGroup
) -> Callable[[Callable[..., Any]], Command]:
    """Decorator that makes a function a command.

    Keyword parameters of the function whose default is a ``fields.setting`` are options; so are the fields of
    parameters that are annotated with Settings or a dataclass of fields.  ``groups``: which fields, by parameter; all
    by default.  ``epilog``: what the help says after the examples.  Arguments are declared with ``click.argument``.
    """

    def decorate(function: Callable[..., Any]) -> Command:
        parameters, objects = declared(function), groups | dict(_other_groups(function, groups))
        fields = [*parameters.values(), *(field for made in objects.values() for field in made.fields.values())]

        @functools.wraps(function)
        def callback(**values: Any) -> Any:
            for parameter, made in objects.items():
                values[parameter] = made.build(values)
            return function(**values)

        arguments = list(reversed(getattr(function, "__click_params__", [])))  # decorators apply from the last one on
        options: list[click.Parameter] = [Option(field) for field in fields]
        if any(field.name == "strict" for field in fields):  # the command reads scenes
            memory = Option(MAX_MEMORY)
            memory.expose_value, memory.callback = False, _limit_memory
            options.append(memory)
        complete = click.Option(
            ["--help-all"],
            is_flag=True,
            is_eager=True,
            expose_value=False,
            callback=_show_complete_help,
            help=f"Show all {len(options)} options and exit.",
        )
        return Command(
            name or function.__name__.replace("_", "-"),
            params=[*arguments, *options, complete],
            callback=callback,
            help=inspect.getdoc(function),
            epilog=epilog,
        )

    return decorate


def _other_groups(function: Callable[..., Any], groups: dict[str, OptionGroup]) -> Iterator[tuple[str, OptionGroup]]:
    """The option groups of parameters that are annotated with a class of fields and are not in ``groups``."""
    for name, kind in typing.get_type_hints(function).items():
        if name not in groups and (kind is Settings or (dataclasses.is_dataclass(kind) and declared(kind))):
            yield name, option_group(kind)


class Commands(Documented, click.Group):
    """A group of commands.  ``sections``: heading -> names, for its help; ``default``: the command that is implied."""

    command_class = Command

    def __init__(self, *args: Any, sections: dict[str, tuple[str, ...]] | None = None, default: str = "", **attrs: Any):
        super().__init__(*args, **attrs)
        self.sections, self.default = sections or {}, default

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """``GROUP ARGUMENT...`` is ``GROUP DEFAULT ARGUMENT...`` unless it begins with a command or asks for help."""
        if self.default and args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            args = [self.default, *args]
        return super().parse_args(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write a list for each section, with whole sentences."""
        width = max(map(len, self.commands))
        for heading, names in (self.sections or {"Commands": self.list_commands(ctx)}).items():
            with formatter.section(heading):
                formatter.write_dl(
                    [(f"{name:<{width}}", self.commands[name].get_short_help_str(1000)) for name in names]
                )
