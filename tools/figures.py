"""Low-poly walking figures with a skeleton of 52 bones, as in games: a mesh, a skin and an animation clip each."""

from __future__ import annotations

import math

import numpy as np
from shapes import Shape, box, join
from valley import height

from taubench_gl import math3d
from taubench_gl.datasets.camera_path import quat_about
from taubench_gl.datasets.gltf_writer import Writer

Array = np.ndarray

BONES = 52
CLIPS = 6
_KEYS_PER_SECOND = 10


def skeleton() -> list[tuple[str, int, tuple[float, float, float], tuple[float, float, float], float]]:
    """(name, parent, offset from the parent, extent, thickness) of each bone, meters; a T-pose that faces +Z.

    6 bones of the trunk, 4 of each arm, 4 of each leg and 15 of the fingers of each hand: 52.
    """
    bones: list[tuple[str, int, tuple[float, float, float], tuple[float, float, float], float]] = [
        ("hips", -1, (0, 0.98, 0), (0, 0.12, 0), 0.30),
        ("spine", 0, (0, 0.12, 0), (0, 0.14, 0), 0.27),
        ("chest", 1, (0, 0.14, 0), (0, 0.16, 0), 0.31),
        ("upper chest", 2, (0, 0.16, 0), (0, 0.12, 0), 0.33),
        ("neck", 3, (0, 0.12, 0), (0, 0.09, 0), 0.11),
        ("head", 4, (0, 0.09, 0), (0, 0.24, 0.02), 0.19),
    ]
    for side, s in (("left", 1.0), ("right", -1.0)):
        parent = 3
        for name, offset, extent, thick in (
            ("shoulder", 0.04, 0.14, 0.13), ("upper arm", 0.14, 0.28, 0.10), ("forearm", 0.28, 0.25, 0.085),
            ("hand", 0.25, 0.09, 0.09),
        ):  # fmt: skip
            up = 0.08 if name == "shoulder" else 0.0
            bones.append((f"{side} {name}", parent, (s * offset, up, 0), (s * extent, 0, 0), thick))
            parent = len(bones) - 1
        hand = parent
        for finger in range(5):
            parent = hand
            for joint in range(3):
                offset = (s * 0.09, 0, 0.04 - 0.02 * finger) if joint == 0 else (s * 0.03, 0, 0)
                bones.append((f"{side} finger {finger} {joint}", parent, offset, (s * 0.03, 0, 0), 0.018))
                parent = len(bones) - 1
        parent = 0
        for name, offset, extent, thick in (
            ("thigh", (s * 0.1, 0, 0), (0, -0.45, 0), 0.15), ("shin", (0, -0.45, 0), (0, -0.43, 0), 0.11),
            ("foot", (0, -0.43, 0), (0, -0.05, 0.14), 0.09), ("toe", (0, -0.05, 0.14), (0, 0, 0.08), 0.08),
        ):  # fmt: skip
            bones.append((f"{side} {name}", parent, offset, extent, thick))
            parent = len(bones) - 1
    assert len(bones) == BONES
    return bones


def rest() -> Array:
    """World positions of the bone heads in the rest pose.  (52, 3)."""
    heads = np.zeros((BONES, 3))
    for i, (_, parent, offset, _, _) in enumerate(skeleton()):
        heads[i] = np.array(offset) + (heads[parent] if parent >= 0 else 0.0)
    return heads


def body() -> Shape:
    """One box per bone; its near end is also skinned to the parent bone, so that joints bend without gaps."""
    heads, parts = rest(), []
    for i, (_, parent, _, extent, thick) in enumerate(skeleton()):
        a, b = heads[i], heads[i] + np.array(extent)
        pad = np.where(np.abs(extent) >= 0.5 * np.abs(extent).max(), 0.0, 0.5 * thick)
        pad[2] *= 0.7 if thick > 0.25 else 1.0
        shape = box(np.minimum(a, b) - pad, np.maximum(a, b) + pad)
        near = np.linalg.norm(shape["POSITION"] - a, axis=1) < np.linalg.norm(shape["POSITION"] - b, axis=1)
        share = np.where(near & (parent >= 0), 0.5, 0.0)
        zero = np.zeros(len(near))
        del shape["TEXCOORD_0"]
        shape["JOINTS_0"] = np.stack([zero + i, np.where(share > 0, max(parent, 0), 0), zero, zero], axis=-1)
        shape["WEIGHTS_0"] = np.stack([1 - share, share, zero, zero], axis=-1)
        parts.append(shape)
    return join(parts)


def clip(rng: np.random.Generator, seconds: float) -> tuple[Array, Array]:
    """A walk cycle: key times (K,) and rotations (K, 52, 4) of every bone."""
    times = np.linspace(0.0, seconds, int(seconds * _KEYS_PER_SECOND) + 1)
    phase = 2 * math.pi * times * rng.uniform(0.8, 1.15) + rng.uniform(0, 2 * math.pi)
    out = np.zeros((len(times), BONES, 4))
    for i, (name, *_) in enumerate(skeleton()):
        s = 1.0 if name.startswith("left") else -1.0
        swing = np.sin(phase) * s
        if "thigh" in name:
            q = quat_about("x", -28 * swing)
        elif "shin" in name:
            q = quat_about("x", 20 + 22 * np.sin(phase + 1.1) * s)
        elif "upper arm" in name:
            q = math3d.quat_multiply(quat_about("x", 26 * swing), quat_about("z", np.full(len(times), -72.0 * s)))
        elif "forearm" in name:
            q = quat_about("y", -s * (28 + 12 * swing))
        elif "finger" in name:
            q = quat_about("z", -s * (22 + 8 * np.sin(0.5 * phase + i)))
        elif "foot" in name or "toe" in name:
            q = quat_about("x", 8 * np.sin(phase + 0.6) * s)
        else:
            q = quat_about("y", 5 * np.sin(phase + 0.4 * i))
        out[:, i] = q
    return times, out


def add_figures(w: Writer, rng: np.random.Generator, places: list[tuple[float, float]], seconds: float,
                albedo: float) -> list[tuple]:  # fmt: skip
    """A figure at each position (x, z); ``albedo``: factor on their colors.  -> tracks for ``Writer.animation``."""
    colors = albedo * np.array([(0.45, 0.12, 0.10), (0.10, 0.20, 0.42), (0.36, 0.32, 0.12), (0.16, 0.30, 0.18)])
    meshes = [
        w.mesh("figure", w.primitive(body(), w.material(f"cloth {i}", c, roughness=0.8)))
        for i, c in enumerate(colors.tolist())
    ]
    clips = [clip(rng, seconds) for _ in range(CLIPS)]
    inverse = np.tile(np.eye(4), (BONES, 1, 1))
    inverse[:, :3, 3] = -rest()
    tracks = []
    for k, (x, z) in enumerate(places):
        yaw, speed = float(rng.uniform(0, 360)), float(rng.uniform(0.9, 1.6))
        t = np.linspace(0.0, seconds, 25)
        forward = np.array([math.sin(math.radians(yaw)), math.cos(math.radians(yaw))])
        xz = np.array([x, z]) + forward * (speed * (t - 0.5 * seconds))[:, None]
        path = np.stack([xz[:, 0], height(xz[:, 0], xz[:, 1]), xz[:, 1]], axis=-1)
        root = w.node(f"figure {k}", translation=path[0].tolist(), rotation=quat_about("y", yaw).tolist())
        joints: list[int] = []
        for name, parent, offset, _, _ in skeleton():
            joints.append(w.node(name, joints[parent] if parent >= 0 else root, translation=list(map(float, offset))))
        w.node(f"figure {k} body", mesh=meshes[k % len(meshes)], skin=w.skin(f"figure {k}", joints, inverse))
        times, keys = clips[k % CLIPS]
        tracks.append((root, "translation", t, path, "LINEAR"))
        tracks += [(joint, "rotation", times, keys[:, i], "LINEAR") for i, joint in enumerate(joints)]
    return tracks
