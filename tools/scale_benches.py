"""Benchmarks of large scenes, their growth, the corner correction and the viewer: CPU time of commands, and frames."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from unittest.mock import patch

from benches import EIGHT, ROOT, Claim, Options, Result, Row, bench, missing, row
from city import write_city
from scaling_benches import Walker, fit, interleaved_frames

from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.context import Gpu
from taubench_gl.paths import ASSETS
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings
from taubench_gl.viewer.feeds import OpenRequest
from taubench_gl.viewer.layout import BAR, SIDE

BASE = "TAUBENCH_BASE"
"""Environment variable: folder of an older checkout to compare with, whose code runs with the same packages."""

GEOMETRY = ("--columns", "frustum,position,normal", "--pairs", "all", "--exposure", "1")
GROWTH: dict[str, tuple[str, tuple[int, ...]]] = {
    "triangles": ("inspect", (250_000, 500_000, 1_000_000, 2_000_000)),
    "lights": ("inspect", (8, 16, 32, 64)),
    "textures of 1024x1024": ("inspect", (8, 16, 32, 64)),
    "pixels": ("geometry of 6 frames", (160 * 90, 320 * 180, 640 * 360, 1280 * 720)),
    "frames": ("geometry", (6, 12, 24, 48)),
}
"""What grows -> the command that is measured, and how many of it."""

READ = {
    "read": "from taubench_gl.scene import load_scene; load_scene({!r})",
    "read by trimesh": "import trimesh; trimesh.load({!r})",
}


def measured(checkout: Path, arguments: list[str], cache: Path) -> tuple[float, float] | None:
    """CPU milliseconds and MiB of a command of ``checkout`` with an empty cache; None if it fails."""
    with tempfile.TemporaryDirectory(dir=cache) as empty:
        environment = os.environ | {"PYTHONPATH": str(checkout), "TAUBENCH_CACHE": empty, "LP_NUM_THREADS": "1"}
        command = [sys.executable, *arguments]
        process = subprocess.Popen(command, cwd=empty, env=environment, stdout=-3, stderr=-3)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    return (1e3 * (used.ru_utime + used.ru_stime), used.ru_maxrss / 1024) if process.returncode == 0 else None


def command(name: str, scene: Path, size: str = "320x180", frames: int = 6) -> list[str]:
    """Arguments of Python for a measured command."""
    if name in READ:
        return ["-c", READ[name].format(str(scene))]
    if name == "inspect":
        return ["-m", "taubench_gl", "inspect", str(scene)]
    chosen = ["--size", size, "--frames", f"0:{frames}", "--out", "out"]
    return ["-m", "taubench_gl", "evaluate", str(scene), *chosen, *(GEOMETRY if name.startswith("geometry") else ())]


@bench
def corners(gpu: Gpu, options: Options) -> Result:
    """The geometry pass with and without the correction for corners that the rasterizer snaps."""
    walkers, scene = [], load_scene(ASSETS / "demo.glb")
    for snapped in (False, True):
        with patch.object(Tuning, "snapped_corners", snapped):
            walkers.append(Walker(gpu, scene, options.size, EIGHT))
    times = interleaved_frames(gpu, walkers, 8 * options.repeats)
    names = ("positions where the triangle is sampled", "positions at pixel centers")
    rows = [row(name, ms) for name, ms in zip(names, times, strict=True)]
    return Result("Corner correction of the geometry pass", rows, [f"demo.glb, {options.size_text}, eight channels"])


@bench
def viewer(gpu: Gpu, options: Options) -> Result:
    """Frames of the viewer with its panels, drawn off-screen; every frame is classified."""
    title = "Viewer, off-screen"
    try:
        from taubench_gl.viewer.app import Viewer
    except ImportError as error:
        return Result(title, [missing("frames of the viewer", f"{error.name} is not installed")], [])
    rows, window = [], (options.size[0] + SIDE, options.size[1] + BAR)
    texture = gpu.ctx.texture(window, 4)
    framebuffer = gpu.ctx.framebuffer([texture])
    for name, lit in {"masks of geometry": False, "with light": True}.items():
        request = OpenRequest(str(ASSETS / "demo.glb"), Settings(size=options.size, exposure=1.0))
        shown = Viewer(gpu, request, light=lit, folder=None)
        shown.window_size = window
        rate = shown.bench(8 * options.repeats, partial(shown.draw, framebuffer))
        rows.append(Row(name, *3 * [1e3 / rate], 8 * options.repeats, f"{rate:.1f} frames/s"))
        shown.close()
    gpu.unbind_framebuffer()
    framebuffer.release()
    texture.release()
    return Result(title, rows, [f"demo.glb, {options.size_text}, window of {window[0]}x{window[1]}; median"])


@bench
def scale(gpu: Gpu, options: Options) -> Result:
    """A city of growing size: this checkout, TAUBENCH_BASE and trimesh in turn; CPU time of whole processes."""
    if not options.alone:
        return Result("Large scenes", [missing("commands on a city", "takes minutes: tools/bench scale")], [])
    rows: list[Row] = []
    notes = ["CPU milliseconds of whole processes with an empty cache; the detail has the peak of memory"]
    claims: list[Claim] = []
    base = os.environ.get(BASE)
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder)
        city = write_city(cache / "city.glb", 1_000_000, 32, 32)
        for name in ("inspect", "geometry of 6 frames", "evaluate of 6 frames", *READ):
            checkouts = {"": ROOT} | ({"base: ": Path(base)} if base and name != "read by trimesh" else {})
            found = {}
            for label, checkout in checkouts.items():
                found[label] = add(rows, f"{label}{name}", measured(checkout, command(name, city), cache))
            if len(found) == 2 and all(found.values()):
                claims.append(Claim(f"{name} relative to {BASE}", "<=", 1.0, found[""] / found["base: "]))
        for what, (name, counts) in GROWTH.items():
            times = []
            for count in counts:
                scene, extra = grown(cache, what, count, city)
                times.append(
                    add(rows, f"{name}, {count:,} {what}", measured(ROOT, command(name, scene, **extra), cache))
                )
            if all(times):
                whole, upper = fit(list(map(float, counts)), times)
                notes.append(f"{name}: time grows as {what}^{whole:.2f} (larger half: ^{upper:.2f})")
    return Result("Large scenes", rows, notes, claims=tuple(claims))


def grown(folder: Path, what: str, count: int, city: Path) -> tuple[Path, dict]:
    """The scene and the keywords of ``command`` where there is ``count`` of ``what``."""
    if what == "pixels":
        height = round((count / 16 * 9) ** 0.5)
        return city, {"size": f"{count // height}x{height}"}
    if what == "frames":
        return city, {"frames": count}
    numbers = {"triangles": 50_000, "lights": 8, "textures": 8} | {what.split()[0]: count}
    return write_city(folder / "grown.glb", **numbers), {}


def add(rows: list[Row], what: str, found: tuple[float, float] | None) -> float | None:
    """Add the row of a measurement; its milliseconds."""
    if found is None:
        rows.append(missing(what, "the command failed"))
        return None
    rows.append(Row(what, *3 * [found[0]], 1, f"{found[1]:.0f} MiB"))
    return found[0]
