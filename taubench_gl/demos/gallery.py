"""Running demos: pictures, pages and notebooks into one folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from taubench_gl.demos.demo import Demo, Result
from taubench_gl.demos.lessons import find_demo
from taubench_gl.demos.page import INDEX_FILE, demo_page, index_page
from taubench_gl.demos.stage import SIZE, Stage
from taubench_gl.errors import OutputError
from taubench_gl.gpu.context import open_gpu
from taubench_gl.outputs import cannot_write, write_atomically


@dataclass(frozen=True, slots=True)
class Shown:
    """A demo that was run, and its page."""

    demo: Demo
    result: Result
    page: Path


@contextmanager
def open_stage(size: tuple[int, int] = SIZE, backend: str = "auto", device: int | None = None) -> Iterator[Stage]:
    """A stage on this machine's GPU or CPU driver, released at the end.  Raises GraphicsError, SettingsError."""
    gpu = open_gpu(backend, device)
    with gpu:
        stage = Stage(gpu, size, device)
        try:
            yield stage
        finally:
            stage.release()
            gpu.collect()


def run_demo(name: str, out: str | Path, size: tuple[int, int] = SIZE) -> Result:
    """Run one demo by name or number; its pictures and its page go into ``out``.  Raises TaubenchError.

    ``size``: pixels of a panel.
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
    """Run demos in order; pictures and a page of each into ``out``, which is made.  ``index``: a page of all as well.

    Raises TaubenchError.
    """
    folder = make_folder(out)
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


def make_folder(out: str | Path) -> Path:
    """``out`` as a folder that exists.  Raises OutputError."""
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise OutputError("is not a folder", where=str(folder), hint="give --out another name") from None
    except OSError as error:
        raise cannot_write(folder, error) from None
    return folder
