"""A field is declared once: options, help, keys of files and keywords of functions follow from its declaration."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import click
import msgspec
import pytest

from taubench_gl.apps.cli import SECTIONS, cli
from taubench_gl.apps.options import MOST_SHORT, Command, Commands, Option, command
from taubench_gl.batch.spec import read_spec
from taubench_gl.benchmark.suite import read_suite
from taubench_gl.errors import SettingsError
from taubench_gl.fields import REQUIRED, at_least, declared, one_of, setting, some_of
from taubench_gl.paths import PACKAGE
from taubench_gl.preset import load_preset
from taubench_gl.settings import KEYS, NO_OPTION, LightingSettings, Settings, parse_size

sys.path.append(str(PACKAGE.parent / "tools"))
from reference_pages import settings_table

READERS = {
    load_preset: 'schema = "taubench-gl/preset/1"\n[settings]\n',
    read_spec: 'scenes = ["a.glb"]\n',
    read_suite: 'schema = "suite/1"\nname = "s"\nframes = 2\n[[cases]]\nscene = "demo"\ntrack = "t"\ninput = "full"\n',
}
"""Reader of a file with settings -> a valid file, to which a setting can be added."""


@pytest.mark.parametrize("name", [name for name in declared(LightingSettings) if name not in NO_OPTION])
def test_a_setting_is_an_option_a_key_and_a_keyword(tmp_path, name):
    """Each names the setting that has a wrong value."""
    for member in ("evaluate", "view", "export"):
        assert name in {param.name for param in cli.commands[member].params}
    (tmp_path / "a.glb").touch()
    for read, text in READERS.items():
        (tmp_path / "file.toml").write_text(text)
        read(tmp_path / "file.toml")
        (tmp_path / "file.toml").write_text(f'{text}{name} = {{ x = "y" }}\n')
        with pytest.raises(SettingsError) as caught:
            read(tmp_path / "file.toml")
        assert name in str(caught.value)
    with pytest.raises(SettingsError) as caught:
        Settings(**{name: {"x": "y"}})
    assert caught.value.setting == name
    assert any(line.startswith(f"| `{name}` |") for line in settings_table())


def members(group: click.Group) -> list[click.Command]:
    return [c for m in group.commands.values() for c in (members(m) if isinstance(m, click.Group) else [m])]


@pytest.mark.parametrize("member", members(cli), ids=lambda member: member.name)
def test_the_short_help_is_short_and_the_complete_help_complete(member):
    assert isinstance(member, Command)
    context = click.Context(member, **cli.context_settings)
    short, complete = member.get_help(context), member.get_complete_help(click.Context(member, **cli.context_settings))
    options = [param for param in member.params if isinstance(param, Option)]
    shown = [param for param in member.shown(context) if isinstance(param, Option)]
    assert len(shown) <= 14 and (len(shown) == len(options) or len(options) > MOST_SHORT)
    assert all(option.opts[0] in complete for option in options) and all(option.opts[0] in short for option in shown)
    assert "--help-all" in short


def test_every_command_has_a_section():
    assert isinstance(cli, Commands)
    listed = [name for names in cli.sections.values() for name in names]
    assert sorted(listed) == sorted(cli.commands) and set(cli.sections) == set(SECTIONS)


def test_no_option_of_a_command_is_declared_twice():
    for member in members(cli):
        flags = [flag for param in member.params if isinstance(param, click.Option) for flag in param.opts]
        assert len(flags) == len(set(flags)), member.name


@command()
def sample(
    *,
    needed: int = setting(REQUIRED, "A number", at_least(2)),
    shape: str = setting("box", "A shape", one_of(("box", "ball"))),
    parts: tuple[str, ...] = setting((), "Parts", some_of(("lid", "base"))),
    sizes: tuple[int, ...] = setting((), "Sizes", flag="--of", read=lambda texts: tuple(map(int, texts)), repeats=True),
    closed: bool = setting(True, "Closed", flag="--closed/--open"),
) -> None:
    """A command."""
    click.echo(repr((needed, shape, parts, sizes, closed)))


@pytest.mark.parametrize(
    ("words", "values"),
    [
        ("--needed 3", (3, "box", (), (), True)),
        ("--needed 2 --shape ball --parts base,lid,base", (2, "ball", ("base", "lid"), (), True)),
        ("--needed 2 --of 4 --of 5 --open", (2, "box", (), (4, 5), False)),
    ],
)  # fmt: skip
def test_parameters_of_a_function_are_options(words, values, capsys):
    sample.main(words.split(), standalone_mode=False)
    assert capsys.readouterr().out == f"{values!r}\n"


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("", "--needed"), ("--needed 1", "--needed is 1"), ("--needed two", "--needed"), ("--needed 2.5", "--needed"),
        ("--needed 2 --shape bal", "did you mean ball?"), ("--needed 2 --parts lid,foot", "foot"),
        ("--needed 2 --parts ,", "--parts is empty"),
    ],
)  # fmt: skip
def test_a_wrong_value_names_its_option(words, named):
    with pytest.raises(click.UsageError) as caught:
        sample.main(words.split(), standalone_mode=False)
    assert named in str(caught.value.format_message())


def test_a_declaration_reads_what_people_and_programs_write():
    fields = declared(sample.callback)
    assert fields["needed"].checked("7") == 7 == fields["needed"].value_of(7)
    assert fields["parts"].value_of(["lid"]) == ("lid",)
    with pytest.raises(SettingsError) as caught:
        fields["needed"].checked(1)
    assert caught.value.setting == "needed" and caught.value.hint == "give 2 or more"


def options_with_text() -> dict[str, Option]:
    """Flag, and the command where another option has that flag -> every different option that takes a value."""
    found: dict[str, Option] = {}
    for member in members(cli):
        for option in (p for p in member.params if isinstance(p, Option) and not p.switch):
            flag = option.opts[0]
            if flag not in found or found[flag].field != option.field:
                found[f"{member.name}{flag}" if flag in found else flag] = option
    return found


HOSTILE = (
    "", "1", "24", "0", "-1", "2.5", "1,2", "24,60", "1,,2", ",", "nan", "inf", "-inf", "1e400", "1" + "0" * 400,
    "0:2", ":", "1:2:3", "x", "all", "none", "auto", "yaw=0:12:7", "yaw=0:12", "normal=0.1", "normal=", "=", "640x360",
    "x360", "90s", "5m", "1GiB", "true", "\u0663", "\udce9", " ", "a/b.toml",
)  # fmt: skip


@pytest.mark.parametrize("option", options_with_text().values(), ids=options_with_text())
def test_every_option_is_read_from_text(option):
    """A text is a value of the declared type, or a usage error; its default is a value."""
    field = option.field

    def parsed(text: str):
        alone = click.Command("alone", params=[Option(dataclasses.replace(field, variable=""))])
        return alone.make_context("alone", [option.opts[0], text]).params[option.name]

    for text in HOSTILE:
        try:
            value = parsed(text)
        except click.UsageError:
            continue
        if field.name in KEYS:  # Settings reads the value of the option again
            assert field.checked(value) == value or value != value, text
        if Path in field.kinds:
            assert isinstance(value, Path | str)
        else:
            assert msgspec.convert(value, field.kind) == value or value != value, text
    default = field.default
    if default in (REQUIRED, None, (), "") or isinstance(default, dict) or default == (None, None):
        return
    if field.repeats or field.read is parse_size:
        return  # one option for each element; a size is written with an x, which other tests read
    text = ",".join(map(str, default)) if isinstance(default, tuple) else str(default)
    assert parsed(text) == default


@pytest.mark.parametrize(
    ("words", "name", "value"),
    [
        ("paper --fps 24", "fps", (24.0,)), ("paper --fps 24,60", "fps", (24.0, 60.0)),
        ("stress a.glb --out b.glb --motion 1", "motion", (1.0,)),
        ("stress a.glb --out b.glb --yaw 3.4,8.9,20", "yaw", (3.4, 8.9, 20.0)),
        ("reuse evaluate a.glb --methods ema --out b --cut 2 --cut 5", "cuts", (2, 5)),
    ],
)  # fmt: skip
def test_a_sequence_of_numbers_is_one_number_or_several(words, name, value):
    """One number stands for a sequence of one; commas separate several."""
    member, words = cli, words.split()
    while isinstance(member, click.Group):
        member = member.commands[words.pop(0)]
    assert member.make_context(member.name, words).params[name] == value


@pytest.mark.parametrize("words", ["paper --fps 24,x", "paper --fps 24,24", "stress a --out b --motion 1,2,3,4"])
def test_a_wrong_sequence_of_numbers_is_a_usage_error(words):
    name, *rest = words.split()
    with pytest.raises(click.UsageError):
        cli.commands[name].make_context(name, rest)
