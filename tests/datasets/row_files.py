"""Small scenes of every format of the registry: a moving object, a moving camera, a light."""

from __future__ import annotations

import subprocess
import zipfile
from pathlib import Path

import numpy as np
from shapes import box

from taubench_gl.datasets.gltf_writer import Writer
from taubench_gl.datasets.registry import Entry

SECONDS = 0.25
"""Duration, in which object and camera move by 1 m (the camera in FBX by 1.2 m)."""

WRITE_FBX = """
import os, sys, bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps = 24
bpy.ops.mesh.primitive_cube_add(size=2.0)
cube = bpy.context.object
bpy.ops.object.camera_add(location=(0.0, -8.0, 1.0), rotation=(1.5707963, 0.0, 0.0))
camera = bpy.context.object
scene.camera = camera
for thing, step in ((cube, (1.0, 0.0, 0.0)), (camera, (0.0, 1.2, 0.0))):
    start = tuple(thing.location)
    for frame, part in ((1, 0.0), (7, 1.0)):
        thing.location = [a + part * b for a, b in zip(start, step)]
        thing.keyframe_insert("location", frame=frame)
bpy.ops.object.light_add(type="POINT", location=(0.0, -2.0, 4.0))
bpy.context.object.data.energy = 500.0
scene.frame_start, scene.frame_end = 1, 7
bpy.ops.export_scene.fbx(filepath=sys.argv[1], bake_anim=True, bake_anim_use_all_actions=False,
                         bake_anim_use_nla_strips=False)
sys.stdout.flush()
os._exit(0)
"""

AFF = """
v
from 0 1 7
at 0 0 0
up 0 1 0
angle 45
hither 0.1
resolution 96 54
l 2 5 4 .6 .6 .6
f .6 .5 .4  .6 .3 0 0 1
p 4  -6 -1.5 6  6 -1.5 6  6 -1.5 -6  -6 -1.5 -6
x ball { s 0 0 0 0.8 }
a 0 0.25 10
k ball { transl 4
-0.25 -1 0 0 0 0 0
0 0 0 0 0 0 0
0.25 1 0 0 0 0 0
0.5 2 0 0 0 0 0
}
k camera { transl 4
-0.25 0 1 8 0 0 0
0 0 1 7 0 0 0
0.25 0 1 6 0 0 0
0.5 0 1 5 0 0 0
}
"""


def row_file(entry: Entry, folder: Path, blender: str | None = None) -> Path:
    """A file in the format of ``entry``, zipped if it consists of several files."""
    return {"gltf": _gltf, "obj sequence": _sequence, "aff": _aff, "fbx": _fbx}[entry.format](entry, folder, blender)


def _gltf(entry: Entry, folder: Path, _: str | None) -> Path:
    w = Writer("", "tests")
    times = [0.0, SECONDS]
    thing = w.node("thing", mesh=w.mesh("thing", w.primitive(box((-1, -1, -1), (1, 1, 1)), w.material("gray"))))
    eye = w.node("eye", camera=w.camera("eye", 0.8, 0.1, 100.0), translation=[0.0, 1.0, 8.0])
    w.node("lamp", translation=[0.0, 3.0, 4.0], extensions=w.light(type="point", intensity=90.0))
    w.animation("all", (thing, "translation", times, [[0, 0, 0], [1, 0, 0]], "LINEAR"),
                (eye, "translation", times, [[0, 1, 8], [0, 1, 7]], "LINEAR"))  # fmt: skip
    path = folder / "valley.glb"
    w.save(path)
    return path


def _sequence(entry: Entry, folder: Path, _: str | None) -> Path:
    shape = box((-1, -1, -1), (1, 1, 1))
    faces = "".join("f " + " ".join(str(i + 1) for i in t) + "\n" for t in shape["indices"].tolist())
    with zipfile.ZipFile(folder / "toasters.zip", "w") as archive:
        for i in range(int(SECONDS * 24) + 1):
            place = shape["POSITION"] + np.array([i / 24, 0, 0])
            lines = "".join("v {:.9g} {:.9g} {:.9g}\n".format(*p) for p in place)
            archive.writestr(f"toasters/toasters{i:03d}.obj", f"mtllib t.mtl\no t\nusemtl gray\n{lines}{faces}")
        archive.writestr("toasters/t.mtl", "newmtl gray\nKd 0.5 0.5 0.5\n")
    return folder / "toasters.zip"


def _aff(entry: Entry, folder: Path, _: str | None) -> Path:
    with zipfile.ZipFile(folder / "bart.zip", "w") as archive:
        archive.writestr(f"bart/{entry.scene}", AFF + "i 0 part.aff\n")
        archive.writestr("bart/part.aff", "f 1 0 0  1 0 0 0 1\nc -2 0 0 .3  -2 1 0 .1\n")
    return folder / "bart.zip"


def _fbx(entry: Entry, folder: Path, blender: str | None) -> Path:
    path = folder / (entry.scene or "scene.fbx")
    subprocess.run([blender, "-c", WRITE_FBX, str(path)], check=True, stdout=subprocess.DEVNULL)
    return path
