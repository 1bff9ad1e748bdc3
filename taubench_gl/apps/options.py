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


class Words(click.ParamType):
    """A comma-separated choice of ``words`` -> tuple, in the order given, each once."""

    name = "LIST"

    def __init__(self, *words: str):
        self.words = words

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        chosen = tuple(dict.fromkeys(word.strip() for word in value.split(",") if word.strip()))
        unknown = [word for word in chosen if word not in self.words]
        if unknown:
            self.fail(f"cannot save {', '.join(unknown)}; choose from {', '.join(self.words)}", param, ctx)
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


def truth_options(command: Any) -> Any:
    """What path-traced files (``exr:DIR``) need to be told: camera, names of passes, lobes."""
    for option in reversed(
        (
            click.option("--camera-file", metavar="JSON", help="exr: camera sidecar.  [default: estimated]"),
            click.option("--scene-file", metavar="SCENE", help="exr: glTF file whose camera took the pictures."),
            click.option(
                "--mapping", metavar="NAME|FILE", help="exr: pass names; blender, mitsuba, falcor or TOML."
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
