"""One scene through other writers: what they keep is the same here as in the source (docs/interoperability.md)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from taubench_gl.animation import choose_camera, sample
from taubench_gl.effects.census import census
from taubench_gl.scene import Scene, load_scene

FOLDER = Path(__file__).with_name("writers")
FRAMES = range(25)
OUTPUTS = ("gltfpack.glb", "gltfpack-cc.glb", "transform.glb", "blender.glb")


def changes(scene: Scene) -> dict[str, list[int]]:
    """Frames in which lights are born and killed, one entry for each light."""
    counts = census(scene, [frame / 24 for frame in FRAMES])["lights_per_frame"]
    return {what: [f for f, n in enumerate(counts[what], start=1) for _ in range(n)] for what in ("born", "killed")}


def eyes(scene: Scene) -> np.ndarray:
    track = choose_camera(scene)
    return np.array([track.view_at(sample(scene, frame / 24)).position for frame in FRAMES])


def is_hidden(scene: Scene) -> bool:
    """Whether the hidden lamp, the rightmost, still is."""
    state = sample(scene, 0.0)
    lamps = np.flatnonzero(scene.nodes.light >= 0)
    return not state.visible[lamps[np.argmax(state.world[lamps, 0, 3])]]


def test_source() -> None:
    scene = load_scene(FOLDER / "source.gltf")
    assert changes(scene) == {"born": [8], "killed": [12, 16]} and is_hidden(scene)
    assert eyes(scene)[:, 0].tolist() == [0.0] * 8 + [0.5] * 17, "0.31 s lies in frame 8"


@pytest.mark.parametrize("name", OUTPUTS)
def test_what_a_writer_keeps(name: str) -> None:
    """Lights by their nodes and the camera; all of these drop the pointer, and gltfpack and Blender the visibility."""
    scene = load_scene(FOLDER / name)
    assert changes(scene) == {"born": [8], "killed": [16]}
    assert (len(scene.lights), scene.duration) == (5, pytest.approx(1.0)) and not scene.notes
    np.testing.assert_allclose(eyes(scene), eyes(load_scene(FOLDER / "source.gltf")), atol=2e-4)
    assert is_hidden(scene) == (name == "transform.glb")
