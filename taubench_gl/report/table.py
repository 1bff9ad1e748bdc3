"""Tables: one description, rendered as terminal text, Markdown, CSV, LaTeX and HTML."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taubench_gl.outputs import csv_text, plain_text, write_atomically

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


@dataclass(frozen=True, slots=True)
class Column:
    """A column of numbers or text, aligned right.

    ``digits``: decimals in formatted text, ``None`` for integers and text; CSV keeps all.  ``definition``: tooltip in
    HTML.
    """

    name: str
    unit: str = ""
    digits: int | None = None
    definition: str = ""
    percent_of: str = ""  # as in Row, of a column with another base than the others

    @property
    def heading(self) -> str:
        """Heading of the column: its name and its unit."""
        return f"{self.name} [{self.unit}]" if self.unit and self.unit not in ("pairs", "1/s") else self.name

    def text_of(self, value: Any) -> str:
        """A value as text: ``–`` for none; ``<0.01`` instead of 0.00 for a value that is not zero."""
        if value is None:
            return NONE
        if self.digits is None or (isinstance(value, float) and not math.isfinite(value)):
            return str(value)
        if self.unit == "1/s":
            return f"{value:g}"
        smallest = 10.0**-self.digits
        if 0 < abs(value) < 0.5 * smallest:
            return f"<{smallest:.{self.digits}f}"
        return f"{value:.{self.digits}f}"


@dataclass(frozen=True, slots=True)
class Row:
    """``values`` in the order of the columns, ``None`` for a missing one; ``paper``: a row of the paper.

    ``reasons`` maps the index of a column to its footnote: why the value is missing, or a remark.
    """

    label: str
    values: tuple[Any, ...]
    paper: bool = False
    reasons: Mapping[int, str] = field(default_factory=dict)
    percent_of: str = "%"  # unit of the columns in percent: of which pixels

    @classmethod
    def of(cls, label: str, values: Sequence[Any], *why: str | None) -> Row:
        """A row with reasons for its missing values: one for all of them, or one for each column."""
        each = why if len(why) == len(values) else why * len(values)
        reasons = {i: each[i] or "not measured" for i, value in enumerate(values) if value is None}
        return cls(label, tuple(values), reasons=reasons)


@dataclass(frozen=True, slots=True)
class Table:
    """One table.  ``number`` as in the paper, or the name of a table that is not in the paper.

    ``lead`` comes before the table, ``notes`` after it; both refer to the whole table.
    """

    number: int | str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()
    lead: tuple[str, ...] = ()

    @property
    def full_title(self) -> str:
        """``Table 1: Animation details``; the title alone of a table without a number."""
        return self.title if isinstance(self.number, str) else f"Table {self.number}: {self.title}"

    @property
    def headings(self) -> list[str]:
        """Headings of all columns; the first, above the row labels, is empty."""
        return ["", *(column.heading for column in self.columns)]

    @property
    def paper_block(self) -> int:
        """Where the paper's rows begin if they follow all others; else, and without any, the number of rows."""
        last = max((i for i, row in enumerate(self.rows) if not row.paper), default=-1) + 1
        return last if not any(row.paper for row in self.rows[:last]) else len(self.rows)

    def cells(self, mark: Callable[[int], Any]) -> tuple[list[list[str]], list[Any]]:
        """Rows of text, the label first, and the lines below the table: footnotes, then notes.

        ``mark(n)``: the number of a footnote; equal reasons share one, in order of appearance.
        """
        reasons: dict[str, int] = {}
        lines = []
        for row in self.rows:
            line = [row.label + (" (paper)" if row.paper else "")]
            for index, (value, column) in enumerate(zip(row.values, self.columns, strict=True)):
                text, reason = column.text_of(value), row.reasons.get(index)
                line.append(text if reason is None else text + mark(reasons.setdefault(reason, len(reasons) + 1)))
            lines.append(line)
        return lines, [mark(number) + " " + reason for reason, number in reasons.items()] + list(self.notes)


def _unicode_mark(number: int) -> str:
    return str(number).translate(_SUPERSCRIPT)


def to_rich(table: Table) -> Any:
    """A rich renderable of at least MIN_WIDTH columns.  The paper's rows are dim."""
    from rich import box
    from rich.console import Group
    from rich.table import Table as RichTable
    from rich.text import Text

    lines, below = table.cells(_unicode_mark)
    grid = RichTable(
        title=Text(table.full_title), title_justify="left", title_style="bold", box=box.SIMPLE_HEAD,
        collapse_padding=True,
    )  # fmt: skip
    grid.add_column("", overflow="fold", max_width=40)
    for column in table.columns:
        # One word per line keeps Table 3 within MIN_WIDTH; otherwise rich folds labels and numbers.
        # Text instead of markup: rich would read "[m]" as a tag, and names come from files.
        grid.add_column(Text(column.heading.replace(" ", "\n")), justify="right", no_wrap=True)
    for position, (row, cells) in enumerate(zip(table.rows, lines, strict=True)):
        if position == table.paper_block:
            grid.add_section()
            grid.add_row(Text("the paper:"), style="dim")
        label = row.label if not row.paper else f"  {row.label}" if position >= table.paper_block else cells[0]
        grid.add_row(*map(Text, [label, *cells[1:]]), style="dim" if row.paper else "")
    above = [Text(line, style="bold") for line in table.lead] + [Text("")] * bool(table.lead)
    return Group(*above, grid, *(Text(line, style="dim") for line in below), Text(""))


def to_text(tables: Sequence[Table], width: int = 120) -> str:
    """The tables as plain text without color, ``width`` columns wide, at least MIN_WIDTH."""
    from rich.console import Console

    console = Console(file=io.StringIO(), width=max(width, MIN_WIDTH), color_system=None, force_terminal=False)
    for table in tables:
        console.print(to_rich(table))
    return "\n".join(line.rstrip() for line in console.file.getvalue().splitlines()) + "\n"


def to_markdown(tables: Sequence[Table]) -> str:
    """The tables as GitHub-flavored Markdown."""

    def cell(text: str) -> str:
        return text.replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;")

    parts = []
    for table in tables:
        lines, below = table.cells(_unicode_mark)
        rows = [table.headings, ["---", *["---:"] * len(table.columns)], *lines]
        text = [line for lead in table.lead for line in (cell(lead), "")] + [f"**{table.full_title}**", ""]
        text += ["| " + " | ".join(line if i == 1 else map(cell, line)) + " |" for i, line in enumerate(rows)]
        text += [line for note in below for line in ("", cell(note))]
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
                unit = (column.percent_of or row.percent_of) if column.unit == "%" else column.unit
                source = "paper" if row.paper else "run"
                out.append((table.number, row.label, source, column.name, unit, value, row.reasons.get(index, "")))
    return csv_text(out)


def latex_text(text: str) -> str:
    """``text`` escaped for LaTeX; characters beyond Latin Extended-A, which its fonts lack, become question marks."""
    plain = "".join(c if ord(c) < 0x180 or ord(c) in _LATEX else "?" for c in plain_text(text))
    return plain.translate(_LATEX)


def to_latex(tables: Sequence[Table], *, shrink: bool = False) -> str:
    """``table`` environments with booktabs rules; footnotes follow the tabular.

    ``shrink``: a table that is wider than the page is scaled down, which needs graphicx.
    """

    def escaped(text: str) -> str:
        return latex_text(text).replace("\x01", r"\textsuperscript{").replace("\x02", "}")

    opening = r"\resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%" if shrink else ""
    parts = [rf"% needs \usepackage{{booktabs{',graphicx' * shrink}}}"]
    for table in tables:
        lines, below = table.cells(lambda number: f"\x01{number}\x02")
        footnotes = len(below) - len(table.notes)
        text = [r"\begin{table}", r"\centering", rf"\caption{{{latex_text(table.title)}}}"]
        text += [opening] * shrink
        text += [rf"\begin{{tabular}}{{l{'r' * len(table.columns)}}}", r"\toprule"]
        text += [" & ".join(map(latex_text, table.headings)) + r" \\", r"\midrule"]
        for position, cells in enumerate(lines):
            text += [r"\midrule"] * (0 < position == table.paper_block)
            text.append(" & ".join(map(escaped, cells)) + r" \\")
        text += [r"\bottomrule", r"\end{tabular}" + "}" * shrink]
        notes = [*below[:footnotes], *table.lead, *table.notes]
        parts.append("\n".join([*text, *(rf"\par\footnotesize {escaped(note)}" for note in notes), r"\end{table}"]))
    return "\n\n".join(parts) + "\n"


def to_html(tables: Sequence[Table], scroll: bool = False) -> str:
    """A fragment without scripts or style sheet.  ``scroll``: each table in a box that scrolls on a narrow screen."""
    from markupsafe import Markup

    from taubench_gl.report.page import macro

    mark = Markup("<sup>{}</sup>").format
    return macro("tables")([(table, *table.cells(mark)) for table in tables], scroll)


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
