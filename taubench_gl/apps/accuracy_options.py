"""Options that trade accuracy for time, and presets of them that ``cost`` writes and ``evaluate`` takes up."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.options import given_options, of_settings, with_options
from taubench_gl.settings import STORAGES, Settings


def accuracy_options(command: Any) -> Any:
    """``--storage``, ``--samples-per-pixel`` and ``--pairs``."""
    return with_options(
        command,
        of_settings("--storage", "Of channels between passes: 32 or 16 bits a component.", type=click.Choice(STORAGES)),
        of_settings(
            "--samples-per-pixel",
            "Places within a pixel at which both frames of a pair are drawn and judged.",
            metavar="N",
        ),
        of_settings(
            "--pairs",
            "Pairs looked at: every K-th, or two from each of H stretches; with confidence intervals.",
            metavar="all|every:K|strata:H",
        ),
        removed_option("--summation", "pixel counts are added as exact integers"),
        removed_option("--histogram-bits", "curves have 8 bins per octave"),
    )


def removed_option(name: str, why: str) -> Any:
    """A hidden option of the last release: accepted with a note and without effect."""

    def note(_context: click.Context, _parameter: click.Parameter, value: str | None) -> None:
        if value is not None:
            click.echo(f"taubench-gl: {name} has no effect: {why}", err=True)

    return click.option(name, hidden=True, expose_value=False, callback=note)


def preset_option(command: Any) -> Any:
    """``--preset``."""
    return click.option(
        "--preset",
        type=click.Path(path_type=Path, dir_okay=False),
        metavar="FILE",
        help="Settings that 'taubench-gl cost --within' chose; options given beside it win.",
    )(command)


def with_preset(options: dict[str, Any], preset: Path | None) -> dict[str, Any]:
    """``options`` of the running command with those of ``preset`` where the user gave none.  Raises SettingsError."""
    if preset is None:
        return options
    from taubench_gl.cost.preset import load_preset

    values = load_preset(preset)
    asked = given_options(("size", *values))
    size = (values.pop("width", Settings().sequence.width), values.pop("height", Settings().sequence.height))
    thresholds = values.pop("thresholds", {})
    out = dict(options)
    if "size" not in asked:
        out["size"] = size
    given = dict(options["thresholds"])
    out["thresholds"] = tuple((dict(thresholds) | given).items())
    for name, value in values.items():
        if name not in asked:
            out[name] = value
    return out
