"""FBX and .blend files -> glTF, through Blender's importer and exporter in a process of its own."""

from __future__ import annotations

import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from taubench_gl.errors import PathTracedError, SceneError
from taubench_gl.outputs import write_atomically
from taubench_gl.pathtraced.cycles.render import HOW_TO_GET_BPY, blender_python, blender_version

SOURCES = (".fbx", ".blend")
LIGHT_UNITS = {"spec": "SPEC", "watts": "COMPAT"}
"""spec: candela and lux, 683 lumens per watt.  watts: the numbers under which Cycles' radiance comes out again."""


def convert(
    source: str | Path, target: str | Path, *, lights: str = "spec", python: str | None = None
) -> dict[str, Any]:
    """Write ``source`` as the .glb ``target``, whole or not at all; animations, cameras and lights are kept.

    An FBX file's first moment is 0 s; frame f of a .blend file is at f / fps, as Blender's exporter writes it.
    -> counts of meshes, cameras, lights, armatures and actions, and Blender's version.  Raises SceneError for a file
    that Blender cannot read, PathTracedError without Blender, OutputError.
    """
    source, target, python = Path(source), Path(target), python or blender_python()
    if source.suffix.lower() not in SOURCES:
        raise SceneError("is no FBX or .blend file", where=str(source), hint=f"it must end in {' or '.join(SOURCES)}")
    if not source.is_file():
        raise SceneError("does not exist", where=str(source))
    if target.suffix.lower() != ".glb":
        raise SceneError("can only be written as .glb", where=str(target), hint="give a name that ends in .glb")
    if blender_version(python) is None:
        raise PathTracedError(f"{python} cannot import bpy, Blender's Python module", hint=HOW_TO_GET_BPY)
    with tempfile.TemporaryDirectory(prefix="taubench-") as folder:
        made, job = Path(folder) / "scene.glb", Path(folder) / "job.json"
        told = {"source": str(source.resolve()), "target": str(made), "lights": LIGHT_UNITS[lights]}
        job.write_text(json.dumps(told), encoding="utf-8")
        said = _run(python, job, source)
        write_atomically(target, made.read_bytes(), parents=True)
    counts = said["counts"]
    return {
        **{name: counts[kind] for name, kind in (("meshes", "MESH"), ("cameras", "CAMERA"), ("lights", "LIGHT"))},
        "armatures": counts["ARMATURE"],
        "actions": said["actions"],
        "blender": said["blender"],
    }


def _run(python: str, job: Path, source: Path) -> dict[str, Any]:
    command = [python, str(Path(__file__).with_name("convert_inside.py")), str(job)]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
    lines = [line.strip() for line in done.stdout.splitlines() if line.strip()]
    said = [json.loads(line[4:]) for line in lines if line.startswith("@tb ")]
    for entry in said:
        if entry["event"] == "failed":
            raise SceneError(f"Blender cannot read it: {entry['why']}", where=str(source))
        if entry["event"] == "done":
            return entry
    last = next((line for line in reversed(lines) if "Error" in line), lines[-1] if lines else "it said nothing")
    raise SceneError(f"Blender stopped with code {done.returncode}: {last}", where=str(source))
