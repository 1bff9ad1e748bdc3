"""Start-up and reading of one scene file by one program.  Arguments: ours | trimesh | pygltflib | json, scene.

Reports import_ms and load_ms, and for ours first_ms (to the counts of the first pair), and ends.
"""

from __future__ import annotations

import sys
import time

from serve import serve


def prepare():
    who, path = sys.argv[1], sys.argv[2]
    start = time.perf_counter()
    if who == "json":
        import json

        def load():
            with open(path, "rb") as file:
                header = file.read(20)  # of a .glb: magic, version, length; length and type of the chunk with the JSON
                if header[:4] == b"glTF":
                    return json.loads(file.read(int.from_bytes(header[12:16], "little")))
                return json.loads(header + file.read())

    elif who == "trimesh":
        import trimesh

        def load():
            return trimesh.load(path, force="scene")

    elif who == "pygltflib":
        from pygltflib import GLTF2

        def load():
            return GLTF2().load(path)

    else:
        from taubench_gl.scene import load_scene

        def load():
            return load_scene(path)

    imported = time.perf_counter()
    scene = load()
    times = {"import_ms": (imported - start) * 1e3, "load_ms": (time.perf_counter() - imported) * 1e3}
    if who == "ours":
        from taubench_gl.evaluation import evaluate_scene
        from taubench_gl.settings import Settings

        columns = ("frustum", "position", "normal")
        evaluate_scene(scene, Settings(width=64, height=36, frames=(0, 2), columns=columns))
        times["first_ms"] = (time.perf_counter() - start) * 1e3
    return (lambda request: {}), times


serve(prepare)
