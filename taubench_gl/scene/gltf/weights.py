"""Skin weights of one primitive: all sets side by side, rows that sum to 1."""

from __future__ import annotations

from collections import Counter

import numpy as np

from taubench_gl.scene.gltf.document import Document

Array = np.ndarray
SUM_TOLERANCE = 1e-3


def skin_weights(
    document: Document, fixes: Counter[str], arrays: dict[str, Array], pointer: str
) -> tuple[Array | None, Array | None]:
    """Joints (V, 4 k) uint32 and weights (V, 4 k) float32, or (None, None).  ``fixes`` counts what was repaired."""
    sets = sorted(int(name[7:]) for name in arrays if name.startswith("JOINTS_"))
    if not sets:
        return None, None
    joints = np.concatenate([arrays[f"JOINTS_{i}"] for i in sets], axis=1)
    weights = np.concatenate([arrays[f"WEIGHTS_{i}"] for i in sets], axis=1).astype(np.float64)
    negative = np.any(weights < 0, axis=1)
    if np.any(negative):
        raise document.error(
            f"vertex {int(np.argmax(negative))} has a negative weight", f"{pointer}/attributes/WEIGHTS_0"
        )
    total = weights.sum(axis=1)
    empty = total == 0
    if np.any(empty):
        # The only joint such a vertex names; without this it would collapse into the origin.
        weights[empty, 0], total[empty] = 1.0, 1.0
        fixes["vertices without any skin weight follow the first joint they name"] += int(empty.sum())
    off = np.abs(total - 1.0) > SUM_TOLERANCE
    if np.any(off):
        fixes["vertices had skin weights that did not sum to 1; they were normalized"] += int(off.sum())
    weights = (weights / total[:, None]).astype(np.float32)
    joints.flags.writeable = weights.flags.writeable = False
    return joints, weights
