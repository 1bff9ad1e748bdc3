"""Log records about work that may take minutes, which the command line shows while it goes on (``apps.stages``)."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator
from contextvars import ContextVar

LASTING, SHARE = "lasting", "share"
"""Attributes of a log record: True where such work begins, False where it ends; the share of it that is done."""


_logged: ContextVar[Callable[[float], None]] = ContextVar("logged", default=lambda share: None)
"""Logs the share of the innermost work that goes on."""


@contextlib.contextmanager
def lasting(log: logging.Logger, text: str, *values: object) -> Iterator[None]:
    """Log work that may take minutes: ``text`` with its ``values`` at level INFO, and its end at level DEBUG."""
    log.info(text, *values, extra={LASTING: True})
    token = _logged.set(lambda share: log.debug(text, *values, extra={SHARE: share}))
    try:
        yield
    finally:
        _logged.reset(token)
        log.debug("done", extra={LASTING: False})


def progressed(share: float) -> None:
    """Log the share of the innermost ``lasting`` work that is done, 0 to 1, from which the time left is estimated."""
    _logged.get()(share)
