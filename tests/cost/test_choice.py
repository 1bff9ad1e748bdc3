"""Errors, Pareto front and recommendations of cost studies by closed forms and laws; no GPU."""

from __future__ import annotations

import math
import random
import shlex

import pytest

from taubench_gl.apps.cli import cli
from taubench_gl.cost.choice import (
    MARGIN,
    SAME,
    Point,
    combined,
    comparable,
    deciding_wins,
    errors_of,
    half_width,
    pareto_front,
    preview_enough,
    within_error,
    within_seconds,
)
from taubench_gl.cost.configurations import DECIDED, FIXED, PREVIEW, Plan, command_line
from taubench_gl.settings import Settings


def column(percent, low=None, high=None):
    return {"percent": percent, "interval95": None if low is None else [low, high], "reason": None}


def point(name, seconds, error, series=DECIDED, options=0, **more):
    return Point(series, name, options, seconds, error, **more)


def random_points(seed, count=40):
    draw = random.Random(seed)
    return [
        point(str(i), round(10 ** draw.uniform(-1, 2), 1), None if draw.random() < 0.2 else draw.randrange(50) / 10,
              draw.choice((PREVIEW, DECIDED, FIXED)), draw.randrange(3), lacking=())
        for i in range(count)
    ]  # fmt: skip


# ------------------------------------------------------------------------------------------------------------ intervals
def test_the_half_width_is_that_of_the_end_that_is_not_cut():
    assert half_width(column(5.0)) == 0.0 and half_width(column(5.0, 4.0, 6.0)) == pytest.approx(1.0)
    assert half_width(column(0.4, 0.0, 1.4)) == pytest.approx(1.0)
    assert half_width(column(99.5, 98.0, 100.0)) == pytest.approx(1.5)


def test_independent_evaluations_combine_to_their_mean_and_a_narrower_interval():
    runs = [{"direct": column(m, m - h, m + h), "position": column(7.0)} for m, h in ((10.0, 3.0), (14.0, 4.0))]
    both = combined(runs)
    assert both["direct"]["percent"] == pytest.approx(12.0)
    assert both["direct"]["half_width"] == pytest.approx(math.hypot(3.0, 4.0) / 2.0)
    assert both["position"] == {"percent": 7.0, "half_width": 0.0, "reason": None}
    equal = combined([{"direct": column(10.0, 8.0, 12.0)}] * 16)
    assert equal["direct"]["half_width"] == pytest.approx(2.0 / 4.0)


TRUTH = combined([{"direct": column(10.0, 9.5, 10.5), "indirect": column(4.0, 3.8, 4.2), "position": column(7.0)}])


def test_a_bias_is_known_as_well_as_the_truth():
    found = errors_of({"direct": column(11.0), "indirect": column(1.0), "position": column(7.0)}, TRUTH)
    assert found["error"] == pytest.approx(3.0 + 0.2)
    assert found["least"] == pytest.approx(3.0 - 0.2) and found["observed"] == pytest.approx(3.0)


def test_decided_samples_are_known_by_their_own_interval():
    columns = {"direct": column(10.3, 9.3, 11.3), "indirect": column(4.0, 2.0, 6.0), "position": column(7.0)}
    found = errors_of(columns, TRUTH)
    assert found["error"] == pytest.approx(2.0) and found["least"] == 0.0 and found["observed"] == pytest.approx(0.3)


def test_an_interval_that_the_truth_contradicts_does_not_count():
    columns = {"direct": column(12.0, 11.0, 13.0), "indirect": column(4.0, 3.9, 4.1), "position": column(7.0)}
    found = errors_of(columns, TRUTH)  # 2 points off, of which the truth may have 0.5
    assert found["error"] == pytest.approx(1.5) == found["least"]


def test_a_column_that_the_truth_lacks_is_not_wanted():
    truth = combined([{"direct": column(10.0, 9.0, 11.0), "indirect": column(None)}])
    assert errors_of({"direct": column(10.0), "indirect": column(None)}, truth)["error"] == pytest.approx(1.0)


# ---------------------------------------------------------------------------------------------------------------- front


@pytest.mark.parametrize("seed", range(5))
def test_no_point_is_below_and_left_of_the_front(seed):
    points = random_points(seed)
    front = pareto_front(points)
    assert front
    for p in comparable(points):
        at_most = [f for f in front if f.seconds <= p.seconds]
        assert p in front or any(f.error <= p.error for f in at_most), "the front is below or left of every point"
    for f in front:
        better = [p for p in comparable(points) if p.seconds <= f.seconds and p.error <= f.error and p is not f]
        assert all((p.seconds, p.error) == (f.seconds, f.error) for p in better), "nothing dominates the front"


# ------------------------------------------------------------------------------------------------------ recommendations
def test_the_most_exact_within_the_seconds_and_the_fastest_within_the_points():
    points = [point("a", 5, 4.0), point("b", 9.0, 1.0), point("c", 9.2, 0.5), point("d", 50, 0.3)]
    assert within_seconds(points, 10.0).name == "b" and within_seconds(points, 60.0).name == "d"
    assert within_error(points, 0.5).name == "c" and within_error(points, 0.3).name == "d"
    assert within_seconds([point("a", 10.0 / MARGIN, 1.0)], 10.0).name == "a"
    assert within_seconds(points, 1.0) is None and within_error(points, 0.1) is None


def test_of_equal_configurations_the_one_with_fewer_options_is_taken():
    points = [point("best", 9.0, 1.0, options=2), point("default", 8.0, SAME, options=0), point("other", 7.0, 2.0)]
    assert within_seconds(points, 10.0).name == "default"
    assert within_seconds([points[0], point("default", 8.0, 1.01 * SAME, options=0)], 10.0).name == "best"
    short = [point("fast", 0.2, 0.4, options=2), point("default", 0.9, 0.4, options=0)]
    assert within_error(short, 0.5).name == "default", "less than a second is no difference"
    slower = [point("fast", 8.0, 0.4, options=2), point("default", 8.0 * SAME, 0.4, options=0)]
    assert within_error(slower, 0.5).name == "default"


@pytest.mark.parametrize("seed", range(5))
def test_what_lacks_a_wanted_column_is_never_recommended(seed):
    draw, points = random.Random(seed), random_points(seed)
    full = {"direct": column(10.0), "indirect": column(4.0), "position": column(7.0)}
    for lacking in ("direct", "indirect", "position"):
        errors = errors_of(full | {lacking: column(None)}, TRUTH)
        assert errors == {"error": None, "lacking": (lacking,)}
        points.insert(draw.randrange(len(points)), Point(PREVIEW, lacking, 0, 0.001, **errors))
    for limit in (0.01, 0.5, 10.0, 1000.0):
        chosen = (within_seconds(points, limit), within_error(points, limit), preview_enough(points))
        assert not any(p is not None and (p.lacking or p.error is None) for p in chosen)
    assert not any(p.lacking for p in pareto_front(points))


def test_deciding_wins_from_the_first_interval_below_every_preview():
    previews = [point("p", 1.0, 3.0, PREVIEW, 1), point("q", 2.0, 2.8, PREVIEW, 2)]
    decided = [point("4", 5.0, 3.5), point("2", 8.0, 1.9), point("1", 20.0, 0.9)]
    assert preview_enough(previews + decided).name == "p", "within the tolerance of q, with fewer options"
    assert deciding_wins(previews + decided).name == "2"
    assert deciding_wins(previews + decided[:1]) is None


# ------------------------------------------------------------------------------------------------------- configurations
def test_the_command_line_gives_the_settings_again():
    """Parsed by the command itself."""
    for baseline in (
        Settings(),
        Settings(size="64x36", frames="3:9", environment=(0.1, 0.2, 0.3), thresholds="normal=0.05", strict=True,
                 columns="direct,indirect", exposure=0.1 + 0.2, animation=("a", "b c"), seed=4),
    ):  # fmt: skip
        for configuration in Plan(baseline, {}).compared:
            settings = configuration.settings(baseline)
            words = shlex.split(command_line("a scene.glb", settings))
            command = cli.commands["evaluate"]
            context = command.make_context("evaluate", words[2:], **cli.context_settings)
            given = {n: v for n, v in context.params.items() if n in settings.to_dict() or n == "size"}
            fields = {name: value for name, value in given.items() if value not in (None, ())}
            fields["thresholds"] = dict(fields.get("thresholds", ()))
            assert words[2] == "a scene.glb" and Settings(**fields) == settings, words


def test_every_configuration_has_its_name_and_what_has_no_effect_is_left_out():
    every = Plan(Settings(), {}).compared
    assert len({c.name for c in every}) == len(every)
    off = {"shadow_size": "no shadows", "spp": "no paths"}
    left = Plan(Settings(), off).compared
    assert not any(c.series == PREVIEW and off.keys() & c.changes.keys() for c in left)
    assert len(left) == len(every) - 3 and {c.series for c in left} == {PREVIEW, FIXED, DECIDED}
