"""Log records about work that may take minutes, which the command line shows while it goes on (``apps.stages``)."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator

LASTING = "lasting"
"""Attribute of a log record: True where such work begins, False where it ends."""


@contextlib.contextmanager
def lasting(log: logging.Logger, text: str, *values: object) -> Iterator[None]:
    """Log work that may take minutes: ``text`` with its ``values`` at level INFO, and its end at level DEBUG."""
    log.info(text, *values, extra={LASTING: True})
    try:
        yield
    finally:
        log.debug("done", extra={LASTING: False})
