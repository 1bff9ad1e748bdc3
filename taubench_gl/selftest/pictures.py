"""Cases: pictures of the demo scene by every method of light, and its masks, against recorded numbers.

Closed forms test one formula each; these see all of them at once, with textures, normal maps, alpha, skins and morphs.
The numbers were recorded with Mesa's llvmpipe, whose passes the tests compare with float64 references.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from taubench_gl.animation import choose_camera
from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.metrics.reuse_rate import occupied
from taubench_gl.paths import ASSETS
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Outcome, case, field
from taubench_gl.selftest.scenes import sky_file

Array = np.ndarray

RECORDED = "pictures.json"
"""Beside this module; ``tools/record selftest-pictures`` writes it."""

BLOCKS = (4, 8)
"""Rows and columns of blocks, of which the mean is compared."""

FRAME = 40
IN_ALL_BLOCKS, IN_HALF_OF_THEM = 3e-3, 0.02
"""What the mean of a block may differ by, over the mean of the image."""

MOVED_PIXELS = {True: 16, False: 48}
"""Pixels that may have another reason word, by whether rendering is in software."""

LIGHT = ("direct", "indirect")
COMMON = {"width": 64, "height": 36, "fps": 24.0, "camera": 0, "textures": "finest"}  # drivers choose other mipmaps
LAMPS = {"shadow_size": 128, "indirect_samples": 256, "probes": 96}


@cache
def _demo() -> Scene:
    return load_scene(ASSETS / "demo.glb")


def _raster(bench: Bench, **settings: Any) -> dict[str, Array]:
    (shot,) = bench.shots(_demo(), (FRAME,), columns=(*LIGHT, "color"), **COMMON | LAMPS | settings)
    return {name: shot[name][..., :3] for name in (*LIGHT, "color")}


def _traced(bench: Bench, **settings: Any) -> dict[str, Array]:
    options = {"columns": LIGHT, "light": "path-traced", "indirect": "auto", "bounces": 4, "spp": 4}
    options |= {"width": 32, "height": 18}
    (shot,) = bench.shots(_demo(), (FRAME,), **COMMON | options | settings)
    return {name: shot[name][..., :3] for name in LIGHT}


def _under_an_image(bench: Bench) -> dict[str, Array]:
    """Path-traced in an environment image with a bright side."""
    across, down = np.meshgrid(np.linspace(0.0, 1.0, 64), np.linspace(0.0, 1.0, 32))
    value = np.stack([np.exp(-8.0 * (across - 0.3) ** 2), 0.5 + 0.5 * across, 1.0 - down], axis=-1)
    with sky_file(value) as path:
        return _traced(bench, environment=path, pattern="independent")


PICTURES: dict[str, Callable[[Bench], dict[str, Array]]] = {
    "rsm": lambda bench: _raster(bench, indirect="rsm"),
    "probes": lambda bench: _raster(bench, indirect="probes", environment="default", shadow_filter="hard"),
    "many-lights": lambda bench: _raster(bench, indirect="rsm", shadow_lights=1, light_error=0.02),
    "paths": lambda bench: _traced(bench, pattern="fixed"),
    "paths-from-lamps": lambda bench: _traced(bench, pattern="independent", bidirectional=True),
    "paths-under-an-image": _under_an_image,
}
"""Radiance and color, (h, w, 3) each, by the name of the picture."""


def blocks(image: Array) -> Array:
    """Means of BLOCKS.  (h, w, 3) -> (rows, columns, 3) float64."""
    rows = [np.stack([part.mean(axis=(0, 1)) for part in np.array_split(row, BLOCKS[1], axis=1)])
            for row in np.array_split(image.astype(np.float64), BLOCKS[0])]  # fmt: skip
    return np.stack(rows)


def masks(bench: Bench, reprojection: str, sampling: str) -> dict[str, int]:
    """Reason word, as text -> pixels of two pairs."""
    options = {"indirect": "rsm", "frames": (FRAME - 2, FRAME + 1), "reprojection": reprojection, "sampling": sampling}
    settings, found = bench.settings_of(COMMON | LAMPS | options), {}

    def add(pair: Any) -> None:
        for word, pixels in zip(*occupied(pair.evaluated.counts.mask_histogram), strict=True):
            found[str(int(word))] = found.get(str(int(word)), 0) + int(pixels)

    evaluate_scene(_demo(), settings, Observers(on_pair=add), camera=choose_camera(_demo()))
    return found


MASKS = {"masks-by-camera": ("camera", "nearest"), "masks-by-motion": ("motion", "bilinear")}


def measured(bench: Bench) -> dict[str, Any]:
    """Means of the blocks of every picture, and counts of every mask, as RECORDED stores them."""
    pictures = {
        name: {channel: blocks(image).round(9).tolist() for channel, image in draw(bench).items()}
        for name, draw in PICTURES.items()
    }
    return {"pictures": pictures, "masks": {name: masks(bench, *modes) for name, modes in MASKS.items()}}


@cache
def recorded() -> dict[str, Any]:
    """``measured`` as it was recorded."""
    return json.loads(resources.files(__package__).joinpath(RECORDED).read_text(encoding="utf-8"))


@case(
    "picture-by-{0}",
    tolerance=1.0,
    source=f"software rendering: {IN_ALL_BLOCKS} in all blocks, float32 in another order; GPUs: {IN_HALF_OF_THEM} in "
    "half of them, since a pixel at an edge, or a path that takes another side, is a twentieth of a block",
    each=tuple((name,) for name in PICTURES),
)
def picture(bench: Bench, name: str) -> Outcome:
    """Frame 40 of the demo by {0}: means of 32 blocks against recorded ones, over the largest accepted difference.

    A driver or a change of one of many formulas alters the image a little, and no other case is sensitive to it.
    """
    errors = []
    for channel, image in PICTURES[name](bench).items():
        expected = np.array(recorded()["pictures"][name][channel])
        off = np.abs(blocks(image) - expected).max(axis=-1) / expected.mean()
        errors.append(off.max() / IN_ALL_BLOCKS if bench.gpu.software else np.median(off) / IN_HALF_OF_THEM)
    return field("as recorded", errors)


@case(
    "{0}",
    tolerance=1.0,
    source=f"of 4,608 pixels, by light in float32, software rendering: {MOVED_PIXELS[True]}; GPUs: "
    f"{MOVED_PIXELS[False]}, pixels at edges and thresholds, each in two words",
    each=tuple((name, *options) for name, options in MASKS.items()),
)
def masks_as_recorded(bench: Bench, name: str, reprojection: str, sampling: str) -> Outcome:
    """Two pairs of the demo, {1} reprojection, {2} sampling: pixels of other words than recorded, over those accepted.

    Pixels change their class while the sum over classes stays.
    """
    found, expected = masks(bench, reprojection, sampling), recorded()["masks"][name]
    moved = sum(abs(found.get(word, 0) - expected.get(word, 0)) for word in found.keys() | expected)
    return field("as recorded", moved / MOVED_PIXELS[bench.gpu.software], measured=f"{moved} pixels")
