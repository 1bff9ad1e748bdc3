"""GPU masks against their float64 reference on real scenes, in two tiers.

Away from every threshold the two must agree bit for bit.  Within a stated band around one (a distance at its threshold,
a sample position half-way between two pixels, the edge of the screen) float32 and float64 may decide differently: few.
"""

from __future__ import annotations

import numpy as np
import pytest
from frame_tools import THRESHOLDS, FormulaCamera, draw_pair, find_scene, looking_at
from repeated import few

from taubench_gl.animation import choose_camera
from taubench_gl.conventions import NOT_COMPARABLE, Reason
from taubench_gl.features import FEATURES
from taubench_gl.metrics.counts import bin_of, counts_of, edges
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Camera

SIZE = (480, 270)
BAND_PX = 2e-3  # sample positions and screen edges, pixels: float32 of coordinates up to 500
BAND = 2e-4  # distances, relative to 1 + threshold
FLIPS = 5e-4  # of all pixels, at most

SCENES = {
    "Sponza.gltf": (0.0, 1.0),
    "CesiumMan.glb": (0.5, 0.5 + 1 / 24),
    "Fox.gltf": (1.0, 1.0 + 1 / 24),
    "MorphStressTest.glb": (0.4, 0.4 + 1 / 24),
    "AlphaBlendModeTest.glb": (0.0, 0.5),
    "BoxAnimated.glb": (1.5, 1.5 + 1 / 24),
    "Knight.glb": (0.3, 0.3 + 1 / 24),
    "player.glb": (0.2, 0.2 + 1 / 24),
}
LARGE = ("Sponza.gltf", "Knight.glb")


def walk_in_sponza() -> FormulaCamera:
    eye, target = np.array([4.0, 2.0, 0.3]), np.array([-6.0, 2.5, -0.2])
    step = np.array([-0.25, 0.02, 0.1])

    def place(t):
        return eye + t * step, looking_at(eye + t * step, target + 6 * t * step)

    return FormulaCamera(Camera(yfov=0.9, znear=0.05, zfar=200.0), place)


def pair_of(gpu, data, name: str, reprojection: str, sampling: str, thresholds=THRESHOLDS, size=SIZE):
    scene = load_scene(find_scene(data, name))
    camera = walk_in_sponza() if name == "Sponza.gltf" else choose_camera(scene)
    return draw_pair(gpu, scene, camera, size, SCENES[name], reprojection=reprojection, sampling=sampling,
                     thresholds=thresholds)  # fmt: skip


def near_half(x: np.ndarray, sampling: str) -> np.ndarray:
    """Pixels whose history tap (or set of taps) hangs on the last digit of the coordinate."""
    shifted = x + 0.5 if sampling == "nearest" else x
    return np.abs(shifted - np.round(shifted)) < BAND_PX


def in_band(reference, result, sampling: str, thresholds) -> np.ndarray:
    h, w = result.mask.shape
    at = np.nan_to_num(reference.at_px, nan=-1e9)
    band = near_half(at[..., 0], sampling) | near_half(at[..., 1], sampling)
    band |= (np.abs(at[..., 0]) < 1) & (np.abs(at[..., 0] + 1 / 256) < BAND_PX)
    for k, last in ((0, w - 1), (1, h - 1)):
        for edge in (-1 / 256, last + 1 / 256):
            band |= np.abs(at[..., k] - edge) < BAND_PX
    for feature, distance in reference.distances.items():
        t = thresholds[feature]
        band |= np.abs(np.nan_to_num(distance, nan=1e9, posinf=1e9) - t) < BAND * (1 + t)
    # DISOCCLUDED and OCCLUDING hang on a difference of ranges; its sign cannot be near its threshold by less.
    reach = np.linalg.norm(result.current["position"][..., :3], axis=-1)
    return band | (reach > 1e4)


@pytest.mark.parametrize(
    ("reprojection", "sampling"),
    few([("motion", "bilinear"), ("camera", "nearest"), ("camera", "bilinear"), ("motion", "nearest")], 2),
)
@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.long if n in LARGE else ()) for n in SCENES])
def test_masks_equal_the_twin(gpu, data, name: str, reprojection: str, sampling: str) -> None:
    result = pair_of(gpu, data, name, reprojection, sampling)
    for values in (*result.current.values(), *result.history.values()):
        assert np.isfinite(values).all()
    reference = pair_masks(result.current, result.history, result.pair, THRESHOLDS, sampling=sampling,
                      reprojection=reprojection)  # fmt: skip
    differ = result.mask != reference.mask
    ranges = Reason.DISOCCLUDED | Reason.OCCLUDING
    hard = (
        differ
        & ~in_band(reference, result, sampling, THRESHOLDS)
        & ((result.mask ^ reference.mask) & ~np.uint32(ranges) > 0)
    )
    assert not hard.any(), f"{hard.sum()} pixels differ away from every threshold, first at {np.argwhere(hard)[0]}"
    assert differ.mean() <= FLIPS, f"{differ.sum()} flips"
    valid = (reference.mask & Reason.BEHIND) == 0
    np.testing.assert_allclose(result.motion[valid], reference.motion_px[valid], atol=2e-3)
    assert (result.mask & NOT_COMPARABLE == 0).any()


@pytest.mark.parametrize("edge", [2.0**-14, 0.001953125, 0.125, 0.25, 1.0])
def test_histogram_tail_is_the_count_at_that_threshold(gpu, data, edge: float) -> None:
    """With a threshold just below a bin's edge, 'greater than' is 'at or above the edge': counts must match exactly."""
    below = float(np.nextafter(np.float32(edge), np.float32(0)))
    result = pair_of(gpu, data, "Fox.gltf", "camera", "nearest", dict.fromkeys(FEATURES, below))
    counts = counts_of(result.counts.mask_histogram)
    first = int(bin_of(np.array(edge)))
    assert edges()[first - 1] == edge
    for feature in ("position", "normal"):
        tail = int(result.counts.histograms[FEATURES.index(feature)][first:].sum())
        assert tail == counts[feature]
        assert 0 < tail < result.mask.size or edge == 1.0
