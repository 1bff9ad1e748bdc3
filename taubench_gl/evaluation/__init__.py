"""Evaluation: frames of a scene -> masks of every pair -> statistics -> Run.

``session`` is the data flow on one page: it owns all that one evaluation needs and yields its pairs.  ``schedule`` says
which frames are drawn and which pairs evaluated, ``pairs`` compares and counts them (``PairEvaluator``), ``summary``
assembles summary.json.  Images, tables and plots are views of
the Run and of the pairs that ``on_pair`` receives; ``taubench_gl.api.evaluate`` adds them.
Path-traced files: ``pathtraced.evaluation``.
"""

from taubench_gl.evaluation.brightness import Brightness, checked_frames
from taubench_gl.evaluation.exact import ExactColumns, exact_channels
from taubench_gl.evaluation.explain import Explanation
from taubench_gl.evaluation.lighting import (
    LightPlan,
    ResolvedLighting,
    environment_image,
    file_hashes,
    files_identity,
    light_plan,
    resolve_lighting,
)
from taubench_gl.evaluation.lobes import (
    LobeColumns,
    missing_of_scene,
    require_lobes,
    scene_channels,
)
from taubench_gl.evaluation.pairs import (
    ChannelPair,
    EvaluatedPair,
    Observers,
    Pair,
    PairEvaluator,
)
from taubench_gl.evaluation.sampled_light import LightVisits
from taubench_gl.evaluation.scene import ScenePlan, evaluate_scene, open_session, plan_scene, require_triangles
from taubench_gl.evaluation.schedule import (
    frame_range,
    frame_schedule,
    frame_total,
    pair_schedule,
    sampled_pairs,
)
from taubench_gl.evaluation.session import Readback, Session, frame_columns
from taubench_gl.evaluation.summary import finish_run, mark_cuts, static_summary
from taubench_gl.evaluation.tally import Tally

__all__ = [
    "Brightness",
    "ChannelPair",
    "EvaluatedPair",
    "ExactColumns",
    "Explanation",
    "LightPlan",
    "LightVisits",
    "LobeColumns",
    "Observers",
    "Pair",
    "PairEvaluator",
    "Readback",
    "ResolvedLighting",
    "ScenePlan",
    "Session",
    "Tally",
    "checked_frames",
    "environment_image",
    "evaluate_scene",
    "exact_channels",
    "file_hashes",
    "files_identity",
    "finish_run",
    "frame_columns",
    "frame_range",
    "frame_schedule",
    "frame_total",
    "light_plan",
    "mark_cuts",
    "missing_of_scene",
    "open_session",
    "pair_schedule",
    "plan_scene",
    "require_lobes",
    "require_triangles",
    "resolve_lighting",
    "sampled_pairs",
    "scene_channels",
    "static_summary",
]
