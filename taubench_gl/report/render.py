"""Tables as terminal text, Markdown, CSV, LaTeX and HTML."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from taubench_gl.outputs import csv_text, plain_text, write_atomically
from taubench_gl.report.tables import Column, Row, Table

NONE = "–"
MIN_WIDTH = 100
"""Terminal columns that Table 3 needs."""
_SUPERSCRIPT = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
_LATEX = str.maketrans(
    {
        "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
        "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "\\": r"\textbackslash{}",
        "–": "--", "²": "$^2$", "·": r"$\cdot$", "<": "$<$", ">": "$>$", "|": "$|$", "≥": r"$\geq$", "≤": r"$\leq$",
        "±": r"$\pm$", "×": r"$\times$", "°": r"$^\circ$",
    }
)  # fmt: skip


def format_value(value: Any, column: Column) -> str:
    """A value as text: ``–`` for none; ``<0.01`` instead of 0.00 for a value that is not zero."""
    if value is None:
        return NONE
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if column.digits is None:
        return str(value)
    if column.unit == "1/s":
        return f"{value:g}"
    smallest = 10.0**-column.digits
    if 0 < abs(value) < 0.5 * smallest:
        return f"<{smallest:.{column.digits}f}"
    return f"{value:.{column.digits}f}"


class Footnotes:
    """Numbers footnotes in order of appearance; equal texts share a number."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def mark(self, row: Row, index: int) -> str:
        """The number of the footnote of a cell as decimal digits, or an empty text."""
        reason = row.reasons.get(index)
        if reason is None:
            return ""
        if reason not in self.texts:
            self.texts.append(reason)
        return str(self.texts.index(reason) + 1)


def _heading(column: Column) -> str:
    return f"{column.name} [{column.unit}]" if column.unit and column.unit not in ("pairs", "1/s") else column.name


def _body(table: Table, superscript: Any) -> tuple[list[list[str]], list[str]]:
    """Cells as text with footnote marks, the label first, and the footnotes."""
    notes = Footnotes()
    lines = []
    for row in table.rows:
        cells = [row.label + (" (paper)" if row.paper else "")]
        for index, (value, column) in enumerate(zip(row.values, table.columns, strict=True)):
            mark = notes.mark(row, index)
            cells.append(format_value(value, column) + (superscript(mark) if mark else ""))
        lines.append(cells)
    return lines, notes.texts


def _unicode_mark(mark: str) -> str:
    return mark.translate(_SUPERSCRIPT)


def _title(table: Table) -> str:
    return table.title if isinstance(table.number, str) else f"Table {table.number}: {table.title}"


def _paper_block(table: Table) -> int:
    """Where the paper's rows begin if they follow all others; else, and without any, the number of rows."""
    last = max((i for i, row in enumerate(table.rows) if not row.paper), default=-1) + 1
    return last if not any(row.paper for row in table.rows[:last]) else len(table.rows)


def to_rich(table: Table) -> Any:
    """A rich renderable of at least MIN_WIDTH columns.  The paper's rows are dim."""
    from rich import box
    from rich.console import Group
    from rich.table import Table as RichTable
    from rich.text import Text

    lines, footnotes = _body(table, _unicode_mark)
    grid = RichTable(
        title=Text(_title(table)), title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, collapse_padding=True
    )
    grid.add_column("", overflow="fold", max_width=40)
    for column in table.columns:
        # One word per line keeps Table 3 within MIN_WIDTH; otherwise rich folds labels and numbers.
        # Text instead of markup: rich would read "[m]" as a tag, and names come from files.
        grid.add_column(Text(_heading(column).replace(" ", "\n")), justify="right", no_wrap=True)
    block = _paper_block(table)
    for position, (row, cells) in enumerate(zip(table.rows, lines, strict=True)):
        if position == block:
            grid.add_section()
            grid.add_row(Text("the paper:"), style="dim")
        label = row.label if not row.paper else f"  {row.label}" if position >= block else cells[0]
        grid.add_row(*map(Text, [label, *cells[1:]]), style="dim" if row.paper else "")
    below = [f"{_unicode_mark(str(i))} {text}" for i, text in enumerate(footnotes, start=1)] + list(table.notes)
    above = [Text(line, style="bold") for line in table.lead] + [Text("")] * bool(table.lead)
    return Group(*above, grid, *(Text(line, style="dim") for line in below), Text(""))


def to_text(tables: Sequence[Table], width: int = 120) -> str:
    """Plain text without color, ``width`` columns wide, at least MIN_WIDTH."""
    from rich.console import Console

    console = Console(file=io.StringIO(), width=max(width, MIN_WIDTH), color_system=None, force_terminal=False)
    for table in tables:
        console.print(to_rich(table))
    return "\n".join(line.rstrip() for line in console.file.getvalue().splitlines()) + "\n"


def to_markdown(tables: Sequence[Table]) -> str:
    """GitHub-flavoured Markdown."""

    def cell(text: str) -> str:
        return text.replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;")

    parts = []
    for table in tables:
        lines, footnotes = _body(table, _unicode_mark)
        heads = ["", *map(_heading, table.columns)]
        rows = [heads, ["---", *["---:"] * len(table.columns)], *lines]
        text = [line for lead in table.lead for line in (cell(lead), "")] + [f"**{_title(table)}**", ""]
        text += ["| " + " | ".join(line if i == 1 else map(cell, line)) + " |" for i, line in enumerate(rows)]
        notes = [f"{_unicode_mark(str(i))} {note}" for i, note in enumerate(footnotes, start=1)] + list(table.notes)
        text += [line for note in notes for line in ("", cell(note))]
        parts.append("\n".join(text))
    return "\n\n".join(parts) + "\n"


def to_csv(tables: Sequence[Table]) -> str:
    """One line per value with all digits: table, row, source (run or paper), column, unit, value, note.

    A long format, because the tables have different columns.  A missing value is empty; its note is the reason.
    """
    out: list[tuple[Any, ...]] = [("table", "row", "source", "column", "unit", "value", "note")]
    for table in tables:
        for row in table.rows:
            for index, (column, value) in enumerate(zip(table.columns, row.values, strict=True)):
                source = "paper" if row.paper else "run"
                note = row.reasons.get(index, "")
                unit = (column.percent_of or row.percent_of) if column.unit == "%" else column.unit
                out.append((table.number, row.label, source, column.name, unit, value, note))
    return csv_text(out)


def latex_text(text: str) -> str:
    """``text`` escaped for LaTeX; characters beyond Latin Extended-A, which its fonts lack, become question marks."""
    plain = "".join(c if ord(c) < 0x180 or ord(c) in _LATEX else "?" for c in plain_text(text))
    return plain.translate(_LATEX)


def to_latex(tables: Sequence[Table], *, shrink: bool = False) -> str:
    """``table`` environments with booktabs rules; footnotes follow the tabular.

    ``shrink``: a table that is wider than the page is scaled down, which needs graphicx.
    """
    opening = r"\resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%" if shrink else ""
    parts = [rf"% needs \usepackage{{booktabs{',graphicx' * shrink}}}"]
    for table in tables:
        lines, footnotes = _body(table, lambda mark: f"\x01{mark}\x02")
        text = [r"\begin{table}", r"\centering", rf"\caption{{{latex_text(table.title)}}}"]
        text += [opening] * shrink
        text += [rf"\begin{{tabular}}{{l{'r' * len(table.columns)}}}", r"\toprule"]
        text += [" & ".join(["", *(latex_text(_heading(column)) for column in table.columns)]) + r" \\", r"\midrule"]
        block = _paper_block(table)
        for position, cells in enumerate(lines):
            if position and position == block:
                text.append(r"\midrule")
            line = " & ".join(map(latex_text, cells)) + r" \\"
            text.append(line.replace("\x01", r"\textsuperscript{").replace("\x02", "}"))
        text += [r"\bottomrule", r"\end{tabular}" + "}" * shrink]
        notes = [rf"\textsuperscript{{{i}}} {latex_text(note)}" for i, note in enumerate(footnotes, start=1)]
        text += [rf"\par\footnotesize {note}" for note in [*notes, *map(latex_text, (*table.lead, *table.notes))]]
        parts.append("\n".join([*text, r"\end{table}"]))
    return "\n\n".join(parts) + "\n"


def to_html(tables: Sequence[Table], scroll: bool = False) -> str:
    """A fragment without scripts or style sheet.  ``scroll``: each table in a box that scrolls on a narrow screen."""
    from markupsafe import Markup

    from taubench_gl.report.page import render

    mark = Markup("<sup>{}</sup>").format
    shown = []
    for table in tables:
        rows, footnotes = _body(table, mark)
        shown.append({
            "title": _title(table),
            "lead": table.lead,
            "heads": ["", *map(_heading, table.columns)],
            "tips": ["", *(column.definition for column in table.columns)],
            "rows": rows,
            "notes": [mark(i) + " " + note for i, note in enumerate(footnotes, start=1)] + list(table.notes),
            "dim": [i for i, row in enumerate(table.rows) if row.paper],
            "region": _title(table).split(":")[0] if scroll else "",
        })  # fmt: skip
    return Markup(render("tables.html", tables=shown))


class TablesView:
    """Several tables that ``print``, rich and notebooks display."""

    def __init__(self, tables: Sequence[Table]):
        self.tables = tuple(tables)

    def __rich__(self) -> Any:
        from rich.console import Group

        return Group(*map(to_rich, self.tables))

    def __str__(self) -> str:
        return to_text(self.tables)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return to_html(self.tables)


FORMATS = {"text": to_text, "markdown": to_markdown, "csv": to_csv, "latex": to_latex, "html": to_html}
"""Format name -> function from a sequence of tables to text."""
TABLE_FILES = {"tables.txt": "text", "tables.md": "markdown", "tables.csv": "csv", "tables.tex": "latex"}
"""The files that every folder of results holds, and their formats."""


def write_tables(folder: Path, tables: Sequence[Table]) -> list[Path]:
    """Write TABLE_FILES to ``folder``.  -> the files.  Raises OutputError."""
    for name, form in TABLE_FILES.items():
        write_atomically(folder / name, FORMATS[form](tables))
    return [folder / name for name in TABLE_FILES]
