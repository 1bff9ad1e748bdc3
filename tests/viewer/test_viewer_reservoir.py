"""The reservoir of a method that samples lights at the probed pixel."""

from __future__ import annotations

import re

import numpy as np
import pytest
from fixed import fixed_settings
from viewer_tools import DEMO

from taubench_gl.viewer import comparisons

pytestmark = pytest.mark.usefixtures("coarse_light")

LIT = fixed_settings(width=24, height=14, indirect="none", exposure=1.0)


def test_the_probe_shows_the_reservoir(drive, monkeypatch):
    """Each pixel has the light, M and visibility of the method's own reports; other methods have no reservoir."""
    monkeypatch.setattr(comparisons, "WARM_UP", 1)
    driven = drive(DEMO, settings=LIT, light=True)
    driven.run(
        "frame 10\nset channel color\nset against method\nset method_input path-traced\nset method restir-di\nkey Z"
    )
    method = driven.engine.comparisons["method"]
    words = np.array([[driven.engine.reservoir_words(driven.state, x, y) for x in range(24)] for y in range(14)])
    reported = method._runner.reported(method._frame)["kept_sample"]
    light, count = reported[..., 0].astype(int), reported[..., 3]
    for (y, x), text in np.ndenumerate(words):
        numbers = [float(n) for n in re.findall(r"\d+", text)]
        assert numbers == ([light[y, x], count[y, x]] if light[y, x] >= 0 else [])
    assert len(set(np.ravel([re.sub(r"[\d.]+", "", text) for text in words.ravel()]))) >= 2
    driven.run("set probe 10,10\nset method accumulate")
    assert driven.engine.reservoir_words(driven.state, 10, 10) is None
