"""Path-traced files: OpenEXR sequences evaluated like rendered scenes, and reference images rendered with Cycles.

Data flow: ``exr`` reads one file, ``passes`` converts its channels to canonical quantities, ``sequence`` finds the
files of all frames, ``cameras`` (with ``fit``) gives their views, ``source`` uploads them as channels, ``evaluation``
compares the frames of each pair.  ``check`` finds wrong conventions, ``compare`` compares a run with a reference run,
``references`` stores frames that this package traces itself, ``blender`` runs Cycles and converters apart.

Reading, cameras, checks and comparison work without OpenGL; ``source``, ``evaluation`` and ``references`` need it.
"""
