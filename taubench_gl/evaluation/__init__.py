"""Evaluation: frames of a scene -> masks of every pair -> statistics -> Run.

``scene.plan_scene`` resolves what a run leaves open; ``session`` is the data flow on one page: it owns all that one
evaluation needs and yields its pairs.  ``schedule`` says which frames are drawn and which pairs evaluated, ``pairs``
compares and counts them (``PairEvaluator``), ``tally`` adds them up, ``summary`` makes summary.json.  Images, tables
and plots are views of the Run and of the pairs that ``on_pair`` receives; ``taubench_gl.api.evaluate`` adds them.
Path-traced files: ``pathtraced.evaluation``.
"""

from taubench_gl.evaluation.explain import Explanation
from taubench_gl.evaluation.lighting import (
    LightPlan,
    environment_image,
    file_hashes,
    files_identity,
    light_plan,
    resolve_lighting,
)
from taubench_gl.evaluation.pairs import ChannelPair, Observers, Pair, PairEvaluator
from taubench_gl.evaluation.scene import ScenePlan, evaluate_scene, open_session, plan_scene
from taubench_gl.evaluation.schedule import frame_range, frame_schedule, sampled_pairs
from taubench_gl.evaluation.session import Readback, Session

__all__ = [
    "ChannelPair", "Explanation", "LightPlan", "Observers", "Pair", "PairEvaluator", "Readback", "ScenePlan", "Session",
    "environment_image", "evaluate_scene", "file_hashes", "files_identity", "frame_range", "frame_schedule",
    "light_plan", "open_session", "plan_scene", "resolve_lighting", "sampled_pairs",
]  # fmt: skip
