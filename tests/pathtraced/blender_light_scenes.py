"""Scenes with punctual lights, built, exported and rendered by Blender (tools/blender_references), and both columns."""

from __future__ import annotations

from pathlib import Path

from fixed import fixed_settings

from taubench_gl.evaluation import evaluate_scene
from taubench_gl.pathtraced.evaluation import PathTracedOptions, evaluate_path_traced
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.run import Run

FOLDER = Path(__file__).parent / "blender_lights"
MAPPING = FOLDER / "mapping.toml"
COLUMNS = ("frustum", "position", "direct")


def scene_names() -> list[str]:
    return sorted(path.stem for path in FOLDER.glob("*.glb"))


def columns(name: str) -> tuple[Run, Run]:
    """The rasterizer's run at its defaults but for size, frames and columns; the run of the Cycles renders."""
    renders = f"exr:{FOLDER / name}"
    sequence = PathTracedSequence.open(renders, mapping=MAPPING)
    frames = sequence.frames
    options = PathTracedOptions(camera_file=FOLDER / name / "camera.json", mapping=MAPPING)
    cycles = evaluate_path_traced(renders, fixed_settings(columns=COLUMNS), options)
    width, height = sequence.size
    auto = {"light_unit": "auto", "exposure": "auto", "environment": "auto"}
    settings = fixed_settings(width=width, height=height, frames=(frames[0], frames[-1] + 1), columns=COLUMNS, **auto)
    return evaluate_scene(FOLDER / f"{name}.glb", settings), cycles
