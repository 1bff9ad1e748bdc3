"""Animations and KHR_animation_pointer, one tiny file per feature."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from gltf_builders import (
    LIGHT,
    lights,
    morphing,
    notes_about,
    pointer,
)
from gltf_files import TRIANGLE, triangle_scene

from taubench_gl.animation import sample
from taubench_gl.scene import load_scene

# Animation


@pytest.mark.parametrize("interpolation", [None, "STEP", "LINEAR", "CUBICSPLINE"])
def test_interpolations(tmp_path: Path, interpolation: str | None) -> None:
    gltf = triangle_scene()
    rows = 3 if interpolation == "CUBICSPLINE" else 1
    values = np.arange(2 * rows * 3, dtype=np.float32).reshape(-1, 3)
    gltf.animation({"node": 0, "path": "translation"}, [0.5, 2.0], values, interpolation)
    scene = load_scene(gltf.save(tmp_path))
    (channel,) = scene.channels
    assert channel.interpolation == (interpolation or "LINEAR")
    assert (channel.target, channel.index, channel.path) == ("node", 0, "translation")
    assert channel.values.shape == ((2, 3, 3) if rows == 3 else (2, 3)) and channel.values.dtype == np.float64
    np.testing.assert_array_equal(channel.values.ravel(), np.arange(2 * rows * 3))
    assert scene.duration == 2.0 and channel.times.tolist() == [0.5, 2.0]


def test_cubic_weights_are_grouped_by_key(tmp_path: Path) -> None:
    gltf = morphing(2)
    gltf.animation({"node": 0, "path": "weights"}, [0, 1], np.arange(12), "CUBICSPLINE")
    (channel,) = load_scene(gltf.save(tmp_path)).channels
    assert channel.values.tolist() == [[[0, 1], [2, 3], [4, 5]], [[6, 7], [8, 9], [10, 11]]]


def test_normalized_rotation(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.animation({"node": 0, "path": "rotation"}, [0, 1], [[0, 0, 0, 127], [127, 0, 0, 0]], dtype="i1",
                   normalized=True)  # fmt: skip
    (channel,) = load_scene(gltf.save(tmp_path)).channels
    np.testing.assert_array_equal(channel.values, [[0, 0, 0, 1], [1, 0, 0, 0]])


def test_keys_at_one_time(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.animation({"node": 0, "path": "translation"}, [0, 1, 1, 2], np.arange(12).reshape(4, 3))
    scene = load_scene(gltf.save(tmp_path))
    (channel,) = scene.channels
    assert channel.times.tolist() == [0, 1, 1, 2] and channel.values[:, 0].tolist() == [0, 3, 6, 9]
    assert notes_about(scene, 1) == ["/animations/0/samplers/0/input"]


def test_colliding_animations(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.node()
    for node, path in ((0, "translation"), (1, "translation"), (0, "translation"), (0, "scale")):
        gltf.animation({"node": node, "path": path}, [0, 1], [[0, 0, 0], [1, 1, 1]])
    gltf.json["animations"][2]["name"] = "late"
    path = gltf.save(tmp_path)
    scene = load_scene(path)
    assert scene.playing == ("animation 0", "animation 1", "animation 3") and len(scene.channels) == 3
    assert notes_about(scene, "'late'", "--animation")
    assert load_scene(path, animation=["late", 3]).playing == ("late", "animation 3")
    assert load_scene(path, animation=[]).playing == ()


@pytest.mark.parametrize(
    "text, values, target",
    [
        (f"{LIGHT}/color", [[0, 0, 0], [1, 1, 1]], ("light", 1, "color")),
        (f"{LIGHT}/intensity", [0, 1], ("light", 1, "intensity")),
        (f"{LIGHT}/range", [1, 2], ("light", 1, "range")),
        (f"{LIGHT}/spot/innerConeAngle", [0, 1], ("light", 1, "inner_cone")),
        (f"{LIGHT}/spot/outerConeAngle", [0, 1], ("light", 1, "outer_cone")),
        ("/cameras/0/perspective/yfov", [1, 2], ("camera", 0, "yfov")),
        ("/cameras/0/perspective/zfar", [1, 2], ("camera", 0, "zfar")),
        ("/cameras/1/orthographic/xmag", [1, 2], ("camera", 1, "xmag")),
        ("/nodes/0/translation", [[0, 0, 0], [1, 1, 1]], ("node", 0, "translation")),
        ("/nodes/0/rotation", [[0, 0, 0, 1], [1, 0, 0, 0]], ("node", 0, "rotation")),
        ("/nodes/3/weights", [0, 0, 1, 1], ("node", 3, "weights")),
        ("/meshes/0/weights", [0, 0, 1, 1], ("node", 3, "weights")),
    ],
    ids=lambda v: v.rpartition("/")[2] if isinstance(v, str) else None,
)
def test_animation_pointers(tmp_path: Path, text: str, values: list, target: tuple) -> None:
    gltf = lights()
    gltf.extension("KHR_animation_pointer")
    gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1, "zfar": 9}})
    gltf.add("cameras", {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 9}})
    gltf.node(mesh=gltf.mesh())
    targets = [{"POSITION": gltf.accessor(TRIANGLE)} for _ in range(2)]
    gltf.json["meshes"][0]["primitives"][0]["targets"] = targets
    gltf.animation(pointer(text), [0, 1], values)
    (channel,) = load_scene(gltf.save(tmp_path)).channels
    assert (channel.target, channel.index, channel.path) == target
    np.testing.assert_array_equal(channel.values.ravel(), np.ravel(values))


def test_mesh_weights_move_only_nodes_without_their_own(tmp_path: Path) -> None:
    gltf = morphing(1)
    gltf.extension("KHR_animation_pointer")
    gltf.node(mesh=0, weights=[0.5])
    gltf.node(mesh=0)
    gltf.animation(pointer("/meshes/0/weights"), [0, 1], [0, 1])
    assert [c.index for c in load_scene(gltf.save(tmp_path)).channels] == [0, 2]


def single_weights(tmp_path, *parts, count: int = 3, **node):
    """The weights channel of a node whose animation has a channel (weight, times, values, interpolation) each."""
    gltf = morphing(count)
    gltf.extension("KHR_animation_pointer")
    gltf.json["nodes"][0] |= node
    for k, (weight, times, values, interpolation) in enumerate(parts):
        gltf.animation(pointer(f"/nodes/0/weights/{weight}"), times, values, interpolation)
        if k:
            other = gltf.json["animations"].pop()
            channel = other["channels"][0] | {"sampler": k}
            gltf.json["animations"][0]["channels"].append(channel)
            gltf.json["animations"][0]["samplers"] += other["samplers"]
    return load_scene(gltf.save(tmp_path))


def test_single_weights_become_one_channel(tmp_path: Path) -> None:
    """The others rest at the node's weights; LINEAR keys at other times are joined exactly."""
    (only,) = single_weights(tmp_path, (1, [0, 1], [0.25, 1], "STEP"), weights=[0.5, 0, 0.75]).channels
    assert (only.path, only.interpolation) == ("weights", "STEP")
    assert only.values.tolist() == [[0.5, 0.25, 0.75], [0.5, 1, 0.75]]
    (both,) = single_weights(tmp_path, (0, [0, 2], [0, 1], None), (2, [0, 1], [1, 0], None)).channels
    assert both.times.tolist() == [0, 1, 2] and both.values.tolist() == [[0, 0, 1], [0.5, 0, 0], [1, 0, 0]]
    (cubic,) = single_weights(tmp_path, (1, [0, 1], np.arange(6), "CUBICSPLINE"), weights=[0.5, 0, 0]).channels
    assert cubic.values[0].tolist() == [[0, 0, 0], [0.5, 1, 0], [0, 2, 0]]


def test_single_weights_that_cannot_be_joined_are_noted(tmp_path: Path) -> None:
    scene = single_weights(tmp_path, (0, [0, 2], [0, 1], "STEP"), (2, [0, 1], [1, 0], "LINEAR"))
    (channel,) = scene.channels
    assert channel.values.tolist() == [[0, 0, 0], [1, 0, 0]] and notes_about(scene, "weights/2")


def test_single_weight_of_a_file(data: Path) -> None:
    scene = load_scene(data / "reports4" / "gltf" / "pointer_single_weight.gltf")
    assert [sample(scene, t).weights[0].tolist() for t in (0.0, 0.5, 1.0)] == [[0, 0], [0.5, 0], [1, 0]]


@pytest.mark.parametrize(("dtype", "normalized", "scale"), [("u2", False, 1), ("u2", True, 65535), ("i1", False, 1)])
def test_integers_of_a_pointer(tmp_path: Path, dtype: str, normalized: bool, scale: int) -> None:
    gltf = lights()
    gltf.extension("KHR_animation_pointer")
    gltf.animation(pointer(f"{LIGHT}/intensity"), [0, 1], [3, 100], dtype=dtype, normalized=normalized)
    (channel,) = load_scene(gltf.save(tmp_path)).channels
    np.testing.assert_allclose(channel.values.ravel(), np.array([3, 100]) / scale, rtol=1e-6)


def test_animated_visibility(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.extension("KHR_animation_pointer")
    gltf.extension("KHR_node_visibility")
    text = "/nodes/0/extensions/KHR_node_visibility/visible"
    gltf.animation(pointer(text), [0, 1, 2], [0, 1, 0], "STEP", dtype="u1")
    (channel,) = load_scene(gltf.save(tmp_path)).channels
    assert channel.path == "visible" and channel.values.tolist() == [[0], [1], [0]]


@pytest.mark.parametrize(
    "text", ["/materials/0/alphaCutoff", "/nodes/0/weights/0", "/cameras/0/perspective/aspectRatio", "junk", ""]
)
def test_unsupported_pointers_are_noted(tmp_path: Path, text: str) -> None:
    gltf = triangle_scene()
    gltf.extension("KHR_animation_pointer")
    gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}})
    gltf.animation(pointer(text), [0, 1], [0, 1])
    scene = load_scene(gltf.save(tmp_path))
    assert not scene.channels and notes_about(scene, text)
