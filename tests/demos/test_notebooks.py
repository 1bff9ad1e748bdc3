"""Notebooks of the demos are valid and run from top to bottom."""

from __future__ import annotations

import importlib.util
import io

import numpy as np
import pytest
from PIL import Image

from taubench_gl.demos import gallery as module
from taubench_gl.demos.explore import explore
from taubench_gl.demos.gallery import write_notebook
from taubench_gl.demos.lessons import DEMOS, find_demo
from taubench_gl.errors import SettingsError

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")


def execute(path, folder) -> list:
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(folder)}}).execute()
    return [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]


def shown(outputs, kind: str) -> list[str]:
    return [output["data"][kind] for output in outputs if kind in output.get("data", {})]


def check(demo, tmp_path) -> None:
    path = write_notebook(demo, tmp_path, (160, 90))
    assert path.name == f"{demo.stem}.ipynb"
    outputs = execute(path, tmp_path)
    assert len(shown(outputs, "image/png")) >= 1
    assert any("| measured | meaning |" in text for text in shown(outputs, "text/markdown"))
    assert shown(outputs, "text/html"), "the table of the last cell"
    assert shown(outputs, "application/vnd.jupyter.widget-view+json"), "the slider"


def test_one_notebook_runs(tmp_path):
    check(find_demo("thresholds"), tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("name", [name for name in DEMOS if name != "thresholds"])
def test_every_notebook_runs(name, tmp_path):
    check(find_demo(name), tmp_path)


def test_the_slider_redraws_image_and_number(runs, gpu):
    pytest.importorskip("ipywidgets", reason="the notebook extra is not installed")
    parameter = runs.of(find_demo("thresholds"), gpu).parameter
    slider, reading, image, _ = explore(parameter).children
    assert slider.index == parameter.start
    seen = set()
    for i in (0, len(parameter.values) // 2, len(parameter.values) - 1):
        slider.index = i
        assert f"{parameter.measured[i]:.2f} %" in reading.value and f"{parameter.expected[i]:.2f}" in reading.value
        seen.add(image.value)
        drawn = np.asarray(Image.open(io.BytesIO(image.value)))
        assert (drawn == parameter.mark).all(axis=-1).sum() == (parameter.plane > i).sum()
    assert len(seen) == 3


def test_without_ipywidgets_is_an_error_that_names_the_extra(runs, gpu, monkeypatch):
    parameter = runs.of(find_demo("thresholds"), gpu).parameter
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(SettingsError) as error:
        explore(parameter)
    assert "taubench-gl[notebook]" in error.value.hint


def test_notebooks_are_reproducible(tmp_path):
    """Cell names are not random, so that notebooks can be under version control."""
    one = find_demo("half")
    first = write_notebook(one, tmp_path).read_text(encoding="utf-8")
    assert write_notebook(one, tmp_path).read_text(encoding="utf-8") == first
    assert one.text.idea.split(".")[0] in first and "assert result.as_expected" in first


def test_without_nbformat_is_an_error_that_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(SettingsError) as error:
        module.write_notebook(find_demo("half"), tmp_path)
    assert "taubench-gl[notebook]" in error.value.hint and list(tmp_path.iterdir()) == []
