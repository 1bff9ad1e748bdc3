#!/usr/bin/env python3
"""Render the images of the README into docs/images: tools/make_images.py [NAME ...]

Each image comes from a command of the package.  The report is captured in Chromium, the viewer under Xvfb.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "images"
DEMO = ROOT / "assets" / "demo.glb"


def taubench(*arguments: object, before: tuple[str, ...] = ()) -> None:
    subprocess.run([*before, sys.executable, "-m", "taubench_gl", *map(str, arguments)], check=True)


def keep(image_file: Path, name: str) -> None:
    """Save to docs/images without a palette, so that mask colors match their legends."""
    image = Image.open(image_file).convert("RGB")
    if name.endswith(".jpg"):  # noise compresses badly as PNG
        image.save(FOLDER / name, quality=88, subsampling=0)
    else:
        image.save(FOLDER / name, optimize=True)


def report(scratch: Path) -> None:
    from playwright.sync_api import sync_playwright

    taubench("evaluate", DEMO, "--size", "640x360", "--frames", "0:25", "--out", scratch / "run", "--report")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1180, "height": 1010})
        page.goto((scratch / "run" / "report.html").as_uri())
        page.wait_for_function("document.images.length === 0 || [...document.images].every((i) => i.complete)")
        page.wait_for_load_state("networkidle")
        page.screenshot(path=scratch / "report.png")
        browser.close()
    keep(scratch / "report.png", "report.png")
    keep(scratch / "run" / "mask.png", "mask.png")


def viewer(scratch: Path) -> None:
    steps = scratch / "steps.txt"
    image_file = scratch / "viewer.png"
    steps.write_text(f"frame 22\nset probe 545,190\nset probe_pinned on\nscreenshot {image_file} window\nquit\n")
    screen = ("xvfb-run", "-a", "-s", "-screen 0 1440x900x24")
    options = ("--size", "640x360", "--lighting", "--indirect", "none", "--window", "1280x720")
    taubench("view", DEMO, *options, "--script", steps, before=screen)
    keep(image_file, "viewer.png")


def reuse(scratch: Path) -> None:
    methods = "none,accumulate,taa_variance,svgf,ideal-masks"
    options = ("--input", "noisy+jittered", "--size", "320x180", "--frames", "0:12", "--indirect", "none")
    taubench("reuse", "evaluate", DEMO, "--methods", methods, *options, "--video", "none", "--out", scratch / "reuse")
    keep(scratch / "reuse" / "side_by_side.png", "reuse.jpg")


IMAGES = {"report": report, "viewer": viewer, "reuse": reuse}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", choices=[[], *IMAGES], help=f"of {', '.join(IMAGES)}; default: all")
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in parser.parse_args().names or IMAGES:
        with tempfile.TemporaryDirectory() as scratch:
            IMAGES[name](Path(scratch))


if __name__ == "__main__":
    main()
