"""The reuse rate for people: a sentence that names the largest reasons, and the tables that come before Table 1."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from taubench_gl.conventions import MIXED, OTHER_REPROJECTION, mixed_definitions
from taubench_gl.glossary import CONCEPTS, OPTIONS, REUSE_REASONS, STATISTICS
from taubench_gl.metrics.reuse_rate import RATES
from taubench_gl.report.labels import run_labels
from taubench_gl.report.paper import INTERVAL, SAMPLING_COLUMNS, exact_tables, half_width, paper_tables, table_row
from taubench_gl.report.table import Column, Table

Summary = Mapping[str, Any]

TERMS = {term.key: term for term in REUSE_REASONS.values()}
MERGED = (("behind", "outside"), ("lit", "shadowed"))
"""Reasons that are one phrase in the sentence."""
OF_SURFACE = "% of surface pixels"
_MOST_REASONS = 6
"""Most columns of the table of reasons; further reasons are summed up in one."""


def run_tables(summaries: Sequence[Summary], paper: bool = True) -> list[Table]:
    """All tables of runs: reusable pixels and the reasons of the others, Tables 1 to 4 (``paper_tables``), exact
    reasons if any.
    """
    return [*reusable_tables(summaries), *paper_tables(summaries, paper), *exact_tables(summaries)]


def short_tables(summaries: Sequence[Summary]) -> list[Table]:
    """The tables that fit one screen: reusable pixels, the reasons of the others, Table 4 without the paper's rows,
    exact reasons if any.

    Every fact stands once.
    """
    rates, reasons = (replace(table, notes=()) for table in reusable_tables(summaries))
    return [rates, reasons, paper_tables(summaries, paper=False)[3], *exact_tables(summaries)]


def reusable_sentence(summary: Summary) -> str:
    """``81.3 % of surface pixels can be reused; most of the rest is disoccluded (9.1 %) or off-screen (6.0 %)``.

    Where surfaces move, with both: ``58.3 % of surface ... by camera reprojection, 68.1 % with motion vectors ...``.
    """
    block = summary.get("reusable") or {}
    rate = block.get("reasons_of")
    if rate is None:
        return f"reusable pixels are unknown: {_why(block, 'surface')}"
    shares = {name: entry["mean_percent"] for name, entry in (block.get("reasons") or {}).items()}
    percent, sky = block[rate]["mean_percent"], block.get("sky_percent")
    if both := both_rates(summary, rate):
        texts = {mode: rate_text(entry["mean_percent"], half_width(entry)) for mode, entry in both.items()}
        return both_sentence(texts, block["reprojection"], percent, shares, rate, sky)
    return sentence(percent, shares, rate, sky, half_width(block[rate]))


def both_rates(summary: Summary, rate: str) -> dict[str, Any]:
    """Reprojection -> its entry of ``rate``, where surfaces move by themselves and both are known; else empty."""
    block, effects = summary.get("reusable") or {}, summary.get("effects") or {}
    entries = {mode: (block.get(mode) or {}).get(rate) or {} for mode in OTHER_REPROJECTION}
    moves = (effects.get("previous_pose") or {}).get("on")
    known = all(entry.get("mean_percent") is not None for entry in entries.values())
    return entries if moves and known else {}


def both_sentence(
    texts: Mapping[str, str],
    chosen: str,
    percent: float,
    shares: Mapping[str, float],
    rate: str = "shading",
    sky_percent: float | None = None,
) -> str:
    """``sentence`` with the rate of each reprojection, ``texts``; ``percent`` and ``shares`` are of ``chosen``."""
    named = rate if rate == "shading" else f"{rate}; light was not measured"
    text = f"{texts['camera']} of surface pixels can be reused by camera reprojection"
    text += f", {texts['motion']} with motion vectors ({named})"
    return text + _reasons_text(percent, shares, f"by {chosen} reprojection ") + _sky_text(sky_percent)


def pair_sentence(rates: Mapping[str, float], shares: Mapping[str, float], rate: str, sky_percent: float) -> str:
    """The sentence of one pair.  ``rates``: reprojection -> percent, the chosen one first, and the other if counted."""
    chosen, percent = next(iter(rates.items()))
    if len(rates) == 1:
        return sentence(percent, shares, rate, sky_percent)
    texts = {mode: percent_text(each) for mode, each in rates.items()}
    return both_sentence(texts, chosen, percent, shares, rate, sky_percent)


def headline(summary: Summary) -> str:
    """``camera reprojection: 81.3 % of surface ...``: the reprojection mode and ``reusable_sentence``.

    A sentence with both reprojections stands alone.
    """
    if both_rates(summary, (summary.get("reusable") or {}).get("reasons_of") or ""):
        return reusable_sentence(summary)
    mode, _, history = (reprojection_of(summary) or "").partition(", ")
    kind = f"{mode} reprojection" + (f", {OPTIONS[history].label}" if history else "")
    return (f"{kind}: " if mode else "") + reusable_sentence(summary)


def sentence(
    percent: float,
    shares: Mapping[str, float],
    rate: str = "shading",
    sky_percent: float | None = None,
    half: float | None = None,
) -> str:
    """The sentence from a reuse rate and the shares of its disjoint reasons, in % of surface pixels.

    ``sky_percent``: of all pixels; ``half``: half width of the interval of an estimated rate, points.
    """
    text = f"{rate_text(percent, half)} of surface pixels can be reused{_reasons_text(percent, shares)}"
    if rate != "shading":
        text = f"by geometry {text} (light was not measured)"
    return text + _sky_text(sky_percent)


def rate_text(percent: float, half: float | None = None) -> str:
    """``81.3 %``, or ``81.3 ± 0.8 %`` of an estimated rate with the half width ``half`` of its interval."""
    return percent_text(percent) if half is None else f"{percent:.1f} ± {half:.1f} %"


def _sky_text(percent: float | None) -> str:
    return f"; sky fills {percent_text(percent)} of the image" if percent else ""


def _reasons_text(percent: float, shares: Mapping[str, float], under: str = "") -> str:
    """``; most of the rest is disoccluded (9.1 %)``, of a rate of ``percent``; ``under``: words before it."""
    phrases, covered = _largest(shares, 100.0 - percent)
    if not phrases:
        return ""
    reasons = " or ".join(f"{words} ({percent_text(share)})" for words, share in phrases)
    if covered >= 1.0:
        return f"; {under}the rest is {reasons}"
    return f"; {under}most of the rest is {reasons}" if covered > 0.5 else f"; {under}the largest reasons are {reasons}"


def percent_text(percent: float) -> str:
    """One decimal; a rounded value never reads 0 or 100 % unless it is."""
    if 0.0 < percent < 0.05:
        return "less than 0.1 %"
    if 99.95 <= percent < 100.0:
        return "more than 99.9 %"
    return f"{percent:.0f} %" if percent in (0.0, 100.0) else f"{percent:.1f} %"


def _largest(shares: Mapping[str, float], other_share: float, most: int = 2) -> tuple[list[tuple[str, float]], float]:
    """The largest reasons in words with their shares, and the part of ``other_share`` that they explain."""
    groups: dict[tuple[str, ...], float] = {}
    for name in TERMS:
        share = shares.get(name) or 0.0
        group = next((g for g in MERGED if name in g), (name,))
        groups[group] = groups.get(group, 0.0) + share
    ranked = sorted(((g, s) for g, s in groups.items() if s > 0), key=lambda item: -item[1])
    shown = ranked[:most] if len(ranked) != most + 1 else ranked  # not three quarters of a list of three
    words = [(" or ".join(TERMS[n].label for n in group if shares.get(n)), share) for group, share in shown]
    covered = 1.0 if len(shown) == len(ranked) else sum(share for _, share in shown) / max(other_share, 1e-30)
    return words, covered


def reusable_tables(summaries: Sequence[Summary]) -> list[Table]:
    """Reusable surface pixels with the reprojection mode, and the disjoint reasons of the others; a row per run."""
    labels = run_labels(summaries)
    several = len(summaries) > 1
    lead = [f"{label}, {headline(s)}" if several else headline(s) for label, s in zip(labels, summaries, strict=True)]
    if mixed := mixed_definitions(summaries):
        lead.insert(0, f"{mixed}: {MIXED}")
    return [_rates(summaries, labels, tuple(lead)), _reasons(summaries, labels)]


def _rates(summaries: Sequence[Summary], labels: Sequence[str], lead: tuple[str, ...]) -> Table:
    """A row for each rate of each run."""
    rows = []
    sampled = any(half_width((s.get("reusable") or {}).get("shading") or {}) is not None for s in summaries)
    for label, summary in zip(labels, summaries, strict=True):
        block = summary.get("reusable") or {}
        mode = reprojection_of(summary)
        of_both = [(mode, rate, block.get(rate) or {}) for rate in RATES]
        for rate in RATES:
            others = both_rates(summary, rate).items()
            of_both += [(other, rate, entry) for other, entry in others if other != block.get("reprojection")]
        for mode, rate, entry in of_both:
            shares = [entry.get(key) for key in ("mean_percent", "min_percent", "max_percent")]
            shares += [half_width(entry)] * sampled
            values = [mode, *shares, entry.get("of_picture_percent"), block.get("sky_percent")]
            why = [_why(block, rate)] * len(values)
            if half_width(entry) is not None:
                why[2:4] = ["too few sampled pixels in a pair"] * 2
            elif sampled and entry.get("mean_percent") is not None:
                why[4] = "no interval: every pixel is measured"
            row = table_row(f"{label}, {rate}", values, summary, *why)
            rows.append(replace(row, percent_of=OF_SURFACE))
    of_all = STATISTICS["of_picture_percent"].label
    columns = (
        Column(
            "reprojection",
            definition="How a pixel finds its history: camera or motion; "
            "eye: in the other eye, both: in the better of it and the last frame",
        ),
        Column("reusable", "%", 2, "; ".join(CONCEPTS[rate].tooltip for rate in RATES)),
        Column("min", "%", 2, STATISTICS["min_percent"].tooltip),
        Column("max", "%", 2, STATISTICS["max_percent"].tooltip),
        *([Column("±", "%", 2, f"Half width: {INTERVAL}")] * sampled),
        Column(of_all.removeprefix("% "), "%", 2, STATISTICS["of_picture_percent"].tooltip, of_all),
        Column("sky", "%", 2, STATISTICS["sky_percent"].tooltip, of_all),
        *SAMPLING_COLUMNS,
    )
    notes = ("A mean is a total over all pairs by a total; min and max are of a pair. sky: % of all pixels.",)
    return Table("reusable", f"Reusable pixels, {OF_SURFACE}", columns, tuple(rows), notes, lead)


def _reasons(summaries: Sequence[Summary], labels: Sequence[str]) -> Table:
    blocks = [(summary.get("reusable") or {}).get("reasons") or {} for summary in summaries]
    shares = [{name: (block.get(name) or {}).get("mean_percent") for name in TERMS} for block in blocks]
    highest = {name: max((share[name] or 0.0 for share in shares), default=0.0) for name in TERMS}
    present = [name for name in TERMS if highest[name] > 0]
    named = (
        present if len(present) <= _MOST_REASONS else sorted(present, key=lambda n: -highest[n])[: _MOST_REASONS - 1]
    )
    named = [name for name in TERMS if name in named]
    rows = []
    for label, summary, share in zip(labels, summaries, shares, strict=True):
        block = summary.get("reusable") or {}
        rate = block.get("reasons_of")
        values = [None if rate is None else block[rate]["mean_percent"], *(share[name] for name in named)]
        if len(named) < len(present):
            others = [share[name] for name in present if name not in named]
            values.append(None if rate is None else sum(value or 0.0 for value in others))
        why = [_why(block, "shading" if rate else "surface")] * len(values)
        row = table_row(label if rate != "surface" else f"{label}, surface", values, summary, *why)
        rows.append(replace(row, percent_of=OF_SURFACE))
    columns = [Column("reusable", "%", 2, CONCEPTS["reuse_rate"].tooltip)]
    columns += [Column(TERMS[name].label, "%", 2, TERMS[name].tooltip) for name in named]
    if len(named) < len(present):
        others = ", ".join(TERMS[name].label for name in present if name not in named)
        columns.append(Column("other", "%", 2, f"All other reasons: {others}"))
    notes = ("A pixel counts once, under its first reason; reasons and reusable pixels add up to 100 %.",)
    title = f"Why surface pixels are not reusable, {OF_SURFACE}"
    return Table("reasons", title, (*columns, *SAMPLING_COLUMNS), tuple(rows), notes)


def reprojection_of(summary: Summary) -> str | None:
    """camera or motion; ``camera, eye`` or ``camera, both`` where the history is not the frame before."""
    settings = summary.get("settings") or {}
    mode = (summary.get("reusable") or {}).get("reprojection") or settings.get("reprojection")
    history = settings.get("history", "frame")
    return mode if mode is None or history == "frame" else f"{mode}, {history}"


def _why(block: Mapping[str, Any], rate: str) -> str:
    return str((block.get(rate) or {}).get("reason") or "not recorded")
