"""Parameters that repeat what the first of them proves."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def few(values: Iterable[Any], keep: int = 1) -> list[Any]:
    """``values``, all but the first ``keep`` for ``tools/test --long`` alone.  A tuple is of several arguments."""
    return [
        pytest.param(*(v if isinstance(v, tuple) else (v,)), marks=pytest.mark.long if k >= keep else ())
        for k, v in enumerate(values)
    ]
