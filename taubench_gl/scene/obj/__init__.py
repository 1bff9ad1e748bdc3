"""Wavefront OBJ with MTL: one still scene, or a numbered sequence of files as vertex animation."""
