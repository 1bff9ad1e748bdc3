"""The notebook that trains a denoiser runs, and its method is better than accumulation on a scene it has not seen."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).resolve().parents[2] / "docs" / "notebooks" / "denoiser.ipynb"
ROW = re.compile(r"^(\w+) +(\w+) +(-?[\d.]+) +([\d.]+) +([\d.]+)$", re.MULTILINE)


def scores(notebook) -> dict[tuple[str, str], tuple[float, float, float]]:
    """PSNR, FLIP and trimmed relMSE by scene and method, of the outputs."""
    text = "".join(o.get("text", "") for cell in notebook.cells for o in cell.get("outputs", []))
    return {(scene, name): tuple(map(float, values)) for scene, name, *values in ROW.findall(text)}


def check(found: dict[tuple[str, str], tuple[float, float, float]]) -> None:
    assert {scene for scene, _ in found} == {"demo", "interior"}
    ours, theirs = found["demo", "denoiser"], found["demo", "accumulate"]
    assert ours[0] > theirs[0] and ours[1] < theirs[1] and ours[2] < theirs[2]
    assert found["interior", "denoiser"][0] > found["interior", "none"][0]


def test_stored_outputs_are_small_and_show_the_comparison():
    nbformat = pytest.importorskip("nbformat")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    assert NOTEBOOK.stat().st_size < 150_000
    check(scores(notebook))


@pytest.mark.long
def test_notebook_trains_exports_and_evaluates(tmp_path):
    for module in ("torch", "onnx", "onnxruntime", "nbformat"):
        pytest.importorskip(module)
    import nbformat

    nbclient = pytest.importorskip("nbclient")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    client = nbclient.NotebookClient(notebook, timeout=3600, resources={"metadata": {"path": str(tmp_path)}})
    check(scores(client.execute()))
    assert (tmp_path / "denoiser.onnx").is_file() and (tmp_path / "denoiser.py").is_file()
