"""The parts of the documentation site that are computed: ``python tools/live_pages.py FOLDER``.

The demo's report, the lessons, and reuse methods on three scenes of the benchmark, each by the command that a user
would type.  The site's home page shows what it finds in the folder.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from taubench_gl.benchmark.scenes import DEMO, SceneRecipe, scene_file

RUN, LESSONS = "run", "demos"
"""Folders of the demo's report and of the lessons."""
METHODS = "none,accumulate,taa_variance,svgf,asvgf"
SIZE, FRAMES = "320x180", 16


@dataclass(frozen=True, slots=True)
class MethodsPage:
    """Reuse methods on one scene.  ``name``: of its folder."""

    name: str
    title: str
    recipe: SceneRecipe

    def arguments(self) -> tuple[str, ...]:
        """Of taubench-gl, without the folder."""
        options = ("--input", "noisy", "--size", SIZE, "--frames", f"0:{FRAMES}", "--video", "none", "--report")
        return "reuse", "evaluate", str(scene_file(self.recipe)), "--methods", METHODS, *options


METHODS_PAGES = (
    MethodsPage("reuse-demo", "The demo as it is", SceneRecipe(DEMO)),
    MethodsPage("reuse-rotation", "The camera turns 4° a frame", SceneRecipe(DEMO, "rotation", 4.0, FRAMES, 24.0)),
    MethodsPage("reuse-light", "Lights move 0.5 m a frame", SceneRecipe(DEMO, "light_speed", 0.5, FRAMES, 24.0)),
)


def make(folder: Path) -> None:
    """Write every part to a folder of its own.  Raises subprocess.CalledProcessError if one fails."""
    taubench("the demo's report", "evaluate", str(scene_file(SceneRecipe(DEMO))), "--report", "--out", folder / RUN)
    taubench("the lessons", "demo", "--all", "--out", folder / LESSONS)
    for page in METHODS_PAGES:
        taubench(f"reuse methods: {page.title}", *page.arguments(), "--out", folder / page.name)


def taubench(title: str, *arguments: str | Path) -> None:
    """Run one command; its progress stays visible, its tables are in the folder."""
    print(f"tools/docs: {title}", file=sys.stderr, flush=True)
    subprocess.run([sys.executable, "-m", "taubench_gl", *map(str, arguments)], stdout=subprocess.DEVNULL, check=True)


if __name__ == "__main__":
    make(Path(sys.argv[1]))
