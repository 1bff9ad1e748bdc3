"""docs/hard-cases.md says what the cases say."""

from __future__ import annotations

from taubench_gl.selftest import cases
from taubench_gl.selftest.case import GROUPS
from taubench_gl.selftest.doc import PATH, TITLES, page


def test_the_page_is_up_to_date():
    assert PATH.read_text(encoding="utf-8") == page(), "run: python -m taubench_gl.selftest.doc"


def test_every_group_has_cases_and_a_title():
    assert {c.group for c in cases()} == set(GROUPS) == set(TITLES)


def test_every_case_says_all_it_should():
    for one in cases():
        for text in (one.what, one.elsewhere, one.here, one.source):
            assert len(text) > 10 and "\n" not in text, one.name
        assert 0 <= one.tolerance < 100, one.name
