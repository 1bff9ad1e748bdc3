"""pyrender rendering color and depth of a scene with the same GL driver.  Arguments: scene, width, height."""

from __future__ import annotations

import os
import sys
import time

os.environ["PYOPENGL_PLATFORM"] = "egl"

from serve import serve


def prepare():
    import numpy as np

    if not hasattr(np, "infty"):
        setattr(np, "infty", np.inf)  # noqa: B010 (pyrender 0.1.45 uses the name that NumPy 2 removed)
    import pyrender
    import trimesh

    path, width, height = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    loaded = trimesh.load(path, force="scene")
    for name in list(loaded.graph.nodes_geometry):
        if np.linalg.det(loaded.graph[name][0]) == 0.0:
            loaded.graph.transforms.remove_node(name)  # scaled to nothing; pyrender inverts every matrix
    scene = pyrender.Scene.from_trimesh_scene(loaded, ambient_light=[0.5, 0.5, 0.5])
    node = None
    renderer = pyrender.OffscreenRenderer(width, height)

    def answer(request: dict) -> dict:
        """Keys world_from_view (4, 4), yfov, znear, zfar -> ms, share of pixels that show a surface, depth (h, w)."""
        nonlocal node
        if node is None:
            lens = pyrender.PerspectiveCamera(yfov=request["yfov"], znear=request["znear"], zfar=request["zfar"])
            node = scene.add(lens, pose=request["world_from_view"])
        scene.set_pose(node, request["world_from_view"])
        start = time.perf_counter()
        _, depth = renderer.render(scene)
        ms = (time.perf_counter() - start) * 1e3
        return {"ms": ms, "covered": float((depth > 0).mean()), "depth": depth if request.get("depth") else None}

    return answer, {"version": getattr(pyrender, "__version__", "?")}


serve(prepare)
