"""Notebooks of the demos are valid and run from top to bottom."""

from __future__ import annotations

import importlib.util
import io

import numpy as np
import pytest
from PIL import Image
from repeated import few

from taubench_gl.demos.explore import explore
from taubench_gl.demos.gallery import write_notebook
from taubench_gl.demos.lessons import DEMOS, find_demo
from taubench_gl.errors import SettingsError

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")


def shown(outputs, kind: str) -> list[str]:
    return [output["data"][kind] for output in outputs if kind in output.get("data", {})]


@pytest.mark.parametrize("name", few(sorted(DEMOS, key=lambda name: name != "thresholds")))
def test_a_notebook_runs(name, tmp_path):
    path = write_notebook(find_demo(name), tmp_path, (160, 90))
    assert path.name == f"{find_demo(name).stem}.ipynb"
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert len(shown(outputs, "image/png")) >= 1
    assert any("| measured | meaning |" in text for text in shown(outputs, "text/markdown"))
    assert shown(outputs, "text/html"), "the table of the last cell"
    assert shown(outputs, "application/vnd.jupyter.widget-view+json"), "the slider"


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


def test_notebooks_are_reproducible(tmp_path):
    """Cell names are not random, so that notebooks can be under version control."""
    one = find_demo("half")
    first = write_notebook(one, tmp_path).read_text(encoding="utf-8")
    assert write_notebook(one, tmp_path).read_text(encoding="utf-8") == first
    assert one.text.idea.split(".")[0] in first and "assert result.as_expected" in first


def test_without_the_extra_is_an_error_that_names_it(runs, gpu, tmp_path, monkeypatch):
    parameter = runs.of(find_demo("thresholds"), gpu).parameter
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    for call in (lambda: explore(parameter), lambda: write_notebook(find_demo("half"), tmp_path)):
        with pytest.raises(SettingsError) as error:
            call()
        assert "taubench-gl[notebook]" in error.value.hint
    assert list(tmp_path.iterdir()) == []
