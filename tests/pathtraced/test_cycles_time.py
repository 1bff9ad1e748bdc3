"""tools/cycles_time: times at equal error from curves of error against time."""

from __future__ import annotations

import importlib.machinery
import importlib.util
import sys

import pytest
from light_transport import FOLDER

TOOLS = FOLDER.parents[2] / "tools"


@pytest.fixture(scope="module")
def tool():
    sys.path.append(str(TOOLS))
    loader = importlib.machinery.SourceFileLoader("cycles_time", str(TOOLS / "cycles_time"))
    spec = importlib.util.spec_from_loader("cycles_time", loader)
    module = importlib.util.module_from_spec(spec)
    sys.modules["cycles_time"] = module  # dataclasses look their module up
    loader.exec_module(module)
    yield module
    sys.path.remove(str(TOOLS))


def curve(tool, seconds_per_sample, error_of_one, power):
    counts = (1, 4, 16, 64)
    return [tool.Point(n, seconds_per_sample * n, error_of_one * n**-power, 0.0) for n in counts]


def test_the_ratio_is_that_of_the_times_at_the_same_error(tool):
    """Errors of 1 / sqrt(samples) and twice that, at equal time per sample: four times the samples."""
    ratios = tool.equal_error(curve(tool, 0.1, 1.0, 0.5), curve(tool, 0.1, 2.0, 0.5), "indirect_pp")
    assert [r[2] for r in ratios[:3]] == pytest.approx([4.0, 4.0, 4.0]) and not any(r[3] for r in ratios[:3])
    assert ratios[3][3] and ratios[3][2] == pytest.approx(1.0), "an error that Cycles does not reach is a lower bound"


def test_errors_above_those_of_cycles_are_left_out(tool):
    ours, cycles = curve(tool, 0.1, 8.0, 0.5), curve(tool, 0.1, 1.0, 0.5)
    assert [(samples, ratio) for samples, _, ratio, _ in tool.equal_error(ours, cycles, "indirect_pp")] == [
        (64, pytest.approx(1 / 64))
    ]
