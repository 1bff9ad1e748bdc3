"""FBX and .blend files -> glTF, with Blender's importers and exporter."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from taubench_gl.errors import SceneError
from taubench_gl.outputs import write_atomically
from taubench_gl.pathtraced.blender.process import blender_python, require_blender, run_script

SOURCES = (".fbx", ".blend")
LIGHTING_MODE = "SPEC"
"""Mode of Blender's exporter: candela and lux at 683 lumens per watt, what ``light_unit`` expects of its files."""


def convert(source: str | Path, target: str | Path, *, python: str | None = None) -> dict[str, Any]:
    """Write ``source`` as the .glb file ``target``, atomically, with animations, cameras and lights in candela and lux.

    The first frame of an FBX file is at 0 s; frame f of a .blend file is at f / fps, as Blender's exporter writes it.
    Returns the counts of meshes, cameras, lights, armatures and actions, and Blender's version.  Raises SceneError for
    a file that Blender cannot read, PathTracedError without Blender, OutputError.
    """
    source, target, python = Path(source), Path(target), python or blender_python()
    if source.suffix.lower() not in SOURCES:
        raise SceneError("is no FBX or .blend file", where=str(source), hint=f"it must end in {' or '.join(SOURCES)}")
    if not source.is_file():
        raise SceneError("does not exist", where=str(source))
    if target.suffix.lower() != ".glb":
        raise SceneError("can only be written as .glb", where=str(target), hint="give a name that ends in .glb")
    require_blender(python)
    with tempfile.TemporaryDirectory(prefix="taubench-") as name:
        folder = Path(name)
        made = folder / "scene.glb"
        job = {"source": str(source.resolve()), "target": str(made), "lights": LIGHTING_MODE}
        done = _run(python, job, folder, source)
        write_atomically(target, made.read_bytes(), parents=True)
    counts = done["counts"]
    return {
        **{name: counts[kind] for name, kind in (("meshes", "MESH"), ("cameras", "CAMERA"), ("lights", "LIGHT"))},
        "armatures": counts["ARMATURE"],
        "actions": done["actions"],
        "blender": done["blender"],
    }


def _run(python: str, job: dict[str, Any], folder: Path, source: Path) -> dict[str, Any]:
    events: dict[str, dict[str, Any]] = {}
    failure = run_script(python, "convert_script.py", job, folder, lambda event: events.update({event["event"]: event}))
    if "failed" in events:
        raise SceneError(f"Blender cannot read it: {events['failed']['why']}", where=str(source))
    if "done" not in events:
        raise SceneError(failure or "Blender stopped without a result", where=str(source))
    return events["done"]
