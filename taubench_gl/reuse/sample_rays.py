"""Shadow rays to the light samples that a method reports: what reaches which pixel, exactly."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

import moderngl
import numpy as np

from taubench_gl.conventions import FRUSTUM, Reason
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.declare import WRITE, ComputePass
from taubench_gl.reuse.contract import SAMPLE_REPORTS
from taubench_gl.reuse.frame import read_result
from taubench_gl.reuse.scene_light import SceneLight

Array = np.ndarray


class Fact(enum.IntFlag):
    """What rays say of one pixel: GONE by rays of the previous frame, the others by rays of the current one."""

    LIT = 1 << 0  # a surface that scatters light
    HISTORY_REACHES = 1 << 1  # the light of the history reservoir
    KEPT_REACHES = 1 << 2  # the light of the reservoir after the frame
    MOVED = 1 << 3  # the point itself moved by more than the position threshold
    BORN = 1 << 4  # a light that was off in the previous frame reaches it
    GONE = 1 << 5  # a light that is off now reached it


REASONS: dict[str, tuple[int, int, str]] = {
    "off_screen": (int(FRUSTUM), 0, "was off-screen or behind the camera in the previous frame"),
    "disoccluded": (int(Reason.DISOCCLUDED), 0, "was hidden in the previous frame"),
    "geometry": (int(Reason.OCCLUDING | Reason.POSITION | Reason.NORMAL), 0, "another position or normal"),
    "light_gone": (0, int(Fact.GONE), "a light that is off now reached it"),
    "light_born": (0, int(Fact.BORN), "a light that was off reaches it"),
    "moved": (0, int(Fact.MOVED), "the point itself moved"),
    "brightened": (int(Reason.LIT), 0, "direct light increased"),
    "darkened": (int(Reason.SHADOWED), 0, "direct light decreased"),
    "other_light": (int(Reason.DIRECT | Reason.INDIRECT | Reason.COLOR), 0, "any other change of light or color"),
    "unchanged": (0, 0, "none of these"),
}
"""Name -> (bits of the exact mask, bits of Fact, meaning).  A pixel has the first reason with one of its bits."""

_NO_SAMPLE = (-1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class SampleFrame:
    """One frame of one method, arrays (h, w, ...), row 0 at the top.

    ``history``, ``kept`` (h, w, 4): as of contract.SAMPLE_REPORTS, light -1 where a method does not report them;
    ``facts`` (h, w) int bits of Fact; ``born`` (h, w) int: number of the born light that reflects most, -1: none;
    ``born_light`` (h, w): luminance that it reflects, exposure not applied; ``counts`` (h, w, 3): shadow rays, light
    samples and evaluations of reflected light.
    """

    history: Array
    kept: Array
    facts: Array
    born: Array
    born_light: Array
    counts: Array = field(default_factory=lambda: np.zeros(0))

    def has(self, fact: Fact) -> Array:
        """Which pixels have the bit ``fact`` in ``facts``, (h, w) bool."""
        return (self.facts & fact) != 0

    def reasons(self, mask: Array) -> Array:
        """Index into REASONS of every pixel; -1: nothing scatters light, or no history.  ``mask``: reason words."""
        out = np.full(mask.shape, len(REASONS) - 1, dtype=np.int8)
        for index, (bits, facts, _) in reversed(list(enumerate(REASONS.values()))):
            if bits or facts:
                out[((mask & np.uint32(bits)) != 0) | ((self.facts & facts) != 0)] = index
        none = (mask & np.uint32(Reason.FIRST | Reason.CUT | Reason.INVALID)) != 0
        return np.where(none | ~self.has(Fact.LIT), np.int8(-1), out)

    def words(self, x: int, row: int) -> str:
        """The reservoir of pixel (x, row): ``light 7, M 20, occluded now``."""
        light, *_, count = self.kept[row, x]
        if light < 0:
            return "holds no light"
        seen = "reaches the pixel" if self.has(Fact.KEPT_REACHES)[row, x] else "occluded now"
        return f"light {int(light)}, M {count:g}, {seen}"


class SampleRays(GpuOwner):
    """Traces the samples of methods in the frames of one ``SceneLight``."""

    def __init__(self, gpu: Gpu, light: SceneLight, size: tuple[int, int], moved_from: float):
        """Compile the pass for the lights of ``light``.  ``moved_from``: distance from which a point has moved, scene
        units."""
        super().__init__(gpu)
        self._light, self._size, self._moved_from = light, size, moved_from
        with self.opening():
            p = light.declare(ComputePass("reuse sample rays", ("reuse/sample_rays.comp.glsl",)))
            p.glsl(*(f"const int FACT_{fact.name} = {fact.value};" for fact in Fact))
            for name in (*SAMPLE_REPORTS, "position", "prev_position", "motion"):
                p.texture(name)
            p.buffer("changed_lights", "int").image("sample_facts", access=WRITE)
            p.dispatch(size, Tuning(gpu.software).shading_group)
            self._pass = self.own(self.context.compute(p))
            self._textures = {n: self.own(gpu.texture(size)) for n in (*SAMPLE_REPORTS, "sample_facts")}

    def of(self, reported: dict[str, Array], motion: moderngl.Texture, counts: Array) -> SampleFrame:
        """Trace the samples of a frame: ``reported`` and ``counts`` of a ``MethodRunner``, and the input ``motion``."""
        height, width = self._size[::-1]
        samples = {}
        for name in SAMPLE_REPORTS:
            samples[name] = reported.get(name, np.broadcast_to(np.float32(_NO_SAMPLE), (height, width, 4)))
            # GL's row 0 is at the bottom.
            self._textures[name].write(np.ascontiguousarray(samples[name][::-1], dtype=np.float32))
        changed = [len(self._light.born), len(self._light.gone), *self._light.born, *self._light.gone]
        buffer = self.gpu.ctx.buffer(np.array(changed, dtype=np.int32).tobytes())
        resources = {**self._light.channels, **self._light.resources, **self._textures}
        self._pass.run(None, resources | {"motion": motion, "changed_lights": buffer}, size=self._size,
                       moved_from=self._moved_from)  # fmt: skip
        self.gpu.hazards.publish()
        facts = read_result(self._textures["sample_facts"])
        buffer.release()
        return SampleFrame(*samples.values(), facts[..., 0].astype(np.int32), facts[..., 1].astype(np.int32),
                           facts[..., 2], counts)  # fmt: skip
