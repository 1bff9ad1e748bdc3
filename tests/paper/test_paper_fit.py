"""The fit of the thresholds: least squares in closed form, over datasets only."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taubench_gl.conventions import HISTOGRAM_BINS
from taubench_gl.features import FEATURES
from taubench_gl.metrics.counts import edges
from taubench_gl.paper.fit import fit_threshold, fit_thresholds
from taubench_gl.paper.output import fitted_of
from taubench_gl.paper.scenes import DATASET, STAND_IN, PaperScene
from taubench_gl.paper.study import SceneResult
from taubench_gl.run import Run

PIXELS = 1000


def falling(start, slope):
    """Percent ``start`` - ``slope`` log2(threshold) at thresholds of 1, 2, 4 ... 64."""
    thresholds = 2.0 ** np.arange(7)
    return thresholds, start - slope * np.arange(7)


def test_two_scenes_have_the_least_squares_of_two_lines():
    """60 - 10 x = 30 and 40 - 5 x = 30 in least squares: x = (30 10 + 10 5) / (10^2 + 5^2)."""
    threshold, rates = fit_threshold([falling(60.0, 10.0), falling(40.0, 5.0)], [30.0, 30.0])
    x = 350.0 / 125.0
    assert math.log2(threshold) == pytest.approx(x)
    assert rates == pytest.approx([60.0 - 10.0 * x, 40.0 - 5.0 * x])


def test_a_rate_beyond_the_curve_gives_its_end():
    threshold, rates = fit_threshold([falling(60.0, 10.0)], [99.0])
    assert threshold == pytest.approx(1.0) and rates == pytest.approx([60.0])


def histogram(above):
    """A curve of summary.json with ``above`` pixels between the last two edges and the rest below all edges."""
    counts = np.zeros(HISTOGRAM_BINS, dtype=int)
    counts[0], counts[-2] = PIXELS - above, above
    return {"edges": edges().tolist(), "counts": counts.tolist()}


def summary(**above):
    settings = {"width": PIXELS, "height": 1}
    return {"pairs": 1, "settings": settings, "curves": {name: histogram(pixels) for name, pixels in above.items()}}


def test_features_that_no_run_measured_are_left_out():
    wanted = dict.fromkeys(FEATURES, 20.0)
    fitted = fit_thresholds({"a": (summary(normal=300, direct=200), wanted), "b": (summary(normal=100), wanted)})
    assert list(fitted) == ["normal", "direct"]
    # Between the last two edges the rates fall from 30 and 10 to 0: 30 k - 20 and 10 k - 20 are least at k = 0.8.
    assert fitted["normal"].residuals == pytest.approx({"a": 4.0, "b": -12.0})
    assert fitted["normal"].rms == pytest.approx(math.sqrt(80.0))
    assert fitted["direct"].residuals == pytest.approx({"a": 0.0}, abs=1e-9)


def test_stand_ins_never_enter():
    def result(row, kind):
        scene = PaperScene(row.lower(), row, kind, "x.glb", {}, {})
        return SceneResult(scene, images={"raster": Run(summary(normal=300), [])})

    assert fitted_of([result("Eternal Valley VR", STAND_IN)]) == {}
    both = fitted_of([result("Eternal Valley VR", STAND_IN), result("Bistro Interior", DATASET)])
    assert list(both["normal"].residuals) == ["bistro interior"]
