"""How numbers are added up: exactly in integers, or in float32, plainly or with compensation.

Table 4 sums pixel counts over the pairs of a sequence.  A float32 holds integers up to 2^24 = 16,777,216 exactly; a sum
beyond that rounds at every step, a few frames into a 1080p run.  The engine counts in integers; the other two are here
to be measured against it.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def total(values: Array, how: str = "integer") -> float:
    """Sum of counts (n,) integers.

    ``integer``: int64, exact.  ``plain``: one float32 accumulator, in order; relative error up to (n - 1) 2^-24
    (Higham 2002, Eq. 4.4).  ``compensated``: float32 with the running compensation of Neumaier (1974), error about
    2^-24 whatever n is.  Raises ValueError for another name.
    """
    values = np.asarray(values)
    if how == "integer":
        return float(values.astype(np.int64).sum())
    terms = values.astype(np.float32)
    if how == "plain":
        return float(np.cumsum(terms, dtype=np.float32)[-1]) if len(terms) else 0.0  # cumsum adds one after another
    if how != "compensated":
        raise ValueError(f"no summation is named {how!r}")
    running = lost = np.float32(0)
    for term in terms:
        after = np.float32(running + term)
        larger, smaller = (running, term) if abs(running) >= abs(term) else (term, running)
        lost = np.float32(lost + np.float32(np.float32(larger - after) + smaller))
        running = after
    return float(np.float32(running + lost))
