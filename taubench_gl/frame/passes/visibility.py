"""Exact visibility: a ray from the previous camera to the surface point of each pixel, at the place it had."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from taubench_gl import conventions
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import Visibility
from taubench_gl.frame.context import FrameContext
from taubench_gl.frame.pair_record import PAIR_FIELDS, pair_values
from taubench_gl.frame.passes.pathtracing import pixel_footprint
from taubench_gl.frame.raytracing.attributes import HitAttributes
from taubench_gl.frame.raytracing.hit_tables import HitOptions
from taubench_gl.frame.raytracing.structure import SceneStructure
from taubench_gl.frame.renderer import Renderer
from taubench_gl.frame.spec import FrameSpec
from taubench_gl.gpu.declare import ComputePass, Pass, stage
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.gpu.owner import Owner
from taubench_gl.metrics.reprojection import NEAR_GUARD

Array = np.ndarray
CHANNEL = "prev_visibility"

PARAMETERS = Struct(
    "VisibilityRecord",
    *PAIR_FIELDS,
    Field("footprint", "vec4", "width of a previous pixel: x, meters of a parallel camera; y, for each meter of depth"),
    Field("size", "ivec4", "xy: pixels"),
    Field("prev_near", "float", "meters, previous camera's near plane"),
    Field("guarded_near", "float", "meters, prev_near minus NEAR_GUARD"),
    Field("near", "float", "meters, current camera's near plane"),
    Field("guard_px", "float", "pixels, guard of the off-screen test"),
    Field("parallel", "float", "1: the previous camera is parallel"),
    Field("threshold_position", "float", "meters: a point that moved by more has MOVED"),
)

SIDE_CULLED, SIDE_FLIPPED, SIDE_ABSENT = 1, 2, 4
"""Bits per draw: undrawn back faces; the triangles of its tree are wound the other way; absent in the frame before."""


def declaration(spec: FrameSpec) -> ComputePass:
    """The pass, without the acceleration structure, which a renderer's scene has."""
    width, height = spec.size

    def values(frame: FrameContext) -> dict:
        before = frame.before[1]
        pair = reprojection(frame.view, before, width, height)
        return {
            **pair_values(pair),
            "footprint": (*pixel_footprint(before, spec.size), 0.0, 0.0),
            "size": (width, height, 0, 0),
            "prev_near": pair.prev_near,
            "guarded_near": pair.prev_near * (1.0 - NEAR_GUARD),
            "near": pair.near,
            "guard_px": conventions.GUARD_PX,
            "parallel": float(before.camera.parallel),
            "threshold_position": spec.settings.metrics.threshold("position"),
        }

    p = ComputePass("exact visibility", ("visibility/visibility.comp.glsl",)).define(TRACE_SIGHT=True)
    p.glsl(*(f"const uint VISIBILITY_{bit.name} = {bit.value}u;" for bit in Visibility))
    p.glsl(f"const uint NO_HISTORY = {conventions.NO_HISTORY}u;")
    p.glsl(f"const uint SIDE_CULLED = {SIDE_CULLED}u, SIDE_FLIPPED = {SIDE_FLIPPED}u, SIDE_ABSENT = {SIDE_ABSENT}u;")
    p.constants("V", PARAMETERS, values).use(*spec.channels("position", "prev_position", "ids"))
    p.buffer("draw_sides", "uint", filled=True).use(*spec.outputs(CHANNEL))
    return p.dispatch(spec.size, spec.tuning.shading_group)


@stage(options=("previous_pose", "cuts", "alpha_mask"))
def visibility(spec: FrameSpec) -> Sequence[Pass]:
    """The pass, where ``spec`` asks for its channel: it needs an acceleration structure of two frames."""
    return (declaration(spec),) if CHANNEL in spec.extra else ()


class VisibilityPass(Owner):
    """Fills the channel ``prev_visibility`` of a renderer's frames."""

    def __init__(self, renderer: Renderer, spec: FrameSpec):
        """Raises GraphicsError where the device has no room for the acceleration structure."""
        super().__init__()
        context, self._renderer = renderer.context, renderer
        alpha = "alpha_mask" in spec.enabled
        self.structure = self.own(SceneStructure(renderer, alpha_test=alpha, keep_previous=True))
        options = HitOptions(normal_maps=False, glossy=False, emission="none", alpha_test=alpha)
        self.attributes = self.own(HitAttributes(renderer, options))
        self._sides = self.own(context.gpu.ctx.buffer(reserve=4 * max(len(renderer.draws), 1), dynamic=True))
        merged = np.concatenate([g.draws for g in self.structure.table.merged] or [np.zeros(0, np.int64)])
        # Triangles of other draws are in the space of their primitive, which no mirror has turned over.
        self._world_space = np.array([d.posed for d in renderer.draws], dtype=bool)
        self._world_space[merged] = True
        culling = renderer.culling == "gltf"
        keys = renderer.materials.keys
        self._culled = np.array([culling and not keys[d.material + 1].double_sided for d in renderer.draws], dtype=bool)
        p = declaration(spec)
        self._compiled = self.own(context.compute(self.attributes.declare(self.structure.declare(p))))

    def run(self, frame: FrameContext) -> None:
        """Trace ``frame`` against the frame before it."""
        with self._renderer.context.timer.measure("exact visibility"):
            self.structure.update(frame)
            self.attributes.update(frame)
            before = frame.before[2]
            sides = self._culled * SIDE_CULLED + (self._world_space & before.mirrored) * SIDE_FLIPPED
            sides += ~before.visible * SIDE_ABSENT
            self._sides.write(sides.astype(np.uint32).tobytes() or bytes(4))
            tables = {**self.structure.resources, **self.attributes.resources, "draw_sides": self._sides}
            self._compiled.run(frame, {**frame.resources, **tables})
            self._renderer.context.gpu.hazards.publish()

    @property
    def memory(self) -> dict[str, int]:
        """GPU memory that the pass does not declare, bytes by name."""
        return {**self.structure.memory, **self.attributes.memory}

    def notes(self) -> list[str]:
        """What the rays left out, one line each."""
        count = self.structure.unfinished_rays
        lost = [f"{count} rays of visibility ended after too many nodes and count as unoccluded"] if count else []
        return [*self.attributes.notes, *lost]
