"""Cases: precision of stored positions and motion, and GPU results against float64 references."""

from __future__ import annotations

import numpy as np

from taubench_gl import math3d
from taubench_gl.channels import CHANNELS
from taubench_gl.frame.targets import History
from taubench_gl.gpu.owner import Owner
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.metrics.reprojection import reproject
from taubench_gl.scene.model import Camera
from taubench_gl.selftest.bench import Bench, limits, pixel_grid, rays, to_pixels
from taubench_gl.selftest.case import Naive, Outcome, case, count, field, worst
from taubench_gl.selftest.scenes import SceneBuilder, busy_room, quad, turn_y

Array = np.ndarray


def _fast_turn(bench: Bench):
    b = SceneBuilder()
    b.node(translation=(0.0, -500.0, 0.0), mesh=b.mesh(quad()))
    camera = b.camera(yfov=np.radians(10.0))
    b.animate(camera, "rotation", [0.0, 1.0], [turn_y(0.0), turn_y(-80.0)])
    images = bench.pair(b.build())
    lens = Camera(yfov=np.radians(10.0))
    then = rays(bench.size, lens) @ math3d.mat3_from_quat(turn_y(-80.0)).T
    return images, to_pixels(then, bench.size, lens) - pixel_grid(bench.size)


@case(
    "motion-storage",
    description="motion of 1200 to 8000 px (a fast turn, 10-degree lens): relative error of the stored motion",
    elsewhere="half floats have steps of 1 px above 1024 and 2 px above 2048",
    here="float32 motion in pixels",
    tolerance=1e-5,
    source="relative; float32: matrices, and a quotient near its pole, which magnifies rounding by 6",
)
def motion_storage(bench: Bench) -> Outcome:
    images, expected = _fast_turn(bench)
    size = np.abs(expected[..., 0])
    naive = worst((expected[..., 0].astype(np.float16).astype(float) - expected[..., 0]) / size)
    return field(
        f"{size.min():.0f} to {size.max():.0f} px",
        (images.motion - expected)[..., 0] / size,
        Naive("half-float motion", f"off by {naive:.3g}, {naive * size.max():.2g} px", naive),
    )


@case(
    "position-storage",
    description="stored positions on the back wall of the busy room: distance from the wall, relative to the camera "
    "distance",
    elsewhere="half-float positions are off by 1/2048: 2 mm at 4 m, 5 cm at 100 m, as large as many thresholds",
    here="float32 relative to the camera: 4e-7 m at 4 m",
    tolerance=1e-5,
    source="relative; raster rule: corners snapped to 1/256 px move a point along its ray by less than this",
)
def position_storage(bench: Bench) -> Outcome:
    frame, view = bench.frame(busy_room(), 0.3)
    position = frame["position"].astype(float)
    # Points of the back wall z = -4, whose distance from it is known.
    world = position[..., :3] + view.position
    wall = (np.abs(world[..., 2] + 4.0) < 0.01) & (np.abs(frame["normal"][..., 2]) > 0.99)
    points, distance = world[wall], np.linalg.norm(position[wall][:, :3], axis=-1)
    half = (position[wall][:, 2].astype(np.float16).astype(float) + view.position[2] + 4.0) / distance
    naive = Naive("half floats", f"off by {worst(half):.3g}", worst(half))
    return field("the wall z = -4", (points[:, 2] + 4.0) / distance if wall.any() else np.nan, naive)


def _reference_case(name: str, mode: str, sampling: str) -> None:
    @case(
        name,
        description=f"the busy room, {mode} reprojection, {sampling} history: pixels that differ from the float64 "
        "reference",
        elsewhere="the difference between the GPU and the paper's equations is unknown",
        here="every formula has a float64 reference in NumPy",
        tolerance=12.0,
        source="0.2 % of 6144 pixels: a distance within a few float ulps of its threshold may be on either side",
    )
    def reference(bench: Bench) -> Outcome:
        images = bench.pair(busy_room(), (0.5, 0.75), reprojection=mode, sampling=sampling)
        exact = pair_masks(
            images.current, images.history, images.pair, limits(None), reprojection=mode, sampling=sampling
        )
        return count(0, int((exact.mask != images.mask).sum()))


_reference_case("reference-camera", "camera", "nearest")
_reference_case("reference-motion", "motion", "nearest")
_reference_case("reference-bilinear", "motion", "bilinear")


@case(
    "masks-in-half-floats",
    description="a wall 100 m away that moves sideways by 1 mm per frame, threshold 1 cm: position discards",
    elsewhere="half-float positions have steps of 6 cm at 100 m, so the wall is discarded",
    here="float32 positions: steps of 8 micrometers",
    source="exact: an unsigned count on the GPU",
)
def masks_in_half_floats(bench: Bench) -> Outcome:
    wall = bench.wall(bench.size)
    position = wall["position"] * [100.0, 100.0, 100.0, 100.0]
    moved = position + [0.001, 0.0, 0.0, 0.0]
    # The motion is no multiple of the half-float step, so only rounding differs.
    now, then = {**wall, "position": moved}, {**wall, "position": position}
    few = {"position": 0.01}
    naive = bench.compare(now, then, thresholds=few, dtype="f2").counts["position"]
    measured = bench.compare(now, then, thresholds=few).counts["position"]
    return count(0, measured, Naive("half-float positions", naive, naive))


@case(
    "motion-reference",
    description="the busy room: motion on the GPU against float64",
    elsewhere="differences of projected world-space positions lose three digits",
    here="clip positions are relative to the camera of each frame",
    tolerance=1e-3,
    source="px; float32: 64 ulps of coordinates up to 100 px, near the screen's edge",
)
def motion_reference(bench: Bench) -> Outcome:
    images = bench.pair(busy_room(), (0.5, 0.75), reprojection="motion")
    position, before = (images.current[n].astype(np.float64) for n in ("position", "prev_position"))
    exact = reproject(images.pair, position, before)
    seen = ~exact.behind & ~exact.outside
    half = worst(images.motion.astype(np.float16).astype(np.float64)[seen] - exact.motion_px[seen])
    naive = Naive("half floats", f"off by {half:.3g} px", half)
    return field("float64 reference", (images.motion - exact.motion_px)[seen], naive)


@case(
    "bytes-of-a-frame",
    description="each channel in two frames, and their depth buffer, in floats and half floats: bytes that are added "
    "up before they exist against those of the textures",
    elsewhere="history is left out of the sum, and an image that passed the check does not fit",
    here="both frames, components and type of each channel",
    source="exact: integers",
)
def bytes_of_a_frame(bench: Bench) -> Outcome:
    errors = []
    for name in CHANNELS:
        for storage in ("float", "half"):
            with Owner() as owner:
                history = owner.own(History(bench.gpu, (20, 10), (name,), storage))
                textures = [history.depth, *(frame.textures[name] for frame in (history.current, history.previous))]
                taken = [t.width * t.height * t.components * int(t.dtype[-1]) for t in textures]
                errors.append(history.bytes - sum(taken))
    return field("the bytes of the textures", errors)
