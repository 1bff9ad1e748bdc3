"""``taubench-gl scenes``: named scenes, and stand-ins for the paper's scenes."""

from __future__ import annotations

import click

from taubench_gl.apps.aliases import Group
from taubench_gl.apps.scenes_make_command import make
from taubench_gl.apps.scenes_registry_commands import get, list_scenes, show, verify


@click.group(cls=Group)
def scenes() -> None:
    """Named scenes, such as the paper's, and procedural stand-ins."""


for command in (list_scenes, show, get, verify, make):
    scenes.add_command(command)
