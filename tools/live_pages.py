"""The parts of the documentation site that are computed: ``python tools/live_pages.py FOLDER``.

The demo's report, the lessons, and reuse methods on three scenes of the benchmark, each by the command that a user
would type.  The site's home page shows what it finds in the folder.
"""

from __future__ import annotations

import base64
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from taubench_gl.benchmark.scenes import SceneRecipe, scene_file

RUN, LESSONS = "run", "demos"
"""Folders of the demo's report and of the lessons."""
CARD, CARD_SIZE = "card.webp", (640, 640)
"""The worst frame by every method, in the folder of a MethodsPage."""
METHODS = "none,accumulate,taa_variance,svgf,asvgf"
SIZE, FRAMES = "240x135", 10
RUN_SIZE = "256x144"
"""So that the site stays below 30 MB."""
FIRST_IMAGE = re.compile(r"data:image/(png|webp);base64,([A-Za-z0-9+/=]+)")


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
    MethodsPage("reuse-demo", "The demo as it is", SceneRecipe("demo")),
    MethodsPage("reuse-rotation", "The camera turns 4° a frame", SceneRecipe("demo", "rotation", 4.0, FRAMES, 24.0)),
    MethodsPage("reuse-light", "Lights move 0.5 m a frame", SceneRecipe("demo", "light_speed", 0.5, FRAMES, 24.0)),
)


def make(folder: Path) -> None:
    """Write every part to a folder of its own.  Raises subprocess.CalledProcessError if one fails."""
    report = ("evaluate", str(scene_file(SceneRecipe("demo"))), "--size", RUN_SIZE, "--report-full")
    taubench("the demo's report", *report, "--out", folder / RUN)
    taubench("the lessons", "demo", "--all", "--out", folder / LESSONS)
    for page in sorted((folder / LESSONS).glob("[0-9]*.html")):
        keep_first_image(page)
    for page in METHODS_PAGES:
        out = folder / page.name
        taubench(f"reuse methods: {page.title}", *page.arguments(), "--out", out)
        with Image.open(out / "side_by_side.png") as image:
            image.thumbnail(CARD_SIZE)
            image.save(out / CARD)


def keep_first_image(page: Path) -> None:
    """Beside a page the first image that it shows: that of a lesson's page tells no answer, as its figure does."""
    kind, data = FIRST_IMAGE.search(page.read_text(encoding="utf-8")).groups()
    page.with_suffix(f".{kind}").write_bytes(base64.b64decode(data))


def taubench(title: str, *arguments: str | Path) -> None:
    """Run one command; its progress stays visible, its tables are in the folder."""
    print(f"tools/docs: {title}", file=sys.stderr, flush=True)
    subprocess.run([sys.executable, "-m", "taubench_gl", *map(str, arguments)], stdout=subprocess.DEVNULL, check=True)


if __name__ == "__main__":
    make(Path(sys.argv[1]))
