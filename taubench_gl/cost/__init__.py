"""Seconds for a table against the error of its columns, and which configuration to use.

>>> from taubench_gl.cost import cost
>>> print(*cost("scene.glb", size="480x270", out="study")["lines"], sep="\\n")  # doctest: +SKIP

configurations -> unit (one evaluation) -> choice (errors, Pareto front, recommendations); ``study`` runs them in order.
"""

from taubench_gl.cost.study import cost

__all__ = ["cost"]
