"""Procedural stand-ins for the paper's two EternalValley scenes, glTF files in ``assets/stand-ins``.

A stand-in has exactly the paper's Table 1 row, and its Table 2 and 3 rows at the capture rate of 60 fps: the paper does
not state the rate of these tables.  Its lights, albedos and recorded exposure give about the paper's light columns of
Table 4, path-traced at 1920x1080.  Everything else, the geometry in particular, is original and CC0, so the rest of its
Table 4 row differs from the paper's.
"""

from __future__ import annotations

from taubench_gl.paths import ASSETS

STAND_INS = {path.stem: path for path in sorted((ASSETS / "stand-ins").glob("*.glb"))}
"""Name of the scene of the registry -> the file that stands in for it."""

FITTED = frozenset({"counts", "camera position", "camera rotation", "direct", "indirect"})
"""Figures of the paper that a stand-in was made to have: Tables 1 to 3, and the light columns of Table 4 with
path-traced light at 1920x1080, the default thresholds and the recorded exposure.  They are no evidence for the
paper's."""
