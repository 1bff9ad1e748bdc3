"""Options that trade accuracy for time, and ``--preset``, which reads the settings that ``cost`` recommends."""

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
        of_settings("--storage", "Component type of channels between passes.", type=click.Choice(STORAGES)),
        of_settings(
            "--samples-per-pixel",
            "Sub-pixel positions at which both frames of a pair are rendered and classified.",
            metavar="N",
        ),
        of_settings(
            "--pairs",
            "Pairs to evaluate: every K-th, or two from each of H strata; with confidence intervals.  auto: all of an "
            "animation as long as the paper's, else strata:H; with path-traced light as many as take about a minute.",
            metavar="auto|all|every:K|strata:H",
        ),
    )


def preset_option(command: Any) -> Any:
    """``--preset``."""
    return click.option(
        "--preset",
        type=click.Path(path_type=Path, dir_okay=False),
        metavar="FILE",
        help="Settings recommended by 'taubench-gl cost'; options given beside it take precedence.",
    )(command)


def with_preset(options: dict[str, Any], preset: Path | None) -> dict[str, Any]:
    """``options`` of the running command, those that the user did not give from ``preset``.  Raises SettingsError."""
    if preset is None:
        return options
    from taubench_gl.preset import load_preset

    values = load_preset(preset)
    given = given_options(("size", *values))
    default = Settings().sequence
    size = (values.pop("width", default.width), values.pop("height", default.height))
    thresholds = values.pop("thresholds", {})
    out = options | {name: value for name, value in values.items() if name not in given}
    if "size" not in given:
        out["size"] = size
    out["thresholds"] = tuple((dict(thresholds) | dict(options["thresholds"])).items())
    return out
