"""Materials, blocks, lights and tracks of small animated scenes that are made by code.

Where path tracers agree by definition, the scenes stay: dielectrics are Lambertian (KHR_materials_specular, factor 0),
metals and half-metals have a single-scatter GGX lobe, every surface is two-sided, textures are sampled nearest
(Cycles interpolates encoded sRGB, OpenGL decoded), and shading normals are those of the faces, because Blender rebuilds
the smooth normals of deformed meshes.  Intensities are 683 times watts per steradian: light unit watt.
"""

from __future__ import annotations

import math

import numpy as np
import pygltflib as gl
from shapes import Shape, box

from taubench_gl.datasets.gltf_writer import Writer
from taubench_gl.effects.lighting import LUMENS_PER_WATT

SECONDS = 0.5
"""Duration: 12 frames at 24 fps."""

Tracks = list[tuple]


def turn(axis: str, degrees) -> np.ndarray:
    """Quaternions xyzw about one axis.  (...) -> (..., 4)."""
    half = np.radians(np.asarray(degrees, dtype=float)) / 2
    out = np.zeros((*half.shape, 4))
    out[..., "xyz".index(axis)], out[..., 3] = np.sin(half), np.cos(half)
    return out


# ------------------------------------------------------------------------------------------------------------ materials
def surface(w: Writer, name: str, color, metallic: float = 0.0, roughness: float = 1.0, **rest) -> int:
    material = w.material(name, color, metallic, roughness, doubleSided=True, **rest)
    extend(w, material, "KHR_materials_specular", {"specularFactor": 0.0})
    return material


def tiled(w: Writer, pixels: np.ndarray) -> int:
    """A surface with a repeated texture without filtering."""
    w.gltf.samplers.append(gl.Sampler(magFilter=gl.NEAREST, minFilter=gl.NEAREST))
    w.gltf.textures.append(gl.Texture(source=w.image(pixels), sampler=len(w.gltf.samplers) - 1))
    return surface(w, "tiled", (1.0, 1.0, 1.0), texture=len(w.gltf.textures) - 1)


def brick_colors() -> np.ndarray:
    """(8, 8, 3) uint8."""
    return np.random.default_rng(4).integers(90, 230, (8, 8, 3)).astype(np.uint8)


def emitter(w: Writer, name: str, color, strength: float) -> int:
    """Black, with emitted radiance ``strength`` times ``color``."""
    material = surface(w, name, (0.0, 0.0, 0.0))
    w.gltf.materials[material].emissiveFactor = list(color)
    extend(w, material, "KHR_materials_emissive_strength", {"emissiveStrength": strength})
    return material


def extend(w: Writer, material: int, extension: str, values: dict) -> None:
    w.gltf.materials[material].extensions = {**w.gltf.materials[material].extensions, extension: values}
    if extension not in w.gltf.extensionsUsed:
        w.gltf.extensionsUsed.append(extension)


# ------------------------------------------------------------------------------------------------------------- geometry
def flat(shape: Shape) -> Shape:
    """``shape`` without normals: glTF and Blender then use those of the faces."""
    return {name: values for name, values in shape.items() if name != "NORMAL"}


def place(w: Writer, name: str, shape: Shape, material: int, smooth: bool = False, **where) -> int:
    return w.node(name, mesh=w.mesh(name, w.primitive(shape if smooth else flat(shape), material)), **where)


def block(w: Writer, name: str, size, material: int, at, degrees: float = 0.0) -> int:
    """A box on y = ``at[1]``, turned about +Y."""
    half = 0.5 * np.array(size)
    shape = box((-half[0], 0.0, -half[2]), (half[0], size[1], half[2]))
    return place(w, name, shape, material, translation=list(at), rotation=turn("y", degrees).tolist())


def times(count: int) -> np.ndarray:
    return np.linspace(0.0, SECONDS, count)


def move(node: int, path: str, values) -> tuple:
    return (node, path, times(len(values)), np.array(values, dtype=float), "LINEAR")


def camera(w: Writer, places, degrees, tilt: float = 0.0) -> Tracks:
    """Add a camera that moves along ``places`` while it turns by ``degrees`` about +Y, tilted by ``tilt`` degrees."""
    walker = w.node("walker")
    w.node("eye", walker, camera=w.camera("eye", math.radians(50), 0.05, 100.0), rotation=turn("x", tilt).tolist())
    return [move(walker, "translation", places), move(walker, "rotation", turn("y", degrees))]


# --------------------------------------------------------------------------------------------------------------- lights
def light(w: Writer, name: str, kind: str, watts: float, color=(1.0, 1.0, 1.0), *, spot=None, **where) -> int:
    """Add a punctual light.  ``watts``: W/sr of a point or spot light, W/m2 of a directional one.  Returns its node."""
    cone = {} if spot is None else {"spot": {"innerConeAngle": spot[0], "outerConeAngle": spot[1]}}
    extension = w.light(type=kind, name=name, color=list(color), intensity=watts * LUMENS_PER_WATT, **cone)
    return w.node(name, extensions=extension, **where)


def down(about_y: float, about_x: float) -> list[float]:
    """Rotation of a light: first about its X axis, then about +Y, in degrees."""
    y, x = turn("y", about_y), turn("x", about_x)
    vector = y[3] * x[:3] + x[3] * y[:3] + np.cross(y[:3], x[:3])
    return np.append(vector, y[3] * x[3] - y[:3] @ x[:3]).tolist()


def leaves(size: int = 64) -> np.ndarray:
    """(size, size, 4) uint8: leaves of one color, so that filtering changes alpha only."""
    y, x = (np.mgrid[0:size, 0:size] + 0.5) / size
    alpha = np.zeros((size, size))
    rng = np.random.default_rng(2)
    for cx, cy in rng.uniform(0.15, 0.85, (16, 2)):
        angle = rng.uniform(0, math.pi)
        along, across = (
            (x - cx) * math.cos(angle) + (y - cy) * math.sin(angle),
            (y - cy) * math.cos(angle) - (x - cx) * math.sin(angle),
        )
        alpha = np.maximum(alpha, np.clip(0.5 + 8.0 * (1.0 - (along / 0.14) ** 2 - (across / 0.05) ** 2), 0.0, 1.0))
    color = np.broadcast_to(np.array([110, 160, 70]), (size, size, 3))
    return np.dstack([color, np.round(255 * alpha)]).astype(np.uint8)
