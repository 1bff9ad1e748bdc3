"""What records share: places, a run of the package's command, marked parts and images of pages, and tables."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("TAUBENCH_DATA") or ROOT.parent / "shared" / "data")
DEMO = ROOT / "assets" / "demo.glb"
DOCS = ROOT / "docs"


def taubench(*arguments: object, before: tuple[str, ...] = (), fine: tuple[int, ...] = (0,)) -> str:
    """Run a command of the package, print it, return what it prints.  Exit codes not in ``fine`` end the program."""
    print("taubench-gl", *arguments, flush=True)
    command = [*before, sys.executable, "-m", "taubench_gl", *map(str, arguments)]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    if done.returncode not in fine:
        sys.exit(f"tools/record: this command failed with exit code {done.returncode}")
    return done.stdout


def write_marked(page: Path, name: str, text: str) -> None:
    """Replace what is between ``<!-- record: NAME -->`` and the next ``<!-- end -->`` in a page."""
    mark = f"<!-- record: {name} -->\n"
    before, found, rest = page.read_text(encoding="utf-8").partition(mark)
    _, end, after = rest.partition("<!-- end -->\n")
    if not (found and end):
        sys.exit(f"tools/record: {page.name} has no marks for {name}")
    page.write_text(f"{before}{mark}\n{text.strip()}\n\n{end}{after}", encoding="utf-8")


def keep_image(image_file: Path, name: str) -> None:
    """Save to docs/images without a palette, so that mask colors match their legends."""
    from PIL import Image

    image = Image.open(image_file).convert("RGB")
    if name.endswith(".jpg"):  # noise compresses badly as PNG
        image.save(DOCS / "images" / name, quality=88, subsampling=0)
    else:
        image.save(DOCS / "images" / name, optimize=True)


def table(head: list[str], rows: list[list[str]]) -> str:
    return "\n".join(f"| {' | '.join(row)} |" for row in (["", *head], ["---"] * (len(head) + 1), *rows)) + "\n"


def number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
