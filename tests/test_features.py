"""The feature table: its records agree with the reason bits."""

from __future__ import annotations

from taubench_gl.conventions import FRUSTUM, NOT_COMPARABLE, Reason
from taubench_gl.features import COUNTED_BITS, TABLE


def test_the_bits_of_the_table_are_those_of_the_reason_word() -> None:
    bits = [int(bit) for feature in TABLE for bit in (feature.bit, *feature.details)]
    rest = NOT_COMPARABLE | FRUSTUM | Reason.SKY | Reason.HISTORY_SKY
    assert len(set(bits)) == len(bits)
    assert sum(bits) + int(rest) == sum(map(int, Reason)) == (1 << COUNTED_BITS) - 1
