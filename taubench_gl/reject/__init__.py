"""Rejection tests of history, scored against exact visibility: contract, tests/, evaluation, fit (docs/reject.md)."""
