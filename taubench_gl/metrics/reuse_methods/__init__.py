"""Equations of the built-in reuse methods, in float64, one module per family of methods.

References for taubench_gl/reuse/methods and shaders/common/reuse.glsl.  Images are (h, w, ...) with row 0 at the top,
colors linear radiance (h, w, 3); outside the image the edge pixels are repeated.  ``at_px`` (h, w, 2) is (column, row)
of a point's previous position.
"""

from __future__ import annotations

from taubench_gl.metrics.reuse_methods.blending import (
    blend,
    effective_weight,
    nearest_weight,
    on_segment,
    used_history,
)
from taubench_gl.metrics.reuse_methods.bmfr import (
    accept_taps,
    block_features,
    block_offset,
    block_regression,
    display_decoded,
    display_encoded,
    feature_noise,
)
from taubench_gl.metrics.reuse_methods.caching import cache_hit, refresh_due, timewarp_px
from taubench_gl.metrics.reuse_methods.history import (
    catmull_rom_weights,
    consistent_blend,
    inside,
    nearest_surface,
    neighbors,
    previous_px,
    sample_history,
    shifted,
)
from taubench_gl.metrics.reuse_methods.means import exponential_average, running_mean
from taubench_gl.metrics.reuse_methods.sparse import new_samples, shaded_neighbors, upsample_blend
from taubench_gl.metrics.reuse_methods.svgf import (
    DEPTH_FLOOR,
    KERNEL,
    LUMINANCE_FLOOR,
    EdgeStopping,
    atrous_level,
    depth_slope,
    moments_variance,
    smoothed_variance,
    spatial_estimate,
)
from taubench_gl.metrics.reuse_methods.svgf_frames import (
    Svgf,
    albedo_of,
    antialiased,
    consistent_history,
    demodulated,
    luminance_moments,
    modulated,
    new_weight,
    reprojected,
    tone_mapped,
    tone_unmapped,
)
from taubench_gl.metrics.reuse_methods.taa import (
    clip_to_box,
    clip_towards,
    karis_blend,
    neighborhood_box,
    neighborhood_mean,
    rgb_from_ycocg,
    variance_box,
    ycocg_from_rgb,
)

__all__ = [
    "DEPTH_FLOOR",
    "KERNEL",
    "LUMINANCE_FLOOR",
    "EdgeStopping",
    "Svgf",
    "accept_taps",
    "albedo_of",
    "antialiased",
    "atrous_level",
    "blend",
    "block_features",
    "block_offset",
    "block_regression",
    "cache_hit",
    "catmull_rom_weights",
    "clip_to_box",
    "clip_towards",
    "consistent_blend",
    "consistent_history",
    "demodulated",
    "depth_slope",
    "display_decoded",
    "display_encoded",
    "effective_weight",
    "exponential_average",
    "feature_noise",
    "inside",
    "karis_blend",
    "luminance_moments",
    "modulated",
    "moments_variance",
    "nearest_surface",
    "nearest_weight",
    "neighborhood_box",
    "neighborhood_mean",
    "neighbors",
    "new_samples",
    "new_weight",
    "on_segment",
    "previous_px",
    "refresh_due",
    "reprojected",
    "rgb_from_ycocg",
    "running_mean",
    "sample_history",
    "shaded_neighbors",
    "shifted",
    "smoothed_variance",
    "spatial_estimate",
    "timewarp_px",
    "tone_mapped",
    "tone_unmapped",
    "upsample_blend",
    "used_history",
    "variance_box",
    "ycocg_from_rgb",
]
