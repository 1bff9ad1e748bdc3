"""What an undisturbed run of the kill tests' study gives."""

from __future__ import annotations

from pathlib import Path

import pytest
from batch_tools import DEMO, SMALL, final_files, write_study

from taubench_gl.batch.run import run_study
from taubench_gl.batch.study import read_study


@pytest.fixture(scope="session")
def reference(tmp_path_factory) -> tuple[Path, dict[str, bytes]]:
    """The kill tests' study, and its files from an undisturbed run in one process."""
    folder = tmp_path_factory.mktemp("reference")
    path = write_study(folder, f'scenes = ["{DEMO}"]\nreprojection = ["camera", "motion"]\nframes = "0:31"\n{SMALL}')
    run_study(read_study(path), folder / "out")
    return path, final_files(folder / "out")
