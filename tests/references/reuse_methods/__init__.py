"""Equations of the built-in reuse methods, in float64, one module per family of methods.

References for taubench_gl/reuse/methods and shaders/common/reuse.glsl.  Images are (h, w, ...) with row 0 at the top,
colors linear radiance (h, w, 3); outside the image the edge pixels are repeated.  ``at_px`` (h, w, 2) is (column, row)
of a point's previous position.
"""

# ruff: noqa: F403
from __future__ import annotations

from references.reuse_methods import restir  # noqa: F401
from references.reuse_methods.asvgf import *
from references.reuse_methods.bmfr import *
from references.reuse_methods.caching import *
from references.reuse_methods.fsr2 import *
from references.reuse_methods.history import *
from references.reuse_methods.reblur import *
from references.reuse_methods.sparse import *
from references.reuse_methods.svgf import *
from references.reuse_methods.svgf_frames import *
from references.reuse_methods.taa import *
