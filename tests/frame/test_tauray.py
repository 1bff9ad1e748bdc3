"""Another renderer's images of the same file: Tauray's positions, normals, albedo and distance of its test scene.

The references are half floats, so tolerances are half a unit in the last place (2 m: 1 mm, 8 m: 4 mm) plus rounding.
What differs and why: (a) the rim of the blended sign has alpha below 0.5, where Tauray draws the sign and we, by the
documented rule for blended surfaces, what is behind it; (b) two edges of the room run exactly through the pixel centers
of a diagonal, and which wall wins there is a matter of the last bit; (c) the sign's texture is minified, and mipmaps
filter it differently from a single lookup.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from frame_tools import draw_frame

from taubench_gl.animation import choose_camera
from taubench_gl.gpu.context import open_gpu
from taubench_gl.scene import load_scene

SIZE = (512, 512)
SIGN = "Material.009"


def reference(folder: Path, name: str) -> np.ndarray:
    """(h, w, 3) float64, row 0 at the top."""
    channels = OpenEXR.File(str(folder / f"validate_{name}.exr"), separate_channels=True).channels()
    return np.stack([channels[c].pixels for c in "RGB"], axis=-1).astype(np.float64)


@pytest.fixture(scope="module")
def ours(data: Path) -> dict[str, np.ndarray]:
    scene = load_scene(data / "tauray_test" / "test.glb")
    gpu = open_gpu()
    with gpu:
        names = ("position", "normal", "base_color", "ids")
        channels, view = draw_frame(gpu, scene, choose_camera(scene), SIZE, names)
    relative = channels["position"][..., :3].astype(np.float64)
    normal = channels["normal"][..., :3].astype(np.float64)
    sign = channels["ids"][..., 1] == [m.name for m in scene.materials].index(SIGN) + 1
    return {
        "world-pos": relative + view.position,
        "view-pos": relative @ view.world_from_view,
        "world-normal": normal,
        "view-normal": normal @ view.world_from_view,
        "distance": np.repeat(np.linalg.norm(relative, axis=-1, keepdims=True), 3, axis=-1),
        "albedo": channels["base_color"][..., :3].astype(np.float64),
        "clear": ~grown(sign, 6) & ~np.fliplr(np.eye(512, dtype=bool)),
    }


def grown(mask: np.ndarray, pixels: int) -> np.ndarray:
    """``mask`` widened by ``pixels`` in every direction."""
    padded = np.pad(mask, pixels)
    h, w = mask.shape
    steps = range(2 * pixels + 1)
    return np.logical_or.reduce([padded[y : y + h, x : x + w] for y in steps for x in steps])


def half_ulp(values: np.ndarray) -> np.ndarray:
    """Half a unit in the last place of a half float of this size."""
    return 0.5 * 2.0 ** (np.floor(np.log2(np.maximum(np.abs(values), 2.0**-14))) - 10)


# (median error, share of all pixels within the rounding of half floats): a little below what was measured.
MEASURED = {
    "world-pos": (3e-4, 0.996),
    "view-pos": (8e-4, 0.996),
    "distance": (1.2e-3, 0.996),
    "world-normal": (1e-6, 0.995),
    "view-normal": (1e-6, 0.995),
    "albedo": (1e-3, 0.96),
}


@pytest.mark.parametrize("name", list(MEASURED))
def test_agreement(ours, data: Path, name: str) -> None:
    theirs = reference(data / "tauray_test" / "references", name)
    error = np.abs(ours[name] - theirs)
    # Our own base color is a half float too: two roundings.
    within = (error <= half_ulp(theirs) * (2 if name == "albedo" else 1) + 2e-4).all(axis=-1)
    median, share = MEASURED[name]
    assert np.median(error.max(axis=-1)) <= median
    assert within.mean() >= share, f"{within.mean():.4f} of the pixels agree"
    # Away from the sign and the diagonal nothing is left to explain.
    clear = ours["clear"]
    assert clear.mean() > 0.9
    assert within[clear].mean() > 0.9999, f"{(~within & clear).sum()} pixels differ"
