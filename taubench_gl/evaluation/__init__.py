"""Evaluation: frames of a scene -> masks of every pair -> statistics -> Run.

``session`` is the data flow on one page: it owns all that one evaluation needs and yields its pairs.  ``schedule`` says
which frames are drawn and which pairs evaluated, ``pairs`` compares and counts them (``PairEvaluator``), ``summary``
assembles summary.json.  Images, tables and plots are views of
the Run and of the pairs that ``on_pair`` receives; ``taubench_gl.api.evaluate`` adds them.
Path-traced files: ``pathtraced.evaluation``.
"""

from taubench_gl.evaluation.brightness import Brightness, checked_frames, describe_brightness
from taubench_gl.evaluation.exact import ExactColumns, exact_channels
from taubench_gl.evaluation.explain import Explanation
from taubench_gl.evaluation.lighting import (
    ResolvedLighting,
    environment_image,
    file_hashes,
    files_identity,
    resolve_lighting,
)
from taubench_gl.evaluation.lobes import (
    LobeColumns,
    missing_of_scene,
    require_lobes,
    scene_channels,
    scene_lobes,
    summarize_lobes,
)
from taubench_gl.evaluation.pairs import (
    ChannelPair,
    EvaluatedPair,
    Observers,
    Pair,
    PairEvaluator,
)
from taubench_gl.evaluation.sampled_light import LightVisits, SampledLight, decides_light, preview_notes
from taubench_gl.evaluation.scale import describe_scale
from taubench_gl.evaluation.scene import SceneInput, evaluate_scene, open_scene, open_session, require_triangles
from taubench_gl.evaluation.schedule import (
    frame_range,
    frame_schedule,
    frame_total,
    pair_schedule,
    sampled_pairs,
)
from taubench_gl.evaluation.session import Session, Wants, camera_row, frame_columns
from taubench_gl.evaluation.summary import assemble_summary, finish_run, mark_cuts, scene_facts

__all__ = [
    "Brightness",
    "ChannelPair",
    "EvaluatedPair",
    "ExactColumns",
    "Explanation",
    "LightVisits",
    "LobeColumns",
    "Observers",
    "Pair",
    "PairEvaluator",
    "ResolvedLighting",
    "SampledLight",
    "SceneInput",
    "Session",
    "Wants",
    "assemble_summary",
    "camera_row",
    "checked_frames",
    "decides_light",
    "describe_brightness",
    "describe_scale",
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
    "mark_cuts",
    "missing_of_scene",
    "open_scene",
    "open_session",
    "pair_schedule",
    "preview_notes",
    "require_lobes",
    "require_triangles",
    "resolve_lighting",
    "sampled_pairs",
    "scene_channels",
    "scene_facts",
    "scene_lobes",
    "summarize_lobes",
]
