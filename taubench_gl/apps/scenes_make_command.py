"""``taubench-gl scenes make``: procedural stand-ins for the paper's scenes that cannot be bundled."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

NAMES = ("eternal-valley-fps", "eternal-valley-vr")


@click.command(
    epilog="""\b
Examples:
  taubench-gl scenes make eternal-valley-fps valley.glb
  taubench-gl evaluate valley.glb --fps 60 --environment 0.2,0.3,0.5"""
)
@click.argument("name", type=click.Choice(NAMES))
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT.glb")
def make(name: str, out: Path) -> None:
    """Write a procedural stand-in for one of the paper's EternalValley scenes (CC0).

    It is not the dataset.  It has exactly the paper's counts (Table 1), and its camera statistics (Tables 2 and 3) at
    the capture rate of 60 fps.  Its geometry and its Table 4 row differ from the paper's.
    """
    from taubench_gl.apps.screen import show_tables
    from taubench_gl.datasets.stand_ins import make_stand_in
    from taubench_gl.report import paper_tables
    from taubench_gl.scene import load_scene

    recipe = make_stand_in(name, out)
    summary = describe(load_scene(out), recipe.camera.fps)
    show_tables(paper_tables([summary])[:3])
    click.echo(f"note: {recipe.note}")
    click.echo(f"written to {out} ({out.stat().st_size:,} bytes, CC0)")
    click.echo(f"Table 4: taubench-gl evaluate {out} --fps {recipe.camera.fps:g} --environment 0.2,0.3,0.5")


def describe(scene: Any, fps: float) -> dict[str, Any]:
    """The part of summary.json that needs no OpenGL: census and camera of all frames at ``fps``."""
    import numpy as np

    from taubench_gl.animation import Poser, choose_camera
    from taubench_gl.effects.census import census
    from taubench_gl.metrics.activity import camera_activity, detect_cuts, summarize
    from taubench_gl.settings import Settings

    poser, camera = Poser(scene), choose_camera(scene)
    times = [i / fps for i in range(Settings(fps=fps).sequence.frame_count(scene.duration))]
    views = [camera.view_at(poser.sample(t)) for t in times]
    activity = camera_activity(np.array([v.position for v in views]), np.array([v.world_from_view for v in views]))
    return {
        "scene": {"name": scene.name, "stand_in": scene.stand_in},
        "settings": {"fps": fps},
        "pairs": len(activity),
        "census": census(scene, times, poser),
        "camera": summarize(activity, detect_cuts(activity), fps) | {"source": camera.describe()},
    }
