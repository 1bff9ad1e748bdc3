"""Cases: degenerate node scales and triangles, normals, and silhouettes counted exactly."""

from __future__ import annotations

import numpy as np

from taubench_gl import math3d
from taubench_gl.conventions import Reason
from taubench_gl.scene.builder import SceneBuilder, box, quad, sphere, turn, turn_x, turn_y
from taubench_gl.scene.model import Camera, Primitive, Scene
from taubench_gl.selftest.bench import Bench, pixel_grid, to_pixels
from taubench_gl.selftest.case import Outcome, case, count, field, worst

Array = np.ndarray
RASTER = "exact raster rule: a pixel is covered if its center is inside; edges lie on pixel borders"
FLOAT_NORMAL = "float32: 16 ulps of 1"


def one_metre_per_pixel(b: SceneBuilder, bench: Bench, **node) -> int:
    """An orthographic camera with 1 m per pixel; pixel borders lie at integer meters."""
    return b.camera(kind="orthographic", xmag=bench.size[0] / 2, ymag=bench.size[1] / 2, zfar=1000.0, **node)


def _show(bench: Bench, primitive: Primitive, **node) -> Scene:
    b = SceneBuilder()
    b.node(mesh=b.mesh(primitive), translation=(0.0, 0.0, -100.0), **node)
    one_metre_per_pixel(b, bench)
    return b.build()


@case("zero-scale", source=RASTER)
def zero_scale(bench: Bench) -> Outcome:
    """A box with scale 0 in front of the sky: pixels that are not sky in both frames.

    The inverse of a singular matrix is NaN, or the object is drawn as a dot.
    """
    images = bench.pair(_show(bench, box((10, 10, 10)), scale=(0, 0, 0)), (0.0, 0.0), reprojection="motion")
    return count(0, int((images.mask != (Reason.SKY | Reason.HISTORY_SKY)).sum()))


@case("zero-scale-to-visible", source=RASTER)
def zero_scale_to_visible(bench: Bench) -> Outcome:
    """A 20 x 20 m wall that jumps from scale 0 to 1: pixels that now cover sky (reason OCCLUDING).

    All previous positions coincide, and history is read at that point.
    """
    b = SceneBuilder()
    wall = b.node(mesh=b.mesh(quad(10, 10)), translation=(0.0, 0.0, -100.0))
    one_metre_per_pixel(b, bench)
    b.animate(wall, "scale", [0.0, 1.0], [(0, 0, 0), (1, 1, 1)], "STEP")
    scene = b.build()
    images = bench.pair(scene)
    word = Reason.HISTORY_SKY | Reason.POSITION | Reason.NORMAL | Reason.OCCLUDING
    return count(400, int((images.mask == word).sum()))


@case(
    "negative-scale",
    source="exact count; the box is its own mirror image, values within 1e-5 (16 float ulps of 5 m) are equal",
)
def negative_scale(bench: Bench) -> Outcome:
    """A box with scale (-1, 1, 1): pixels whose position or normal differ from those of the plain box.

    Mirroring swaps front and back faces: culling shows the inside of the box.
    """
    frames = []
    for sign in (1.0, -1.0):
        b = SceneBuilder()
        parent = b.node(translation=(0.0, 0.0, -5.0), rotation=turn_x(30.0))
        b.node(parent, mesh=b.mesh(box()), scale=(sign, 1.0, 1.0))
        b.camera()
        frames.append(bench.frame(b.build())[0])
    plain, mirrored = frames
    differ = np.zeros(plain["normal"].shape[:2], dtype=bool)
    for name in ("normal", "position"):
        differ |= np.abs(plain[name] - mirrored[name]).max(axis=-1) > 1e-5
    shown = int((plain["position"][..., 3] > 0).sum())
    return count(0, int(differ.sum()) if shown else differ.size)


def _normal_error(bench: Bench, world: Array, primitive: Primitive, normal: Array) -> tuple[float, int]:
    """Largest distance of the rendered normals from ``normal``, turned towards the viewer; and number of pixels."""
    b = SceneBuilder()
    b.node(matrix=world, mesh=b.mesh(primitive))
    b.camera(zfar=1e4)
    frame, _ = bench.frame(b.build(), culling="none")
    shown = frame["position"][..., 3] > 0
    drawn = frame["normal"][shown][:, :3].astype(np.float64)
    towards = np.where(np.sum(normal * frame["position"][shown][:, :3], axis=-1) > 0, -1.0, 1.0)
    return worst(drawn - towards[:, None] * normal), int(shown.sum())


def _placed(mat3: Array) -> Array:
    return math3d.affine(mat3, np.array([0.0, 0.0, -5.0]))


@case("sheared-normal", tolerance=2e-6, source=FLOAT_NORMAL)
def sheared_normal(bench: Bench) -> Outcome:
    """A wall below a rotated node with scale (1, 4, 1): its normal against that of its plane.

    Normals are transformed as points and are not perpendicular to the surface.
    """
    mat3 = np.diag([1.0, 4.0, 1.0]) @ math3d.mat3_from_quat(turn((1.0, 1.0, 0.0), 40.0))
    normal = math3d.normalize(np.cross(mat3[:, 0], mat3[:, 1]))
    error, shown = _normal_error(bench, _placed(mat3), quad(), normal)
    return field(f"the plane's normal at {shown} pixels", error if shown else np.nan)


@case("flattened-normal", tolerance=2e-6, source=FLOAT_NORMAL)
def flattened_normal(bench: Bench) -> Outcome:
    """A sphere with scale (1, 1, 0): normals of the resulting disk.

    The inverse of a singular matrix is Inf, and products with it NaN.
    """
    mat3 = np.diag([1.0, 1.0, 0.0])
    normal = np.array([0.0, 0.0, 1.0])
    error, shown = _normal_error(bench, _placed(mat3), sphere(), normal)
    return field(f"(0, 0, 1) at {shown} pixels", error if shown else np.nan)


@case("tiny-scale-normal", tolerance=2e-6, source=FLOAT_NORMAL)
def tiny_scale_normal(bench: Bench) -> Outcome:
    """A wall of 1e25 units at scale 1e-25: its normal.

    Products of two scales underflow to 0 in float32, and so does the normal.
    """
    turned = math3d.mat3_from_quat(turn_y(20.0))
    error, shown = _normal_error(bench, _placed(1e-25 * turned), quad(1e25, 1e25), turned[:, 2])
    return field(f"the wall's normal at {shown} pixels", error if shown else np.nan)


@case("zero-normals", source="exact: an unsigned count on the GPU")
def zero_normals(bench: Bench) -> Outcome:
    """A wall whose vertex normals have length 0: invalid pixels.

    0 / 0 is NaN, which spreads through every blend.
    """
    wall = quad(10, 10)
    wall = Primitive(wall.positions, wall.triangles, normals=np.zeros_like(wall.positions))
    images = bench.pair(_show(bench, wall), (0.0, 0.0))
    missing = abs(int(images.surface.sum()) - 400)
    return count(0, images.counts["invalid"] + missing)


@case("degenerate-triangles", source=RASTER)
def degenerate_triangles(bench: Bench) -> Outcome:
    """A 20 x 20 m wall among triangles of area 0 (points, lines, repeated corners), flat-shaded: pixels drawn.

    The face normal of a degenerate triangle is NaN.
    """
    wall = quad(10, 10, normals=False)
    bad = np.uint32([[0, 0, 0], [0, 1, 1], [2, 2, 3], [0, 2, 0]])
    mixed = Primitive(wall.positions, np.concatenate([bad, wall.triangles, bad]))
    images = bench.pair(_show(bench, mixed), (0.0, 0.0), extra=("geometric_normal",))
    finite = all(np.isfinite(c).all() for c in images.current.values())
    return count(400, int(images.surface.sum()) if finite else -1)


@case(
    "{0}-triangles",
    source=RASTER + "; depth is exact, as the wall is parallel to the image plane",
    each=(
        ("sliver", (4000, 1), "slivers of 1/100 px"),
        ("sub-pixel", (160, 80), "triangles of a quarter pixel"),
    ),
)
def tiny_triangles(bench: Bench, name: str, cells: tuple[int, int], words: str) -> Outcome:
    """A 40 x 20 m wall of {1[0]} x {1[1]} cells, {2}: pixels that show the wall.

    Cracks or double coverage along shared edges, or normals from derivatives that are NaN.
    """
    frame, _ = bench.frame(_show(bench, quad(20, 10, cells=cells)), extra=("geometric_normal",))
    right = np.abs(frame["position"][..., 3] - 100.0) < 1e-3
    normal = frame["geometric_normal"][..., :3].astype(np.float64)
    right &= np.abs(normal - [0.0, 0.0, 1.0]).max(axis=-1) < 1e-2
    return count(800, int(right.sum()))


@case("many-vertices", source="exact count of pixels within 1/16 px")
def many_vertices(bench: Bench) -> Outcome:
    """A wall of 90,601 vertices that fills the image: pixels that show the right point of it.

    16-bit indices wrap at 65,536 and triangles stretch across the image.
    """
    b = SceneBuilder()
    wall = quad(8.0, 6.0, cells=(300, 300))
    b.node(mesh=b.mesh(wall), translation=(0.0, 0.0, -5.0))
    b.camera(yfov=np.radians(60.0))
    frame, _ = bench.frame(b.build())
    at = to_pixels(frame["position"][..., :3].astype(float), bench.size, Camera(yfov=np.radians(60.0)))
    right = (frame["position"][..., 3] > 0) & (np.abs(at - pixel_grid(bench.size)).max(axis=-1) < 1 / 16)
    return count(right.size, int(right.sum()))


def _moved_wall(bench: Bench, reprojection: str):
    b = SceneBuilder()
    wall = b.node(mesh=b.mesh(quad(10, 10)), translation=(0.0, 0.0, -100.0))
    b.animate(wall, "translation", [0.0, 1.0], [(0.0, 0.0, -100.0), (4.0, 0.0, -100.0)])
    one_metre_per_pixel(b, bench)
    return bench.pair(b.build(), reprojection=reprojection)


@case("silhouette-camera", source=RASTER)
def silhouette_camera(bench: Bench) -> Outcome:
    """A wall moves by 4 px in front of the sky, camera reprojection: sky uncovered plus sky covered.

    Sky pixels are excluded from the masks, so the outline of every moving object is reusable.
    """
    c = _moved_wall(bench, "camera").counts
    wrong = abs(c["disoccluded"] - 80) + abs(c["occluding"] - 80) + abs(c["position"] - 160)
    return Outcome(160, c["disoccluded"] + c["occluding"], float(wrong))


@case("silhouette-motion", source=RASTER)
def silhouette_motion(bench: Bench) -> Outcome:
    """A wall moves by 4 px in front of the sky, motion reprojection: only uncovered sky is discarded.

    Sky pixels use the motion of the wall.
    """
    c = _moved_wall(bench, "motion").counts
    wrong = abs(c["disoccluded"] - 80) + c["occluding"] + abs(c["position"] - 80)
    return Outcome(80, c["position"], float(wrong))


@case("back-of-a-wall", source="exact: a count")
def back_of_a_wall(bench: Bench) -> Outcome:
    """A two-sided wall seen from behind: normals that point away from the viewer.

    The normal of the front face is used, so back faces are lit from the wrong side.
    """
    b = SceneBuilder()
    two_sided = b.material(double_sided=True)
    b.node(mesh=b.mesh(quad(10, 10, material=two_sided)), translation=(0.0, 0.0, -8.0), rotation=turn_y(180.0))
    b.camera()
    frame, _ = bench.frame(b.build())
    shown = frame["position"][..., 3] > 0
    away = shown & (np.sum(frame["normal"][..., :3] * frame["position"][..., :3], axis=-1) >= 0)
    return count(0, int(away.sum()) if shown.any() else shown.size)
