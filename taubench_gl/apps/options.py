"""The options that several commands have, and Settings made of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import click

from taubench_gl.apps.option_types import Color, Frames, Size, Threshold, Words
from taubench_gl.conventions import COLUMNS
from taubench_gl.settings import (
    BACKENDS,
    CULLINGS,
    EFFECTS,
    INDIRECT,
    REPROJECTIONS,
    SAMPLINGS,
    SHADOW_FILTERS,
    TEXTURES,
    TONE_MAPS,
    Settings,
)

Decorator = Callable[[Any], Any]


def with_options(command: Any, *options: Decorator) -> Any:
    """``command`` with ``options``, in the order in which its help lists them."""
    for option in reversed(options):
        command = option(command)
    return command


def of_settings(flag: str, help: str, *, field: str | None = None, **attributes: Any) -> Decorator:
    """An option for a field of Settings, by default the one of its name; default and type are the field's."""
    name = field or flag.removeprefix("--").replace("-", "_")
    return click.option(flag, name, help=help, **{"default": Settings().get(name), "show_default": True, **attributes})


def given_options(names: Iterable[str]) -> frozenset[str]:
    """Of ``names``, parameters of the command that is running, those that the user gave, as opposed to defaults."""
    context = click.get_current_context()
    default = (click.core.ParameterSource.DEFAULT, click.core.ParameterSource.DEFAULT_MAP, None)
    return frozenset(name for name in names if context.get_parameter_source(name) not in default)


def settings_from(options: dict[str, Any], **more: Any) -> Settings:
    """Settings of a command's options, ``frame_options`` among them; all that ``options`` holds must be one.

    ``more``: fields that the command decides.  Raises SettingsError for a value that no evaluation can have.
    """
    options = dict(options)
    width, height = options.pop("size")
    return Settings.of(
        width=width,
        height=height,
        frames=options.pop("frames") or (None, None),
        animation=options.pop("animations") or None,
        thresholds=dict(options.pop("thresholds", ())),
        **options,
        **more,
    )


def gpu_options(command: Any) -> Any:
    """``--backend`` and ``--device``."""
    return with_options(
        command,
        of_settings(
            "--backend",
            "How OpenGL is opened.",
            type=click.Choice(BACKENDS),
            envvar="TAUBENCH_BACKEND",
            show_envvar=True,
        ),
        click.option("--device", type=click.IntRange(min=0), help="EGL device number, see 'taubench-gl doctor'."),
    )


def scene_options(command: Any) -> Any:
    """``--scene`` and ``--animation``: which part of a file."""
    return with_options(
        command,
        click.option("--scene", metavar="NAME|INDEX", help="Scene of the file.  [default: the file's own]"),
        click.option(
            "--animation",
            "animations",
            multiple=True,
            metavar="NAME|INDEX",
            help="Animation to play; may be repeated.  [default: all that fit together]",
        ),
    )


def frame_options(size: str = "1920x1080", fps: float = Settings().sequence.fps) -> Decorator:
    """Which pictures of a scene: ``--camera``, ``--scene``, ``--animation``, ``--fps``, ``--frames``, ``--size``."""

    def decorate(command: Any) -> Any:
        return with_options(
            command,
            click.option(
                "--camera", metavar="NAME|INDEX", help="[default: the first, else an orbit that frames the scene]"
            ),
            scene_options,
            of_settings("--fps", "Frames per second.", default=fps),
            click.option("--frames", type=Frames(), help="Frames A to B-1, a Python slice.  [default: all]"),
            click.option("--size", type=Size(), default=size, show_default=True, help="Pixels."),
        )

    return decorate


def pair_options(
    *,
    reprojection: str = "camera: as the paper, surfaces count as still.  motion: follow moving surfaces.",
    sampling: str = "Of history.",
) -> Decorator:
    """How the two frames of a pair are drawn and judged, from ``--reprojection`` to ``--textures``.

    The arguments are the help texts of the options of their names, where a command uses them in a way of its own.
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
                "--textures",
                "finest: without mipmaps, as 'reference render --crisp' samples them.",
                type=click.Choice(TEXTURES),
            ),
        )

    return decorate


threshold_option = click.option(
    "--threshold",
    "thresholds",
    type=Threshold(),
    multiple=True,
    help="a_B of color, position (metres), normal, direct or indirect; may be repeated.  [default: 32/255]",
)
unit_scale_option = of_settings("--unit-scale", "Scene units per metre.")
culling_option = of_settings("--culling", "Back faces.", type=click.Choice(CULLINGS))
sky_option = of_settings("--sky", "Uniform sky radiance, cd/m2.  [default: 0,0,0]", type=Color(), show_default=False)


def light_options(command: Any) -> Any:
    """What is measured of light, and how it is simulated (docs/light.md)."""
    return with_options(
        command,
        of_settings(
            "--columns",
            f"Columns of Table 4 to measure, of {','.join(COLUMNS)}.  [default: all]",
            type=Words(*COLUMNS, verb="measure", none=False),
            default=",".join(COLUMNS),
            show_default=False,
        ),
        of_settings(
            "--effects",
            "auto: simulate what scene and columns call for.  all: everything, for comparison.",
            type=click.Choice(EFFECTS),
        ),
        lighting_options,
    )


def lighting_options(command: Any) -> Any:
    """How light is simulated: the part of ``light_options`` for commands that choose the columns themselves."""
    return with_options(
        command,
        sky_option,
        of_settings("--exposure", "Factor on radiance before thresholds and tone map.", metavar="VALUE"),
        of_settings("--tone-map", "From radiance x exposure to the color column.", type=click.Choice(TONE_MAPS)),
        of_settings(
            "--shadow-size",
            "Side of a shadow map, texels; directional lights have four times as many.",
            metavar="TEXELS",
        ),
        of_settings("--shadow-lights", "Lights that cast shadows, the most significant first.", metavar="N"),
        of_settings(
            "--shadow-filter",
            "hard: one texel decides.  bilinear: four, weighted.",
            type=click.Choice(SHADOW_FILTERS),
        ),
        of_settings(
            "--light-error",
            "Largest radiance, cd/m2 before exposure, that light culling may leave out of a pixel.",
            metavar="RADIANCE",
        ),
        of_settings(
            "--indirect",
            "Light of two bounces or more: none (column is null), rsm (ignores walls between surfaces and later "
            "bounces) or probes (auto; four bounces, ignores detail below the probe spacing).",
            type=click.Choice(INDIRECT),
        ),
    )


def path_traced_options(command: Any) -> Any:
    """What path-traced files (``exr:DIR``) need to be told: camera, names of passes, lobes."""
    return with_options(
        command,
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
