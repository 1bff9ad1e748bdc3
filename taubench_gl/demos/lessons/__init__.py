"""The demos themselves.  Importing this package registers them."""

from taubench_gl.demos.lessons import (
    behind,
    cost,
    features,
    half,
    noise,
    occlusion,
    relative,
    reuse,
    rotations,
    sampling,
    thresholds,
)

__all__ = [
    "behind", "cost", "features", "half", "noise", "occlusion", "relative", "reuse", "rotations", "sampling",
    "thresholds",
]  # fmt: skip
