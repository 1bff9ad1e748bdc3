"""tools/bench agreement: the cost of accuracy.  Seconds per frame of the rasterizer and of Cycles at several sample
counts, and the difference of their columns to a converged render of the same frames.

Renders are kept in a folder with their times and used again.  Needs Blender as a Python module.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from light_scenes import make
from rich.console import Console
from rich.table import Table

from taubench_gl.animation import choose_camera
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.features import COLUMNS
from taubench_gl.pathtraced.blender.job import Quality
from taubench_gl.pathtraced.blender.render import render_reference
from taubench_gl.pathtraced.cameras import CAMERA_FILE
from taubench_gl.pathtraced.compare import compare_runs, noise_floor_percent, seconds_per_frame
from taubench_gl.pathtraced.evaluation import PathTracedOptions, evaluate_path_traced
from taubench_gl.run import Run
from taubench_gl.scene import load_scene
from taubench_gl.settings import FIXED_LIGHTING, Settings

SAMPLES = (1, 16, 64)
SIZE = (192, 108)
FRAMES = (24, 28)
BOUNCES = 12
RASTERIZED = {"rasterizer": {}, "rasterizer, no indirect light": {"indirect": "none"}}


@dataclass(frozen=True)
class CostRow:
    """One renderer with its settings."""

    name: str
    seconds: float
    ratio: float  # to the first row
    clock: str
    difference_pp: dict[str, float | None]  # column -> less the converged render; None: not measured


@dataclass(frozen=True)
class Costs:
    title: str
    rows: list[CostRow]
    converged: dict[str, float | None]  # percent
    floor: dict[str, float | None]  # percent, of the converged render
    notes: list[str] = field(default_factory=list)


def measure(
    out: Path, scene_name: str = "room", size: tuple[int, int] = SIZE, converged: int = 256, backend: str = "auto"
) -> Costs:
    """Render missing references, evaluate, compare."""
    path = make(out / "scenes")[scene_name]
    scene = load_scene(path)
    shared = {"width": size[0], "height": size[1], "frames": FRAMES, "backend": backend}
    runs: list[tuple[str, Run]] = []
    for name, changes in RASTERIZED.items():
        settings = Settings(**shared, textures="finest", shadow_size=2048, **changes, **FIXED_LIGHTING)
        runs.append((name, evaluate_scene(scene, settings)))
    for samples in SAMPLES:
        run = _path_traced(scene, out, scene_name, size, samples, 0)
        runs.append((f"Cycles, {samples} sample{'s' * (samples > 1)}", run))
    reference = _path_traced(scene, out, scene_name, size, converged, 0, second=1)
    rows = []
    for name, run in (*runs, (f"Cycles, {converged} samples", reference)):
        time = seconds_per_frame(run.summary)
        differences = {c: e["difference_pp"] for c, e in compare_runs(run, reference)["columns"].items()}
        first = rows[0].seconds if rows else time["seconds"]
        rows.append(CostRow(name, time["seconds"], time["seconds"] / first, time["clock"], differences))
    floor = noise_floor_percent(reference.summary)
    return Costs(
        f"Cost of accuracy: {scene_name}, {size[0]}x{size[1]}, {reference.summary['pairs']} pairs at 24 fps",
        rows,
        {c: reference.summary["discard"][c]["mean_percent"] for c in COLUMNS},
        {c: floor.get(c) for c in COLUMNS},
        [
            f"columns: percentage points less the {converged}-sample render; renders: {BOUNCES} bounces, pixel centers",
            "timed one after another on the same machine; cached renders keep their recorded times",
        ],
    )


def _path_traced(
    scene: Any, out: Path, name: str, size: tuple[int, int], samples: int, seed: int, second: int | None = None
):
    folders = []
    for s in (seed, *(() if second is None else (second,))):
        folder = out / f"{name}_{size[0]}x{size[1]}_{samples}_seed{s}"
        quality = Quality(samples=samples, bounces=BOUNCES, seed=s, crisp=True)
        render_reference(scene, choose_camera(scene), range(*FRAMES), folder, fps=24.0, size=size, quality=quality)
        folders.append(folder)
    other = f"exr:{folders[1]}" if len(folders) > 1 else None
    options = PathTracedOptions(camera_file=folders[0] / CAMERA_FILE, second_seed=other)
    return evaluate_path_traced(f"exr:{folders[0]}", Settings(frames=FRAMES, **FIXED_LIGHTING), options)


def show(console: Console, costs: Costs) -> None:
    console.width = max(console.width, 110)
    table = Table(title=costs.title, title_justify="left")
    table.add_column("", no_wrap=True)
    for head in ("s / frame", "ratio", *COLUMNS):
        table.add_column(head, justify="right", no_wrap=True)
    for row in costs.rows:
        cells = [
            "–" if row.difference_pp[c] is None else f"{round(row.difference_pp[c], 2) + 0.0:+.2f}" for c in COLUMNS
        ]
        table.add_row(row.name, f"{row.seconds:.3f}", f"{row.ratio:.2f}", *cells)
    table.add_section()
    for what, values in (("converged, percent", costs.converged), ("its noise floor, percent", costs.floor)):
        table.add_row(what, "", "", *("–" if values[c] is None else f"{values[c]:.2f}" for c in COLUMNS))
    console.print(table)
    clocks = {row.clock: [r.name for r in costs.rows if r.clock == row.clock] for row in costs.rows}
    for clock, names in clocks.items():
        console.print(f"  clock of {'; '.join(names)}: {clock}", markup=False, highlight=False)
    for note in costs.notes:
        console.print(f"  {note}", markup=False, highlight=False)
