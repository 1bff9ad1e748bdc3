"""tools/compare_checkouts: which differences it reports, and a comparison of this checkout with itself."""

from __future__ import annotations

import importlib.util
import sys
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
TOOL = ROOT / "tools" / "compare_checkouts"


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    loader = SourceFileLoader("compare_checkouts", str(TOOL))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(loader.name, loader))
    sys.modules[loader.name] = module
    loader.exec_module(module)
    return module


def result(exit_code: int = 0, **values: Any) -> dict[str, Any]:
    return {
        "exit": exit_code,
        "error": "",
        "values": {name.replace("__", "/"): value for name, value in values.items()},
    }


def found(tool: ModuleType, old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    return [path for path, _ in tool.differences(tool.Case("case", ()), old, new)]


def test_changed_missing_and_added_values_are_differences(tool):
    old = result(summary__pairs=3, summary__gone=1, masks__1__mask="a")
    new = result(summary__pairs=4, summary__new=1, masks__1__mask="a")
    assert found(tool, old, new) == ["summary/gone", "summary/new", "summary/pairs"]
    assert found(tool, old, old) == []


def test_exit_codes_are_compared(tool):
    assert found(tool, result(2), result(0)) == ["exit"]
    assert found(tool, result(2), result(2)) == []
    assert found(tool, result(1), result(1)) == ["exit"], "an internal error is never expected"


def test_text_and_volatile_values_are_not_compared(tool):
    old = result(summary__discard__color__reason="no light", summary__timing__passes__masks=1.0)
    new = result(summary__discard__color__reason="the scene has no light", summary__timing__passes__masks=2.0)
    assert found(tool, old, new) == []
    assert found(tool, old, result(summary__discard__color__reason="")) == ["summary/discard/color/reason"]
