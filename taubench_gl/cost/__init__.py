"""Accuracy against time: mask errors and times of declared configurations, and their Pareto front.

>>> from taubench_gl.cost import cost
>>> study = cost("scene.glb", width=480, height=270, out="study", within=0.5)  # doctest: +SKIP
>>> print(*study.answer(), sep="\n")  # doctest: +SKIP

parameters -> configurations -> pixels, reference, errors, timing -> records -> analysis -> result; ``study``
runs them in order.
"""

from taubench_gl.cost.analysis import Point, choose, pareto_front
from taubench_gl.cost.configurations import Configuration, make_plan
from taubench_gl.cost.parameters import PARAMETERS, Parameter
from taubench_gl.cost.result import CostStudy
from taubench_gl.cost.study import cost
from taubench_gl.preset import load_preset, save_preset

__all__ = [
    "PARAMETERS",
    "Configuration",
    "CostStudy",
    "Parameter",
    "Point",
    "choose",
    "cost",
    "load_preset",
    "make_plan",
    "pareto_front",
    "save_preset",
]
