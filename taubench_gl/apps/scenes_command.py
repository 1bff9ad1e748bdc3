"""``taubench-gl scenes``: the paper's scenes and what stands in for them."""

from __future__ import annotations

import click

from taubench_gl.apps.aliases import Group
from taubench_gl.apps.scenes_make_command import make
from taubench_gl.apps.scenes_registry_commands import get, list_scenes, show, verify


@click.group(cls=Group)
def scenes() -> None:
    """The paper's scenes, and stand-ins made by code."""


for command in (list_scenes, show, get, verify, make):
    scenes.add_command(command)
