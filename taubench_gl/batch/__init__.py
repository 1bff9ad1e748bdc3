"""Batches: a batch spec (TOML) in, a folder of results out, independent of engine and machine."""
