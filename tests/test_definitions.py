"""Results of two definitions never meet without a word."""

from __future__ import annotations

import copy
import json

import pytest

from taubench_gl.benchmark.output import require_comparable
from taubench_gl.conventions import DEFINITIONS, mixed_definitions
from taubench_gl.errors import OutputError
from taubench_gl.report import run_tables
from taubench_gl.study.store import STUDY_FILE, Store, json_bytes

NOW = {"provenance": {"definitions": DEFINITIONS}}


@pytest.mark.parametrize("other", [{}, {"provenance": {}}, {"provenance": {"definitions": DEFINITIONS + 1}}])
def test_a_mix_is_flagged_above_the_tables_of_several_runs(other):
    first = copy.deepcopy(NOW)
    assert mixed_definitions([first, NOW]) is None and mixed_definitions([other, other]) is None
    tables = run_tables([first, other])
    assert tables[0].lead[0].startswith(mixed_definitions([first, other]))
    assert len(run_tables([first, NOW])[0].lead) == len(tables[0].lead) - 1


def test_a_study_of_another_definition_is_refused_and_keeps_its_files(tmp_path):
    store = Store(tmp_path, "batch", "taubench-gl/batch/1")
    store.write_about({"spec": 1})
    assert store.about()["definitions"] == DEFINITIONS
    file = tmp_path / STUDY_FILE
    values = json.loads(file.read_text())
    for older in ({"definitions": DEFINITIONS - 1}, {}):
        file.write_text(json.dumps({k: v for k, v in values.items() if k != "definitions"} | older))
        with pytest.raises(OutputError) as raised:
            store.require_usable({"spec": 1})
        assert raised.value.where == str(file) and raised.value.hint


@pytest.mark.parametrize("older", [b'"definitions":2,', b""])
def test_a_record_of_another_definition_is_made_again(older, tmp_path):
    store = Store(tmp_path, "batch", "taubench-gl/batch/1")
    store.save("job/unit", json_bytes({"value": 5}))
    assert store.load("job/unit") == {"value": 5}
    file = tmp_path / "records/job/unit.json"
    file.write_bytes(file.read_bytes().replace(b'"definitions":%d,' % DEFINITIONS, older))
    assert store.load("job/unit", remove=False) is None and file.exists()
    assert store.load("job/unit") is None and not file.exists()


def test_benchmarks_of_two_definitions_are_refused():
    suite = {"version": "1", "name": "quick", "sha256": "0" * 64}
    one = {"suite": suite, "cases": {}, "provenance": {"definitions": str(DEFINITIONS)}}
    require_comparable(one, copy.deepcopy(one))
    with pytest.raises(OutputError):
        require_comparable(one, one | {"provenance": {}})
