"""Inputs of methods that generate frames: rendered frames only, and the newest camera.

Frames of the sequence are those that are displayed, and every ``render_every``-th one is rendered.  Motion, masks and
history of inputs are between rendered frames.  Exact masks compare a generated frame with the last rendered one.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

from taubench_gl.animation.jitter import halton_jitter
from taubench_gl.animation.pairs import reprojection
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import frame_range
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.sources import Source
from taubench_gl.reuse.frame import FrameInputs
from taubench_gl.reuse.input_kind import InputKind
from taubench_gl.reuse.inputs import FrameRequest, MaskPass, RasterInputs, light_settings

LAST_RENDERED = "present-last"
"""The built-in method that displays the last rendered frame again."""

INTERPOLATE = "interpolate"
"""Value of ``Method.generates`` of methods that wait for the next rendered frame; the others extrapolate."""


def all_generate(methods: Sequence[Any], request: FrameRequest, cuts: Collection[int]) -> bool:
    """Whether ``methods`` generate frames.  Raises SettingsError where only some do, or the frames do not allow it."""
    generates = [getattr(method, "generates", None) is not None for method in methods if method is not None]
    if any(generates) and not all(generates):
        raise SettingsError("methods that generate frames are evaluated among themselves", hint="leave out the others")
    if any(generates):
        check_rendered(request.kind, request.settings.metrics.history, cuts)
    return any(generates)


def check_rendered(kind: InputKind, history: str, cuts: Collection[int]) -> None:
    """Raises SettingsError if frames cannot be generated from rendered ones of ``kind``, with ``cuts``.

    ``history``: as ``Settings.metrics.history``.
    """
    if cuts or history != "frame" or kind.files is not None or kind.rate != "full" or kind.upscale != 1:
        hint = "give --input full, jittered, noisy or path-traced@N, and no --cut or --history"
        raise SettingsError("frames are generated from whole rendered ones of one shot, of their size", hint=hint)


def generated_frames(shown: range, every: int) -> list[int]:
    """The frames between rendered ones of the displayed frames ``shown``.  Raises SettingsError for fewer than three
    rendered ones."""
    first, last = -(-shown.start // every) * every, (shown.stop - 1) // every * every
    if last < first + 2 * every:
        what = f"of {len(shown)} frames fewer than 3 are rendered"
        raise SettingsError(what, hint="select more --frames or a smaller --render-every")
    return [frame for frame in range(first, last) if frame % every]


def add_generated(methods: Mapping[str, dict[str, Any]], every: int, fps: float) -> None:
    """Add the block ``generated`` to methods of reuse.json.

    ``gain_db``: PSNR over that of LAST_RENDERED, None where one failed; ``latency_frames``: rendered ones that the
    display waits for; ``latency_ms``: by which every frame is displayed later.

    A method that interpolates displays the first frame of an interval when the rendered frame at its end is there.
    """
    psnr = {label: method.get("mean", {}).get("psnr_db") for label, method in methods.items()}
    for label, method in methods.items():
        waits, pair = method["generates"] == INTERPOLATE, (psnr[label], psnr[LAST_RENDERED])
        delay = {"latency_frames": int(waits), "latency_ms": 1000.0 * (every - 1) / fps if waits else 0.0}
        method["generated"] = {"gain_db": None if None in pair else pair[0] - pair[1], **delay}


class GeneratedInputs(GpuOwner):
    """Frames for methods that generate frames, in place of ``Inputs``.

    ``frames``: the generated ones; ``before`` and then ``advance`` are called for each in order.
    """

    stereo = in_turn = keeps_exact = False

    def __init__(
        self, request: FrameRequest, reads: Collection[str], kinds: Collection[str], every: int, exact: Source | None
    ):
        """Open the rendered and the exact frames.  Raises SettingsError for fewer than three rendered ones.

        ``kinds``: of ``Method.generates``; ``every``: one of this many displayed frames is rendered; ``exact``: source
        of exact frames, which stays the caller's, None: a new one.
        """
        super().__init__(request.gpu)
        self._every, self.request, self.settings = every, request, light_settings(request.settings, request.kind)
        shown = frame_range(request.scene, request.camera, request.settings)
        self.frames = generated_frames(shown, every)
        self._now: FrameInputs | None = None  # the last rendered frame
        self._end: FrameInputs | None = None  # of those that interpolate: the rendered frame at the end of the interval
        with self.opening():
            self._source = self._open(reads)
            # Those that interpolate get each rendered frame an interval earlier than the others.
            self._ahead = self._open(reads) if INTERPOLATE in kinds else None
            shading = Shading(gather_each=request.kind.noisy)
            self._exact = exact or self.open_source(request.animated, self.settings, shading=shading)
            self._masks = MaskPass(self, self._exact, self.settings, self._exact.radiance)
        self.exact_mask, self.exact_motion = self._masks.mask, self._masks.motion
        self.size = self.output_size = self._exact.size

    def _open(self, reads: Collection[str]) -> RasterInputs:
        every = self._every
        inputs = self.own(RasterInputs(self.request, reads, jitter=lambda frame: halton_jitter(frame // every)))
        inputs.source.step = every
        return inputs

    def begin(self, seed: int) -> None:
        """The next frame is the first of a sequence with the random numbers of ``seed``."""
        self._now = self._end = None
        for inputs in filter(None, (self._source, self._ahead)):
            inputs.begin(seed)

    def before(self, frame: int) -> FrameInputs | None:
        """The rendered frame before the generated ``frame``, None for later ones."""
        if frame % self._every != 1:
            return None
        self._now = self._source.advance(frame - 1)
        if self._ahead is not None and self._end is None:
            self._end = self._ahead.advance(frame - 1)
        return self._displayed(frame - 1)

    def advance(self, frame: int) -> FrameInputs:
        """The inputs of the generated ``frame``; textures are valid until the next rendered one."""
        step = frame % self._every
        if step == 1 and self._ahead is not None:
            self._end = self._ahead.advance(frame - 1 + self._every)
        before = self._exact.advance(frame - step)
        self._exact.step = step
        view = self._exact.advance(frame)
        self._masks.run(reprojection(view.centered(), before.centered(), *self.size), 0)
        camera = self.request.animated.view_at(frame / self.settings.sequence.fps)
        return self._displayed(frame, phase=step / self._every, shown=camera)

    def _displayed(self, frame: int, **changes: Any) -> FrameInputs:
        """The inputs of the last rendered frame, and beside them of the next one, as those of ``frame``."""
        changes["index"] = frame - self.frames[0] + 1
        return replace(self._now, **changes, next_rendered=self._end and replace(self._end, **changes))

    def shading_ms(self) -> float | None:
        return self._source.shading_ms()

    def describe(self) -> dict[str, Any]:
        """The block ``input`` of reuse.json."""
        return self._source.describe() | {"render_every": self._every}
