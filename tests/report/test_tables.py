"""Tables: the numbers of the paper and of runs, reasons of missing values, five formats."""

from __future__ import annotations

import copy
import csv
import html
import io
import re
from html.parser import HTMLParser

import pytest

from taubench_gl.features import COLUMNS
from taubench_gl.glossary import CENSUS, STATISTICS
from taubench_gl.glossary import COLUMNS as COLUMN_TERMS
from taubench_gl.report import FORMATS, Column, Row, Table, paper_tables
from taubench_gl.report.labels import lighting_text, run_labels
from taubench_gl.report.table import MIN_WIDTH

# One row of each of the paper's Tables 1 to 4, copied by hand to verify paper.json.
PAPER_ROWS = {
    1: ("Eternal Valley VR", (491, 34, None, 63, 626, None, None)),
    2: ("Emerald Square", (0.154, 0.004, 0.248, None, None, None, None)),
    3: ("Eternal Valley VR", (3.174, 10.539, 8.222, 72.563, 1.871, 3.469, None, None, None, None, None)),
    4: ("Bistro Exterior", (0.3, 6.4, 2.9, 20.3, 7.7, 0.4, 24.0, None)),
}


def find(table: Table, label: str) -> Row:
    return next(row for row in table.rows if row.label == label)


def value(table: Table, row: Row, column: str):
    return row.values[[c.name for c in table.columns].index(column)]


def test_paper_rows_equal_the_printed_ones(summary):
    for table in paper_tables([summary]):
        label, expected = PAPER_ROWS[table.number]
        assert find(table, label).values == expected
        assert find(table, label).paper
        assert sum(row.paper for row in table.rows) == 6


def test_path_traced_runs_have_a_noise_floor_row(summary):
    summary["path_traced"] = {"mapping": "blender"}
    discard = paper_tables([summary])[3]
    assert any("noise floor is unknown" in note for note in discard.notes)
    summary["noise_floor"] = {"color": {"mean_percent": 5.0}, "direct": {"mean_percent": 4.0},
                              "indirect": {"mean_percent": None, "reason": "the files lack the pass X"}}  # fmt: skip
    discard = paper_tables([summary])[3]
    row = find(discard, f"{summary['scene']['name']}, noise floor")
    assert discard.rows[1] is row and not any("unknown" in note for note in discard.notes)
    assert [value(discard, row, name) for name in COLUMNS] == [None, 5.0, None, None, 4.0, None]
    assert row.reasons[5] == "the files lack the pass X" and value(discard, row, "N") == summary["pairs"] + 1


def test_numbers_of_a_run_are_in_their_columns(summary):
    census, position, rotation, discard = tables = paper_tables([summary])
    assert {(value(t, t.rows[0], "fps"), value(t, t.rows[0], "N")) for t in tables} == {(24.0, 12)}
    assert value(census, census.rows[0], "dynamic point lights") == 7
    assert value(position, position.rows[0], "max") == 2
    assert value(rotation, rotation.rows[0], "yaw mean") == 1
    assert value(rotation, rotation.rows[0], "pitch var") == 3
    assert value(rotation, rotation.rows[0], "angle max") == 6
    assert [c.name for c in discard.columns[:6]] == list(COLUMNS)
    assert discard.rows[0].values[:6] == (0.0, 1.5, 3.0, 4.5, 6.0, None)
    assert [row.label for row in discard.rows[:2]] == [
        f"{summary['scene']['name']}, {STATISTICS[key].label}" for key in ("mean_percent", "comparable_mean_percent")
    ]
    assert discard.rows[1].values[1:5] == (2.5, 5.0, 7.5, 10.0)


def test_missing_values_are_none_with_a_reason(summary):
    discard = paper_tables([summary])[3]
    index = COLUMNS.index("indirect")
    assert discard.rows[0].values[index] is None
    assert discard.rows[0].reasons[index] == "no indirect light here"
    text = FORMATS["text"](paper_tables([summary]))
    mark = re.search(r"(\S) no indirect light here", text)[1]
    assert f"–{mark}" in text
    summary |= {"pairs": 0, "camera": {"samples": 0, "cuts": [], "position": {}}}  # a still image
    row = paper_tables([summary])[1].rows[0]
    assert row.values[0] is None and row.reasons[0] == "no frame pair"


def test_cuts_add_a_row_without_cuts(summary):
    assert not any("without cuts" in row.label for row in paper_tables([summary])[1].rows)
    summary["camera"]["cuts"] = [4, 9]
    summary["discard"]["normal"]["without_cuts_mean_percent"] = 3.25
    position, discard = (paper_tables([summary])[i] for i in (1, 3))
    row = next(row for row in position.rows if row.label.endswith("without cuts"))
    assert value(position, row, "variance") == 0.5
    assert value(position, row, "N") == 10
    row = next(row for row in discard.rows if row.label.endswith("without cuts"))
    assert value(discard, row, "normal") == 3.25
    assert value(discard, row, "N") == 10


def test_notes_name_the_camera_and_the_settings(summary):
    tables = paper_tables([summary])
    assert [sum("framing orbit" in note for note in table.notes) for table in tables] == [0, 0, 0, 1]
    parts = ("40x20", "normal 0.1255", "camera reprojection")
    assert any(all(part in note for part in parts) for note in tables[3].notes)


def test_labels_of_several_runs_are_unique(summary):
    other = copy.deepcopy(summary)
    other["settings"]["width"] = 99
    tables = paper_tables([summary, other], paper=False)
    assert not any(row.paper for table in tables for row in table.rows)
    assert not any("Paper" in note for table in tables for note in table.notes)
    table = tables[3]
    assert len({row.label for row in table.rows}) == 4
    assert any(note.startswith("walk [1] | 50 %_x (size 99x20): 99x20") for note in table.notes)


def test_runs_of_one_scene_are_named_by_the_settings_that_differ(summary):
    """Runs without different settings are numbered."""
    runs = [copy.deepcopy(summary) for _ in range(3)]
    for run in runs:
        run["settings"]["unit_scale"] = 1.0
    runs[1]["settings"] |= {"fps": 60.0, "unit_scale": 100.0, "last_frame": 7}
    runs[1]["settings"]["thresholds"]["normal"] = 0.05
    runs[1]["camera"]["source"] = "camera 'Top' (node 'eye')"
    name = summary["scene"]["name"]
    first = f"{name} (frames 0:13, normal threshold 0.12549, fps 24, unit scale 1, camera framing orbit)"
    second = f"{name} (frames 0:8, normal threshold 0.05, fps 60, unit scale 100, camera 'Top')"
    assert run_labels(runs[:2]) == [first, second]
    assert run_labels(runs) == [f"{first} #1", second, f"{first} #2"]
    runs[1]["scene"]["name"] = "other"
    assert run_labels(runs) == [f"{name} #1", "other", f"{name} #2"]


@pytest.mark.parametrize(
    ("number", "digits", "expected"),
    [(0.0, 2, "0.00"), (0.004, 2, "<0.01"), (0.006, 2, "0.01"), (12.345, 2, "12.35"), (3, None, "3"), (None, 2, "–")],
)
def test_small_values_are_not_shown_as_zero(number, digits, expected):
    assert Column("x", "%", digits).text_of(number) == expected


def test_text_fits_its_width_and_keeps_units_and_brackets(summary):
    text = FORMATS["text"](paper_tables([summary]))
    assert max(map(len, text.splitlines())) <= 120
    assert "[m]" in text and "[%]" in text and "[deg²]" in text and "walk [1] | 50 %_x" in text
    narrow = FORMATS["text"](paper_tables([summary]), width=20)
    assert max(map(len, narrow.splitlines())) <= MIN_WIDTH
    assert "72.563" in narrow


def test_markdown_rows_have_the_same_number_of_cells(summary):
    for block in FORMATS["markdown"](paper_tables([summary])).split("**Table")[1:]:
        rows = [line for line in block.splitlines() if line.startswith("|")]
        assert len({len(re.findall(r"(?<!\\)\|", row)) for row in rows}) == 1
        assert rows[2].startswith("| walk [1] \\| 50 %_x")


def test_csv_is_complete_and_exact(summary):
    summary["camera"]["position"]["mean"] = 0.1 + 0.2
    rows = list(csv.DictReader(io.StringIO(FORMATS["csv"](paper_tables([summary])))))
    tables = paper_tables([summary])
    assert len(rows) == sum(len(table.rows) * len(table.columns) for table in tables)
    mean = next(row for row in rows if row["table"] == "2" and row["column"] == "mean")
    assert float(mean["value"]) == 0.1 + 0.2 and mean["source"] == "run" and mean["unit"] == "m"
    units = [row["unit"] for row in rows if row["table"] == "4" and row["column"] == "position"]
    assert {"% of all pixels", "% of comparable pixels"} == set(units)
    missing = [row for row in rows if row["note"] == "no indirect light here"]
    assert len(missing) == 2 and all(row["value"] == "" for row in missing)


def test_latex_escapes_and_balances(summary):
    text = FORMATS["latex"](paper_tables([summary]))
    assert r"50 \%\_x" in text
    assert text.count(r"\begin{tabular}") == text.count(r"\end{tabular}") == 4
    assert not re.search(r"(?<!\\)%(?! needs)", text) and not re.search(r"[^\x00-\x7f]", text)


def test_html_heads_have_the_definitions_of_the_glossary(summary):
    text = FORMATS["html"](paper_tables([summary]))
    terms = [*(COLUMN_TERMS[name] for name in COLUMNS), CENSUS["bones"], STATISTICS["pairs"]]
    assert all(f'title="{html.escape(term.tooltip)}"' in text for term in terms)
    assert all(column.definition for table in paper_tables([summary]) for column in table.columns)


def test_html_is_well_formed_and_escaped(summary):
    summary["scene"]["name"] = "<script>alert(1)</script>"
    open_tags: list[str] = []

    class Check(HTMLParser):
        def handle_starttag(self, tag, attrs):
            assert tag != "script"
            if tag != "br":
                open_tags.append(tag)

        def handle_endtag(self, tag):
            assert open_tags.pop() == tag

    Check().feed(FORMATS["html"](paper_tables([summary])))
    assert not open_tags


def test_run_table_prints_and_shows_in_notebooks(run):
    view = run.table()
    assert "Table 4" in str(view) and "Eternal Valley" in str(view)
    assert "<table>" in view._repr_html_()
    assert "Eternal Valley" not in str(run.table(paper=False))
    assert [table.number for table in run.tables()] == ["reusable", "reasons", 1, 2, 3, 4]


def test_lighting_names_path_tracing_only_where_paths_were_traced():
    settings = {"light_unit": "candela", "exposure": 1.0, "environment": "none", "light": "path-traced", "spp": 1}
    traced = {"path_traced": {"on": True}}
    assert "path-traced (1 fixed sample " in (lighting_text({"settings": settings, "effects": traced}) or "")
    not_traced = {"path_traced": {"on": False}}
    assert "path-traced" not in (lighting_text({"settings": settings, "effects": not_traced}) or "")
