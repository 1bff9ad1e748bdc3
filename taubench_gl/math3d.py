"""Vectorized float64 linear algebra for poses and cameras.

Column vectors: ``dst_from_src @ p``.  Quaternions are ``xyzw`` (glTF order).  Functions take and return arrays with
leading batch dimensions ``...``.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def normalize(v: Array) -> Array:
    """Unit vectors along the last axis.  (..., n) -> (..., n).  Zero vectors and non-finite vectors are unchanged."""
    v = np.asarray(v, dtype=np.float64)
    # Division by the largest component first: squares of 1e-200 and 1e200 would underflow and overflow.
    peak = np.max(np.abs(v), axis=-1, keepdims=True)
    usable = (peak > 0) & np.isfinite(peak)
    scaled = v / np.where(usable, peak, 1.0)
    length = np.sqrt(np.sum(scaled * scaled, axis=-1, keepdims=True))
    return np.where(usable, scaled / np.where(usable, length, 1.0), v)


def cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors, (3,) each, with the bits of ``np.cross``, which takes 30 times as long."""
    (ax, ay, az), (bx, by, bz) = a, b
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def unit_quaternions(q: Array) -> Array:
    """Unit length; the zero quaternion means no rotation.  (..., 4) -> (..., 4) float64, xyzw."""
    q = normalize(q)
    return np.where(np.any(q, axis=-1, keepdims=True), q, (0.0, 0.0, 0.0, 1.0))


_CORNERS = np.array([(x, y, z) for y in (0, 1) for x in (0, 1) for z in (0, 1)], dtype=bool)


def box_corners(points: Array) -> Array:
    """The corners of the axis-aligned bounding box of ``points`` (N, 3), N > 0.  -> (8, 3) float64."""
    low, high = bounds(points)
    return np.where(_CORNERS, high, low).astype(np.float64)


def bounds(points: Array) -> tuple[Array, Array]:
    """Least and greatest value of each column.  (N, n), N > 0 -> (n,), (n,).

    Sixty-four rows at a time: NumPy reduces along short rows one by one, which takes ten times as long.
    """
    count, columns = points.shape
    whole = count // 64 * 64
    if count < 1024 or not points.flags.c_contiguous:
        return points.min(axis=0), points.max(axis=0)
    if columns == 1:
        return points.min(keepdims=True)[0], points.max(keepdims=True)[0]
    wide, rest = points[:whole].reshape(-1, 64 * columns), points[whole:]
    low = np.concatenate([wide.min(axis=0).reshape(64, columns), rest]).min(axis=0)
    return low, np.concatenate([wide.max(axis=0).reshape(64, columns), rest]).max(axis=0)


def mat3_from_quat(q: Array) -> Array:
    """Rotation matrices of quaternions xyzw, normalized first.  (..., 4) -> (..., 3, 3); zero gives the identity."""
    q = normalize(q)
    x, y, z, w = np.moveaxis(q, -1, 0)
    out = np.empty((*q.shape[:-1], 3, 3))
    out[..., 0, 0] = 1 - 2 * (y * y + z * z)
    out[..., 0, 1] = 2 * (x * y - z * w)
    out[..., 0, 2] = 2 * (x * z + y * w)
    out[..., 1, 0] = 2 * (x * y + z * w)
    out[..., 1, 1] = 1 - 2 * (x * x + z * z)
    out[..., 1, 2] = 2 * (y * z - x * w)
    out[..., 2, 0] = 2 * (x * z - y * w)
    out[..., 2, 1] = 2 * (y * z + x * w)
    out[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return out


def quat_from_mat3(m: Array) -> Array:
    """Unit quaternions xyzw of rotation matrices, w >= 0.  (..., 3, 3) -> (..., 4).

    Takes the longest column of the outer product 4 q q^T, which avoids division by a small number.
    """
    m = np.asarray(m, dtype=np.float64)
    m00, m01, m02 = m[..., 0, 0], m[..., 0, 1], m[..., 0, 2]
    m10, m11, m12 = m[..., 1, 0], m[..., 1, 1], m[..., 1, 2]
    m20, m21, m22 = m[..., 2, 0], m[..., 2, 1], m[..., 2, 2]
    outer = np.empty((*m.shape[:-2], 4, 4))
    outer[..., 0, 0] = 1 + m00 - m11 - m22
    outer[..., 1, 1] = 1 - m00 + m11 - m22
    outer[..., 2, 2] = 1 - m00 - m11 + m22
    outer[..., 3, 3] = 1 + m00 + m11 + m22
    outer[..., 0, 1] = outer[..., 1, 0] = m10 + m01
    outer[..., 0, 2] = outer[..., 2, 0] = m20 + m02
    outer[..., 1, 2] = outer[..., 2, 1] = m21 + m12
    outer[..., 0, 3] = outer[..., 3, 0] = m21 - m12
    outer[..., 1, 3] = outer[..., 3, 1] = m02 - m20
    outer[..., 2, 3] = outer[..., 3, 2] = m10 - m01
    diagonal = np.diagonal(outer, axis1=-2, axis2=-1)
    best = np.argmax(diagonal, axis=-1)
    q = normalize(np.take_along_axis(outer, best[..., None, None], axis=-1)[..., 0])
    return np.where(q[..., 3:] < 0, -q, q)


def affine(mat3: Array, translation: Array) -> Array:
    """Affine matrices of linear parts ``mat3`` (..., 3, 3) and translations (..., 3).  -> (..., 4, 4)."""
    out = np.zeros((*np.broadcast_shapes(mat3.shape[:-2], translation.shape[:-1]), 4, 4))
    out[..., :3, :3] = mat3
    out[..., :3, 3] = translation
    out[..., 3, 3] = 1.0
    return out


def trs(translation: Array, rotation: Array, scale: Array) -> Array:
    """glTF node transforms T * R * S.  (..., 3), (..., 4) xyzw, (..., 3) -> (..., 4, 4)."""
    return affine(mat3_from_quat(rotation) * np.asarray(scale)[..., None, :], np.asarray(translation, dtype=np.float64))


def transform_points(dst_from_src: Array, points: Array) -> Array:
    """Affine image of points.  (4, 4), (..., 3) -> (..., 3)."""
    return points @ dst_from_src[:3, :3].T + dst_from_src[:3, 3]


def orthonormal(mat3: Array) -> Array:
    """Proper rotation of a 3x3 matrix that may scale, shear or mirror.  (3, 3) -> (3, 3).

    Keeps -Z (the view direction of a camera or light) exactly and +Y as closely as possible, as glTF viewers do.  A
    singular matrix uses its remaining axes, then those of the identity.
    """
    z = normalize(mat3[:, 2])
    if not np.any(z):
        z = normalize(_cross(mat3[:, 0], mat3[:, 1]))
    if not np.any(z):
        return np.eye(3)
    for up in (mat3[:, 1], _cross(z, mat3[:, 0]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])):
        x = _cross(normalize(up), z)
        if np.linalg.norm(x) > 1e-12:
            x = normalize(x)
            return np.stack([x, _cross(z, x), z], axis=1)
    return np.eye(3)


def _cross(a: Array, b: Array) -> Array:
    """``np.cross`` of two vectors, bit for bit, without its cost of 25 microseconds.  (3,), (3,) -> (3,)."""
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def normal_matrix(mat3: Array) -> Array:
    """Matrix that transforms normals where ``mat3`` transforms points, up to a factor > 0.  (..., 3, 3) -> (..., 3, 3).

    The cofactor matrix, which is also defined for a scale of 0 along one axis, times the sign of the determinant: with
    a mirror the cofactors alone flip the normals.
    """
    x, y, z = np.moveaxis(np.asarray(mat3, dtype=np.float64), -1, 0)
    cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=-1)
    mirrored = np.sum(x * cofactors[..., 0], axis=-1) < 0
    return np.where(mirrored[..., None, None], -cofactors, cofactors)


def quat_multiply(a: Array, b: Array) -> Array:
    """Hamilton product (rotation b first, then a).  (..., 4), (..., 4) -> (..., 4), xyzw."""
    av, aw, bv, bw = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    vector = aw * bv + bw * av + np.cross(av, bv)
    return np.concatenate([vector, aw * bw - np.sum(av * bv, axis=-1, keepdims=True)], axis=-1)


def quat_from_axis_angle(axis: Array, radians: Array) -> Array:
    """Quaternions xyzw of turns about ``axis`` (..., 3), of any length > 0, by ``radians`` (...).  -> (..., 4)."""
    half = 0.5 * np.asarray(radians, dtype=np.float64)[..., None]
    return np.concatenate([normalize(axis) * np.sin(half), np.cos(half) * np.ones_like(half)], axis=-1)


def quat_angle(a: Array, b: Array) -> Array:
    """Geodesic angle between unit quaternions, radians: 4 atan2(|a-b|, |a+b|) on one hemisphere (docs/conventions.md).

    Accurate at every angle; 2 acos(|a.b|) has no precision below 1e-8 rad.
    """
    a, b = normalize(a), normalize(b)
    b = np.where(np.sum(a * b, axis=-1, keepdims=True) < 0, -b, b)
    return 4.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))


def perspective_reversed(yfov: float, aspect: float, znear: float, zfar: float) -> Array:
    """clip_from_view (4, 4), reversed Z in [0, 1]: depth 1 at ``znear``, 0 at ``zfar`` (which may be infinite)."""
    f = 1.0 / np.tan(0.5 * yfov)
    out = np.zeros((4, 4))
    out[0, 0], out[1, 1], out[3, 2] = f / aspect, f, -1.0
    if np.isinf(zfar):
        out[2, 3] = znear
    else:
        out[2, 2] = znear / (zfar - znear)
        out[2, 3] = zfar * znear / (zfar - znear)
    return out


def orthographic_reversed(xmag: float, ymag: float, znear: float, zfar: float) -> Array:
    """clip_from_view (4, 4), reversed Z in [0, 1]; half-extents ``xmag``, ``ymag`` in scene units."""
    out = np.eye(4)
    out[0, 0], out[1, 1] = 1.0 / xmag, 1.0 / ymag
    out[2, 2] = 1.0 / (zfar - znear)
    out[2, 3] = zfar / (zfar - znear)
    return out
