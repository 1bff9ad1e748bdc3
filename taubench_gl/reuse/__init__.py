"""Temporal reuse methods: the contract, the shipped methods, what they are fed and how they are judged."""
