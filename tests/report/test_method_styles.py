"""Methods differ in plots, also for color-blind readers, and look the same on every page."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from vision_tools import SIGHTS, oklab

from taubench_gl.report.method_styles import ALL, BUILTIN, method_styles
from taubench_gl.reuse.loading import builtin_methods

MINIMUM = 0.05
"""Smallest OKLab distance, as in test_palette."""


def rgb(color):
    return [int(color[i : i + 2], 16) for i in (1, 3, 5)]


def test_every_built_in_method_has_a_style_of_its_own():
    assert set(BUILTIN) == set(builtin_methods())
    assert len(set(BUILTIN.values())) == len(BUILTIN)


@pytest.mark.parametrize("sight", SIGHTS)
def test_any_two_methods_differ_in_color_or_line(sight):
    for a, b in itertools.combinations([BUILTIN["none"], *ALL], 2):
        distance = np.linalg.norm(oklab(rgb(a.color), sight) - oklab(rgb(b.color), sight))
        assert distance >= MINIMUM or (a.line != b.line and a.marker != b.marker), f"{a}, {b}: {distance:.3f}"


def test_a_style_does_not_depend_on_the_other_methods():
    few, many = method_styles(["svgf", "mine"]), method_styles(["none", *builtin_methods()[::-1], "mine"])
    assert few["svgf"] == many["svgf"] and few["mine"] == many["mine"]
    own = [f"mine@alpha={i}" for i in range(len(ALL) + 1 - len(BUILTIN))]  # as many as there are other styles
    assert len(set(method_styles([*builtin_methods(), *own]).values())) == len(builtin_methods()) + len(own)
    assert len(method_styles(own * 4)) == len(own) and len(method_styles([f"m{i}" for i in range(99)])) == 99
