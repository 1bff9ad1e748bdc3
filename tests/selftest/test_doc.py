"""docs/hard-cases.md is generated from the cases."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))
from make_hard_cases import TITLES

from taubench_gl.selftest import cases
from taubench_gl.selftest.case import GROUPS


def test_every_group_has_cases_and_a_title():
    assert {c.group for c in cases()} == set(GROUPS) == set(TITLES)


def test_every_case_is_described():
    for one in cases():
        for text in (one.description, one.common_failure, one.source):
            assert 10 < len(text) < 200 and "{" not in text, one.name
        assert 0 <= one.tolerance < 100, one.name
