"""tools/mutants.toml: every text is in its file once, and a mutant that the self-test must notice is noticed."""

from __future__ import annotations

import importlib.machinery
import importlib.util
from pathlib import Path

import pytest

TOOL = Path(__file__).parents[1] / "tools" / "mutate"


@pytest.fixture(scope="module")
def mutate():
    loader = importlib.machinery.SourceFileLoader("mutate_tool", str(TOOL))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("mutate_tool", loader))
    loader.exec_module(module)
    return module


def test_every_text_is_in_its_file_once(mutate):
    mutants = mutate.load()
    assert len(mutants) >= 100
    assert len({one["name"] for one in mutants}) == len(mutants)
    assert all(one["text"] != one["replacement"] and one["breaks"] for one in mutants)


def test_a_mutant_is_noticed_and_its_file_is_as_before(mutate, tmp_path):
    (one,) = (m for m in mutate.load() if m["name"] == "range-window")
    mutate.copy_project(tmp_path)
    path = tmp_path / one["file"]
    before = path.read_bytes()
    verdict, by = mutate.run(one | {"cases": ["range-window"]}, tmp_path, (), False)
    assert (verdict, by) == ("killed", "range-window")
    assert path.read_bytes() == before


def test_a_text_that_is_not_there_is_an_error(mutate, tmp_path):
    broken = tmp_path / "mutants.toml"
    broken.write_text('[[mutant]]\nname = "x"\nfile = "pyproject.toml"\ntext = "not there"\nreplacement = ""\n')
    with pytest.raises(ValueError, match="0 times"):
        mutate.load(broken)
