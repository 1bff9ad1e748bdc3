"""The results of an uninterrupted run of the batch that the kill tests interrupt."""

from __future__ import annotations

from pathlib import Path

import pytest
from batch_tools import DEMO, SMALL, final_files, write_spec

from taubench_gl.batch.spec import read_spec
from taubench_gl.batch.study import run_batch


@pytest.fixture(scope="session")
def reference(tmp_path_factory) -> tuple[Path, dict[str, bytes]]:
    """The spec of the kill tests, and the files of an uninterrupted run in one process."""
    folder = tmp_path_factory.mktemp("reference")
    path = write_spec(folder, f'scenes = ["{DEMO}"]\nreprojection = ["camera", "motion"]\nframes = "0:16"\n{SMALL}')
    run_batch(read_spec(path), folder / "out")
    return path, final_files(folder / "out")
