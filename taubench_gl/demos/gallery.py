"""Runs demos and writes their figures and pages to one folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from taubench_gl.demos.demo import Demo, Result
from taubench_gl.demos.lessons import find_demo
from taubench_gl.demos.page import INDEX_FILE, demo_page, index_page
from taubench_gl.demos.stage import SIZE, Stage
from taubench_gl.gpu.context import open_gpu
from taubench_gl.outputs import output_folder, write_atomically


@dataclass(frozen=True, slots=True)
class Shown:
    """A demo with its result and its page."""

    demo: Demo
    result: Result
    page: Path


@contextmanager
def open_stage(size: tuple[int, int] = SIZE, backend: str = "auto", device: int | None = None) -> Iterator[Stage]:
    """A stage on the GPU or CPU driver of this machine, released on exit.  Raises GraphicsError, SettingsError."""
    gpu = open_gpu(backend, device)
    with gpu:
        stage = Stage(gpu, size, device)
        try:
            yield stage
        finally:
            stage.release()
            gpu.collect()


def run_demo(name: str, out: str | Path, size: tuple[int, int] = SIZE) -> Result:
    """Run one demo, given by name or number, and write its figures and page to ``out``.  Raises TaubenchError.

    ``size``: width and height of a panel in pixels.
    """
    chosen = find_demo(name)
    with open_stage(size) as stage:
        return run_demos(stage, [chosen], out)[0].result


def run_demos(
    stage: Stage,
    chosen: Sequence[Demo],
    out: str | Path,
    *,
    index: bool = False,
    on_demo: Callable[[Shown], None] | None = None,
) -> list[Shown]:
    """Run demos in order and write the figures and the page of each to the folder ``out``.

    ``index``: write an index of all as well.  ``on_demo``: called after each demo.  Raises TaubenchError.
    """
    folder = output_folder(out)
    shown: list[Shown] = []
    for i, demo in enumerate(chosen):
        result = demo.run(stage, folder)
        around = (chosen[i - 1] if i else None, chosen[i + 1] if i + 1 < len(chosen) else None)
        page = folder / f"{demo.stem}.html"
        write_atomically(page, demo_page(demo, result, around if index else None))
        shown.append(Shown(demo, result, page))
        if on_demo is not None:
            on_demo(shown[-1])
    if index:
        write_atomically(folder / INDEX_FILE, index_page([(s.demo, s.result) for s in shown]))
    return shown
