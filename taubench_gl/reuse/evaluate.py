"""Reuse methods side by side: the same frames to all of them, one reference, every picture judged.

``evaluate_methods`` asks for it; the frames are walked in ``evaluate_bench``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from taubench_gl.animation import CameraTrack, choose_camera
from taubench_gl.errors import SettingsError
from taubench_gl.gpu.context import open_gpu
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.provenance import provenance
from taubench_gl.reuse.evaluate_bench import SCHEMA, Bench, JudgedFrame, MethodSpec, method_settings
from taubench_gl.reuse.inputs_kind import InputKind, parse_input
from taubench_gl.reuse.quality import CHOICES
from taubench_gl.run import Progress
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

__all__ = ["SCHEMA", "Evaluation", "JudgedFrame", "MethodSpec", "evaluate_methods", "method_settings"]


NEEDS = {"ssim": ("skimage", "scikit-image"), "flip": ("flip_evaluator", "flip-evaluator")}
"""Metrics that other packages compute: module and package."""


@dataclass(frozen=True, slots=True)
class Evaluation:
    """``summary``: reuse.json (schema ``SCHEMA``); ``rows``: frames.csv, one per frame and method."""

    summary: dict[str, Any]
    rows: list[dict[str, Any]]

    @property
    def failed(self) -> dict[str, str]:
        """Label -> one line, of methods that could not be run to the end."""
        return {label: m["failed"] for label, m in self.summary["methods"].items() if m["failed"]}


def evaluate_methods(
    scene: Scene | str | Path,
    methods: Sequence[str | MethodSpec],
    settings: Settings | None = None,
    *,
    input: str | InputKind = "full",
    reference: str = "max",
    reference_samples: int = 16,
    metrics: Collection[str] = CHOICES,
    cuts: Collection[int] = (),
    mapping: str | None = None,
    camera: CameraTrack | None = None,
    progress: Callable[[Progress], None] | None = None,
    on_frame: Callable[[JudgedFrame], None] | None = None,
) -> Evaluation:
    """Run ``methods`` over the frames of ``scene`` and judge every picture.

    ``input`` as ``parse_input`` reads it; ``reference``: ``max`` (our own best, ``reference_samples`` per pixel) or
    ``exr:DIR``; ``metrics`` of quality.CHOICES; ``cuts``: frames declared to have no history; ``mapping``: names of the
    passes of EXR files.  A method that fails is told of in ``Evaluation.failed`` and harms no other.  Raises
    TaubenchError for what stops them all, and where no method can be run at all.
    """
    settings = settings or Settings.of(reprojection="motion")
    kind = parse_input(input) if isinstance(input, str) else input
    specs = [MethodSpec.parse(m) if isinstance(m, str) else m for m in methods]
    check_request(specs, metrics, reference)
    if not isinstance(scene, Scene):
        scene = load_scene(scene, scene=settings.sequence.scene, animation=settings.sequence.animation)
    camera = camera or choose_camera(scene, settings.sequence.camera)
    gpu = open_gpu(settings.device.backend, settings.device.device)
    with gpu:
        bench = Bench(gpu, scene, camera, settings, kind, specs, reference, reference_samples, metrics, cuts, mapping)
        try:
            bench.run(progress, on_frame)
            gpu.check("reuse evaluation")
            summary = bench.summary() | {"provenance": provenance(gpu, PassTimer.clock)}
            rows = [row for step in zip(*(r.rows for r in bench.records.values() if not r.failed)) for row in step]
        finally:
            bench.release()
            gpu.collect()
    return Evaluation(summary, rows)


def check_request(specs: Sequence[MethodSpec], metrics: Collection[str], reference: str) -> None:
    """Raises SettingsError for a request that cannot be meant."""
    labels = [spec.label for spec in specs]
    if not labels:
        raise SettingsError("no method was named", hint="see 'taubench-gl reuse list'")
    if len(set(labels)) < len(labels):
        twice = next(label for label in labels if labels.count(label) > 1)
        raise SettingsError(f"method {twice!r} is named twice", hint="give it other settings, NAME@setting=value")
    for name in metrics:
        if name not in CHOICES:
            raise SettingsError(f"no metric is named {name!r}", hint=f"choose from {', '.join(CHOICES)}")
        module, package = NEEDS.get(name, ("", ""))
        if module and find_spec(module) is None:
            hint = f"pip install 'taubench-gl[reuse]', or choose others than {name}, such as psnr,relmse"
            raise SettingsError(f"metric {name} needs {package}", hint=hint)
    if reference != "max" and not is_sequence(reference):
        raise SettingsError(f"reference is {reference!r}", hint="give max or exr:DIR")
