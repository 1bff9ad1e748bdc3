"""One tiny file per feature, with the expected numbers worked out here."""

from __future__ import annotations

import base64
import io
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from gltf_files import TRIANGLE, Gltf, triangle_scene

from taubench_gl.scene import Scene, load_scene
from taubench_gl.scene.gltf.triangles import TRIANGLE_FAN, TRIANGLE_STRIP, TRIANGLES, triangle_list

QUAD = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)


def messages(scene: Scene) -> str:
    return "\n".join(map(str, scene.notes))


def primitive_of(gltf: Gltf, folder: Path):
    return load_scene(gltf.save(folder)).meshes[0].primitives[0]


def test_reader_needs_no_gl() -> None:
    code = "import sys, taubench_gl.scene.gltf.reader; print('moderngl' in sys.modules, 'DracoPy' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.split() == ["False", "False"]


def test_minimal_scene(tmp_path: Path) -> None:
    path = triangle_scene().save(tmp_path, "minimal.gltf")
    scene = load_scene(str(path))
    primitive = scene.meshes[0].primitives[0]
    np.testing.assert_array_equal(primitive.positions, TRIANGLE)
    np.testing.assert_array_equal(primitive.triangles, [[0, 1, 2]])
    assert primitive.material == -1 and primitive.normals is None and primitive.tangents is None
    assert scene.name == "minimal" and scene.path == path and not scene.notes and scene.duration == 0.0
    assert scene.mesh_nodes.tolist() == [0]


def test_nothing_but_an_asset(tmp_path: Path) -> None:
    scene = load_scene(Gltf().save(tmp_path))
    assert len(scene.nodes) == 0 and not scene.meshes and scene.nodes.levels() == []


def test_glb_is_the_same_scene(tmp_path: Path) -> None:
    gltf = triangle_scene()
    a, b = load_scene(gltf.save(tmp_path, "a.gltf")), load_scene(gltf.save(tmp_path, "b.glb"))
    np.testing.assert_array_equal(a.meshes[0].primitives[0].positions, b.meshes[0].primitives[0].positions)
    assert a.sha256 != b.sha256


def test_sha256_covers_external_buffers(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.json["buffers"] = [{"byteLength": len(gltf.blob), "uri": "data.bin"}]
    (tmp_path / "data.bin").write_bytes(gltf.blob)
    path = gltf.save(tmp_path)
    first = load_scene(path).sha256
    (tmp_path / "data.bin").write_bytes(bytes(gltf.blob) + b"\0")  # longer than byteLength is allowed
    assert load_scene(path).sha256 != first and len(first) == 64


@pytest.mark.parametrize("uri", ["dätä %231.bin", "d%C3%A4t%C3%A4%20%231.bin", "sub/../dätä %231.bin"])
def test_percent_encoded_and_unicode_uris(tmp_path: Path, uri: str) -> None:
    gltf = triangle_scene()
    gltf.json["buffers"] = [{"byteLength": len(gltf.blob), "uri": uri}]
    (tmp_path / "sub").mkdir()
    (tmp_path / "dätä #1.bin").write_bytes(gltf.blob)
    assert len(load_scene(gltf.save(tmp_path, "szene ❤.gltf")).meshes) == 1


def test_integers_written_as_floats(tmp_path: Path) -> None:
    document = triangle_scene().document()
    document["accessors"][0]["count"] = 3.0
    document["nodes"][0]["mesh"] = 0.0
    path = tmp_path / "floats.gltf"
    path.write_text(json.dumps(document))
    assert load_scene(path).nodes.mesh.tolist() == [0]


def test_bytes_after_a_glb_are_noted(tmp_path: Path) -> None:
    path = triangle_scene().save(tmp_path, "long.glb")
    path.write_bytes(path.read_bytes() + b"xyz")
    assert "3 bytes after" in messages(load_scene(path))


# Triangles


def area_sign(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    a, b, c = points[triangles].swapaxes(0, 1)
    return np.sign((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def test_strip_winding() -> None:
    """A zigzag strip whose first triangle is counter-clockwise is so throughout."""
    points = np.array([[i // 2, -(i % 2)] for i in range(8)], float)
    triangles = triangle_list(TRIANGLE_STRIP, np.arange(8))
    assert triangles.tolist()[:3] == [[0, 1, 2], [1, 3, 2], [2, 3, 4]]
    assert len(triangles) == 6 and np.all(area_sign(triangles, points) == area_sign(triangles, points)[0])


def test_fan_winding() -> None:
    angles = np.linspace(0, 2 * math.pi, 6, endpoint=False)
    points = np.vstack([[0, 0], np.c_[np.cos(angles), np.sin(angles)]])
    triangles = triangle_list(TRIANGLE_FAN, np.arange(7))
    assert triangles.tolist()[:2] == [[1, 2, 0], [2, 3, 0]]
    assert len(triangles) == 5 and np.all(area_sign(triangles, points) == 1)


def test_degenerate_triangles_are_dropped_from_strips_only() -> None:
    stitched = np.array([0, 1, 2, 2, 3, 3, 4, 5])
    assert triangle_list(TRIANGLE_STRIP, stitched).tolist() == [[0, 1, 2], [3, 5, 4]]
    assert triangle_list(TRIANGLES, np.array([0, 0, 1, 2])).tolist() == [[0, 0, 1]]


@pytest.mark.parametrize("dtype", ["u1", "u2", "u4"])
def test_index_types(tmp_path: Path, dtype: str) -> None:
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh(QUAD))
    gltf.json["meshes"][0]["primitives"][0]["indices"] = gltf.accessor([0, 1, 2, 2, 3, 0], dtype)
    triangles = primitive_of(gltf, tmp_path).triangles
    assert triangles.tolist() == [[0, 1, 2], [2, 3, 0]] and triangles.dtype == np.uint32


def test_points_and_lines_are_counted(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.mesh(QUAD)
    for mode in (0, 1, 2, 3):
        primitive = gltf.json["meshes"][gltf.mesh(QUAD, mode=mode)]["primitives"][0]
        gltf.json["meshes"][0]["primitives"].append(primitive)
    gltf.json["meshes"] = gltf.json["meshes"][:1]
    scene = load_scene(gltf.save(tmp_path))
    assert len(scene.meshes[0].primitives) == 1
    assert "4 primitives of points or lines are not drawn (4 points, 9 lines)" in messages(scene)


# Accessors


@pytest.mark.parametrize(
    "dtype, stored, value",
    [("u1", 255, 1.0), ("u1", 51, 0.2), ("u2", 13107, 0.2), ("u2", 65535, 1.0)],
)
def test_normalized_unsigned(tmp_path: Path, dtype: str, stored: int, value: float) -> None:
    gltf = Gltf()
    uv = gltf.accessor([[0, stored], [0, 0], [stored, 0]], dtype, normalized=True)
    gltf.node(mesh=gltf.mesh(TEXCOORD_0=uv))
    got = primitive_of(gltf, tmp_path).texcoords[0]
    assert got.dtype == np.float32
    np.testing.assert_allclose(got, [[0, value], [0, 0], [value, 0]], atol=1e-7)


def test_quantized_positions_and_normals(tmp_path: Path) -> None:
    """-128 and -127 both mean -1; integers that are not normalized are taken as they are."""
    gltf = Gltf()
    gltf.extension("KHR_mesh_quantization")
    normals = gltf.view(np.array([[0, 0, 127, 0], [0, 0, -127, 0], [0, 0, -128, 0]], "i1").tobytes(), byteStride=4)
    normal = gltf.add("accessors", {"bufferView": normals, "componentType": 5120, "count": 3, "type": "VEC3",
                                    "normalized": True})  # fmt: skip
    points = gltf.view(np.array([[0, 0, 0, 9], [300, 0, 0, 9], [0, -300, 0, 9]], "<i2").tobytes(), byteStride=8)
    position = gltf.add("accessors", {"bufferView": points, "componentType": 5122, "count": 3, "type": "VEC3"})
    gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": position, "NORMAL": normal}}]})
    primitive = primitive_of(gltf, tmp_path)
    np.testing.assert_array_equal(primitive.normals, [[0, 0, 1], [0, 0, -1], [0, 0, -1]])
    np.testing.assert_array_equal(primitive.positions, [[0, 0, 0], [300, 0, 0], [0, -300, 0]])


def test_interleaved(tmp_path: Path) -> None:
    gltf = Gltf()
    rows = np.hstack([TRIANGLE, np.array([[0, 0], [1, 0], [0, 1]], np.float32)]).astype("<f4")
    view = gltf.view(rows.tobytes(), byteStride=20)
    common = {"bufferView": view, "componentType": 5126, "count": 3}
    position = gltf.add("accessors", {**common, "type": "VEC3"})
    uv = gltf.add("accessors", {**common, "type": "VEC2", "byteOffset": 12})
    gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": position, "TEXCOORD_0": uv}}]})
    primitive = primitive_of(gltf, tmp_path)
    np.testing.assert_array_equal(primitive.positions, TRIANGLE)
    np.testing.assert_array_equal(primitive.texcoords[0], rows[:, 3:])
    assert primitive.positions.flags.c_contiguous


@pytest.mark.parametrize("base", [True, False], ids=["over-data", "over-zeros"])
def test_sparse(tmp_path: Path, base: bool) -> None:
    gltf = Gltf()
    points = np.zeros((5, 3), np.float32) + (7 if base else 0)
    expected = points.copy()
    expected[[1, 4]] = [[1, 2, 3], [4, 5, 6]]
    sparse = {
        "count": 2,
        "indices": {"bufferView": gltf.view(np.array([1, 4], "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": gltf.view(expected[[1, 4]].tobytes())},
    }
    bounds = {"min": expected.min(axis=0).tolist(), "max": expected.max(axis=0).tolist()}
    if base:
        position = gltf.accessor(points, sparse=sparse, **bounds)
    else:
        item = {"componentType": 5126, "count": 5, "type": "VEC3", "sparse": sparse, **bounds}
        position = gltf.add("accessors", item)
    gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": position}}]})
    np.testing.assert_array_equal(primitive_of(gltf, tmp_path).positions, expected)


@pytest.mark.parametrize(
    "values, dtype, expected",
    [
        ([[0, 51, 255]] * 3, "u1", [0, 0.2, 1, 1]),
        ([[0, 51, 255, 51]] * 3, "u1", [0, 0.2, 1, 0.2]),
        ([[0, 0.25, 1]] * 3, "f4", [0, 0.25, 1, 1]),
        ([[0, 0.25, 1, 0.5]] * 3, "f4", [0, 0.25, 1, 0.5]),
    ],
    ids=["rgb8", "rgba8", "rgb32f", "rgba32f"],
)
def test_vertex_colors(tmp_path: Path, values: list, dtype: str, expected: list) -> None:
    gltf = Gltf()
    if dtype == "u1" and len(values[0]) == 3:
        view = gltf.view(np.pad(np.array(values, "u1"), ((0, 0), (0, 1))).tobytes(), byteStride=4)
        color = gltf.add("accessors", {"bufferView": view, "componentType": 5121, "count": 3, "type": "VEC3",
                                       "normalized": True})  # fmt: skip
    else:
        color = gltf.accessor(values, dtype, normalized=dtype == "u1")
    gltf.mesh(COLOR_0=color)
    colors = primitive_of(gltf, tmp_path).colors
    assert colors.dtype == np.float32 and colors.shape == (3, 4)
    np.testing.assert_allclose(colors, [expected] * 3, atol=1e-7)


# Materials


def png(size: tuple[int, int] = (3, 2), mode: str = "RGB", color: object = (10, 20, 30)) -> bytes:
    out = io.BytesIO()
    PIL.Image.new(mode, size, color).save(out, "PNG")
    return out.getvalue()


def textured(info: dict, **attributes: int) -> Gltf:
    gltf = Gltf()
    gltf.add("images", {"uri": "data:image/png;base64," + base64.b64encode(png()).decode()})
    gltf.add("textures", {"source": 0})
    gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **info}}})
    return gltf


def test_material_defaults_and_extensions(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.extension("KHR_materials_emissive_strength")
    gltf.extension("KHR_materials_unlit")
    gltf.extension("KHR_materials_clearcoat")
    gltf.extension("ACME_unheard_of")
    gltf.add("materials", {})
    gltf.add("materials", {
        "emissiveFactor": [1, 0.5, 0], "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": True,
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4}, "KHR_materials_unlit": {},
                       "KHR_materials_clearcoat": {"clearcoatFactor": 1}},
    })  # fmt: skip
    scene = load_scene(gltf.save(tmp_path))
    plain, rich = scene.materials
    assert plain.base_color == (1, 1, 1, 1) and plain.metallic == plain.roughness == 1.0 and not plain.unlit
    assert rich.emissive == (4.0, 2.0, 0.0) and rich.unlit and rich.double_sided
    assert (rich.alpha_mode, rich.alpha_cutoff) == ("MASK", 0.25)
    for name in ("KHR_materials_clearcoat", "ACME_unheard_of"):
        assert f"extension {name} is used but not simulated" in messages(scene)
    assert "unlit" not in messages(scene)


def test_texture_transform(tmp_path: Path) -> None:
    transform = {"offset": [0.1, 0.2], "rotation": math.pi / 2, "scale": [2, 3], "texCoord": 1}
    gltf = textured({"texCoord": 0, "extensions": {"KHR_texture_transform": transform}})
    gltf.extension("KHR_texture_transform")
    texture = load_scene(gltf.save(tmp_path)).materials[0].base_color_texture
    assert texture.texcoord == 1
    # Scaled first, then turned counter-clockwise as seen (v down: u goes to -v), then moved.
    np.testing.assert_allclose(texture.uv_transform @ [1, 0, 1], [0.1, 0.2 - 2.0], atol=1e-12)
    np.testing.assert_allclose(texture.uv_transform @ [0, 1, 1], [0.1 + 3.0, 0.2], atol=1e-12)


def test_missing_texture_coordinates_are_zero(tmp_path: Path) -> None:
    gltf = textured({})
    gltf.mesh()
    gltf.json["meshes"][0]["primitives"][0]["material"] = 0
    scene = load_scene(gltf.save(tmp_path))
    np.testing.assert_array_equal(scene.meshes[0].primitives[0].texcoords[0], np.zeros((3, 2)))
    assert "TEXCOORD_0" in messages(scene)


def test_third_texture_coordinates_are_noted(tmp_path: Path) -> None:
    scene = load_scene(textured({"texCoord": 2}).save(tmp_path))
    assert scene.materials[0].base_color_texture is None and "TEXCOORD_2" in messages(scene)


def test_sampler_defaults(tmp_path: Path) -> None:
    gltf = textured({})
    gltf.add("samplers", {"wrapS": 33071, "magFilter": 9728})
    gltf.json["textures"][0]["sampler"] = 0
    sampler = load_scene(gltf.save(tmp_path)).materials[0].base_color_texture.sampler
    assert (sampler.mag_filter, sampler.min_filter, sampler.wrap_s, sampler.wrap_t) == (9728, 9987, 33071, 10497)


def test_image_in_a_buffer_view_and_lazy(tmp_path: Path) -> None:
    gltf = textured({})
    gltf.json["images"] = [{"bufferView": gltf.view(png((5, 4))), "mimeType": "image/png", "name": "tile"},
                           {"uri": "nowhere.png"}]  # fmt: skip
    images = load_scene(gltf.save(tmp_path)).images
    assert images[0].size == (5, 4) and images[0].name == "tile"
    pixels = images[0].decode()
    assert pixels.shape == (4, 5, 4) and pixels[0, 0].tolist() == [10, 20, 30, 255]
    assert images[1].size == (0, 0)


def test_sixteen_bit_grey_is_scaled_not_clipped(tmp_path: Path) -> None:
    gltf = textured({})
    gltf.json["images"] = [{"bufferView": gltf.view(png(mode="I;16", color=0x8000)), "mimeType": "image/png"}]
    assert load_scene(gltf.save(tmp_path)).images[0].decode()[0, 0].tolist() == [128, 128, 128, 255]


def test_webp(tmp_path: Path) -> None:
    out = io.BytesIO()
    PIL.Image.new("RGB", (4, 4), (200, 0, 0)).save(out, "WEBP", lossless=True)
    gltf = textured({})
    gltf.add("images", {"bufferView": gltf.view(out.getvalue()), "mimeType": "image/webp"})
    gltf.json["textures"][0]["extensions"] = {"EXT_texture_webp": {"source": 1}}
    gltf.extension("EXT_texture_webp")
    scene = load_scene(gltf.save(tmp_path))
    assert scene.materials[0].base_color_texture.image == 1
    assert scene.images[1].decode()[0, 0].tolist() == [200, 0, 0, 255]


# Nodes, scenes, cameras, lights


def test_scene_selection(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.node(name="b")
    gltf.node(name="c", children=[1])
    gltf.json["scenes"] = [{"name": "first", "nodes": [0]}, {"nodes": [2]}, {}]
    gltf.json["scene"] = 1
    path = gltf.save(tmp_path)
    assert load_scene(path).nodes.in_scene.tolist() == [False, True, True]
    assert load_scene(path, scene="first").nodes.in_scene.tolist() == [True, False, False]
    assert load_scene(path, scene="0").nodes.in_scene.tolist() == [True, False, False]
    assert load_scene(path, scene=2).nodes.in_scene.tolist() == [False] * 3
    assert load_scene(path).scene_names == ("first", "scene 1", "scene 2")
    assert load_scene(path).nodes.parent.tolist() == [-1, 2, -1]


def test_file_without_scenes_shows_all_roots(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.node(children=[0])
    scene = load_scene(gltf.save(tmp_path))
    assert scene.nodes.in_scene.all() and scene.scene_names == ()


def test_matrix_is_stored_by_columns(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.node(matrix=[0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 5, 6, 7, 1])
    gltf.node(translation=[1, 2, 3], rotation=[0, 0, 0.6, 0.8], scale=[1, -1, 0])
    nodes = load_scene(gltf.save(tmp_path)).nodes
    assert nodes.has_matrix.tolist() == [True, False]
    np.testing.assert_array_equal(nodes.matrix[0], [[0, -2, 0, 5], [2, 0, 0, 6], [0, 0, 2, 7], [0, 0, 0, 1]])
    assert nodes.rotation[1].tolist() == [0, 0, 0.6, 0.8] and nodes.scale[1].tolist() == [1, -1, 0]


def test_cameras(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}})
    gltf.add("cameras", {"type": "perspective",
                         "perspective": {"yfov": 0.5, "znear": 1, "zfar": 9, "aspectRatio": 2}})  # fmt: skip
    gltf.add("cameras", {"type": "orthographic", "orthographic": {"xmag": 2, "ymag": 3, "znear": 0, "zfar": 4}})
    for camera in range(3):
        gltf.node(camera=camera)
    scene = load_scene(gltf.save(tmp_path))
    infinite, finite, flat = scene.cameras
    assert math.isinf(infinite.zfar) and infinite.aspect is None
    assert (finite.zfar, finite.aspect, finite.yfov) == (9, 2, 0.5)
    assert (flat.kind, flat.xmag, flat.ymag, flat.znear, flat.zfar) == ("orthographic", 2, 3, 0, 4)
    assert scene.camera_nodes.tolist() == [0, 1, 2]


def lights() -> Gltf:
    gltf = Gltf()
    gltf.extension("KHR_lights_punctual", {"lights": [
        {"type": "point", "color": [1, 0.5, 0], "intensity": 20, "range": 5},
        {"type": "spot", "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2}},
        {"type": "directional", "name": "sun"},
    ]})  # fmt: skip
    for light in range(3):
        gltf.node(extensions={"KHR_lights_punctual": {"light": light}})
    return gltf


def test_lights(tmp_path: Path) -> None:
    scene = load_scene(lights().save(tmp_path))
    point, spot, sun = scene.lights
    assert (point.kind, point.color, point.intensity, point.range) == ("point", (1, 0.5, 0), 20, 5)
    assert (spot.inner_cone, spot.outer_cone) == (0.1, 0.2) and math.isinf(spot.range)
    assert (sun.kind, sun.name, sun.intensity) == ("directional", "sun", 1.0)
    assert scene.light_nodes.tolist() == [0, 1, 2]


def test_visibility(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.extension("KHR_node_visibility")
    gltf.node(extensions={"KHR_node_visibility": {"visible": False}})
    gltf.node(extensions={"KHR_node_visibility": {}})
    assert load_scene(gltf.save(tmp_path)).nodes.visible.tolist() == [False, True]


def test_instancing(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.extension("EXT_mesh_gpu_instancing")
    half = math.sqrt(0.5)
    attributes = {
        "TRANSLATION": gltf.accessor([[1, 2, 3], [4, 5, 6]]),
        "ROTATION": gltf.accessor([[0, 0, 0, 1], [0, 0, half, half]]),
        "SCALE": gltf.accessor([[1, 1, 1], [2, 2, 2]]),
        "_COLOR": gltf.accessor([1, 2]),
    }
    gltf.json["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    instances = load_scene(gltf.save(tmp_path)).nodes.instances[0]
    assert instances.shape == (2, 4, 4)
    np.testing.assert_allclose(instances[0] @ [1, 0, 0, 1], [2, 2, 3, 1], atol=1e-6)
    np.testing.assert_allclose(instances[1] @ [1, 0, 0, 1], [4, 7, 6, 1], atol=1e-6)


# Skins and morph targets


def skinned(weights: object, joints: object = None, **skin: object) -> Gltf:
    gltf = Gltf()
    joints = np.zeros((3, 4)) if joints is None else joints
    mesh = gltf.mesh(JOINTS_0=gltf.accessor(joints, "u1"), WEIGHTS_0=gltf.accessor(weights))
    gltf.node(mesh=mesh, skin=0)
    gltf.node(name="root", children=[2])
    gltf.node(name="tip")
    gltf.add("skins", {"joints": [1, 2], **skin})
    return gltf


def test_skin_without_inverse_bind_matrices(tmp_path: Path) -> None:
    scene = load_scene(skinned([[1, 0, 0, 0]] * 3, skeleton=1).save(tmp_path))
    np.testing.assert_array_equal(scene.skins[0].inverse_bind, np.tile(np.eye(4), (2, 1, 1)))
    assert scene.skins[0].joints.tolist() == [1, 2] and scene.nodes.skin.tolist() == [0, -1, -1]
    assert not scene.notes


def test_inverse_bind_matrices_are_stored_by_columns(tmp_path: Path) -> None:
    gltf = skinned([[1, 0, 0, 0]] * 3)
    matrix = np.eye(4)
    matrix[:3, 3] = [1, 2, 3]
    gltf.json["skins"][0]["inverseBindMatrices"] = gltf.accessor(np.stack([matrix.T.ravel(), np.eye(4).ravel()]))
    inverse_bind = load_scene(gltf.save(tmp_path)).skins[0].inverse_bind
    np.testing.assert_array_equal(inverse_bind[0], matrix)


def test_weights_are_normalized_and_noted(tmp_path: Path) -> None:
    scene = load_scene(skinned([[0.5, 0.25, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0]], [[1, 0, 0, 0]] * 3).save(tmp_path))
    primitive = scene.meshes[0].primitives[0]
    np.testing.assert_allclose(primitive.weights, [[2 / 3, 1 / 3, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]], atol=1e-7)
    assert primitive.joints[1, 0] == 1
    text = messages(scene)
    assert "1 vertices had skin weights" in text and "1 vertices without any skin weight" in text


def test_two_sets_of_weights(tmp_path: Path) -> None:
    gltf = skinned([[0.5, 0, 0, 0]] * 3)
    attributes = gltf.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["JOINTS_1"] = gltf.accessor([[1, 0, 0, 0]] * 3, "u2")
    attributes["WEIGHTS_1"] = gltf.accessor([[0.5, 0, 0, 0]] * 3)
    primitive = primitive_of(gltf, tmp_path)
    assert primitive.joints.shape == primitive.weights.shape == (3, 8)
    assert primitive.joints[0].tolist() == [0, 0, 0, 0, 1, 0, 0, 0]
    np.testing.assert_allclose(primitive.weights[:, [0, 4]], 0.5)


def morphing(targets: int = 2) -> Gltf:
    gltf = triangle_scene()
    primitive = gltf.json["meshes"][0]["primitives"][0]
    primitive["targets"] = [{"POSITION": gltf.accessor(TRIANGLE * (i + 1))} for i in range(targets)]
    return gltf


def test_morph_targets_and_weights(tmp_path: Path) -> None:
    gltf = morphing(9)
    gltf.json["meshes"][0]["weights"] = [0.125 * i for i in range(9)]
    gltf.json["nodes"][0]["weights"] = [1.0] * 9
    gltf.node(mesh=0)
    scene = load_scene(gltf.save(tmp_path))
    targets = scene.meshes[0].primitives[0].targets
    assert len(targets) == 9 and targets[0].normals is None
    np.testing.assert_array_equal(targets[8].positions, TRIANGLE * 9)
    np.testing.assert_array_equal(scene.meshes[0].weights, np.arange(9) / 8)
    assert list(scene.nodes.weights) == [0] and scene.nodes.weights[0].tolist() == [1.0] * 9


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
    assert channel.times.tolist() == [0, 1, 2] and channel.values[:, 0].tolist() == [0, 6, 9]
    assert "1 keys share their time" in messages(scene)


def test_single_key_is_fine(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.animation({"node": 0, "path": "translation"}, [0], [[1, 2, 3]])
    assert load_scene(gltf.save(tmp_path)).duration == 0.0


def test_colliding_animations(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.node()
    for node, path in ((0, "translation"), (1, "translation"), (0, "translation"), (0, "scale")):
        gltf.animation({"node": node, "path": path}, [0, 1], [[0, 0, 0], [1, 1, 1]])
    gltf.json["animations"][2]["name"] = "late"
    path = gltf.save(tmp_path)
    scene = load_scene(path)
    assert scene.playing == ("animation 0", "animation 1", "animation 3") and len(scene.channels) == 3
    assert "'late'" in messages(scene) and "--animation" in messages(scene)
    assert load_scene(path, animation=["late", 3]).playing == ("late", "animation 3")
    assert load_scene(path, animation=[]).playing == ()


def pointer(text: str) -> dict:
    return {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": text}}}


LIGHT = "/extensions/KHR_lights_punctual/lights/1"


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
def test_pointers_elsewhere_are_noted(tmp_path: Path, text: str) -> None:
    gltf = triangle_scene()
    gltf.extension("KHR_animation_pointer")
    gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}})
    gltf.animation(pointer(text), [0, 1], [0, 1])
    scene = load_scene(gltf.save(tmp_path))
    assert not scene.channels and f"not animated: {text}" in messages(scene)


# Compression


def test_draco_against_the_same_mesh_uncompressed(tmp_path: Path) -> None:
    draco = pytest.importorskip("DracoPy")
    rng = np.random.default_rng(4)
    points = rng.normal(size=(60, 3)).astype(np.float32)
    faces = np.arange(60, dtype=np.uint32).reshape(-1, 3)
    uv = rng.random((60, 2)).astype(np.float32)
    packed = draco.encode(points, faces, preserve_order=True, quantization_bits=20, tex_coord=uv.astype(np.float64))
    ids = {a["attribute_type"]: a["unique_id"] for a in draco.decode(packed).attributes}
    gltf = Gltf()
    gltf.extension("KHR_draco_mesh_compression")
    for kind, count in (("VEC3", 60), ("VEC2", 60)):
        gltf.add("accessors", {"componentType": 5126, "count": count, "type": kind})
    gltf.add("accessors", {"componentType": 5125, "count": 60, "type": "SCALAR"})
    types = draco.AttributeType
    compression = {"bufferView": gltf.view(packed),
                   "attributes": {"POSITION": ids[types.POSITION], "TEXCOORD_0": ids[types.TEX_COORD]}}  # fmt: skip
    gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2,
                                        "extensions": {"KHR_draco_mesh_compression": compression}}]})  # fmt: skip
    primitive = primitive_of(gltf, tmp_path)
    np.testing.assert_array_equal(primitive.triangles, faces)
    np.testing.assert_allclose(primitive.positions, points, atol=1e-5)
    np.testing.assert_allclose(primitive.texcoords[0], uv, atol=1e-5)


def compressed(
    gltf: Gltf, data: bytes, stride: int, count: int, mode: str, filter: str = "NONE", **view: object
) -> int:
    """A bufferView whose only data is compressed; its own buffer is a fallback without bytes."""
    packed = {"buffer": 0, "byteOffset": len(gltf.blob) + -len(gltf.blob) % 4, "byteLength": len(data),
              "byteStride": stride, "count": count, "mode": mode, "filter": filter}  # fmt: skip
    gltf.blob += bytes(-len(gltf.blob) % 4) + data
    return gltf.add("bufferViews", {"buffer": 1, "byteLength": stride * count, **view,
                                    "extensions": {"EXT_meshopt_compression": packed}})  # fmt: skip


def finish(gltf: Gltf) -> Gltf:
    gltf.extension("EXT_meshopt_compression")
    uri = "data:application/octet-stream;base64," + base64.b64encode(gltf.blob).decode()
    fallback = {"byteLength": 1 << 16, "extensions": {"EXT_meshopt_compression": {"fallback": True}}}
    gltf.json["buffers"] = [{"byteLength": len(gltf.blob), "uri": uri}, fallback]
    return gltf


@pytest.mark.parametrize("index_type", [5123, 5125])
def test_meshopt_round_trip(tmp_path: Path, index_type: int) -> None:
    meshopt = pytest.importorskip("meshoptimizer")
    points = np.random.default_rng(5).normal(size=(100, 3)).astype(np.float32)
    faces = np.random.default_rng(6).permutation(99).astype(np.uint32)
    gltf = Gltf()
    vertices = compressed(gltf, meshopt.encode_vertex_buffer(points), 12, 100, "ATTRIBUTES", byteStride=12)
    size = 2 if index_type == 5123 else 4
    indices = compressed(gltf, meshopt.encode_index_sequence(faces, vertex_count=100), size, 99, "INDICES")
    gltf.add("accessors", {"bufferView": vertices, "componentType": 5126, "count": 100, "type": "VEC3"})
    gltf.add("accessors", {"bufferView": indices, "componentType": index_type, "count": 99, "type": "SCALAR"})
    gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]})
    primitive = primitive_of(finish(gltf), tmp_path)
    np.testing.assert_array_equal(primitive.positions, points)
    np.testing.assert_array_equal(primitive.triangles.ravel(), faces)


def test_meshopt_octahedral_filter(tmp_path: Path) -> None:
    """Axis directions in octahedral form: x, y and the number that stands for 1."""
    meshopt = pytest.importorskip("meshoptimizer")
    encoded = np.array([[127, 0, 127, 0], [0, 127, 127, 0], [0, 0, 127, 0], [0, -127, 127, 0]], np.int8)
    gltf = Gltf()
    gltf.extension("KHR_mesh_quantization")
    view = compressed(gltf, meshopt.encode_vertex_buffer(encoded), 4, 4, "ATTRIBUTES", "OCTAHEDRAL", byteStride=4)
    gltf.mesh(QUAD, [0, 1, 2, 0, 2, 3])
    normal = gltf.add("accessors", {"bufferView": view, "componentType": 5120, "normalized": True, "count": 4,
                                    "type": "VEC3"})  # fmt: skip
    gltf.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = normal
    normals = primitive_of(finish(gltf), tmp_path).normals
    np.testing.assert_allclose(normals, [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]], atol=1e-6)
