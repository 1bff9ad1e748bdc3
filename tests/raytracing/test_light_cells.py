"""The grid by which one of many lights is chosen: its probabilities, and light of listed pixels without noise."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from test_path_tracing import SIZE, render, room

from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.metrics.stochastic import CELL_UNIFORM_SHARE, LightCells, cell_choice
from taubench_gl.settings import FIXED_LIGHTING, Settings


def lamps(count: int, seed: int = 3):
    """Positions, powers, ranges and whether light falls off, of every kind of light."""
    rng = np.random.default_rng(seed)
    ranges = np.where(rng.random(count) < 0.7, rng.uniform(0.3, 3.0, count), 0.0)
    return rng.uniform(-1.0, 6.0, (count, 3)), rng.lognormal(0.0, 2.0, count), ranges, rng.random(count) < 0.8


def test_probabilities_of_a_cell():
    grid, of = LightCells.of_box(np.zeros(3), np.array([5.0, 3.0, 4.0]), 60), lamps(40)
    assert np.prod(grid.counts) <= 60 and np.all(grid.low < 0.0)
    assert np.all(grid.low + grid.side * np.array(grid.counts) >= [5.0, 3.0, 4.0])
    importance = grid.importance(*of)
    first, entries = cell_choice(importance)
    assert len(first) == 2 + np.prod(grid.counts) and first[-1] == len(entries) == np.count_nonzero(importance)
    for row, (a, b) in enumerate(pairwise(first.tolist())):
        cumulative, lights = entries[a:b, 0].astype(np.float64), entries[a:b, 1].astype(int)
        found, weight = np.diff(cumulative, prepend=0.0), importance[row, lights]
        assert np.array_equal(lights, np.flatnonzero(importance[row])) and cumulative[-1] == 1.0
        expected = (1.0 - CELL_UNIFORM_SHARE) * weight / weight.sum() + CELL_UNIFORM_SHARE / len(lights)
        np.testing.assert_allclose(found, expected, atol=1e-6)
        assert found.min() > 0.5 * CELL_UNIFORM_SHARE / len(lights), "every light that may contribute can be chosen"
    assert np.array_equal(importance[0], of[1]), "outside of the grid by power"


def test_lights_left_out_of_a_cell_do_not_reach_it():
    """Only lights of its cell are within range of a random point; importance is power over squared distance."""
    grid, (positions, power, ranges, faded) = LightCells.of_box(np.zeros(3), np.full(3, 5.0), 100), lamps(60, 7)
    importance = grid.importance(positions, power, ranges, faded)
    points = np.random.default_rng(1).uniform(0.0, 5.0, (4000, 3))
    cell = 1 + np.ravel_multi_index(tuple(np.floor((points - grid.low) / grid.side).astype(int).T), grid.counts)
    away = np.linalg.norm(points[:, None] - positions, axis=2)
    reached = (ranges == 0.0) | (away < ranges)
    assert np.all(importance[cell][reached] > 0.0) and np.any(importance[cell] == 0.0)
    center = grid.low + grid.side * (np.stack(np.unravel_index(cell - 1, grid.counts), axis=1) + 0.5)
    far = (ranges == 0.0) & faded & (np.linalg.norm(center[:, None] - positions, axis=2) > grid.side)
    squared = np.sum((center[:, None] - positions) ** 2, axis=2)
    np.testing.assert_allclose(importance[cell][far], (power / squared)[far], rtol=1e-9)


def test_cells_without_light_and_without_lights():
    first, entries = cell_choice(np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 0.0], [1.0, 3.0]]))
    assert first.tolist() == [0, 0, 1, 1, 3] and entries.tolist() == [[1.0, 0.0], [0.3125, 0.0], [1.0, 1.0]]
    first, entries = cell_choice(np.zeros((2, 0)))
    assert first.tolist() == [0, 0, 0] and entries.shape == (0, 2)


@pytest.mark.parametrize("bounces", [1, 3])
def test_listed_pixels_have_every_light(gpu, bounces):
    """Direct light of 24 lights at listed pixels: equal in all samples, and that of an image with exact light."""
    scene = room(lights=24)
    exact = render(gpu, scene, spp=6, bounces=1)["direct"][..., :3]
    options = {**FIXED_LIGHTING, "light": "path-traced", "columns": ("direct", "indirect"), "pattern": "independent"}
    settings = Settings(width=SIZE[0], height=SIZE[1], **options, spp=1, bounces=bounces)
    at = np.argwhere(np.full(SIZE[::-1], True))[:, ::-1]
    with RasterSource(gpu, AnimatedScene(scene), settings, pixel_list=True) as source:
        source.draw(0)
        light = source.listed_light(0, at, at, range(4), drawn=True)
        direct = [k for k, name in enumerate(source.listed_lobes) if name.startswith("direct")]
    listed = light[:, :, direct].sum(axis=2)
    assert np.array_equal(listed, np.broadcast_to(listed[:, :1], listed.shape))
    np.testing.assert_allclose(listed[:, 0].reshape(exact.shape), exact, rtol=1e-5, atol=1e-6)
    assert np.any(light[:, 0] != light[:, 1]) == (bounces > 1)
