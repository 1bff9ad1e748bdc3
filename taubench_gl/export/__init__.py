"""Channels out: EXR, NPZ, Zarr and the Sintel layout, frame by frame, each whole or not there."""
