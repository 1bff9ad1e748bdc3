"""The notebook of the cost study runs from top to bottom."""

from __future__ import annotations

from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).resolve().parents[2] / "docs" / "notebooks" / "cost.ipynb"


@pytest.mark.long
def test_notebook_runs(tmp_path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "stored without outputs"
    client = nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}})
    done = client.execute()
    text = "".join(o.get("text", "") for cell in done.cells for o in cell.get("outputs", []))
    assert "preset.toml" in text and "Use " in text
    images = [o for cell in done.cells for o in cell.get("outputs", []) if "image/png" in o.get("data", {})]
    tables = [o for cell in done.cells for o in cell.get("outputs", []) if "text/html" in o.get("data", {})]
    assert images and "position" in tables[0]["data"]["text/html"]
