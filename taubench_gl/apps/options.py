"""Option types and the options that several commands have."""

from __future__ import annotations

from typing import Any

import click


class Size(click.ParamType):
    """``1920x1080`` -> (1920, 1080)."""

    name = "WxH"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        width, by, height = value.lower().partition("x")
        if not (by and width.isdecimal() and height.isdecimal()):
            self.fail(f"{value!r} is not a size such as 1920x1080", param, ctx)
        return int(width), int(height)


class Frames(click.ParamType):
    """``A:B`` -> (A, B), either end may be missing: a Python slice of frame numbers."""

    name = "A:B"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        first, colon, stop = value.partition(":")
        try:
            if not colon:
                raise ValueError
            return tuple(int(end) if end.strip() else None for end in (first, stop))
        except ValueError:
            self.fail(f"{value!r} is not a range of frames such as 0:24, 100: or :-1", param, ctx)


class Threshold(click.ParamType):
    """``normal=0.1`` -> ("normal", 0.1); the names are checked by Settings."""

    name = "NAME=V"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        name, equals, number = value.partition("=")
        try:
            if not equals:
                raise ValueError
            return name.strip(), float(number)
        except ValueError:
            self.fail(f"{value!r} is not a threshold such as normal=0.1", param, ctx)


class Color(click.ParamType):
    """``R,G,B``, or one number for a grey -> (r, g, b) floats; the range is checked by Settings."""

    name = "R,G,B"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(float(part) for part in value.split(","))
        except ValueError:
            numbers = ()
        if len(numbers) not in (1, 3):
            self.fail(f"{value!r} is not a radiance such as 0.2,0.4,0.9", param, ctx)
        return numbers * 3 if len(numbers) == 1 else numbers


class Words(click.ParamType):
    """A comma-separated choice of ``words`` -> tuple, in the order given, each once."""

    name = "LIST"

    def __init__(self, *words: str, verb: str = "save"):
        self.words, self.verb = words, verb

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        chosen = tuple(dict.fromkeys(word.strip() for word in value.split(",") if word.strip()))
        unknown = [word for word in chosen if word not in self.words]
        if unknown:
            self.fail(f"cannot {self.verb} {', '.join(unknown)}; choose from {', '.join(self.words)}", param, ctx)
        return chosen


def gpu_options(command: Any) -> Any:
    """``--backend`` and ``--device``."""
    from taubench_gl.settings import BACKENDS

    command = click.option("--device", type=click.IntRange(min=0), help="EGL device number, see 'taubench-gl doctor'.")(
        command
    )
    return click.option(
        "--backend",
        type=click.Choice(BACKENDS),
        default="auto",
        envvar="TAUBENCH_BACKEND",
        show_default=True,
        show_envvar=True,
        help="How OpenGL is opened.",
    )(command)


def scene_options(command: Any) -> Any:
    """``--scene`` and ``--animation``: which part of a file."""
    command = click.option(
        "--animation",
        "animations",
        multiple=True,
        metavar="NAME|INDEX",
        help="Animation to play; may be repeated.  [default: all that fit together]",
    )(command)
    return click.option("--scene", metavar="NAME|INDEX", help="Scene of the file.  [default: the file's own]")(command)


def light_options(command: Any) -> Any:
    """What is measured of light, and how it is simulated (docs/light.md)."""
    from taubench_gl.conventions import COLUMNS
    from taubench_gl.settings import EFFECTS, INDIRECT, SHADOW_FILTERS, TONE_MAPS, Settings

    default = Settings()
    for option in reversed(
        (
            click.option(
                "--columns",
                type=Words(*COLUMNS, verb="measure"),
                default=",".join(COLUMNS),
                help=f"Columns of Table 4 to measure, of {','.join(COLUMNS)}.  [default: all]",
            ),
            click.option(
                "--effects",
                type=click.Choice(EFFECTS),
                default=default.effects,
                show_default=True,
                help="auto: simulate what scene and columns call for.  all: everything, for comparison.",
            ),
            click.option(
                "--sky", type=Color(), default=default.sky, help="Uniform sky radiance, cd/m2.  [default: 0,0,0]"
            ),
            click.option(
                "--exposure",
                type=float,
                metavar="VALUE",
                default=default.exposure,
                show_default=True,
                help="Factor on radiance before thresholds and tone map.",
            ),
            click.option(
                "--tone-map",
                type=click.Choice(TONE_MAPS),
                default=default.tone_map,
                show_default=True,
                help="From radiance x exposure to the color column.",
            ),
            click.option(
                "--shadow-size",
                type=int,
                metavar="TEXELS",
                default=default.shadow_size,
                show_default=True,
                help="Side of a shadow map, texels; directional lights have four times as many.",
            ),
            click.option(
                "--shadow-lights",
                type=int,
                metavar="N",
                default=default.shadow_lights,
                show_default=True,
                help="Lights that cast shadows, the most significant first.",
            ),
            click.option(
                "--shadow-filter",
                type=click.Choice(SHADOW_FILTERS),
                default=default.shadow_filter,
                show_default=True,
                help="hard: one texel decides.  bilinear: four, weighted.",
            ),
            click.option(
                "--light-error",
                type=float,
                metavar="RADIANCE",
                default=default.light_error,
                show_default=True,
                help="Largest radiance, cd/m2 before exposure, that light culling may leave out of a pixel.",
            ),
            click.option(
                "--indirect",
                type=click.Choice(INDIRECT),
                default=default.indirect,
                show_default=True,
                help="Light of two bounces or more: none (column is null), rsm (ignores walls between surfaces and "
                "later bounces) or probes (auto; four bounces, ignores detail below the probe spacing).",
            ),
        )
    ):
        command = option(command)
    return command


def truth_options(command: Any) -> Any:
    """What path-traced files (``exr:DIR``) need to be told: camera, names of passes, lobes."""
    for option in reversed(
        (
            click.option("--camera-file", metavar="JSON", help="exr: camera sidecar.  [default: estimated]"),
            click.option("--scene-file", metavar="SCENE", help="exr: glTF file whose camera took the pictures."),
            click.option(
                "--mapping", metavar="NAME|FILE", help="exr: pass names; blender, mitsuba, falcor, taubench or TOML."
            ),
            click.option("--layer", metavar="NAME", help="exr: view layer.  [default: the one with most passes]"),
            click.option("--second-seed", metavar="exr:DIR", help="exr: same frames, other seed, for the noise floor."),
            click.option(
                "--lobe",
                "lobes",
                multiple=True,
                type=click.Choice(["diffuse", "glossy", "transmission", "volume"]),
                help="exr: also measure this lobe of direct and indirect; may be repeated.",
            ),
        )
    ):
        command = option(command)
    return command
