"""Exports channels as EXR, NPZ, Zarr or the Sintel layout; every frame is written completely or not at all."""
