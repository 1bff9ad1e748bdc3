"""Files written by ``scenes make`` and ``stress`` load completely in Blender."""

from __future__ import annotations

import json
import subprocess
import zipfile

import pytest
from row_files import row_file

from taubench_gl.datasets.camera_path import CameraSpec
from taubench_gl.datasets.motion_stats import MotionStats
from taubench_gl.datasets.registry import Entry
from taubench_gl.datasets.stress import stress
from taubench_gl.pathtraced.blender.process import INTERPRETER, blender_python, blender_version

pytestmark = pytest.mark.long

IMPORT = """
import bpy, json, os, sys
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=sys.argv[1])
kinds = [o.type for o in bpy.data.objects]
found = {kind: kinds.count(kind) for kind in ("MESH", "CAMERA", "LIGHT", "ARMATURE")}
found["shape keys"] = sum(len(k.key_blocks) - 1 for k in bpy.data.shape_keys)
found["actions"] = len(bpy.data.actions)
print("@found " + json.dumps(found))
sys.stdout.flush()
os._exit(0)
"""


def contents(path) -> dict[str, int]:
    python = blender_python()
    if blender_version(python) is None:
        pytest.skip(f"no bpy in {INTERPRETER} or this interpreter")
    done = subprocess.run([python, "-c", IMPORT, str(path)], capture_output=True, text=True, timeout=600)
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("@found ")] or [done.stdout[-500:]]
    return json.loads(line.removeprefix("@found "))


def test_stand_in(made):
    found = contents(made["eternal-valley-fps"])
    assert found["ARMATURE"] == 32 and found["LIGHT"] == 73 + 617 + 2 and found["CAMERA"] == 1 and found["actions"] > 0


@pytest.mark.parametrize("kind", ["aff", "obj sequence"])
def test_stress_of_another_format(tmp_path, kind):
    with zipfile.ZipFile(row_file(Entry(title="x", format=kind, scene="x.aff"), tmp_path)) as archive:
        archive.extractall(tmp_path)
    source = str(tmp_path / ("bart/x.aff" if kind == "aff" else "toasters"))
    stress(source, tmp_path / "out.glb", CameraSpec(MotionStats(0.01), MotionStats(1.0), frames=13, fps=24.0))
    found = contents(tmp_path / "out.glb")
    assert found["MESH"] >= 1 and found["actions"] >= 2
    assert (found["CAMERA"], found["LIGHT"]) == ((2, 1) if kind == "aff" else (1, 0))
    assert (found["shape keys"] > 0) == (kind == "obj sequence")
