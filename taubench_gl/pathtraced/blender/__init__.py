"""Blender in its own process: Cycles renders reference images, importers and exporters convert FBX and .blend files.

This process never imports bpy.  ``render_script.py`` and ``convert_script.py`` run in the other one and import nothing
of this package.
"""
