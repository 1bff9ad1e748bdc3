"""The bench of a reuse evaluation: what is open while frames go by, and the walk over them.

All methods are resident and take each frame in turn, so that what slows the machine for a while slows them all; whose
turn is first changes from frame to frame.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack, Poser
from taubench_gl.errors import GraphicsError, MethodError, SettingsError
from taubench_gl.evaluation import frame_range
from taubench_gl.frame.targets import read_channel
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.reuse.arrays import read_result
from taubench_gl.reuse.classes import CLASSES, classify
from taubench_gl.reuse.contract import Method, Value
from taubench_gl.reuse.evaluate_records import MethodRecord, Shown
from taubench_gl.reuse.frame import FrameInputs
from taubench_gl.reuse.inputs import RasterInputs
from taubench_gl.reuse.inputs_files import FileInputs
from taubench_gl.reuse.inputs_kind import InputKind
from taubench_gl.reuse.inputs_reference import FileReference, MaxReference
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.quality import MEASURES, display
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.run import Progress
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray
SCHEMA = "taubench-gl/reuse/1"
JUDGED_READS = ("mask", "motion", "truth_mask")


@dataclass(frozen=True, slots=True)
class MethodSpec:
    """A method and its settings.  ``label`` names it in every output."""

    label: str
    method: str | Path | type | Method
    settings: Mapping[str, Value | str] = field(default_factory=dict)  # text is read as the method's settings say

    @classmethod
    def parse(cls, text: str) -> MethodSpec:
        """``NAME`` or ``NAME@setting=value@setting=value``; NAME may be a folder or file.  Raises SettingsError."""
        name, *given = text.split("@")
        pairs = [part.partition("=") for part in given]
        if not name or any(not equals or not key for key, equals, _ in pairs):
            raise SettingsError(f"{text!r} names no method", hint="give NAME or NAME@setting=value")
        return cls(text, name, {key.strip(): value for key, _, value in pairs})


@dataclass(frozen=True, slots=True)
class JudgedFrame:
    """One frame while its pictures are in hand.  Arrays (h, w, 3) in [0, 1], error maps (h, w), row 0 at the top."""

    frame: int
    input: Array
    reference: Array
    pictures: Mapping[str, Array]
    errors: Mapping[str, Array]
    rows: Mapping[str, Mapping[str, Any]]


class Bench:
    """Everything that is open during an evaluation."""

    def __init__(
        self,
        gpu: Gpu,
        scene: Scene,
        camera: CameraTrack,
        settings: Settings,
        kind: InputKind,
        specs: Sequence[MethodSpec],
        reference: str,
        samples: int,
        metrics: Collection[str],
        cuts: Collection[int],
        mapping: str | None,
    ):
        self._gpu, self._scene, self._settings = gpu, scene, settings
        self._reference = self._inputs = None
        self.runners: dict[str, MethodRunner] = {}
        self.records: dict[str, MethodRecord] = {}
        self._told: dict[str, dict[str, Any]] = {}
        loaded = self._load(specs, frozenset(metrics))
        self._require(len(loaded) > 0)
        reads = {name for _, method in loaded for name in method.reads} | set(JUDGED_READS)
        try:
            if kind.files is not None:
                if reference == "max":
                    raise SettingsError("path-traced input has no 'max' reference", hint="give --reference exr:DIR")
                self._inputs = FileInputs(
                    gpu, scene, camera, settings, kind, reads, cuts=cuts, truth=reference, mapping=mapping
                )
                self.frames = self._inputs.frames(settings.sequence.frames)
            else:
                poser = Poser(scene)
                self.frames = frame_range(scene, camera, settings)
                self._inputs = RasterInputs(
                    gpu, scene, camera, settings, kind, reads, cuts=cuts, truth=True, poser=poser
                )
            if lost := sorted(set(cuts) - set(self.frames)):
                ends = f"{self.frames[0]} to {self.frames[-1]}"
                raise SettingsError(f"cut {lost[0]} is not among the frames", hint=f"they are {ends}")
            if len(self.frames) < 2:
                raise SettingsError("one frame has no history to reuse", hint="give --frames of two at least")
            if reference == "max":
                self._reference = MaxReference(gpu, scene, camera, settings, kind, samples, poser)
            else:
                self._reference = FileReference(reference, self._inputs.size, self.frames, settings, mapping)
            self._open(loaded)
            self._require(len(self.runners) > 0)
        except BaseException:
            self.release()
            raise
        self._mask_source = "truth" if self._inputs.truth_mask is not None else "geometry"
        for record in self.records.values():
            record.judged = self._mask_source == "truth"

    def _load(self, specs: Sequence[MethodSpec], metrics: frozenset[str]) -> list[tuple[MethodSpec, Method]]:
        loaded = []
        for spec in specs:
            self.records[spec.label] = MethodRecord(spec.label, metrics, True)
            self._told[spec.label] = {"title": None, "cite": [], "settings": None, "memory_bytes": None}
            with self._harmless(spec.label):
                method = load_method(spec.method)
                self._told[spec.label] |= {"title": method.title, "cite": list(method.cite)}
                loaded.append((spec, method))
        return loaded

    def _open(self, loaded: Sequence[tuple[MethodSpec, Method]]) -> None:
        for spec, method in loaded:
            with self._harmless(spec.label):
                values = method_settings(method, spec.settings)
                timer = PassTimer(self._gpu)
                runner = MethodRunner(self._gpu, method, self._inputs.size, values, timer=timer)
                self.runners[spec.label] = runner
                self._told[spec.label] |= {"settings": dict(runner.values), "memory_bytes": runner.bytes}

    def _require(self, some: bool) -> None:
        """MethodError with what ails every method, before anything is drawn or written."""
        if not some:
            raise MethodError("; ".join(str(record.failed) for record in self.records.values()))

    @contextmanager
    def _harmless(self, label: str) -> Iterator[None]:
        """A MethodError, or graphics memory that does not suffice, ends this method alone."""
        try:
            yield
        except (MethodError, GraphicsError) as error:
            self.records[label].failed = str(error)
            runner = self.runners.pop(label, None)
            if runner is not None:
                runner.release()

    def run(self, progress: Callable[[Progress], None] | None, on_frame: Callable[[JudgedFrame], None] | None) -> None:
        self._shading: list[float] = []
        before: Shown | None = None
        for done, frame in enumerate(self.frames):
            if not self.runners:
                return  # nobody is left to watch
            started = time.perf_counter()
            inputs = self._inputs.advance(frame)
            shading = self._inputs.shading_ms()
            if shading is not None and done:
                self._shading.append(shading)
            pictures = self._step_all(inputs, done)
            before = self._judge(frame, inputs, pictures, before, on_frame)
            if progress is not None and done:
                progress(Progress(self._scene.name, done, len(self.frames) - 1, time.perf_counter() - started))

    def _step_all(self, inputs: FrameInputs, turn: int) -> dict[str, Array]:
        """Every method's picture of the frame, (h, w, 4).  The order turns: nobody is always the first."""
        labels = list(self.runners)
        shift = turn % len(labels)
        out = {}
        for label in labels[shift:] + labels[:shift]:
            with self._harmless(label):
                out[label] = read_result(self.runners[label].step(inputs))
        return out

    def _judge(
        self,
        frame: int,
        inputs: FrameInputs,
        pictures: Mapping[str, Array],
        before: Shown | None,
        on_frame: Callable[[JudgedFrame], None] | None,
    ) -> Shown:
        curve = self._settings.lighting.tone_map
        radiance = self._reference.picture(frame)
        finite = np.isfinite(radiance).all(axis=-1)
        reference = _shown(radiance, finite, curve)
        judge = self._inputs.truth_mask or inputs.textures["mask"]
        mask = read_channel(judge, "mask")[..., 0]
        motion = read_channel(self._inputs.truth_motion or inputs.textures["motion"], "motion")
        classes, errors = classify(mask), {}
        shown: dict[str, Shown] = {}
        for label in self.runners:
            picture = pictures[label]
            usable = finite & np.isfinite(picture).all(axis=-1)
            shown[label] = _shown(picture[..., :3], usable, curve)
            errors[label] = self.records[label].add(
                frame, shown[label], picture[..., 3], _masked(reference, usable), before, mask,
                classes, motion, self._time_ms(label), int(np.count_nonzero(~usable)),
            )  # fmt: skip
        if on_frame is not None:
            given = read_result(inputs.textures["radiance"])[..., :3]
            on_frame(
                JudgedFrame(
                    frame,
                    display(np.nan_to_num(given), curve),
                    reference.colors,
                    {label: s.colors for label, s in shown.items()},
                    errors,
                    {label: self.records[label].rows[-1] for label in shown},
                )
            )
        return reference

    def _time_ms(self, label: str) -> float | None:
        samples = self.runners[label].timer.samples_ms().get(self.runners[label].method.name)
        return None if samples is None or not len(samples) else float(samples[-1])

    def summary(self) -> dict[str, Any]:
        scene, settings = self._scene, self._settings.replace(width=self._inputs.size[0], height=self._inputs.size[1])
        methods = {label: self._told[label] | record.summary() for label, record in self.records.items()}
        clock = PassTimer.clock
        shading = float(np.median(self._shading)) if getattr(self, "_shading", None) else None
        return {
            "schema": SCHEMA,
            "scene": {"name": scene.name, "path": None if scene.path is None else str(scene.path),
                      "sha256": scene.sha256, "stand_in": scene.stand_in},
            "settings": settings.as_summary(self.frames),
            "frames": len(self.frames),
            "judged_frames": len(self.frames) - 1,
            "input": self._inputs.describe() | {"shading_ms": shading, "clock": clock},
            "reference": self._reference.describe(),
            "judged_by": self._mask_source,
            "measures": {m.name: {"unit": m.unit, "better": m.better, "doc": m.doc} for m in MEASURES.values()},
            "classes": {name: doc for name, (_, doc) in CLASSES.items()},
            "clock": clock,
            "methods": methods,
        }  # fmt: skip

    def release(self) -> None:
        for runner in self.runners.values():
            runner.release()
        for part in (self._inputs, self._reference):
            if part is not None:
                part.release()


def method_settings(method: Method, given: Mapping[str, Value | str]) -> dict[str, Value]:
    """``given`` with text read as the settings of ``method`` say.  Raises MethodError, also for unknown names."""
    out: dict[str, Value] = {}
    for name, value in given.items():
        setting = method.settings.get(name)
        text = isinstance(value, str) and setting is not None and setting.kind != "choice"
        try:
            out[name] = setting.parse(value) if text else value
        except MethodError as error:
            raise MethodError(error.what, where=method.label) from None
    return method.values(out)


def _shown(radiance: Array, usable: Array, curve: str) -> Shown:
    """Radiance with what is not ``usable`` black, and as it is shown."""
    radiance = np.where(usable[..., None], radiance, 0.0)
    return Shown(radiance, display(radiance, curve), usable)


def _masked(shown: Shown, usable: Array) -> Shown:
    """Black where a picture beside it is not usable, so that such a pixel counts as no error; it is counted apart."""
    if usable.all():
        return shown
    keep = usable[..., None]
    return Shown(np.where(keep, shown.radiance, 0.0), np.where(keep, shown.colors, 0.0), usable)
