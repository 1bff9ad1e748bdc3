"""Small glTF files and a stand-in for Blender's Python, for the tests of the Blender driver."""

from __future__ import annotations

import math
import os
import stat
import sys
from pathlib import Path

import numpy as np

from taubench_gl.datasets.gltf_writer import Writer

DOWN = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
BASE_COLOR = (0.5, 0.25, 0.125)


LAMP = {"light": {"type": "point", "intensity": 10.0}, "node": {"translation": [0, 2, 0]}}


def plane_writer(lights: list[dict] = (), keys: dict[str, list] | None = None, eye: list[float] = DOWN) -> Writer:
    """A 2 m square at y = 0 with a rough dielectric, a camera 3 m above, lights as nodes from number 2 on.

    ``keys``: animated path of the plane's node -> one value per half second, LINEAR.  ``eye``: rotation of the camera.
    """
    w = Writer("", "tests")
    shape = {"POSITION": np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]]),
             "NORMAL": np.tile([0, 1, 0], (4, 1)), "indices": np.array([0, 1, 2, 0, 2, 3])}  # fmt: skip
    w.node("plane", mesh=w.mesh("plane", w.primitive(shape, w.material("rough", BASE_COLOR, roughness=1.0))))
    w.node("eye", camera=w.camera("eye", 0.5, 0.1, None), translation=[0, 3, 0], rotation=eye)
    for light in lights:
        w.node("light", extensions=w.light(**light["light"]), **light["node"])
    for name, values in (keys or {}).items():  # an animation per channel: Blender's importer mutes all but one
        w.animation(name, (0, name, 0.5 * np.arange(len(values)), values, "LINEAR"))
    return w


def plane(path: Path, lights: list[dict] = (), **options) -> Path:
    """The scene of ``plane_writer`` as a .glb file."""
    plane_writer(lights, **options).save(path)
    return path


def blinking(path: Path, *, ground: bool = True) -> Path:
    """On, off, on, every half second: a light by scale; another one and, if ``ground``, the plane by visibility."""
    w, times = plane_writer([LAMP, LAMP]), [0.0, 0.5, 1.0]
    for node in (0, 3):
        w.gltf.nodes[node].extensions[w.uses("KHR_node_visibility")] = {"visible": True}
    hidden = [3, 0] if ground else [3]
    w.animation("blink", (2, "scale", times, [[1, 1, 1], [0, 0, 0], [1, 1, 1]], "STEP"),
                *((f"/nodes/{node}/extensions/KHR_node_visibility/visible", "pointer", times,
                   np.array([True, False, True]), "STEP") for node in hidden))  # fmt: skip
    w.save(path)
    return path


FAKE = """
import json, os, sys
if sys.argv[1] == "-c":
    print("@tb 4.5.0 stand-in"); sys.exit()
import numpy as np, OpenEXR
job = json.load(open(sys.argv[2]))
assert os.path.isfile(job["scene"])
print("Blender says hello", flush=True)
renders = [(folder, frame) for folder in job["folders"] for frame in job["frames"]]
for n, (folder, frame) in enumerate(renders):
    if n == int(os.environ.get("FAKE_STOPS_AFTER", "999")):
        print("Error: out of pixels"); sys.exit(3)
    w, h = job["size"]
    z = np.full((h, w), 1e10, np.float32)
    path = os.path.join(folder, job["name"] % frame)
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"ViewLayer.Depth.Z": z}).write(path)
    print("@tb " + json.dumps({"event": "samples", "done": 1, "total": 2}))
    print("@tb " + json.dumps({"event": "frame", "frame": frame, "seconds": 0.5, "cpu_seconds": 1.0 + n}), flush=True)
"""


def fake_blender(folder: Path) -> str:
    """An executable that runs a job as Blender's Python does, and writes empty frames."""
    return executable(folder, FAKE)


def executable(folder: Path, source: str) -> str:
    """A program that runs ``source`` with this interpreter, instead of one that has bpy."""
    script, program = folder / "fake.py", folder / "fake_python"
    script.write_text(source)
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{script}" "$@"\n')
    os.chmod(program, program.stat().st_mode | stat.S_IXUSR)
    return str(program)
