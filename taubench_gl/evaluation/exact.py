"""Exact visibility beside the masks: which discards a ray confirms, and which are misregistration.  On request only."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from taubench_gl.conventions import FEATURE_BIT, FRUSTUM, Reason, Visibility
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation.pairs import Pair
from taubench_gl.evaluation.previous_shading import PreviousShading
from taubench_gl.frame.passes.visibility import CHANNEL
from taubench_gl.metrics.streaming import Welford
from taubench_gl.run import EXACT_COLUMNS
from taubench_gl.settings import Settings
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray
CLASSES = {
    "visible": Visibility.VISIBLE, "occluded": Visibility.OCCLUDED, "outside": Visibility.OUTSIDE,
    "behind": Visibility.BEHIND, "new": Visibility.NEW, "invalid": Visibility.INVALID,
}  # fmt: skip
"""Disjoint classes that cover all pixels."""

GEOMETRY = ("position", "normal")
"""Columns whose discards a ray can confirm."""

LIGHT = ("direct", "indirect")
"""Columns whose discards the light of the same point can confirm (``previous_shading``)."""

_SURFACE = FRUSTUM | Reason.FIRST | Reason.CUT | Reason.INVALID | Reason.POSITION | Reason.NORMAL


def require_exact(settings: Settings) -> None:
    """Raises SettingsError where positions are not those of one ray per pixel."""
    if settings.metrics.samples_per_pixel > 1:
        raise SettingsError("exact visibility is at one sample per pixel", hint="leave samples per pixel at 1")
    if settings.device.storage != "float":
        raise SettingsError("exact visibility needs positions of 32 bits", hint="leave --storage at float")


def misregistered(mask: Array, bits: Array, column: str, reprojection: str) -> Array:
    """Pixels that ``column`` (one of GEOMETRY) discards although the previous camera saw their surface point.  (h, w).

    What a point's own motion explains is left out: in position under camera reprojection, in normal always.
    """
    found = ((mask & FEATURE_BIT[column]) != 0) & ((bits & Visibility.VISIBLE) != 0)
    if column == "normal" or reprojection == "camera":
        found &= (bits & Visibility.MOVED) == 0
    return found


def missed(mask: Array, bits: Array) -> Array:
    """Pixels whose point was occluded, and that no geometric column discards.  (h, w)."""
    return ((bits & Visibility.OCCLUDED) != 0) & ((mask & _SURFACE) == 0)


class ExactColumns:
    """Compares the masks of every pair with the channel ``prev_visibility`` and the light of the same points."""

    def __init__(
        self, measured: dict[str, str], settings: Settings, reprojection: str, shading: PreviousShading | None = None
    ):
        """``measured``: column of GEOMETRY and LIGHT -> why it is null, "" where it is measured; ``shading``: for the
        columns of LIGHT that are."""
        self._reasons, self._reprojection, self._shading = measured, reprojection, shading
        self._limits = {name: settings.metrics.threshold(name) for name in LIGHT}
        self._light = {name: Welford() for name in ("brightened", "darkened")}
        self._classes = {name: Welford() for name in CLASSES}
        self._wrong = {name: Welford() for name in (*GEOMETRY, *LIGHT)}
        self._totals = {name: [0, 0] for name in (*GEOMETRY, *LIGHT, "missed")}  # wrong or missed, and of how many
        self._missed = Welford()

    def observer(self, on_pair: Callable[[Pair], None] | None) -> Callable[[Pair], None]:
        """A callback that counts each pair, adds to its row, and then calls ``on_pair``."""

        def observe(pair: Pair) -> None:
            changes = {} if self._shading is None else self._shading.changes(pair.source, pair.frame)
            pair.row.update(self.add(pair.mask, pair.read(CHANNEL)[..., 0], changes))
            if on_pair is not None:
                on_pair(pair)

        return observe

    def add(self, mask: Array, bits: Array, changes: Mapping[str, Array] | None = None) -> dict[str, int | None]:
        """Count one pair; its columns of frames.csv.  ``changes``: of ``PreviousShading.changes``."""
        row: dict[str, int | None] = dict.fromkeys(EXACT_COLUMNS)
        for name, bit in CLASSES.items():
            count = int(np.count_nonzero(bits & bit))
            self._classes[name].add(100.0 * count / bits.size)
            if name in row:
                row[name] = count
        for column in GEOMETRY:
            if self._reasons[column]:
                continue
            wrong = int(np.count_nonzero(misregistered(mask, bits, column, self._reprojection)))
            row[f"misregistered_{column}"] = wrong
            self._count(column, wrong, int(np.count_nonzero(mask & FEATURE_BIT[column])))
            self._wrong[column].add(100.0 * wrong / bits.size)
        self._add_light(row, mask, bits, changes or {})
        if not any(self._reasons[column] for column in GEOMETRY):
            unseen = int(np.count_nonzero(missed(mask, bits)))
            self._count("missed", unseen, row["occluded"])
            self._missed.add(100.0 * unseen / bits.size)
        return row

    def _add_light(self, row: dict[str, int | None], mask: Array, bits: Array, changes: Mapping[str, Array]) -> None:
        visible = (bits & Visibility.VISIBLE) != 0
        placed = visible & ((bits & Visibility.MOVED) == 0) if self._reprojection == "camera" else visible
        for column, change in changes.items():
            if self._reasons[column]:
                continue
            same = np.linalg.norm(change, axis=-1) <= self._limits[column]
            discarded = (mask & FEATURE_BIT[column]) != 0
            wrong = int(np.count_nonzero(discarded & placed & same))
            row[f"misregistered_{column}"] = wrong
            self._count(column, wrong, int(np.count_nonzero(discarded)))
            self._wrong[column].add(100.0 * wrong / bits.size)
            if column == "direct":
                rise = change @ LUMINANCE
                for name, found in (("brightened", rise > 0), ("darkened", rise < 0)):
                    row[name] = int(np.count_nonzero(visible & ~same & found))
                    self._light[name].add(100.0 * row[name] / bits.size)

    def _count(self, name: str, part: int, whole: int) -> None:
        self._totals[name][0] += part
        self._totals[name][1] += whole

    def summary(self) -> dict[str, Any]:
        """The block ``exact`` of summary.json."""
        out: dict[str, Any] = {name: _rate(w) for name, w in self._classes.items()}
        wrong = {}
        for column in (*GEOMETRY, *LIGHT):
            reason = self._reasons[column] or None
            wrong[column] = _rate(self._wrong[column]) | self._share(column)
            wrong[column] |= {"reason": reason} if reason else {}
        out["misregistered"] = wrong
        out |= {name: _rate(w) for name, w in self._light.items()}
        out["missed"] = _rate(self._missed) | self._share("missed")
        return out | {"reprojection": self._reprojection}

    def _share(self, name: str) -> dict[str, float | None]:
        part, whole = self._totals[name]
        return {"share_percent": 100.0 * part / whole if whole else None}


def _rate(values: Welford) -> dict[str, float | None]:
    if not values.count:
        return {"mean_percent": None, "max_percent": None}
    return {"mean_percent": values.mean, "max_percent": values.max}
