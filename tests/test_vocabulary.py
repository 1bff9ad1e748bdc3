"""Standard words: code, messages, docs and tests use one word per thing, in American spelling."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from test_architecture import lines_with, texts

BANNED = {
    "told": "reported, recorded",
    "judg(es?|ing|ment)": "classify, evaluate",  # "not judged" is a verdict on frames of other programs
    "rungs?": "method, quality level",
    "ladders?": "series, method",
    "knobs?": "parameter",
    "laps?": "iteration",
    "anew": "again, from scratch",
    "dear(er|est)?(?! imgui)": "expensive",
    "twins?": "float64 reference",
    "soup": "vertex data",
    "inmost": "innermost",
    "whoever": "name the subject",
    "(?!colour_linear)\\w*colour\\w*": "color",  # a tensor of ng-model-gym has this name
    "grey\\w*": "gray",
    "centred?s?": "center",
    "neighbour\\w*": "neighbor",
    "(kilo|centi|milli|micro)?metres?": "meter",
    "(normal|minim|maxim|initial|raster|recogn|optim|serial|visual|quant)is(e[sd]?|ing|ations?)": "-ize",
}
"""Regular expression of a word -> what to write instead."""

PATTERN = re.compile("|".join(rf"\b(?:{word})\b" for word in BANNED), re.IGNORECASE)
SUFFIXES = {".py", ".glsl", ".md", ".toml", ".html", ".js", ".css", ".ipynb", ".sh", ""}
EXEMPT = {
    "CHANGELOG.md",
    "LICENSE",
    "tests/test_vocabulary.py",
}
"""History, and the words themselves."""


def test_no_banned_word():
    of = [(name, text) for name, text in texts() if name not in EXEMPT and Path(name).suffix in SUFFIXES]
    faults = lines_with(PATTERN, of)
    assert not faults, f"{len(faults)} lines\n" + "\n".join(faults)


@pytest.mark.parametrize("word", ["told", "Judges", "judging", "rung", "colour", "coloured", "grey", "centre", "dear"])
def test_banned_words_are_found(word):
    assert PATTERN.search(f"a {word} b")
