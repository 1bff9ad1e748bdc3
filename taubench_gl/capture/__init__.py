"""Recorded games become scenes: readers of recordings, the model that they share, and the glTF file made of it."""
