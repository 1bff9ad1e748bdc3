"""Path-traced references with Blender's Cycles, in a process of its own: this package never imports bpy.

``render.render_reference`` is the way in; ``inside.py`` is what runs in the other process and imports nothing of ours.
"""
