"""A box that passes in front of a wall, rendered by Cycles: ``cycles_mover/``.

``python tests/reuse/cycles_mover.py`` renders it again (needs bpy): ``input``, 2 samples per pixel, other noise in
every frame, and ``reference``, 256 samples; only the passes that the tests read, as small as they can be.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import OpenEXR

from taubench_gl.scene import load_scene
from taubench_gl.scene.builder import SceneBuilder, box, quad, turn_x
from taubench_gl.scene.model import Scene

FOLDER = Path(__file__).parent / "cycles_mover"
SIZE, FRAMES = (64, 36), range(2, 8)
KEPT = {
    "input": {"Combined": "RGB", "Depth": "Z", "Normal": "XYZ", "Vector": "XY", "DiffCol": "RGB", "DiffDir": "RGB"},
    "reference": {"Combined": "RGB", "Depth": "Z", "Normal": "XYZ", "Vector": "XY"},
}
PRECISE = ("Depth", "Vector")
"""Stored as 32-bit floats, the others as 16-bit floats."""


def mover() -> Scene:
    """The camera slides to the left, a box moves to the right by 2.4 m/s and turns; colored, no texture."""
    b = SceneBuilder()
    gray = b.material(base_color=(0.6, 0.6, 0.55, 1.0), metallic=0.0, roughness=1.0, specular=0.0)
    red = b.material(base_color=(0.8, 0.25, 0.15, 1.0), metallic=0.0, roughness=1.0, specular=0.0)
    b.node(mesh=b.mesh(quad(8.0, 8.0, material=gray)), rotation=turn_x(-90.0))
    b.node(mesh=b.mesh(quad(8.0, 8.0, material=gray)), translation=(0.0, 0.0, -4.0))
    thing = b.node(mesh=b.mesh(box((0.7, 0.7, 0.7), material=red)))
    b.animate(thing, "translation", [0.0, 1.0], [(-0.9, 0.8, 0.0), (1.5, 0.8, 0.0)])
    half = np.radians(15.0)
    b.animate(thing, "rotation", [0.0, 1.0], [(0.0, 0.0, 0.0, 1.0), (0.0, np.sin(half), 0.0, np.cos(half))])
    for place, intensity in (((1.5, 3.0, 2.5), 60.0), ((-2.5, 2.5, 1.5), 40.0)):
        b.light(translation=place, intensity=intensity)
    camera = b.camera(yfov=np.radians(45.0), znear=0.1, rotation=turn_x(-8.0))
    b.animate(camera, "translation", [0.0, 1.0], [(0.1, 1.5, 4.5), (-0.5, 1.5, 4.5)])
    return b.build()


def keep(source: Path, target: Path, passes: dict[str, str]) -> None:
    """The chosen passes of one frame."""
    channels = OpenEXR.File(str(source), separate_channels=True).channels()
    out = {}
    for name, letters in passes.items():
        for letter in letters:
            found = next(c for c in channels if c.endswith(f".{name}.{letter}"))
            dtype = np.float32 if name in PRECISE else np.float16
            out[f"{name}.{letter}"] = np.ascontiguousarray(channels[found].pixels.astype(dtype))
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, out).write(str(target))


def main() -> None:
    from taubench_gl.animation import choose_camera
    from taubench_gl.datasets.gltf_from_scene import write_scene
    from taubench_gl.pathtraced.blender.job import Quality
    from taubench_gl.pathtraced.blender.render import render_reference

    file = Path(tempfile.mkdtemp()) / "mover.glb"
    write_scene(mover(), file)
    scene = load_scene(file)
    for name, samples, animated in (("input", 2, True), ("reference", 256, False)):
        with tempfile.TemporaryDirectory() as folder:
            quality = Quality(samples=samples, seed=7, seed_per_frame=animated, bounces=4)
            render_reference(scene, choose_camera(scene), FRAMES, folder, fps=24.0, size=SIZE, quality=quality)
            (FOLDER / name).mkdir(parents=True, exist_ok=True)
            for frame in sorted(Path(folder).glob("frame_*.exr")):
                keep(frame, FOLDER / name / frame.name, KEPT[name])


if __name__ == "__main__":
    main()
