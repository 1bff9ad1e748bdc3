"""Conformance suite: small glTF scenes with known motion, and the score of an engine's frames of them.  No GL."""
