"""Option types, the options that several commands share, and the Settings made from them.

Help texts come from the metadata of Settings' fields and from the glossary.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import click

from taubench_gl.errors import SettingsError
from taubench_gl.features import COLUMNS
from taubench_gl.glossary import OPTIONS
from taubench_gl.memory_budget import VARIABLE, parse_bytes
from taubench_gl.settings import (
    AUTO,
    BACKENDS,
    BLENDS,
    CULLINGS,
    DEFAULT_SIZE,
    DEFAULT_SPP,
    EFFECTS,
    FIELDS,
    INDIRECT,
    LIGHT_UNITS,
    LIGHTS,
    PATTERNS,
    REPROJECTIONS,
    SAMPLINGS,
    SHADOW_FILTERS,
    TEXTURES,
    TONE_MAPS,
    Settings,
    parse_environment,
    parse_frames,
    parse_size,
    parse_threshold,
)

Decorator = Callable[[Any], Any]


# Option types


def _parsed(kind: click.ParamType, parse: Callable[[str], Any], value: str, param: Any, ctx: Any) -> Any:
    """``parse(value)``; its SettingsError as an error of the option."""
    try:
        return parse(value)
    except SettingsError as error:
        kind.fail(f"{error.what}: {error.hint}", param, ctx)


class Size(click.ParamType):
    """``1920x1080`` -> (1920, 1080), ``paper`` -> the paper's size."""

    name = "WxH"

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        return self.name

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        return _parsed(self, parse_size, value, param, ctx)


class List(click.ParamType):
    """``a,b`` -> ("a", "b"), in the order given.  ``empty``: what to say of an empty list."""

    name = "LIST"

    def __init__(self, empty: str = "the list is empty"):
        self.empty = empty

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        parts = tuple(part.strip() for part in value.split(",") if part.strip())
        if not parts:
            self.fail(self.empty, param, ctx)
        return parts


class Frames(click.ParamType):
    """``A:B`` -> (A, B), a Python slice of frame numbers; a missing end is None."""

    name = "A:B"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        return _parsed(self, parse_frames, value, param, ctx)


class Threshold(click.ParamType):
    """``normal=0.1`` -> ("normal", 0.1); Settings checks the name."""

    name = "NAME=V"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        return _parsed(self, parse_threshold, value, param, ctx)


class Exposure(click.ParamType):
    """A number, or ``auto``; Settings checks the range."""

    name = "VALUE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == AUTO or not isinstance(value, str):
            return value
        try:
            return float(value)
        except ValueError:
            self.fail(f"{value!r} is neither auto nor a number", param, ctx)


class EnvironmentValue(click.ParamType):
    """``auto``, ``none``, ``default``, ``R,G,B`` or an image file, as ``settings.parse_environment``."""

    name = "ENVIRONMENT"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return parse_environment(value) if isinstance(value, str) else value


class OutPath(click.Path):
    """Output path -> Path.  An empty name, such as an unset shell variable, is an error."""

    def __init__(self, *, dir_okay: bool = True) -> None:
        super().__init__(path_type=Path, dir_okay=dir_okay)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "":
            self.fail("the name is empty; '.' is the current folder", param, ctx)
        return super().convert(value, param, ctx)


class Words(click.ParamType):
    """Comma-separated values out of ``words`` -> tuple without duplicates, in the order given.

    ``verb`` completes the message "cannot VERB x"; ``none`` allows an empty list.
    """

    name = "LIST"

    def __init__(self, *words: str, verb: str = "save", none: bool = True):
        self.words, self.verb, self.none = words, verb, none

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        given = (word.strip() for word in value.split(",") if word.strip())
        chosen = tuple(dict.fromkeys(given))
        unknown = [word for word in chosen if word not in self.words]
        if unknown:
            self.fail(f"cannot {self.verb} {', '.join(unknown)}; choose from {', '.join(self.words)}", param, ctx)
        if not (chosen or self.none):
            self.fail(f"nothing to {self.verb}; choose from {', '.join(self.words)}", param, ctx)
        return chosen


# Settings from options


def with_options(command: Any, *options: Decorator) -> Any:
    """``command`` with ``options``, in the order of its help."""
    for option in reversed(options):
        command = option(command)
    return command


def of_settings(flag: str, help: str | None = None, *, field: str | None = None, **attributes: Any) -> Decorator:
    """An option for a field of Settings, by default the field of its name.

    Default, type and, without ``help``, the help text are the field's.
    """
    name = field or flag.removeprefix("--").replace("-", "_")
    if help is None:
        meaning, unit = FIELDS[name].metadata["meaning"], FIELDS[name].metadata["unit"]
        unit = f", {unit}" if unit and unit not in ("1/m", "1/s") and unit not in meaning else ""
        starts_with_value = meaning.partition(":")[0] in getattr(attributes.get("type"), "choices", ())
        help = f"{meaning if starts_with_value else meaning[0].upper() + meaning[1:]}{unit}."
    return click.option(flag, name, help=help, **{"default": Settings().get(name), "show_default": True, **attributes})


def given_options(names: Iterable[str]) -> frozenset[str]:
    """Those of ``names``, parameters of the running command, that the user gave rather than the default."""
    context = click.get_current_context()
    default = (click.core.ParameterSource.DEFAULT, click.core.ParameterSource.DEFAULT_MAP, None)
    return frozenset(name for name in names if context.get_parameter_source(name) not in default)


def settings_from(options: dict[str, Any], **more: Any) -> Settings:
    """Settings from the options of a command that has ``frame_options``; every option must be a setting.

    ``more``: fields that the command decides.  Raises SettingsError for a value out of range.
    """
    options = dict(options)
    if options.get("light") == "raster" and given_options({"spp"} & options.keys()):
        what = f"spp is {options['spp']} and light is raster, which has no samples"
        raise SettingsError(what, hint="leave --spp out, or give --light path-traced", setting="spp")
    width, height = options.pop("size")
    return Settings(
        width=width,
        height=height,
        frames=options.pop("frames") or (None, None),
        animation=options.pop("animations") or None,
        thresholds=dict(options.pop("thresholds", ())),
        **options,
        **more,
    )


def _meanings(*values: str) -> str:
    """``camera: the glossary's definition.  motion: ...`` for the values of an option."""
    return "  ".join(f"{value}: {OPTIONS[value].sentence}" for value in values)


# Shared options


def gpu_options(command: Any) -> Any:
    """``--backend`` and ``--device``."""
    return with_options(
        command,
        of_settings("--backend", type=click.Choice(BACKENDS), envvar="TAUBENCH_BACKEND", show_envvar=True),
        click.option("--device", type=click.IntRange(min=0), help="EGL device index; see 'taubench-gl doctor'."),
    )


strict_option = click.option(
    "--strict",
    is_flag=True,
    help="Refuse scene files that depart from their format.  [default: repair them, with a note for each kind]",
)


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


memory_option = click.option(
    "--max-memory",
    metavar="SIZE",
    expose_value=False,
    callback=_limit_memory,
    help="Refuse scenes that take more memory in one process, such as 4GiB; TAUBENCH_MAX_MEMORY is the same.  "
    "[default: that of the machine or container, divided by the workers]",
)


def scene_options(command: Any) -> Any:
    """``--scene`` and ``--animation``: the part of a file; ``--strict`` and ``--max-memory``."""
    return with_options(
        command,
        click.option("--scene", metavar="NAME|INDEX", help="Scene of the file.  [default: the file's default]"),
        click.option(
            "--animation",
            "animations",
            multiple=True,
            metavar="NAME|INDEX",
            help="Animation to play; may be repeated.  [default: all that do not collide]",
        ),
        strict_option,
        memory_option,
    )


def frame_options(size: str = "{}x{}".format(*DEFAULT_SIZE), fps: float = Settings().sequence.fps) -> Decorator:
    """Frames to render: ``--camera``, ``scene_options``, ``--fps``, ``--frames``, ``--size``."""

    def decorate(command: Any) -> Any:
        return with_options(
            command,
            click.option(
                "--camera",
                metavar="NAME|INDEX|orbit",
                help="Camera of the scene, or a framing orbit.  [default: the file's; orbit if there is none or the "
                "camera and the scene are still]",
            ),
            scene_options,
            of_settings("--fps", default=fps),
            click.option("--frames", type=Frames(), help="Frames A to B-1, a Python slice.  [default: all]"),
            click.option("--size", type=Size(), default=size, show_default=True, help="Pixels; paper: 1920x1080."),
        )

    return decorate


def pair_options(*, reprojection: str = _meanings(*REPROJECTIONS), sampling: str = _meanings(*SAMPLINGS)) -> Decorator:
    """How the two frames of a pair are compared, from ``--reprojection`` to ``--textures``.

    ``reprojection``, ``sampling``: help texts, for a command that uses the option differently.
    """

    def decorate(command: Any) -> Any:
        return with_options(
            command,
            of_settings("--reprojection", reprojection, type=click.Choice(REPROJECTIONS)),
            of_settings("--sampling", sampling, type=click.Choice(SAMPLINGS)),
            threshold_option,
            unit_scale_option,
            culling_option,
            of_settings(
                "--blend",
                "Blended surfaces (alpha mode BLEND).  cutoff: drawn where alpha is at least 0.5.  opaque: drawn "
                "everywhere.  stochastic: drawn with a probability of alpha, the same in every frame.",
                type=click.Choice(BLENDS),
            ),
            of_settings("--textures", type=click.Choice(TEXTURES)),
        )

    return decorate


threshold_option = click.option(
    "--threshold",
    "thresholds",
    type=Threshold(),
    multiple=True,
    help="Threshold of color, position (meters), normal, direct or indirect; may be repeated.  [default: 32/255]",
)
unit_scale_option = of_settings("--unit-scale")
culling_option = of_settings("--culling", type=click.Choice(CULLINGS))


def environment_options(command: Any) -> Any:
    """``--light-unit``, ``--exposure`` and ``--environment``."""
    return with_options(
        command,
        of_settings(
            "--light-unit",
            "Unit of punctual lights.  watt: intensities divided by 683, as Blender exports them.  candela: as "
            "written.  auto: watt for files of Blender's exporter 3.4 or newer.  [default: auto]",
            type=click.Choice(LIGHT_UNITS),
            show_default=False,
        ),
        of_settings(
            "--exposure",
            "Factor on radiance before thresholds and tone mapping, or auto: 1 for watt, else metered.  "
            "[default: auto]",
            type=Exposure(),
            metavar="VALUE",
            show_default=False,
        ),
        of_settings(
            "--environment",
            "Light from all around: none, default (a uniform sky and a sun), R,G,B (uniform radiance), an "
            "equirectangular FILE.hdr or FILE.exr, or auto: default where the file has no light.  [default: auto]",
            type=EnvironmentValue(),
            show_default=False,
        ),
    )


def light_options(command: Any) -> Any:
    """``--columns``, ``--effects`` and ``lighting_options`` (docs/light.md)."""
    return with_options(
        command,
        of_settings(
            "--columns",
            f"Columns of Table 4 to measure, comma-separated: {', '.join(COLUMNS)}.  [default: all]",
            type=Words(*COLUMNS, verb="measure", none=False),
            default=",".join(COLUMNS),
            show_default=False,
        ),
        of_settings(
            "--effects",
            "auto: simulate the effects that scene and columns need.  all: simulate every effect.",
            type=click.Choice(EFFECTS),
        ),
        lighting_options,
    )


def path_options(command: Any) -> Any:
    """``--light``, and the samples of path-traced light: ``--spp``, ``--bounces``, ``--bidirectional``, ``--pattern``,
    ``--seed``."""
    return with_options(
        command,
        of_settings(
            "--light",
            "Method of light.  raster: shadow maps, unoccluded environment; emissive surfaces light nothing.  "
            "path-traced: all light by path tracing.  auto: raster for punctual lights, path tracing for emissive "
            "surfaces of strength above 1 and for the environment.  [default: auto]",
            type=click.Choice(LIGHTS),
            show_default=False,
        ),
        of_settings(
            "--spp",
            f"Samples per pixel of path-traced light.  [default: {DEFAULT_SPP['path-traced']}, with --light auto 4 to "
            "256 by the measured noise]",
            type=int,
            metavar="N",
            show_default=False,
        ),
        of_settings("--bounces", "Most bounces of a path; 1: direct light alone.", metavar="N"),
        of_settings(
            "--bidirectional",
            "Path-traced indirect light also by paths from point and spot lights: less noise where one is close to a "
            "surface, more time per sample.",
            is_flag=True,
        ),
        of_settings(
            "--pattern",
            "Sample pattern of path-traced light.  fixed: the same numbers in every pixel and frame, so that noise is "
            "not counted as change.  independent: other numbers in every pixel and frame, as a renderer.",
            type=click.Choice(PATTERNS),
        ),
        of_settings("--seed", "Seed of the sample pattern.", metavar="N"),
    )


def lighting_options(command: Any) -> Any:
    """How light is simulated: ``light_options`` without the columns."""
    return with_options(
        command,
        path_options,
        environment_options,
        of_settings("--tone-map", type=click.Choice(TONE_MAPS)),
        of_settings("--shadow-size", metavar="TEXELS"),
        of_settings("--shadow-lights", metavar="N"),
        of_settings(
            "--shadow-filter",
            "Filter of the shadow-map lookup.  hard: nearest texel.  bilinear: weighted mean of four texels.",
            type=click.Choice(SHADOW_FILTERS),
        ),
        of_settings(
            "--light-error",
            "Radiance times exposure that light culling may leave out of a tile.",
            metavar="RADIANCE",
        ),
        of_settings(
            "--indirect",
            "Indirect light of the raster method; not with --light path-traced.  none: the column is null.  rsm: one "
            "bounce by reflective shadow maps, without occlusion between surfaces.  probes: up to four bounces, "
            "without detail below the probe spacing.  auto: probes.",
            type=click.Choice(INDIRECT),
        ),
    )


def path_traced_options(command: Any) -> Any:
    """How to read path-traced files (``exr:DIR``): camera, pass names; and the lobes to measure."""
    return with_options(
        command,
        *exr_options,
        click.option(
            "--second-seed", metavar="exr:DIR", help="exr: the same frames with another seed, for the noise floor."
        ),
        click.option(
            "--lobe",
            "lobes",
            multiple=True,
            type=click.Choice(["diffuse", "glossy", "transmission", "volume"]),
            help="Also measure this lobe of direct and indirect apart; may be repeated.  Rendered scenes have diffuse "
            "and glossy lobes.",
        ),
    )


exr_options = (
    click.option(
        "--camera-file", metavar="JSON", help="exr: camera sidecar.  [default: that of an export, else estimated]"
    ),
    click.option("--scene-file", metavar="SCENE", help="exr: glTF file with the camera of the frames."),
    click.option(
        "--mapping",
        metavar="NAME|FILE",
        help="exr: pass names: blender, falcor, mitsuba, taubench, unity, unreal or TOML.  "
        "[default: taubench for an export, else blender]",
    ),
    click.option("--layer", metavar="NAME", help="exr: view layer.  [default: the one with most passes]"),
)
