"""Evaluation of reuse methods: equal frames for all methods, one reference, scores of every image.

All methods are resident and process each frame in turn, so that a temporary slowdown of the machine affects all of
them.  The order rotates from frame to frame.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack, Poser, camera_of_run
from taubench_gl.effects.census import census
from taubench_gl.effects.lighting import as_rendered
from taubench_gl.errors import GraphicsError, MethodError, SettingsError
from taubench_gl.evaluation import plan_scene
from taubench_gl.evaluation.owner import GpuOwner, opened_gpu
from taubench_gl.features import COLUMNS
from taubench_gl.fields import from_values
from taubench_gl.frame.targets import read_channel, write_channel
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.option_groups import ReuseOptions
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.provenance import provenance
from taubench_gl.reuse.bound import Blended
from taubench_gl.reuse.comparison import compare_methods
from taubench_gl.reuse.contract import REFERENCE_INPUT, Method
from taubench_gl.reuse.file_inputs import FileInputs
from taubench_gl.reuse.frame import EYE_INPUTS, FrameInputs, read_result
from taubench_gl.reuse.generated import INTERPOLATE, LAST_RENDERED, GeneratedInputs, add_generated, all_generate
from taubench_gl.reuse.input_kind import InputKind, parse_input
from taubench_gl.reuse.inputs import FrameRequest, Inputs, OtherEye, RasterInputs
from taubench_gl.reuse.loading import MethodSpec, load_method, method_settings
from taubench_gl.reuse.perceptual import open_perceptual
from taubench_gl.reuse.quality import MEASURES, WHITE, display, fixed_gain, half_noise, psnr, reusable, warp_error
from taubench_gl.reuse.recorded import RecordedFrames, RecordedRunner
from taubench_gl.reuse.references import (
    FITTED,
    FileReference,
    PathTracedReference,
    ReferenceImage,
    SupersampledReference,
    reference_samples,
)
from taubench_gl.reuse.response import EVENTS, EventTracker
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.reuse.sample_rays import REASONS, SampleRays
from taubench_gl.reuse.samples import SampleRecord, light_colors, outcome_colors
from taubench_gl.reuse.scores import CLASSES, Displayed, FrameTruth, MethodRecord, classify
from taubench_gl.run import Progress
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray

SCHEMA = "taubench-gl/reuse/3"

REQUIRED = {
    "ssim": ("skimage", "scikit-image"),
    "flip": ("flip_evaluator", "flip-evaluator"),
    "hdr_flip": ("flip_evaluator", "flip-evaluator"),
}
"""Metrics that need another package: module and package.  For ``lpips`` and ``cvvdp`` see ``perceptual``."""

_EVALUATION_READS = ("mask", "motion", "exact_mask")
"""The input that the evaluation itself provides: what methods are compared with."""

KEPT_REFERENCE_BYTES = 1 << 31
"""Reference images, and exact masks, are kept in memory for further seeds up to this size, else made again; sums of the
errors of all methods up to this size, else those of fewer frames."""

_EXACT_BYTES = 12
"""Bytes of the exact mask and motion of one pixel."""

FACTS = ("title", "cite", "yardstick", "generates", "settings", "memory_bytes")
"""What reuse.json tells about a method before its scores."""

MAX_SEED = 65535

TWICE = "use other settings, NAME@setting=value, or rename the class, file or folder"


@dataclass(frozen=True, slots=True, kw_only=True)
class EvaluationRequest(ReuseOptions):
    """What methods are evaluated on: the options of ``reuse evaluate``, with the reference that goes with the input.

    ``statistics``: intervals, differences and rankings; ``exact_samples``: a path-traced reference has exactly M
    samples, also where more are stored.
    """

    statistics: bool = True
    exact_samples: bool = False

    def __post_init__(self) -> None:
        ReuseOptions.__post_init__(self)
        if self.reference is None:
            object.__setattr__(self, "reference", FITTED if self.kind().path_samples else "max")

    def kind(self, seed: int = 0) -> InputKind:
        """The input, whose first random numbers are those of ``seed``.  Raises SettingsError."""
        samples = {"light_samples": self.light_samples, "indirect_samples": self.vpl_samples}
        return parse_input(self.input, **samples, seed=seed)

    def check(self, seed: int = 0) -> None:
        """Refuse values that do not go together and metrics whose package is missing.  Raises SettingsError."""
        for name in self.metrics:
            module, package = REQUIRED.get(name, ("", ""))
            if module and find_spec(module) is None:
                hint = f"pip install 'taubench-gl[reuse]', or choose metrics other than {name}, such as psnr,relmse"
                raise SettingsError(f"metric {name} needs {package}", hint=hint)
        kind, traced = self.kind(seed), reference_samples(self.reference) is not None
        if self.seeds > 1 and not (kind.noisy or kind.path_samples):
            message = f"input {kind.text!r} is the same for every seed"
            raise SettingsError(message, hint="--seeds goes with noisy or path-traced@N input")
        if seed + self.seeds - 1 > MAX_SEED:
            raise SettingsError(f"the last seed is above {MAX_SEED}", hint="give a smaller --seed or fewer --seeds")
        if self.reference != "max" and not traced and not is_sequence(self.reference):
            hint = "give max, path-traced, path-traced@M or exr:DIR"
            raise SettingsError(f"reference is {self.reference!r}", hint=hint)
        if kind.files is not None and not is_sequence(self.reference):
            message = f"path-traced files have no {self.reference!r} reference"
            raise SettingsError(message, hint="give --reference exr:DIR")
        if kind.path_samples and not traced:
            message = f"path-traced input has no {self.reference!r} reference"
            raise SettingsError(message, hint="give --reference path-traced or path-traced@M")


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Results of methods.  ``summary``: reuse.json (schema ``SCHEMA``); ``rows``: frames.csv, one per seed, frame and
    method."""

    summary: dict[str, Any]
    rows: list[dict[str, Any]]

    @property
    def failed(self) -> dict[str, str]:
        """Label -> one line, for methods that failed."""
        return {label: m["failed"] for label, m in self.summary["methods"].items() if m["failed"]}


@dataclass(frozen=True, slots=True)
class EvaluatedFrame:
    """One frame of an evaluation: images (h, w, 3) in [0, 1], error maps (h, w), row 0 at the top.

    ``radiance``: linear radiance times ``exposure`` of ``input``, of every method and of ``reference``, (h, w, 3);
    ``classes`` (h, w): index into CLASSES; ``seed``: of the input. ``repetition``: 0 for the first seed;
    ``maps``: further images, of what reservoirs hold.
    """

    frame: int
    input: Array
    reference: Array
    images: Mapping[str, Array]
    errors: Mapping[str, Array]
    rows: Mapping[str, Mapping[str, Any]]
    radiance: Mapping[str, Array] = field(default_factory=dict)
    classes: Array | None = None
    exposure: float = 1.0
    seed: int = 0
    repetition: int = 0
    maps: Mapping[str, Array] = field(default_factory=dict)


def evaluate_methods(
    scene: Scene | str | Path,
    methods: Sequence[str | MethodSpec],
    settings: Settings | None = None,
    *,
    camera: CameraTrack | None = None,
    progress: Callable[[Progress], None] | None = None,
    on_frame: Callable[[EvaluatedFrame], None] | None = None,
    announce: Callable[[str], None] | None = None,
    **request: Any,
) -> Evaluation:
    """Run ``methods`` over the frames of ``scene`` and score every image.

    ``request``: fields of ``EvaluationRequest``; ``announce``: gets the time that references take, before they are
    traced.  A method that fails is listed in ``Evaluation.failed`` and does not
    affect the others.  Raises TaubenchError for an invalid request and if every method fails to load or compile.
    """
    settings = settings or Settings(reprojection="motion")
    options = from_values(EvaluationRequest, request)
    specs = [MethodSpec.parse(m) if isinstance(m, str) else m for m in methods]
    _check_labels([spec.label for spec in specs])
    options.check(settings.lighting.seed)
    kind = options.kind(settings.lighting.seed)
    if settings.metrics.history != "frame" and kind.files is not None:
        what = f"methods have no history {settings.metrics.history} in files"
        raise SettingsError(what, hint="give --history frame, or a rendered scene", setting="history")
    if kind.files is not None:
        if not isinstance(scene, Scene):
            scene = load_scene(scene, **settings.sequence.reading)
        camera = camera or camera_of_run(scene, settings.sequence, settings.metrics.unit_scale)
        settings, reasons = as_rendered(settings), {}
    else:
        # Images need their exposure whatever the columns.
        opened = plan_scene(scene, settings.replace(columns=COLUMNS), camera)
        scene, camera, reasons = opened.animated.scene, opened.animated.camera, opened.lighting.reasons
        settings = opened.settings.replace(columns=settings.metrics.columns, pairs=settings.metrics.pairs)
    with opened_gpu(settings) as owner:
        poser = Poser(scene, settings.sequence.fps)
        inputs = FrameRequest(owner.gpu, scene, camera, settings, kind, poser, options.mapping)
        evaluator = _Evaluator(owner, inputs, specs, options, announce)
        evaluator.run(progress, on_frame)
        owner.gpu.check("reuse evaluation")
        records = [run.record for run in evaluator.runs if not run.record.failed]
        rows = [row for step in zip(*(record.rows for record in records)) for row in step]
        counted = evaluator.frames[evaluator.warmup :]
        yardsticks = {run.spec.label for run in evaluator.runs if run.entry["yardstick"]}
        statistics = None
        if options.statistics:
            statistics = compare_methods(rows, counted, options.cuts, yardsticks=yardsticks, noise=evaluator.noise)
        origin = {"lighting": reasons, "provenance": provenance(owner.gpu, PassTimer.clock)}
        summary = evaluator.summary() | {"statistics": statistics} | origin
    return Evaluation(summary, rows)


def _check_labels(labels: Sequence[str]) -> None:
    if not labels:
        raise SettingsError("there is no method to evaluate", hint="see 'taubench-gl reuse list'")
    if twice := next((label for label in labels if labels.count(label) > 1), None):
        raise SettingsError(f"method {twice!r} is given twice", hint=TWICE)


@dataclass(frozen=True, slots=True)
class _Stepped:
    """One frame of a method: ``result`` (h, w, 4); ``reported``, ``counts`` as of ``MethodRunner``."""

    result: Array
    reported: dict[str, Array]
    counts: Array | None


@dataclass(slots=True)
class _MethodRun:
    """One method of an evaluation: what it is, its runner while a sequence is open, and its scores."""

    spec: MethodSpec
    record: MethodRecord
    method: Method | RecordedFrames | None = None  # None: it could not be loaded
    entry: dict[str, Any] = field(default_factory=lambda: dict.fromkeys(FACTS) | {"cite": []})
    runner: MethodRunner | RecordedRunner | None = None
    eye: MethodRunner | None = None  # of the other eye, of a method that asks for both histories
    samples: SampleRecord | None = None  # of a method that samples lights

    @contextmanager
    def isolated(self) -> Iterator[None]:
        """A MethodError, or a lack of GPU memory, ends this method only."""
        try:
            yield
        except (MethodError, GraphicsError) as error:
            self.record.failed = str(error)
            self.release()

    def load(self) -> None:
        source = self.spec.method
        if is_sequence(source):
            self.method = RecordedFrames.parse(str(source), self.spec.settings)
            self.entry["title"] = "frames made elsewhere"
        else:
            self.method = load_method(source)
            self.entry |= {"title": self.method.title, "cite": list(self.method.cite)}
            self.entry |= {"yardstick": self.method.yardstick, "generates": self.method.generates}

    def open(self, inputs: Inputs, seed: int) -> None:
        """The runner for ``inputs``, whose random numbers are those of ``seed``; one that is open begins again."""
        gpu, size, method = inputs.gpu, inputs.output_size, self.method
        if isinstance(self.runner, MethodRunner):
            self.runner.reset()
            if self.eye is not None:
                self.eye.reset()
            return
        if isinstance(method, RecordedFrames):
            self.release()
            self.runner = RecordedRunner(gpu, method, size, inputs.frames, mapping=inputs.request.mapping, seed=seed)
        else:
            values = method_settings(method, self.spec.settings)
            timer = PassTimer(gpu)
            self.runner = MethodRunner(
                gpu, method, size, values, input_size=inputs.size, timer=timer, count=method.own_light
            )
            if self.asks_for_eye and inputs.settings.metrics.history == "both":
                self.eye = MethodRunner(gpu, method, size, values, input_size=inputs.size)
            if method.own_light and size == inputs.size:
                exposure = inputs.settings.lighting.exposure_factor
                self.samples = self.samples or SampleRecord(self.record.warmup, exposure)
        self.entry |= {"settings": dict(self.runner.values), "memory_bytes": self.runner.bytes}

    @property
    def asks_for_eye(self) -> bool:
        return isinstance(self.method, Method) and bool({*EYE_INPUTS} & {*self.method.reads})

    def step(self, inputs: FrameInputs, eye: FrameInputs | None = None) -> _Stepped:
        """Run the method for one frame, first in the other eye where it asks for it.  Raises MethodError."""
        if inputs.next_rendered is not None and self.method.generates == INTERPOLATE:
            inputs = inputs.next_rendered
        if self.eye is not None and eye is not None:
            inputs = replace(inputs, textures={**inputs.textures, "eye_result": self.eye.step(eye)})
        result = read_result(self.runner.step(inputs))
        counts = None if self.samples is None else self.runner.light_counts()
        return _Stepped(result, self.runner.reported(inputs), counts)

    def release(self) -> None:
        """Free the runner, after which the method takes no part in later frames."""
        for runner in (self.runner, self.eye):
            if runner is not None:
                runner.release()
        self.runner = self.eye = None


class _Evaluator:
    """The reference, the inputs and the runners of one evaluation, and the loop over its frames."""

    def __init__(
        self,
        owner: GpuOwner,
        inputs: FrameRequest,
        specs: Sequence[MethodSpec],
        request: EvaluationRequest,
        announce: Callable[[str], None] | None = None,
    ):
        """Load the methods and open inputs, reference and runners; ``owner`` frees them.  Raises TaubenchError."""
        self._owner = owner
        self._input_request, self._request, self._settings = inputs, request, inputs.settings
        self._reference_texture = None
        self._images: dict[int, ReferenceImage] = {}
        self._noise: list[dict[str, float]] = []  # of the reference, by frame
        self._shading: list[float] = []
        self._gain: float | None = None
        self._warp_errors: list[float] = []
        self._rays: SampleRays | None = None
        self.runs = self._load(specs)
        for run in self.runs:
            run.record.warmup = self.warmup
            run.record.parts.most_bytes = KEPT_REFERENCE_BYTES // len(self.runs) if request.seeds > 1 else 0
        self._require_methods(any(run.method is not None for run in self.runs))  # before anything is rendered
        if self._settings.metrics.history == "both" and not any(run.asks_for_eye for run in self.runs):
            what = f"no method reads {', '.join(EYE_INPUTS)}"
            raise SettingsError(what, hint="give --history frame or eye", setting="history")
        self.seeds = tuple(inputs.kind.seed + k for k in range(request.seeds))
        traced, self._reference = reference_samples(request.reference), None
        of_camera = replace(inputs, settings=inputs.settings.replace(history="frame"))
        if traced is not None:
            self._reference = owner.own(PathTracedReference(of_camera, traced, request.exact_samples))
        # Inputs need the reference for their exact masks, and a path-traced reference the frames for its samples.
        self._open_inputs()
        self._check_frames()
        if traced is not None:
            seconds = request.reference_time if request.reference == FITTED else None
            # The first generated frame has a rendered one before it.
            drawn = range(self.frames[0] - (not self._inputs.in_turn), self.frames[-1] + 1)
            estimate = self._reference.prepare(drawn, seconds)
            if announce is not None and (seconds is not None or estimate.seconds is not None):
                announce(estimate.text)
        elif request.reference == "max":
            self._reference = owner.own(SupersampledReference(of_camera, request.reference_samples))
        else:
            self._reference = FileReference(inputs, request.reference, self._inputs.output_size, self.frames)
        times = (frame / self._settings.sequence.fps for frame in self.frames)
        lights = {} if inputs.scene is None else census(inputs.scene, times, inputs.animated.poser)["lights_per_frame"]
        self._events = EventTracker(lights)
        for run in self.runs:
            owner.own(run)
        self._open_runners(self.seeds[0])
        requested = {spec.label for spec in specs}  # beside which the last rendered frame can stand
        self._require_methods(any(run.spec.label in requested for run in self.running))
        self._mask_source = "exact" if self._inputs.exact_mask is not None else "geometry"
        for run in self.runs:
            run.record.exact_mask, run.record.in_turn = self._mask_source == "exact", self._inputs.in_turn

    def _load(self, specs: Sequence[MethodSpec]) -> list[_MethodRun]:
        """The loaded methods; beside those that generate frames the last rendered frame.  Raises SettingsError."""
        request, labels = self._request, [spec.label for spec in specs]
        perceptual = open_perceptual(request.metrics, self._settings.sequence.fps)

        def load(spec: MethodSpec) -> _MethodRun:
            run = _MethodRun(spec, MethodRecord(spec.label, frozenset(request.metrics), True, perceptual=perceptual))
            with run.isolated():
                run.load()
            return run

        runs, self.warmup = [load(spec) for spec in specs], request.warmup
        self._generates = all_generate([run.method for run in runs], self._input_request, request.cuts)
        if self._generates:
            # The first intervals between rendered frames are left out.
            self.warmup *= request.render_every - 1
            runs += [] if LAST_RENDERED in labels else [load(MethodSpec(LAST_RENDERED, LAST_RENDERED))]
        return runs

    @property
    def running(self) -> list[_MethodRun]:
        """The methods that have not failed."""
        return [run for run in self.runs if run.runner is not None]

    def _require_methods(self, left: bool) -> None:
        """Raise MethodError with the failures of all methods if no method is ``left``."""
        if not left:
            raise MethodError("; ".join(str(run.record.failed) for run in self.runs if run.record.failed))

    def _check_frames(self) -> None:
        if unknown := sorted(set(self._request.cuts) - set(self.frames)):
            ends = f"{self.frames[0]} to {self.frames[-1]}"
            raise SettingsError(f"cut {unknown[0]} is not among the frames", hint=f"the frames are {ends}")
        if len(self.frames) < 2:
            raise SettingsError("one frame has no history to reuse", hint="select at least two --frames")
        if len(self.frames) <= self.warmup:
            message = f"warmup is {self.warmup}, and there are {len(self.frames)} frames"
            raise SettingsError(message, hint="select more --frames or a smaller --warmup")

    def _open_inputs(self) -> None:
        request = self._input_request
        method_reads = {name for run in self.runs if isinstance(run.method, Method) for name in run.method.reads}
        reads, cuts = (method_reads | set(_EVALUATION_READS)) - {REFERENCE_INPUT}, self._request.cuts
        traced = self._reference if request.kind.path_samples else None
        if self._generates:
            kinds = [run.method.generates for run in self.runs if run.method is not None]
            inputs = GeneratedInputs(request, reads - {"exact_mask"}, kinds, self._request.render_every, traced)
        elif request.kind.files is not None:
            inputs = FileInputs(request, reads, cuts=cuts, exact=self._request.reference)
        else:
            inputs = RasterInputs(request, reads, cuts=cuts, exact=traced or True)
        self._inputs, both = self._owner.own(inputs), self._settings.metrics.history == "both"
        self._eye = self._owner.own(OtherEye(inputs, cuts)) if both else None
        self.frames = inputs.frames
        width, height = inputs.output_size
        kept = _EXACT_BYTES * width * height * len(self.frames)
        inputs.keeps_exact = len(self.seeds) > 1 and kept <= KEPT_REFERENCE_BYTES
        if REFERENCE_INPUT in method_reads and inputs.stereo:
            raise SettingsError("a method reads the reference, which the other eye lacks", hint="give --history frame")
        # Else methods that read the reference fail with its name.
        if REFERENCE_INPUT in method_reads and inputs.size == inputs.output_size:
            self._reference_texture = self._owner.own(inputs.gpu.texture(inputs.size))

    def _open_runners(self, seed: int) -> None:
        for run in self.runs:
            if run.record.failed is None:
                with run.isolated():
                    run.open(self._inputs, seed)

    def run(
        self, progress: Callable[[Progress], None] | None, on_frame: Callable[[EvaluatedFrame], None] | None
    ) -> None:
        """Evaluate all frames with every seed.  The runners of the first seed are open already."""
        pairs = len(self.frames) - 1
        for repetition, seed in enumerate(self.seeds):
            if repetition:
                self._inputs.begin(seed)
                if self._eye is not None:
                    self._eye.begin()
                self._open_runners(seed)
            previous: Displayed | None = None
            self._events.begin()
            for run in self.runs:
                run.record.begin(seed)
                if run.samples is not None:
                    run.samples.begin()
            for turn, frame in enumerate(self.frames):
                if not self.running:
                    break  # all methods have failed
                started = time.perf_counter()
                evaluated, previous = self._evaluate(frame, turn, previous, repetition)
                if on_frame is not None:
                    on_frame(evaluated)
                if progress is not None and turn:
                    finished_pairs, seconds = repetition * pairs + turn, time.perf_counter() - started
                    progress(Progress(self._input_request.scene.name, finished_pairs, len(self.seeds) * pairs, seconds))
            for run in self.running:
                run.record.end()

    def _evaluate(
        self, frame: int, turn: int, previous: Displayed | None, repetition: int
    ) -> tuple[EvaluatedFrame, Displayed]:
        """One frame, from the source through every method to the scores; and its reference image.

        ``turn``: place of the frame in its sequence; ``previous``: reference image of the frame before.
        """
        if (before := self._inputs.before(frame)) is not None:
            self._step_all(before, turn)
        eye = None if self._eye is None else self._eye.advance(frame)
        inputs = self._inputs.advance(frame)
        if eye is not None:
            inputs = self._eye.beside(inputs, eye)
        shading = self._inputs.shading_ms()
        if shading is not None and turn:
            self._shading.append(shading)
        reference = self._frame_reference(frame, inputs, previous, repetition)
        outputs = self._step_all(self._with_reference(inputs, reference), turn, eye)
        curve, radiance = self._settings.lighting.tone_map, read_result(inputs.textures["radiance"])
        images, errors, rows, maps, linear = {}, {}, {}, {}, {"input": radiance[..., :3]}
        for run in self.running:
            label, result = run.spec.label, outputs[run.spec.label].result
            blended, of_eye = (
                Blended.of(radiance, outputs[label].reported, name) for name in ("reprojected_history", "eye_history")
            )
            maps |= self._samples(run, inputs, outputs[label], reference)
            images[label], errors[label] = run.record.add(reference, result, curve, run.runner.time_ms, blended, of_eye)
            rows[label], linear[label] = run.record.rows[-1], result[..., :3]
        shown = display(np.nan_to_num(_nearest(radiance[..., :3], self._inputs.output_size)), curve)
        return EvaluatedFrame(
            frame,
            shown,
            reference.image.colors,
            images,
            errors,
            rows,
            linear | {"reference": reference.image.radiance},
            reference.classes,
            inputs.exposure,
            self.seeds[repetition],
            repetition,
            maps,
        ), reference.image if self._inputs.in_turn else None

    def _samples(
        self, run: _MethodRun, inputs: FrameInputs, stepped: _Stepped, reference: FrameTruth
    ) -> dict[str, Array]:
        """Score the light samples of a method that has some.  -> images of them, (h, w, 3) in [0, 1]."""
        if run.samples is None:
            return {}
        if self._rays is None:
            moved = self._settings.metrics.threshold("position")
            self._rays = self._owner.own(SampleRays(self._inputs.gpu, inputs.light, self._inputs.size, moved))
        frame = self._rays.of(stepped.reported, inputs.textures["motion"], stepped.counts)
        run.samples.add(frame, stepped.result, reference)
        maps = {"light kept": light_colors(frame)} if "kept_sample" in stepped.reported else {}
        maps |= {"history kept": outcome_colors(frame)} if "history_sample" in stepped.reported else {}
        return {f"{run.spec.label}: {name}": image for name, image in maps.items()}

    def _frame_reference(
        self, frame: int, inputs: FrameInputs, previous: Displayed | None, repetition: int
    ) -> FrameTruth:
        known = self._reference_image(frame)
        valid = np.isfinite(known.radiance).all(axis=-1)
        mask = read_channel(self._inputs.exact_mask or inputs.textures["mask"], "mask")[..., 0]
        motion = read_channel(self._inputs.exact_motion or inputs.textures["motion"], "motion")
        image = Displayed.of(known.radiance, valid, self._settings.lighting.tone_map)
        if previous is None and self._gain is None:
            self._gain = fixed_gain(image.radiance)
        if previous is not None and not repetition:
            error = warp_error(image.colors, previous.colors, motion, reusable(mask))
            self._warp_errors += [] if error is None else [error]
        halves = None if known.halves is None else tuple(np.where(valid[..., None], half, 0.0) for half in known.halves)
        classes = classify(mask)
        reference = FrameTruth(
            frame, image, previous, mask, classes, motion, self._gain, emitters=known.emitters, halves=halves
        )
        if self._inputs.in_turn:
            reference = replace(reference, events=self._events.advance(mask, motion, reference.scored))
        if halves is not None and not repetition:
            self._noise.append(half_noise(*halves, self._settings.lighting.tone_map, reference.scored))
        return reference

    def _reference_image(self, frame: int) -> ReferenceImage:
        if frame in self._images:
            return self._images[frame]
        image = self._reference.image(frame)
        if len(self.seeds) > 1 and image.bytes * len(self.frames) <= KEPT_REFERENCE_BYTES:
            self._images[frame] = image
        return image

    def _with_reference(self, inputs: FrameInputs, reference: FrameTruth) -> FrameInputs:
        """``inputs``, with the reference image as a further input where a method reads it."""
        if self._reference_texture is None:
            return inputs
        image = np.concatenate([reference.image.radiance, reference.image.valid[..., None]], axis=-1)
        write_channel(self._reference_texture, REFERENCE_INPUT, image)
        return replace(inputs, textures={**inputs.textures, REFERENCE_INPUT: self._reference_texture})

    def _step_all(self, inputs: FrameInputs, turn: int, eye: FrameInputs | None = None) -> dict[str, _Stepped]:
        """Run all methods for one frame, by label.  The order rotates by one method per frame.  ``eye``: the other
        eye, for methods that ask for both histories."""
        runs, out = self.running, {}
        shift = turn % len(runs)
        for run in runs[shift:] + runs[:shift]:
            with run.isolated():
                out[run.spec.label] = run.step(inputs, eye)
        return out

    @property
    def noise(self) -> dict[str, float] | None:
        """Measure -> squared error that noise of the reference adds (``quality.half_noise``), mean over counted frames.

        None where the reference has no two halves.
        """
        counted = self._noise[self.warmup :]
        return {name: float(np.mean([n[name] for n in counted])) for name in counted[0]} if counted else None

    def summary(self) -> dict[str, Any]:
        width, height = self._inputs.output_size
        scene, settings = self._input_request.scene, self._settings.replace(width=width, height=height)
        clock = PassTimer.clock
        methods = {run.spec.label: run.entry | run.record.summary() | self._samples_block(run) for run in self.runs}
        if self._generates:
            add_generated(methods, self._request.render_every, settings.sequence.fps)
        described = self._inputs.describe()
        if described["seed"] is not None:
            described["seed"] = self.seeds[0]
        shading = float(np.median(self._shading)) if self._shading else None
        counted = self._warp_errors[self.warmup - 1 :]
        warped = float(np.mean(counted)) if counted else None
        return {
            "schema": SCHEMA,
            "scene": {"name": scene.name, "path": None if scene.path is None else str(scene.path),
                      "sha256": scene.sha256, "stand_in": scene.stand_in},
            "settings": settings.as_summary(self.frames),
            "frames": len(self.frames),
            "evaluated_frames": len(self.frames) - self.warmup,
            "seeds": list(self.seeds),
            "warmup": self.warmup,
            "input": described | {"shading_ms": shading, "clock": clock},
            "reference": self._reference.describe() | {"warp_error": warped, "gain": self._gain}
            | {"noise_mse": self.noise, "noise_db": self.noise and {n: psnr(v) for n, v in self.noise.items()}},
            "white": WHITE,
            "mask_source": self._mask_source,
            "measures": {name: {"unit": m.unit, "better": m.better, "doc": m.doc} for name, m in MEASURES.items()},
            "classes": {name: doc for name, (_, doc) in CLASSES.items()},
            "events": {name: doc for name, (*_, doc) in EVENTS.items()},
            "clock": clock,
            "methods": methods,
            "sample_reasons": {name: doc for name, (*_, doc) in REASONS.items()},
        }  # fmt: skip

    def _samples_block(self, run: _MethodRun) -> dict[str, Any]:
        """The block of a method that samples lights."""
        measured = run.samples is not None and run.record.failed is None
        return {"samples": run.samples.summary()} if measured else {}


def _nearest(image: Array, size: tuple[int, int]) -> Array:
    """An image at another size, each pixel that of the nearest center."""
    rows, columns = ((2 * np.arange(n) + 1) * side // (2 * n) for n, side in zip(size[::-1], image.shape, strict=False))
    return image[rows[:, None], columns]
