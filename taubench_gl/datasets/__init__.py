"""Scenes by name, procedural stand-ins for the paper's scenes, generated cameras, and writers of glTF files."""
