"""The paper's equations in NumPy float64, without OpenGL.

A *reference* is a plain float64 function that computes what one shader computes.  A test runs both and compares them.
The header of each shader names its reference; those that only tests run are in tests/references.
"""
