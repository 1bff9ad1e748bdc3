"""Exports channels as EXR, NPZ, Zarr, in the Sintel layout or as data of learning; frames are written completely."""
