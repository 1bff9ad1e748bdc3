"""The masks in Numba: a careful CPU implementation without OpenGL.  One pass, threads over rows.

Camera and motion reprojection, nearest history, position and normal; the same reason bits and histograms as
shaders/masks/masks.comp.glsl, in float64 registers over float32 images.
"""

from __future__ import annotations

from collections.abc import Mapping

import numba
import numpy as np
from numba import njit, prange

from taubench_gl.conventions import (
    GUARD_PX,
    HISTOGRAM_BINS,
    HISTOGRAM_MANTISSA_BITS,
    HISTOGRAM_MIN_EXPONENT,
    Reason,
)
from taubench_gl.features import MASK_WORDS
from taubench_gl.metrics.reprojection import NEAR_GUARD, Reprojection

_SKY, _HISTORY_SKY, _BEHIND, _OUTSIDE = (int(Reason[n]) for n in ("SKY", "HISTORY_SKY", "BEHIND", "OUTSIDE"))
_INVALID, _POSITION, _NORMAL = (int(Reason[n]) for n in ("INVALID", "POSITION", "NORMAL"))
_DISOCCLUDED, _OCCLUDING = int(Reason.DISOCCLUDED), int(Reason.OCCLUDING)
_SHIFT = 23 - HISTOGRAM_MANTISSA_BITS
_FIRST_KEY = (127 + HISTOGRAM_MIN_EXPONENT) << HISTOGRAM_MANTISSA_BITS


def numba_masks(
    current: Mapping[str, np.ndarray],
    history: Mapping[str, np.ndarray],
    pair: Reprojection,
    thresholds: Mapping[str, float],
    *,
    reprojection: str,
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels per reason word (MASK_WORDS,) and histograms (2, bins) of position and normal distances, both int64."""
    threads = numba.get_num_threads()
    mask_histogram = np.zeros((threads, MASK_WORDS), dtype=np.int64)
    histograms = np.zeros((threads, 2, HISTOGRAM_BINS), dtype=np.int64)
    motion = reprojection == "motion"
    _classify(
        current["position"], current["normal"], current["prev_position" if motion else "position"],
        history["position"], history["normal"], pair.clip_from_current, pair.prev_clip_from_prev, pair.sky_origin,
        pair.sky_dx, pair.sky_dy, pair.prev_forward, pair.camera_delta, pair.prev_near * (1.0 - NEAR_GUARD),
        float(pair.near), thresholds["position"], thresholds["normal"], motion, mask_histogram, histograms,
    )  # fmt: skip
    return mask_histogram.sum(axis=0), histograms.sum(axis=0)


@njit(inline="always")
def _bin(distance):
    key = np.int64(np.float32(distance).view(np.uint32) >> np.uint32(_SHIFT))
    return 0 if key < _FIRST_KEY else min(key - _FIRST_KEY + 1, HISTOGRAM_BINS - 1)


@njit(inline="always")
def _row(m, i, x, y, z, w):
    return m[i, 0] * x + m[i, 1] * y + m[i, 2] * z + m[i, 3] * w


@njit(parallel=True)
def _classify(
    position, normal, prev_position, history_position, history_normal, clip, prev_clip, sky, sky_dx, sky_dy, forward,
    delta, prev_near, near, most_moved, most_turned, motion, mask_histogram, histograms,
):  # fmt: skip
    h, w = position.shape[:2]
    threads = mask_histogram.shape[0]
    for thread in prange(threads):
        mine, bins = mask_histogram[thread], histograms[thread]
        for row in range(thread * h // threads, (thread + 1) * h // threads):
            y = h - 1 - row
            for x in range(w):
                p, n = position[row, x], normal[row, x]
                if not np.isfinite(p[0] + p[1] + p[2] + p[3] + n[0] + n[1] + n[2]):
                    mine[_INVALID] += 1
                    continue
                surface = p[3] > 0
                word = 0 if surface else _SKY
                if surface:
                    px, py, pz, pw = np.float64(p[0]), np.float64(p[1]), np.float64(p[2]), 1.0
                else:
                    px = sky[0] + x * sky_dx[0] + y * sky_dy[0]
                    py = sky[1] + x * sky_dx[1] + y * sky_dy[1]
                    pz = sky[2] + x * sky_dx[2] + y * sky_dy[2]
                    pw = sky[3]
                if surface and motion:
                    q = prev_position[row, x]
                    qx, qy, qz = np.float64(q[0]), np.float64(q[1]), np.float64(q[2])
                    if not np.isfinite(qx + qy + qz):
                        mine[_INVALID] += 1
                        continue
                else:
                    qx, qy, qz = px + pw * delta[0], py + pw * delta[1], pz + pw * delta[2]
                limit = prev_near - max(near - p[3], 0.0) if surface else 0.0
                if forward[0] * qx + forward[1] * qy + forward[2] * qz <= limit:
                    mine[word | _BEHIND] += 1
                    continue
                cw, bw = _row(clip, 3, px, py, pz, pw), _row(prev_clip, 3, qx, qy, qz, pw)
                mx = (_row(prev_clip, 0, qx, qy, qz, pw) / bw - _row(clip, 0, px, py, pz, pw) / cw) * 0.5 * w
                my = (_row(prev_clip, 1, qx, qy, qz, pw) / bw - _row(clip, 1, px, py, pz, pw) / cw) * 0.5 * h
                if not np.isfinite(mx + my):
                    mine[_INVALID] += 1
                    continue
                at_x, at_y = x + mx, y + my
                low, right, top = -GUARD_PX, w - 1 + GUARD_PX, h - 1 + GUARD_PX
                if at_x < low or at_y < low or at_x > right or at_y > top:
                    mine[word | _OUTSIDE] += 1
                    continue
                column = min(max(int(np.floor(at_x + 0.5)), 0), w - 1)
                up = min(max(int(np.floor(at_y + 0.5)), 0), h - 1)
                b, m = history_position[h - 1 - up, column], history_normal[h - 1 - up, column]
                if not np.isfinite(b[0] + b[1] + b[2] + b[3] + m[0] + m[1] + m[2]):
                    mine[word | _INVALID] += 1
                    continue
                before = b[3] > 0
                if not before:
                    word |= _HISTORY_SKY
                if surface != before:
                    word |= _POSITION | _NORMAL | (_OCCLUDING if surface else _DISOCCLUDED)
                    bins[0, HISTOGRAM_BINS - 1] += 1
                    bins[1, HISTOGRAM_BINS - 1] += 1
                elif surface:
                    moved = np.sqrt((qx - b[0]) ** 2 + (qy - b[1]) ** 2 + (qz - b[2]) ** 2)
                    if moved > most_moved:
                        word |= _POSITION
                        nearer = np.sqrt(qx * qx + qy * qy + qz * qz) - np.sqrt(
                            np.float64(b[0]) ** 2 + np.float64(b[1]) ** 2 + np.float64(b[2]) ** 2
                        )
                        if nearer > most_moved:
                            word |= _DISOCCLUDED
                        elif -nearer > most_moved:
                            word |= _OCCLUDING
                    turned = np.sqrt(
                        (np.float64(n[0]) - m[0]) ** 2 + (np.float64(n[1]) - m[1]) ** 2 + (np.float64(n[2]) - m[2]) ** 2
                    )
                    if turned > most_turned:
                        word |= _NORMAL
                    bins[0, _bin(moved)] += 1
                    bins[1, _bin(turned)] += 1
                mine[word] += 1
