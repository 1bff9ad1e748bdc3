"""Float64 references of shaders that only tests run: each computes what one shader computes, and a test runs both.

Those that the package uses itself are in taubench_gl/metrics.  The header of each shader names its reference.
"""
