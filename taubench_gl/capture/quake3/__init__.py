"""Recordings (demos), maps and models of the Quake 3 family of games."""
