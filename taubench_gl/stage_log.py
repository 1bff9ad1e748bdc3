"""Log records about work that may take minutes, which the command line shows while it goes on (``apps.stages``)."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator

LASTING, SHARE = "lasting", "share"
"""Attributes of a log record: True where such work begins, False where it ends; the share of it that is done."""


@contextlib.contextmanager
def lasting(log: logging.Logger, text: str, *values: object) -> Iterator[Callable[[float], None]]:
    """Log work that may take minutes: ``text`` with its ``values`` at level INFO, and its end at level DEBUG.

    What the block gets takes the share of the work that is done, 0 to 1, from which the time left is estimated.
    """
    log.info(text, *values, extra={LASTING: True})
    try:
        yield lambda share: log.debug(text, *values, extra={SHARE: share})
    finally:
        log.debug("done", extra={LASTING: False})
