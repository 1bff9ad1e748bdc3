"""A demo as a Jupyter notebook.  Needs nbformat: pip install taubench-gl[notebook]."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from taubench_gl.demos.demo import Demo
from taubench_gl.errors import SettingsError
from taubench_gl.outputs import write_atomically

SIZE = (320, 180)


def write_notebook(demo: Demo, folder: Path, size: tuple[int, int] = SIZE) -> Path:
    """Write ``NN-name.ipynb`` into ``folder``, not executed.  Raises OutputError; SettingsError without nbformat."""
    if importlib.util.find_spec("nbformat") is None:
        raise SettingsError("notebooks need nbformat", hint="run: pip install 'taubench-gl[notebook]'")
    import nbformat
    from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

    look = "\n".join(f"- {item}" for item in demo.look_for)
    cells = [
        new_markdown_cell(f"# {demo.number}. {demo.title}\n\n{demo.idea}\n\n**What to look for**\n\n{look}"),
        new_code_cell(_RUN.format(name=demo.name, width=size[0], height=size[1])),
        new_markdown_cell("## Measured numbers and theory"),
        new_code_cell(_NUMBERS),
    ]
    if demo.scene is not None:
        cells += [
            new_markdown_cell(
                "## Experiments\n\nEvaluate the scene of this demo. Change a setting and run the cell "
                'again: `reprojection="motion"`, `thresholds={"position": 0.01}`, another `fps`.'
            ),
            new_code_cell(_EVALUATE.format(width=size[0], height=size[1])),
        ]
    for i, cell in enumerate(cells):
        cell["id"] = f"{demo.name}-{i}"  # reproducible file
    notebook = new_notebook(cells=cells)
    notebook.metadata["kernelspec"] = {"display_name": "Python 3", "language": "python", "name": "python3"}
    nbformat.validate(notebook)
    path = folder / f"{demo.stem}.ipynb"
    write_atomically(path, nbformat.writes(notebook) + "\n")
    return path


_RUN = """\
import tempfile

from IPython.display import Image, Markdown, display
from taubench_gl.demos.lessons import find_demo
from taubench_gl.demos.gallery import run_demo

demo = find_demo("{name}")
result = run_demo(demo.name, tempfile.mkdtemp(), size=({width}, {height}))
for figure in result.figures:
    display(Image(figure.path, width=1000), Markdown(figure.caption))"""

_NUMBERS = """\
rows = ["| measured | meaning | expected | reason |", "| --- | --- | --- | --- |"]
rows += [f"| {f.text} | {f.meaning} | {f.expected.text} | {f.expected.source} |" for f in result.findings]
display(Markdown("\\n".join(rows)))
assert result.as_expected"""

_EVALUATE = """\
import taubench_gl as tb

settings = tb.Settings.of(width={width}, height={height}, fps=4, columns=("frustum", "position", "normal"))
run = tb.evaluate(demo.scene(), settings)
run.table(paper=False)"""
