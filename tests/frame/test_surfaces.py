"""Color, emission and material channels where their value is known: factors, textures, sets, transforms, wrapping."""

from __future__ import annotations

import numpy as np
import pytest
from frame_tools import draw_frame, make_scene, picture, primitive, still_camera

from taubench_gl.scene.model import Camera, Material, Sampler, Texture

SIZE = (64, 64)
# A wall two units wide that fills the view: pixel centers run from (0.5 / 64) to (63.5 / 64) in texture coordinates.
LENS = Camera(kind="orthographic", ymag=1.0, znear=0.1, zfar=10.0)
SRGB = 3e-3  # llvmpipe decodes sRGB by a polynomial that is off by 0.0015; half floats add 0.0005
NEAREST = {"mag_filter": 9728, "min_filter": 9728}
CHANNELS = ("position", "base_color", "emission", "material", "ids")


def wall(uv=None, uv1=None, colors=None):
    corners = [[-1, -1, -2], [1, -1, -2], [1, 1, -2], [-1, 1, -2]]
    upright = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype=np.float32)
    sets = (upright if uv is None else uv, upright[:, ::-1].copy() if uv1 is None else uv1)
    return primitive(corners, [[0, 1, 2], [0, 2, 3]], texcoords=sets, colors=colors, material=0)


def shade(gpu, material: Material, *images, **fields) -> dict[str, np.ndarray]:
    scene = make_scene(wall(**fields), materials=(material,), images=images)
    channels, _ = draw_frame(gpu, scene, still_camera(LENS), SIZE, CHANNELS)
    assert (channels["position"][..., 3] > 0).all()
    return {n: v.astype(np.float64) for n, v in channels.items()}


def linear(byte) -> np.ndarray:
    """The sRGB transfer function of IEC 61966-2-1."""
    c = np.asarray(byte, dtype=np.float64) / 255
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def quarters() -> np.ndarray:
    """Four colors in 2 x 2 texels, row 0 at the top."""
    return np.array([[[255, 0, 0, 255], [0, 255, 0, 255]], [[0, 0, 255, 255], [200, 100, 50, 255]]])


def test_factors(gpu) -> None:
    material = Material(base_color=(0.25, 0.5, 0.75, 1.0), metallic=0.3, roughness=0.6, emissive=(2.0, 0.0, 7.5))
    got = shade(gpu, material)
    np.testing.assert_allclose(got["base_color"][..., :3], np.broadcast_to([0.25, 0.5, 0.75], (64, 64, 3)), atol=5e-4)
    np.testing.assert_allclose(got["emission"][..., :3], np.broadcast_to([2.0, 0, 7.5], (64, 64, 3)))
    np.testing.assert_allclose(got["material"], np.broadcast_to([0.3, 0.6, 1, 1], (64, 64, 4)), atol=5e-4)
    np.testing.assert_array_equal(got["ids"], np.broadcast_to([1, 1], (64, 64, 2)))


def test_the_image_stands_upright_and_is_decoded_from_srgb(gpu) -> None:
    material = Material(base_color=(1, 1, 0.5, 1), base_color_texture=Texture(0, Sampler(**NEAREST)))
    color = shade(gpu, material, picture(quarters()))["base_color"]
    expected = linear(quarters()[..., :3]) * [1, 1, 0.5]
    for row, column in ((0, 0), (0, 1), (1, 0), (1, 1)):
        tile = color[32 * row : 32 * row + 32, 32 * column : 32 * column + 32, :3]
        np.testing.assert_allclose(tile, np.broadcast_to(expected[row, column], tile.shape), atol=SRGB)


def test_vertex_colors_multiply_and_interpolate(gpu) -> None:
    colors = np.array([[0, 0.5, 1, 1], [1, 0.5, 1, 1], [1, 0.5, 0, 1], [0, 0.5, 0, 1]], dtype=np.float32)
    color = shade(gpu, Material(base_color=(1, 1, 0.5, 1)), colors=colors)["base_color"]
    at = (np.arange(64) + 0.5) / 64
    np.testing.assert_allclose(color[..., 0], np.broadcast_to(at, (64, 64)), atol=1e-3)
    np.testing.assert_allclose(color[..., 1], 0.5, atol=1e-3)
    np.testing.assert_allclose(color[..., 2], np.broadcast_to(0.5 * at[:, None], (64, 64)), atol=1e-3)


def test_each_texture_has_its_own_set_and_transform(gpu) -> None:
    """Base color by set 0, emission by set 1 (which is transposed), offset by half a texture along u."""
    shifted = np.array([[1.0, 0, 0.5], [0, 1, 0]])
    material = Material(
        base_color_texture=Texture(0, Sampler(**NEAREST)),
        emissive=(1.0, 1.0, 1.0),
        emissive_texture=Texture(0, Sampler(**NEAREST), texcoord=1, uv_transform=shifted),
    )
    got = shade(gpu, material, picture(quarters()))
    image = linear(quarters()[..., :3])
    np.testing.assert_allclose(got["base_color"][16, 48, :3], image[0, 1], atol=SRGB)
    for row, column in ((16, 16), (16, 48), (48, 16), (48, 48)):
        # Set 1 holds (v, u): what is at the right of the wall is at the bottom of the image; then u moves by one texel.
        u, v = (row // 32 + 1) % 2, column // 32
        np.testing.assert_allclose(got["emission"][row, column, :3], image[v, u], atol=SRGB)


def test_metallic_roughness_and_occlusion_maps(gpu) -> None:
    texel = np.array([51, 102, 204, 255])  # occlusion in red, roughness in green, metallic in blue; all linear
    material = Material(
        metallic=0.5,
        roughness=0.25,
        metallic_roughness_texture=Texture(0),
        occlusion_texture=Texture(0),
        occlusion_strength=0.5,
        unlit=True,
    )
    got = shade(gpu, material, picture(np.tile(texel, (2, 2, 1))))["material"]
    expected = [0.5 * 204 / 255, 0.25 * 102 / 255, 1 + 0.5 * (51 / 255 - 1), -1]  # -1: unlit
    np.testing.assert_allclose(got, np.broadcast_to(expected, (64, 64, 4)), atol=1e-3)


@pytest.mark.parametrize(("wrap", "columns"), [(10497, [0, 1, 0, 1]), (33648, [0, 1, 1, 0]), (33071, [0, 1, 1, 1])])
def test_wrapping(gpu, wrap: int, columns: list[int]) -> None:
    """u runs from 0 to 2: repeated, mirrored, clamped."""
    uv = np.array([[0, 1], [2, 1], [2, 0], [0, 0]], dtype=np.float32)
    sampler = Sampler(**NEAREST, wrap_s=wrap, wrap_t=wrap)
    color = shade(gpu, Material(base_color_texture=Texture(0, sampler)), picture(quarters()), uv=uv)["base_color"]
    image = linear(quarters()[..., :3])
    for i, column in enumerate(columns):
        np.testing.assert_allclose(color[8, 16 * i + 8, :3], image[0, column], atol=SRGB)


def test_minification_averages(gpu) -> None:
    """A checkerboard of single texels seen from afar is gray, in linear light: mipmaps, not a coin toss."""
    board = np.zeros((256, 256, 4), dtype=int)
    board[(np.indices((256, 256)).sum(axis=0) % 2) == 1] = 255
    board[..., 3] = 255
    color = shade(gpu, Material(base_color_texture=Texture(0)), picture(board))["base_color"][8:-8, 8:-8, :3]
    assert color.std() < 0.05
    # The mean of black and white light is 0.5; averaging sRGB bytes would give 0.21.
    assert color.mean() == pytest.approx(0.5, abs=0.03)


def test_geometric_normals_face_a_parallel_camera(gpu) -> None:
    """A wall at a grazing angle: it would face away from a viewer at the camera's position."""
    corners = [[0.5, -1, -2], [0.9, -1, -8], [0.9, 1, -8], [0.5, 1, -2]]
    scene = make_scene(primitive(corners, [[0, 1, 2], [0, 2, 3]], material=0), materials=(Material(double_sided=True),))
    channels, _ = draw_frame(gpu, scene, still_camera(LENS), SIZE, ("position", "geometric_normal"))
    seen = channels["position"][..., 3] > 0
    assert seen.sum() > 100
    expected = np.array([6.0, 0.0, 0.4]) / np.hypot(6.0, 0.4)
    np.testing.assert_allclose(
        channels["geometric_normal"][seen][:, :3], np.broadcast_to(expected, (seen.sum(), 3)), atol=1e-3
    )
