"""What accuracy costs in time: settings turned one by one, their errors and times side by side, and which to use.

>>> from taubench_gl.cost import cost
>>> study = cost("scene.glb", width=480, height=270, out="study", within=0.5)  # doctest: +SKIP
>>> study.table()  # doctest: +SKIP

Knobs (what may be turned) > plan (which settings) > errors and sessions (what is measured) > store (what is kept) >
column_errors, analysis and result (what it says) > forecast, gaps, search and laps (what else to measure, until the
fronts are full) > explain (why a finer dial may err more) > job (all of it in order).
"""

from taubench_gl.cost.analysis import Point, choose, pareto_front
from taubench_gl.cost.parameters import KNOBS, Knob
from taubench_gl.cost.plan import Setting, make_plan
from taubench_gl.cost.preset import load_preset, save_preset
from taubench_gl.cost.result import CostStudy
from taubench_gl.cost.study import cost

__all__ = [
    "KNOBS",
    "CostStudy",
    "Knob",
    "Point",
    "Setting",
    "choose",
    "cost",
    "load_preset",
    "make_plan",
    "pareto_front",
    "save_preset",
]
