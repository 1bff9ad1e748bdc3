"""Safeguards of the pipeline that the hard cases test, each with a context manager that disables it.

``GUARDS`` lists them; ``with guard.disabled(): run_selftest(...)`` runs without one.  Disabling replaces attributes of
the package or text of its shaders, so it is for tests only.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl import conventions, math3d
from taubench_gl.animation import FrameState, Poser, View, curves, pairs
from taubench_gl.frame import geometry, records
from taubench_gl.frame.passes import deform, masks
from taubench_gl.gpu import shader
from taubench_gl.gpu.context import Gpu
from taubench_gl.metrics import activity, counts, streaming
from taubench_gl.scene.gltf import meshes
from taubench_gl.selftest import bench, statistics
from taubench_gl.settings import MetricsSettings, SequenceSettings

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class Guard:
    """``disabled()``: a context manager without it; ``detected_by``: cases of which at least one must then fail."""

    name: str
    description: str
    disabled: Callable[[], AbstractContextManager[None]]
    detected_by: tuple[str, ...]


@contextmanager
def _replaced(*changes: tuple[Any, str, Any]) -> Iterator[None]:
    """Attributes (owner, name, value), replaced inside the block."""
    kept = [(owner, name, getattr(owner, name)) for owner, name, _ in changes]
    try:
        for owner, name, value in changes:
            setattr(owner, name, value)
        yield
    finally:
        for owner, name, value in kept:
            setattr(owner, name, value)


@contextmanager
def _shader_text(old: str, new: str) -> Iterator[None]:
    """Replace ``old`` by ``new`` in all GLSL text resolved here.  Raises LookupError if no text contains it."""
    resolve, seen = shader.resolve, []

    def edited(*arguments: Any, **keywords: Any) -> shader.Source:
        source = resolve(*arguments, **keywords)
        if old in source.text:
            seen.append(old)
        return dataclasses.replace(source, text=source.text.replace(old, new))

    with _replaced((shader, "resolve", edited)):
        yield
    if not seen:
        raise LookupError(f"no shader contains {old!r}")


def _glsl(old: str, new: str) -> Callable[[], AbstractContextManager[None]]:
    return lambda: _shader_text(old, new)


def _python(*changes: tuple[Any, str, Any]) -> Callable[[], AbstractContextManager[None]]:
    return lambda: _replaced(*changes)


def _world_floats() -> AbstractContextManager[None]:
    """World matrices and cameras rounded to float32 before they are subtracted."""
    place = records.RecordTable.place

    def rounded(table: Any, state: FrameState, view: View, mirrored: Array) -> Any:
        world = state.world.astype(np.float32).astype(np.float64)
        seen_from = dataclasses.replace(view, position=view.position.astype(np.float32).astype(np.float64))
        return place(table, dataclasses.replace(state, world=world), seen_from, mirrored)

    return _replaced((records.RecordTable, "place", rounded))


def _world_blending() -> AbstractContextManager[None]:
    """Skin palettes in world space: the camera is subtracted after the blend, from float32."""

    def palettes(one: Any, state: FrameState, view: View) -> Any:
        away = dataclasses.replace(view, position=np.zeros(3))
        matrices, first, mirrored = original(one, state, away)
        return _relative(matrices, view), first, mirrored

    def _relative(matrices: Array, view: View) -> Array:
        out = matrices.astype(np.float32)
        out[:, :3, 3] -= view.position.astype(np.float32)
        return out.astype(np.float64)

    original = deform.DeformPass._palettes
    return _replaced((deform.DeformPass, "_palettes", palettes))


@contextmanager
def _current_pose_as_previous() -> Iterator[None]:
    """The current pose relative to the previous camera, as many engines have it."""
    run = deform.DeformPass.run

    def posed(one: Any, now: tuple[FrameState, View], before: tuple[FrameState, View], *rest: Any) -> Array:
        return run(one, now, (now[0], before[1]), *rest)

    with _replaced((deform.DeformPass, "run", posed)):
        yield


def _previous_time_wrapped() -> AbstractContextManager[None]:
    sample = Poser.sample

    def wrapped(one: Poser, t: float) -> FrameState:
        return sample(one, t % one.duration if one.duration else t)

    return _replaced((Poser, "sample", wrapped))


def _sky_at_the_far_plane() -> AbstractContextManager[None]:
    original = pairs.reprojection

    def finite(view: View, previous: View, width: int, height: int) -> Any:
        pair = original(view, previous, width, height)
        far = {n: np.append(1000.0 * getattr(pair, n)[:3], 0.0) for n in ("sky_origin", "sky_dx", "sky_dy")}
        far["sky_origin"][3] = 1.0
        return dataclasses.replace(pair, **far)

    return _replaced((pairs, "reprojection", finite))


def _sum_in_floats() -> AbstractContextManager[None]:
    original = counts.counts_of

    def floats(mask_histogram: Array) -> dict[str, int]:
        """Adding 1 no longer changes a float32 of 2^24."""
        return {name: min(value, 2**24) for name, value in original(mask_histogram).items()}

    return _replaced((bench, "counts_of", floats))


def one_pass_variance(values: Array) -> float:
    """E[x^2] - E[x]^2, the one-pass formula."""
    total = float(np.cumsum(values)[-1])
    squares = float(np.cumsum(values * values)[-1])
    return squares / len(values) - (total / len(values)) ** 2


class _OnePass(streaming.Welford):
    """E[x^2] - E[x]^2, from sums of squares."""

    __slots__ = ("values",)

    def __init__(self) -> None:
        super().__init__()
        self.values: list[float] = []

    def add(self, value: float) -> None:
        self.values.append(value)

    @property
    def variance(self) -> float:
        return one_pass_variance(np.array(self.values))


def _one_pass_variance() -> AbstractContextManager[None]:
    return _replaced((statistics, "Welford", _OnePass))


def plain_slerp(a: Array, b: Array, u: float) -> Array:
    """Slerp with acos and a division by sin(angle), without a choice of hemisphere.  (4,), (4,) unit xyzw -> (4,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        angle = np.arccos(np.dot(a, b))
        return (np.sin((1 - u) * angle) * a + np.sin(u * angle) * b) / np.sin(angle)


def _slerp_always(flip: bool) -> Callable[[Array, Array, Array], Array]:
    def rows(a: Array, b: Array, u: Array) -> Array:
        a, b, u = np.broadcast_arrays(a, b, np.asarray(u, dtype=np.float64)[..., None])
        out = np.empty(a.shape)
        for index in np.ndindex(a.shape[:-1]):
            sign = -1.0 if flip and a[index] @ b[index] < 0 else 1.0
            out[index] = plain_slerp(a[index], sign * b[index], float(u[index][0]))
        return out

    return rows


def _plain_euler(rotation: Array) -> tuple[Array, Array]:
    change = activity.wrap_degrees(np.degrees(np.diff(activity.euler_yxz(rotation), axis=0)))
    return change, np.zeros(len(change), dtype=bool)


def _acos_angle(a: Array, b: Array) -> Array:
    return 2.0 * np.arccos(np.minimum(np.abs(np.sum(a * b, axis=-1)), 1.0))


def _weights_as_stored(document: Any, fixes: Any, arrays: dict[str, Array], pointer: str) -> tuple[Any, Any]:
    if "JOINTS_0" not in arrays:
        return None, None
    fixes["skin weights were left as they are"] += 1
    return arrays["JOINTS_0"].astype(np.uint32), arrays["WEIGHTS_0"].astype(np.float32)


def _sixteen_bit_indices() -> AbstractContextManager[None]:
    make = geometry.make_vertex_data

    def wrapped(*arguments: Any, **keywords: Any) -> geometry.VertexData:
        made = make(*arguments, **keywords)
        return dataclasses.replace(made, triangles=made.triangles & np.uint32(0xFFFF))

    return _replaced((geometry, "make_vertex_data", wrapped))


def _fronts_not_turned() -> AbstractContextManager[None]:
    place = records.RecordTable.place

    def unmirrored(*arguments: Any) -> Any:
        placement = place(*arguments)
        return dataclasses.replace(placement, mirrored=np.zeros_like(placement.mirrored))

    return _replaced((records.RecordTable, "place", unmirrored))


def _absolute_threshold() -> AbstractContextManager[None]:
    return _replaced((MetricsSettings, "threshold", lambda self, feature: self.thresholds[feature]))


def _hermite_of_all_terms(v0: Array, out0: Array, in1: Array, v1: Array, u: Array, dt: Array) -> Array:
    u, dt = np.asarray(u)[..., None], np.asarray(dt)[..., None]
    h00, h01 = 2 * u**3 - 3 * u**2 + 1, -2 * u**3 + 3 * u**2
    return h00 * v0 + h01 * v1 + dt * ((u**3 - 2 * u**2 + u) * out0 + (u**3 - u**2) * in1)


def _fixed_point_depth(gpu: Gpu, size: tuple[int, int]) -> Any:
    return gpu.ctx.depth_texture(size)


def _everything_keyed() -> AbstractContextManager[None]:
    """Cuts by a fixed limit of 2 m."""
    return _replaced((activity, "detect_cuts", lambda found, unit_scale=1.0: found.position > 2.0))


_NEAR_TEST = "if (prev_depth <= limit) return BEHIND;"
_NORMAL = "vec3 r = vec3(dot(yz, n), dot(cross(z, x), n), dot(cross(x, y), n));"

GUARDS: tuple[Guard, ...] = (
    Guard("w-test", "previous depth compared with near before the division by w", _glsl(_NEAR_TEST, ""),
          ("turn-180", "turn-180-sky", "near-plane-crossing", "w-exactly-zero")),
    Guard("screen-guard", "tolerance of 1/256 px at the edge of the screen", _python((conventions, "GUARD_PX", 0.0)),
          ("screen-edge",)),
    Guard("near-guard", "relative tolerance of 1e-5 at the near plane", _python((masks, "NEAR_GUARD", 0.0)),
          ("on-the-near-plane",)),
    Guard("camera-relative", "matrices composed in float64, relative to the camera", _world_floats,
          ("offset-1e6", "offset-1e9")),
    Guard("camera-relative-skins", "skin palettes made relative to the camera before blending", _world_blending,
          ("offset-1e6", "offset-1e9")),
    Guard("previous-pose", "previous positions use the pose at the previous time", _current_pose_as_previous,
          ("skinned-motion", "skinned-with-camera", "morph-motion")),
    Guard("no-wrapped-time", "previous time is never wrapped", _previous_time_wrapped, ("loop-end",)),
    Guard("sky-direction", "sky is a direction: w = 0", _sky_at_the_far_plane, ("sky-translation",)),
    Guard("float-depth", "depth is stored as 32-bit float", _python((Gpu, "depth_texture", _fixed_point_depth)),
          ("depth-1km", "depth-100km")),
    Guard("hemisphere", "quaternion keys are taken on one hemisphere",
          _python((curves, "slerp", _slerp_always(False))), ("opposite-hemispheres",)),
    Guard("equal-keys", "slerp of equal keys does not divide by sin(0)",
          _python((curves, "slerp", _slerp_always(True))), ("equal-keys", "opposite-keys")),
    Guard("half-turn", "a dot product of rounding noise does not choose the direction of rotation",
          _python((curves, "HALF_TURN", 0.0)), ("half-turn-keys",)),
    Guard("exact-hermite", "Hermite blending as v0 + h01 (v1 - v0), exact for equal keys",
          _python((curves, "hermite", _hermite_of_all_terms)), ("cubic-still",)),
    Guard("wrap", "differences of angles are wrapped",
          _python((activity, "wrap_degrees", lambda difference: difference)), ("angle-wrap",)),
    Guard("gimbal-rule", "roll is held near pitch +-90 degrees", _python((activity, "euler_changes", _plain_euler)),
          ("pitch-through-90",)),
    Guard("chord-angle", "angle = 4 atan2 of chord lengths", _python((math3d, "quat_angle", _acos_angle)),
          ("tiny-rotation",)),
    Guard("proper-rotation", "the view matrix contains no scale and no mirroring",
          _python((math3d, "orthonormal", lambda mat3: mat3)), ("scaled-camera-node",)),
    Guard("cut-rule", "a step is compared with the changes around it", _everything_keyed, ("running-is-not-a-cut",)),
    Guard("normal-cofactors", "normals are transformed by the cofactor matrix",
          _glsl(_NORMAL, "vec3 r = vec3(dot(x, n), dot(y, n), dot(z, n));"), ("sheared-normal", "flattened-normal")),
    Guard("scaled-cofactors", "matrix rows are scaled before they are multiplied",
          _glsl("float scale = peak > 0.0 ? 1.0 / peak : 0.0;", "float scale = 1.0;"), ("tiny-scale-normal",)),
    Guard("safe-normalize", "normalizing a zero vector gives zero", _glsl("if (!(peak > 0.0)) return vec3(0.0);", ""),
          ("zero-normals", "degenerate-triangles")),
    Guard("front-faces", "mirrored draws swap front and back faces", _fronts_not_turned, ("negative-scale",)),
    Guard("shown-side", "normals face the viewer", _glsl("return gl_FrontFacing ? n : -n;", "return n;"),
          ("back-of-a-wall",)),
    Guard("wide-indices", "32-bit indices", _sixteen_bit_indices, ("many-vertices",)),
    Guard("non-finite", "NaN and Inf are detected by their bits",
          _glsl("return (floatBitsToUint(x) & 0x7f800000u) == 0x7f800000u;", "return false;"),
          ("nan-current", "nan-history", "inf-current", "invalid-position")),
    Guard("finite-taps", "bilinear taps that are not finite have weight 0",
          _glsl("if (bad || is_surface(s.position) != surface) continue;", ""), ("nan-beside-bilinear",)),
    Guard("strict-threshold", "a discard is strictly greater than the threshold",
          _glsl("if (d > LIMIT) mask |= BIT;", "if (d >= LIMIT) mask |= BIT;"), ("on-threshold-direct",)),
    Guard("signed-light", "brightened and darkened pixels get different bits",
          _glsl("luminance < 0.0 ? SHADOWED : 0u", "LIT"), ("lit-and-shadowed",)),
    Guard("sky-discards", "sky against surface is always a discard", _glsl("surface != history_surface", "false"),
          ("silhouette-camera", "silhouette-motion")),
    Guard("integer-counts", "counts are integers", _sum_in_floats, ("more-than-2^24-pixels",)),
    Guard("stable-variance", "variance by Welford, not by E[x^2] - E[x]^2", _one_pass_variance, ("variance-stream",)),
    Guard("unit-scale", "the position threshold scales with unit_scale", _absolute_threshold,
          ("scale-2^-20", "scale-1e6")),
    Guard("normalized-weights", "skin weights are normalized to a sum of 1",
          _python((meshes, "skin_weights", _weights_as_stored)), ("weights-not-one",)),
    Guard("surface-cuts", "a surface that replaces another one has no history",
          _glsl("return CUT;", "return 0u;"), ("cut-of-a-surface",)),
    Guard("unit-blend", "blended normals are normalized", _glsl("if (norm > 0.0) sum.normal /= norm;", ""),
          ("blended-normal",)),
    Guard("frame-tolerance", "frame count with tolerances of 2^-23 of the duration and 1e-6 of a frame",
          _python((SequenceSettings, "frame_count", lambda s, duration: int(np.floor(duration * s.fps)) + 1)),
          ("duration-from-float-keys",)),
)  # fmt: skip
"""Every guard, with the cases that fail when it is disabled."""
