"""Files of the size of BART's scenes: read in one piece, and their motion equals the splines of the file."""

from __future__ import annotations

import bart_like
import numpy as np
import pytest
from aff_files import rotation_spline, spline
from scipy.spatial.transform import Rotation

from taubench_gl.animation.curves import sample_channel
from taubench_gl.scene import load_scene
from taubench_gl.scene.aff.splines import ROTATION_ERROR


def channels_of(scene, name: str, path: str):
    node = scene.nodes.names.index(name)
    return next(c for c in scene.channels if c.target == "node" and c.index == node and c.path == path)


def triangles(scene) -> int:
    return sum(len(p.triangles) for mesh in scene.meshes for p in mesh.primitives)


@pytest.mark.long
def test_robots(tmp_path):
    """171 rotation tracks; the notes about key times are one note; a track equals the second implementation."""
    scene = load_scene(bart_like.robots(tmp_path))
    assert 65_000 < triangles(scene) < 75_000
    moving = [c for c in scene.channels if c.path == "rotation"]
    assert len(moving) == bart_like.ROBOTS * (bart_like.PARTS + 1) + 1
    assert all(np.all(np.diff(c.times) > 0) and np.all(np.isfinite(c.values)) for c in moving)
    assert len(scene.notes) <= 3, [str(note) for note in scene.notes]

    keys = np.array([row.split() for row in _rows_of(tmp_path / "robots.aff", "robot3part1", "rot")], dtype=float)
    turns = Rotation.from_rotvec(
        keys[:, 1:4] / np.linalg.norm(keys[:, 1:4], axis=1)[:, None] * np.radians(keys[:, 4:5])
    )
    curve = channels_of(scene, "robot3part1", "rotation")
    for t in np.linspace(0.0, bart_like.SECONDS, 101):
        expected = rotation_spline(keys[:, 0], turns, keys[:, 5:], t)
        assert (expected.inv() * Rotation.from_quat(sample_channel(curve, t))).magnitude() <= 2 * ROTATION_ERROR


@pytest.mark.long
def test_kitchen(tmp_path):
    """Forty included files; moving lights and an object."""
    scene = load_scene(bart_like.kitchen(tmp_path))
    assert scene.files == 41 and 105_000 < triangles(scene) < 115_000
    assert len(scene.lights) == 3 and all(light.constant for light in scene.lights)
    keys = np.array([row.split() for row in _rows_of(tmp_path / "kitchen.aff", "car", "transl")], dtype=float)
    curve = channels_of(scene, "car", "translation")
    for t in np.linspace(0.0, bart_like.SECONDS, 33):
        np.testing.assert_allclose(
            sample_channel(curve, t), spline(keys[:, 0], keys[:, 1:4], keys[:, 4:], t), atol=1e-9
        )


@pytest.mark.long
def test_museum(tmp_path):
    """65,536 animated triangles are one mesh with a morph target per key time."""
    scene = load_scene(bart_like.museum(tmp_path))
    moving = next(m for m in scene.meshes if len(m.weights))
    assert len(moving.primitives[0].triangles) == 65_536 and len(moving.weights) == 10
    assert 74_000 < triangles(scene) < 77_000 and len(scene.lights) == 2


def _rows_of(path, name: str, kind: str) -> list[str]:
    lines = path.read_text().splitlines()
    at = lines.index(f"k {name} {{")
    start = next(i for i in range(at, len(lines)) if lines[i].startswith(f"{kind} "))
    return lines[start + 1 : start + 1 + int(lines[start].split()[1])]
