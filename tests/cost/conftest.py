from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # cost_tools: helpers shared by the tests of this folder

DEMO = Path(__file__).resolve().parents[2] / "assets" / "demo.glb"


@pytest.fixture(scope="session")
def demo() -> Path:
    return DEMO


@pytest.fixture(scope="session")
def small_study(tmp_path_factory, demo):
    """A finished study of the demo scene's geometry: folder and CostStudy, saved."""
    from cost_tools import SMALL

    from taubench_gl.cost import cost

    out = tmp_path_factory.mktemp("study")
    study = cost(demo, out=out, **SMALL)
    study.save()
    return out, study
