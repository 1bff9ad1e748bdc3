"""Golden images: small images of Khronos' samples at characteristic times, as integers that compress well."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from fixed_orbit import file_camera_or_fixed_orbit
from frame_tools import draw_pair, find_scene

from taubench_gl.gpu.context import Gpu
from taubench_gl.paths import PACKAGE
from taubench_gl.scene import load_scene

SIZE = (160, 90)
STEP = 1 / 24
FOLDER = PACKAGE.parent / "tests" / "goldens"

# file: seconds.  Names say what each one tests; at these times wrong poses are visible.
CASES = {
    "InterpolationTest.glb": 0.62,  # step, linear and cubic, side by side
    "AnimatedMorphCube.glb": 0.9,
    "SimpleSkin.gltf": 2.3,
    "RiggedSimple.gltf": 0.8,
    "NegativeScaleTest.glb": 0.0,
    "SimpleSparseAccessor.gltf": 0.0,
    "BoxAnimated.glb": 1.7,
    "CesiumMan.glb": 0.9,
    "AlphaBlendModeTest.glb": 0.0,
    "MorphStressTest.glb": 0.5,
    "Fox.gltf": 1.0,
    "TextureTransformTest.gltf": 0.0,
    "MultiUVTest.glb": 0.0,
    "OrientationTest.glb": 0.0,
    "BoxVertexColors.glb": 0.0,
    "TwoSidedPlane.gltf": 0.0,
    "demo.glb": 1.25,
}


def scene_path(data: Path, name: str) -> Path:
    return PACKAGE.parent / "assets" / name if name == "demo.glb" else find_scene(data, name)


def render(gpu: Gpu, path: Path, time: float) -> dict[str, np.ndarray]:
    """Depth (half float), normal and base color (8 bits), ids, and the reason word of the pair before ``time``."""
    scene = load_scene(path)
    result = draw_pair(gpu, scene, file_camera_or_fixed_orbit(scene), SIZE, (time - STEP, time), reprojection="motion",
                       extra=("base_color", "ids"))  # fmt: skip
    now = result.current
    color = np.clip(now["base_color"][..., :3].astype(np.float64), 0, 1) ** (1 / 2.2)
    return {
        "depth": now["position"][..., 3].astype(np.float16),
        "normal": np.round(now["normal"][..., :3] * 127).astype(np.int8),
        "base_color": np.round(color * 255).astype(np.uint8),
        "ids": now["ids"].astype(np.uint16),
        "mask": result.mask.astype(np.uint16),
    }


def golden_file(name: str) -> Path:
    return FOLDER / f"{Path(name).stem}.npz"
