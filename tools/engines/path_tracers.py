"""Geometry passes of the scene of scene.py by Mitsuba or LuxCore: path_tracers.py SCENE OUT mitsuba|luxcore.

Neither writes motion vectors.  Needs mitsuba or pyluxcore, in an environment of its own.
"""

import json
import math
import sys
import time
from pathlib import Path

import numpy as np


def mitsuba(poses, number, out):
    """One sample in each pixel center: sampler ``stratified`` without jitter, filter ``box``."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    frame, (width, height) = poses["frames"][str(number)], poses["size"]
    look = np.array(frame["camera"]) @ np.diag([-1, 1, -1, 1])  # Mitsuba looks along +Z, +X is left
    film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    scene = {
        "type": "scene", "light": {"type": "constant"},
        "integrator": {"type": "aov", "aovs": "dd:depth,pp:position,nn:sh_normal", "image": {"type": "direct"}},
        "sensor": {"type": "perspective", "fov": math.degrees(poses["yfov"]), "fov_axis": "y",
                   "near_clip": poses["near"],
                   "to_world": mi.ScalarTransform4f(look), "film": film | {"component_format": "float32"},
                   "sampler": {"type": "stratified", "sample_count": 1, "jitter": False}},
    }  # fmt: skip
    for name, (positions, normals, triangles) in poses["meshes"].items():
        mesh = mi.Mesh(name, len(positions), len(triangles), has_vertex_normals=True)
        matrix, params = np.array(frame[name]), mi.traverse(mesh)
        params["vertex_positions"] = (np.array(positions) @ matrix[:3, :3].T + matrix[:3, 3]).ravel()
        params["vertex_normals"] = (np.array(normals) @ matrix[:3, :3].T).ravel()
        params["faces"] = np.array(triangles).ravel()
        params.update()
        mesh.write_ply(str(out / f"{name}.ply"))
        scene[name] = {
            "type": "ply",
            "filename": str(out / f"{name}.ply"),
            "bsdf": {"type": "twosided", "b": {"type": "diffuse"}},
        }
    loaded = mi.load_dict(scene)
    mi.render(loaded)
    loaded.sensors()[0].film().write(str(out / f"frame_{number:04d}.exr"))


def luxcore(poses, number, out):
    """One sample near each pixel center: a box filter of 0.01 pixels and the sampler SOBOL."""
    import pyluxcore as lux

    lux.Init(lambda text: None)
    frame, (width, height) = poses["frames"][str(number)], poses["size"]
    scene, props = lux.Scene(), lux.Properties()
    camera = np.array(frame["camera"])
    across = 2 * math.degrees(math.atan(math.tan(poses["yfov"] / 2) * width / height))  # of the longer side
    values = {"scene.camera.type": "perspective", "scene.camera.lookat.orig": camera[:3, 3],
              "scene.camera.lookat.target": camera[:3, 3] - camera[:3, 2], "scene.camera.up": camera[:3, 1],
              "scene.camera.fieldofview": across, "scene.camera.cliphither": poses["near"],
              "scene.camera.clipyon": 1000.0, "scene.lights.sky.type": "constantinfinite",
              "scene.materials.gray.type": "matte"}  # fmt: skip
    for name, (positions, _, triangles) in poses["meshes"].items():
        matrix = np.array(frame[name])
        points = (np.array(positions) @ matrix[:3, :3].T + matrix[:3, 3]).tolist()
        scene.DefineMesh(name, [tuple(p) for p in points], [tuple(t) for t in triangles], None, None, None, None)
        values |= {f"scene.objects.{name}.shape": name, f"scene.objects.{name}.material": "gray"}
    for key, value in values.items():
        given = [float(v) for v in value] if isinstance(value, np.ndarray) else value
        props.Set(lux.Property(key, given))
    scene.Parse(props)
    settings = {"renderengine.type": "PATHCPU", "sampler.type": "SOBOL", "film.width": width, "film.height": height,
                "film.filter.type": "BOX", "film.filter.width": 0.01, "batch.haltspp": 1,
                "native.threads.count": 1}  # fmt: skip
    for i, kind in enumerate(("POSITION", "SHADING_NORMAL", "DEPTH")):
        settings |= {
            f"film.outputs.{i}.type": kind,
            f"film.outputs.{i}.filename": str(out / f"{kind}_{number:04d}.exr"),
        }
    config = lux.Properties()
    for key, value in settings.items():
        config.Set(lux.Property(key, value))
    session = lux.RenderSession(lux.RenderConfig(config, scene))
    session.Start()
    while not session.HasDone():  # WaitForDone does not end without UpdateStats
        time.sleep(0.05)
        session.UpdateStats()
    session.Stop()
    session.GetFilm().SaveOutputs()


def main(scene, out, program):
    """Render all frames to the folder ``out``."""
    poses, out = json.loads((Path(scene) / "poses.json").read_text()), Path(out)
    out.mkdir(parents=True, exist_ok=True)
    for number in map(int, poses["frames"]):
        {"mitsuba": mitsuba, "luxcore": luxcore}[program](poses, number, out)


if __name__ == "__main__":
    main(*sys.argv[1:4])
