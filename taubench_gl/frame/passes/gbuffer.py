"""The geometry pass, and what every pass that draws the scene's geometry has in common with it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from taubench_gl.channels import CHANNELS
from taubench_gl.frame import occlusion
from taubench_gl.frame.context import FrameContext
from taubench_gl.frame.draw_bounds import DrawBounds, rounding
from taubench_gl.frame.materials import MATERIAL, SLOTS, MaterialKey
from taubench_gl.frame.scene_buffers import Group
from taubench_gl.frame.spec import FrameSpec
from taubench_gl.gpu.declare import CONSTANTS, RasterPass, Use
from taubench_gl.gpu.hazards import ATTRIBUTES
from taubench_gl.gpu.layout import Field, Struct, column_major
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.passes import GpuContext

if TYPE_CHECKING:
    import moderngl

FRAME = Struct(
    "FrameRecord",
    Field("clip_from_relative", "mat4", "clip, reversed Z in [0, 1] <- relative to the current camera, world axes"),
    Field(
        "forward", "vec4", "xyz: unit, view direction: dot with a relative position is planar depth; w: 1 if parallel"
    ),
    Field("half_size", "vec2", "of the image, pixels"),
)
_GLSL_TYPE = {("f4", 4): "vec4", ("f2", 4): "vec4", ("u4", 2): "uvec2"}
PIXELS_PER_TRIANGLE = 4
"""Pixels per triangle below which the depth pre-pass may cost more than the channels of hidden surfaces."""

PREPASS_OFFSET = (-1.0, -4.0)
"""Polygon offset of the depth pre-pass, slopes per pixel and smallest steps of depth: a little too far away.

It only has to exceed the rounding of a depth: the geometry pass itself finds each pixel's surface.
"""


def attachments(channels: Collection[str]) -> tuple[str, ...]:
    """Channels among ``channels`` that the geometry pass writes, in the order of the channel table."""
    return tuple(name for name, info in CHANNELS.items() if info.attachment and name in channels)


@lru_cache(maxsize=1024)
def geometry_variant(key: MaterialKey, posed: bool, channels: tuple[str, ...] = (), colors: bool = False) -> dict:
    """Macros of the geometry shaders for one group of draws: what is off is not compiled in.  Not to be changed."""
    slots = set(key.slots)
    variant = {
        "POSED": posed,
        "TANGENTS": "normal" in slots,
        "TEXCOORDS": bool(slots),
        "PLAIN_UV": bool(slots) and key.plain_uv,
        # Vertex colors matter only where the base color does.
        "COLORS": colors and (key.alpha_test or "base_color" in channels),
        "ALPHA_TEST": key.alpha_test,
        "STOCHASTIC_ALPHA": key.stochastic,
        "PREV_POSITION": "prev_position" in channels,
    }
    variant |= {f"{slot.upper()}_MAP": slot in slots for slot in SLOTS}
    return variant | {f"OUTPUT_{name.upper()}": name in channels for name, c in CHANNELS.items() if c.attachment}


def reads_material(variant: Mapping[str, object]) -> bool:
    """Whether what a ``geometry_variant`` draws depends on the material: it is tested or written."""
    return any(on for macro, on in variant.items() if macro == "ALPHA_TEST" or macro.startswith("OUTPUT_"))


def geometry_pass(name: str, fragment: str, slots: Sequence[str] = SLOTS) -> RasterPass:
    """A pass that draws the scene's geometry with ``fragment``, which may sample material ``slots``."""
    numbers = [f"const int SLOT_{slot.upper()} = {i};" for i, slot in enumerate(SLOTS)]
    p = RasterPass(name, ("gbuffer/gbuffer.vert.glsl", fragment)).glsl(FRAME, MATERIAL, *numbers)
    p.use(Use(CONSTANTS, "F", FRAME.name, filled=True), Use(CONSTANTS, "material", MATERIAL.name, filled=True))
    for slot in slots:
        p.texture(f"{slot}_map", filled=True)
    return p


def channel_pass(
    name: str,
    channels: Sequence[str],
    spec: FrameSpec | None = None,
    *,
    resources: Mapping[str, str] | None = None,
    at_centers: bool = False,
) -> RasterPass:
    """Draws ``channels`` of what is visible; ``resources``: names of the render targets, else the channels' own.

    ``spec``: what is drawn, for the prediction of shader variants.  ``at_centers``: of a target that is the whole
    viewport, positions are moved to pixel centers (``Tuning.snapped_corners``).
    """
    p = geometry_pass(name, "gbuffer/gbuffer.frag.glsl").define(AT_CENTERS=at_centers)
    for channel in channels:
        info = CHANNELS[channel]
        p.attachment(channel, _GLSL_TYPE[info.dtype, info.components], (resources or {}).get(channel, channel))
    for posed, primitive in () if spec is None else spec.draw_kinds:
        key = spec.material_key(primitive, channels)
        p.drawn.append(geometry_variant(key, posed, tuple(channels), primitive.material in spec.colored))
    return p


def set_facing(ctx: moderngl.Context, group: Group) -> None:
    """Cull back faces where ``group`` says so; a mirrored group has its front faces wound clockwise."""
    if group.cull:
        ctx.enable(ctx.CULL_FACE)
    else:
        ctx.disable(ctx.CULL_FACE)
    ctx.front_face = "cw" if group.mirrored else "ccw"


class GBufferPass(Owner):
    """Draws everything visible, once, into the channels of ``declaration`` (``channel_pass``).

    Where triangles are large, a depth pre-pass without alpha-tested surfaces comes first, so that hidden surfaces cost
    no channels; where there are many, llvmpipe leaves out draws that the nearest ones hide.  Neither changes an image:
    of the surfaces at a pixel's least distance the first one drawn is kept, with or without it.
    """

    def __init__(self, context: GpuContext, declaration: RasterPass, colored: frozenset[int], bounds: DrawBounds):
        """``colored``: materials (-1: default) of primitives with vertex colors; ``bounds``: of the scene's draws."""
        super().__init__()
        self._gpu, self._colored, self._bounds = context.gpu, colored, bounds
        self._raster = context.raster(declaration)
        self._channels = tuple(channel for channel, *_ in declaration.outputs)
        # The pre-pass is the same in every scene and depends on the view: it is no part of a scene's resources.
        self._prepass_context = self.own(GpuContext(context.gpu))
        self._prepass = self._prepass_context.raster(geometry_pass("gbuffer", "gbuffer/depth.frag.glsl"))
        self._frame = self.own(context.gpu.ctx.buffer(reserve=FRAME.dtype.itemsize, dynamic=True))
        self._depth: moderngl.Framebuffer | None = None

    def run(self, frame: FrameContext) -> None:
        """Draw one frame.  The record table and commands of ``frame.buffers`` must be up to date."""
        ctx, hazards, targets, buffers = self._gpu.ctx, self._gpu.hazards, frame.targets, frame.buffers
        record = FRAME.zeros()
        record["clip_from_relative"] = column_major(frame.view.clip_from_relative(*targets.size))
        record["forward"] = (*-frame.view.world_from_view[:, 2], float(frame.view.camera.parallel))
        record["half_size"] = np.divide(targets.size, 2)
        self._frame.write(record.tobytes())
        self._frame.bind_to_uniform_block(self._raster.bindings["F"])
        hazards.before((buffer, ATTRIBUTES) for buffer in buffers.posed_buffers)
        ctx.enable_only(ctx.DEPTH_TEST)
        ctx.depth_func = ">"
        prepass = PIXELS_PER_TRIANGLE * buffers.shown_triangles <= targets.size[0] * targets.size[1]
        if prepass:
            target = self._depth_target(frame)
            target.use()
            target.clear(depth=0.0)  # infinitely far, reversed Z
            self._draw_depth(frame, buffers.seen_groups)
        elif self._gpu.software and buffers.shown_triangles >= occlusion.LARGE:
            self._leave_out_hidden(frame)
        targets.framebuffer.use()
        targets.framebuffer.depth_mask = not prepass  # keep the depth of the pre-pass
        targets.clear()
        targets.framebuffer.depth_mask = True
        for group in buffers.seen_groups:
            key = frame.materials.keys[group.material + 1]
            colors = group.material in self._colored
            program = self._raster.program(geometry_variant(key, group.posed, self._channels, colors))
            frame.materials.bind(group.material, self._raster.bindings)
            set_facing(ctx, group)
            buffers.draw(group, program)
        frame.materials.unbind()
        ctx.front_face = "ccw"
        ctx.disable(ctx.CULL_FACE)
        drawn = (texture for name, texture in targets.textures.items() if CHANNELS[name].attachment)
        hazards.wrote(drawn, drawn=True)

    def _leave_out_hidden(self, frame: FrameContext) -> None:
        """Make the buffers show only what is not known to be hidden, of posed and instanced draws all."""
        buffers, size, world = frame.buffers, frame.targets.size, frame.placement.world
        centers, radii = self._bounds.of_fixed(world)
        known = buffers.seen & buffers.alone & np.isfinite(radii)
        draws, relative = np.flatnonzero(known), centers[known] - frame.view.position
        offsets = np.linalg.norm(frame.placement.relative[known, :3, 3], axis=1)
        halves = self._bounds.halves(world, radii)[known] + rounding(relative, radii[known], offsets)[:, None]
        clip_from_relative = frame.view.clip_from_relative(*size)
        clip = occlusion.corners_of(relative, halves) @ clip_from_relative[:, :3].T + clip_from_relative[:, 3]
        shown = occlusion.Shown.projected(draws, clip, np.array(size))
        queue, others = occlusion.NearestFirst(shown, (0, 0, *size), buffers.triangles), buffers.seen & ~known
        target = self._depth_target(frame)
        target.use()
        target.clear(depth=0.0)
        for _ in range(occlusion.TURNS):
            buffers.show(np.isin(np.arange(len(known)), queue.take()))
            self._draw_depth(frame, buffers.seen_groups)
            depths = target.read(components=1, attachment=-1, dtype="f4")
            queue.leave_out(np.frombuffer(depths, np.float32).reshape(size[::-1]))
        others[queue.seen] = True
        buffers.show(others)

    def hidden_backs(self, frame: FrameContext) -> int:
        """Pixels of the frame of the last ``run`` whose surface is seen through a culled back.

        Draws the backs into the frame's depth, which nothing reads later.  Those that alpha masks cut out do not count.
        """
        ctx, groups = self._gpu.ctx, [group for group in frame.buffers.seen_groups if group.cull]
        if not groups:
            return 0
        target = self._depth_target(frame)
        drawn = np.frombuffer(target.read(components=1, attachment=-1, dtype="f4"), np.float32)
        target.use()
        self._frame.bind_to_uniform_block(self._raster.bindings["F"])
        ctx.enable_only(ctx.DEPTH_TEST)
        ctx.depth_func = ">"
        self._draw_depth(frame, [replace(group, mirrored=not group.mirrored) for group in groups])
        ctx.front_face = "ccw"
        ctx.disable(ctx.CULL_FACE)
        nearest = np.frombuffer(target.read(components=1, attachment=-1, dtype="f4"), np.float32)
        return int(np.count_nonzero((drawn > 0.0) & (nearest > drawn)))

    def _depth_target(self, frame: FrameContext) -> moderngl.Framebuffer:
        """The depth of a frame without its channels."""
        depth = frame.targets.framebuffer.depth_attachment
        if self._depth is None or self._depth.depth_attachment is not depth:
            self._gpu.unbind_framebuffer()
            self._depth = self.own(self._gpu.ctx.framebuffer((), depth), instead_of=self._depth)
        return self._depth

    def _draw_depth(self, frame: FrameContext, groups: Iterable[Group]) -> None:
        """Depth of what no alpha mask cuts out, a little too far away."""
        ctx, runs = self._gpu.ctx, list[Group]()
        for group in groups:
            if frame.materials.keys[group.material + 1].alpha_test:
                continue
            last = runs[-1] if runs else None
            if last is not None and last.joins(group):
                runs[-1] = replace(last, count=last.count + group.count)
            else:
                runs.append(group)
        ctx.polygon_offset = PREPASS_OFFSET
        for run in runs:
            set_facing(ctx, run)
            variant = geometry_variant(MaterialKey((), False, False), run.posed)
            frame.buffers.draw(run, self._prepass.program(variant))
        ctx.polygon_offset = 0.0, 0.0

    def release(self) -> None:
        self._gpu.unbind_framebuffer()
        super().release()
