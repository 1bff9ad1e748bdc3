"""Definitions of every reason, column and statistic: one sentence each, with unit and source.

The sentences are in ``glossary.toml``, those of features in ``features.py``.  The help of the command line, the
tooltips of the report and of the viewer, and docs/glossary.md show them.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from taubench_gl.conventions import FRUSTUM, Reason, Visibility
from taubench_gl.data_files import read_toml
from taubench_gl.features import BY_BIT, TABLE


class Term(Struct, frozen=True, forbid_unknown_fields=True):
    """``definition`` is one sentence without a final period; ``source`` is an equation or a page of the docs.

    ``key``: name in files and options; ``label``: the words for people.
    """

    definition: str
    key: str = ""
    label: str = ""
    unit: str = ""
    source: str = ""

    @property
    def sentence(self) -> str:
        """The definition with its final period."""
        return f"{self.definition}."

    @property
    def tooltip(self) -> str:
        """The definition with unit and source: ``Reprojected outside the previous image (paper, Eq. 3)``."""
        remarks = ", ".join(part for part in (self.unit, self.source) if part)
        return f"{self.definition} ({remarks})" if remarks else self.definition


_PAPER = "paper, section 3.2"
_REUSABLE = "docs/conventions.md, Reusable pixels"
_EXACT = "docs/conventions.md, Exact visibility"
_FILE = read_toml(Path(__file__).with_name("glossary.toml"), dict[str, dict[str, Term]])


def _section(name: str) -> dict[str, Term]:
    """Key -> term of a section of glossary.toml."""
    return {key: replace(term, key=key, label=term.label or key) for key, term in _FILE[name].items()}


def _by_key(*terms: Term) -> dict[str, Term]:
    return {term.key: term for term in terms}


def _counts(*terms: Term) -> dict[str, Term]:
    """Columns of frames.csv that count the pixels of ``terms``."""
    return _by_key(*(replace(term, unit="pixels") for term in terms))


CONCEPTS: Mapping[str, Term] = _section("concepts")
"""Words that the other definitions use."""

REASONS: Mapping[Reason, Term] = {
    **{FRUSTUM if key == "frustum" else Reason[key.upper()]: term for key, term in _section("reasons").items()},
    **{f.bit: Term(f.sentence, f.name, f.name, "", _PAPER) for f in BY_BIT},
    **{Reason[key.upper()]: term for key, term in _section("details").items()},
}
"""What sets each bit of the reason mask, and the combination ``frustum``."""

REUSE_REASONS: Mapping[Reason, Term] = {
    **{bit: REASONS[bit] for bit in (Reason.FIRST, Reason.CUT, Reason.INVALID, Reason.BEHIND, Reason.OUTSIDE)},
    **{
        bit: Term(f.cause[1], f.name, f.cause[0], "", _REUSABLE) if bit == f.bit else REASONS[bit]
        for f in BY_BIT if f.rates for bit in (*f.details, f.bit)
    },
}  # fmt: skip
"""Why a pixel is not reusable.  Disjoint: a pixel counts once, under the first reason of this order in its mask."""

COLUMNS: Mapping[str, Term] = _by_key(
    REASONS[FRUSTUM], *(Term(f.sentence, f.name, f.name, f.unit, _PAPER) for f in TABLE)
)
"""The columns of Table 4.  The unit is that of the threshold."""

CAMERA: Mapping[str, Term] = _section("camera")
"""Quantities of Tables 2 and 3."""

STATISTICS: Mapping[str, Term] = _section("statistics")
"""Statistics of summary.json and the tables."""

EXACT: Mapping[str, Term] = {
    **_section("exact"),
    **_by_key(*(
        Term(f.misregistered, f"misregistered_{f.name}", f"misregistered, {f.name}", "pixels", _EXACT) for f in TABLE
    )),
    **_section("exact_light"),
}  # fmt: skip
"""Exact visibility: columns of Table 4 and of frames.csv, where it was asked for."""

EXACT_REASONS: Mapping[Visibility, Term] = {
    Visibility.OCCLUDED: Term(EXACT["occluded"].definition, "disoccluded", "disoccluded", "", _EXACT),
    Visibility.OUTSIDE | Visibility.BEHIND: Term(
        "The surface point was outside the previous image, or behind its camera", "off_screen", "off-screen", "", _EXACT
    ),
    Visibility.NEW: Term(EXACT["exact_new"].definition, "new", "new", "", _EXACT),
    Visibility.BRIGHTENED: EXACT["brightened"],
    Visibility.DARKENED: EXACT["darkened"],
    Visibility.VIEW_DEPENDENT: EXACT["view_dependent"],
}
"""Why the history of a point is wrong, by rays and light of the point itself.  Disjoint."""

CENSUS: Mapping[str, Term] = _section("census")
"""Scene statistics of Table 1, over the evaluated frames."""

FRAMES: Mapping[str, Term] = {
    **_section("frames"),
    **_counts(
        *(replace(CONCEPTS[rate], key=f"reusable_{rate}", label=f"reusable {rate}") for rate in ("surface", "shading"))
    ),
    **_counts(*(term for reason, term in REASONS.items() if reason <= Reason.OUTSIDE or reason == FRUSTUM)),
    **_counts(replace(CONCEPTS["comparable"], label="comparable")),
    **_counts(*(term for reason, term in REASONS.items() if reason > Reason.OUTSIDE and reason != FRUSTUM)),
    **_section("other_reprojection"),
    "translation_m": replace(CAMERA["position"], key="translation_m", label="translation"),
    **_by_key(*(replace(CAMERA[key], key=f"{key}_deg") for key in ("yaw", "pitch", "roll", "angle"))),
    **_section("camera_flags"),
}
"""Columns of frames.csv, one row per pair.  A count column holds the pixels of the pair that have the reason."""

OPTIONS: Mapping[str, Term] = _section("options")
"""Values of ``--reprojection``, ``--sampling`` and ``--history``."""


def key_of(reason: Reason) -> str:
    """Name of a reason in files and options: ``outside``, ``history_sky``, ``frustum``."""
    return REASONS[reason].key


def label_of(reason: Reason) -> str:
    """Name of a reason for people: ``off-screen``, ``sky in history``, ``frustum``."""
    return REASONS[reason].label


def definitions(terms: Mapping[object, Term]) -> str:
    """``terms`` as aligned lines ``key   definition`` for a help text."""
    width = max(len(term.key) for term in terms.values())
    return "\n".join(f"  {term.key:<{width}}  {term.definition}" for term in terms.values())
