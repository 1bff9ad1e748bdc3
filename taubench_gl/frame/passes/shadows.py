"""Shadow maps: depth of the scene from the lights that get shadows, redrawn only where what they see has moved."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from taubench_gl.animation.pose import moved_nodes
from taubench_gl.frame import occlusion
from taubench_gl.frame.casters import ShadowMapCache, StaleFace
from taubench_gl.frame.context import FrameContext
from taubench_gl.frame.geometry import Draw
from taubench_gl.frame.materials import MaterialKey
from taubench_gl.frame.occlusion import Rect
from taubench_gl.frame.passes.gbuffer import FRAME, geometry_pass, geometry_variant, reads_material
from taubench_gl.frame.records import RECORD, Placement, RecordTable
from taubench_gl.frame.scene_buffers import COMMAND, Group, SceneBuffers, triangles_of
from taubench_gl.frame.shadow_faces import FACE, FACE_ROW, Face, FaceTable, faces_of, first_faces, pack
from taubench_gl.frame.spec import FrameSpec
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.declare import Pass, RasterPass, Resource, stage
from taubench_gl.gpu.layout import column_major
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.passes import GpuContext, fitted
from taubench_gl.scene.model import Scene

if TYPE_CHECKING:
    import moderngl

Array = np.ndarray
STRIDE = 256  # bytes; no driver needs a larger alignment of uniform buffer offsets

Variant = tuple[Mapping[str, object], tuple[str, ...]]
"""Macros of the shaders that draw a group, and the texture slots they sample."""


FIXED_TRIANGLES = 16384
"""Triangles that no animation moves, from which on their depth is kept: what moves is then drawn over a copy of it."""


@stage("shadows", "direct", options=("alpha_mask", "skinning", "morphing"))
def shadow_maps(spec: FrameSpec) -> Sequence[Pass]:
    """Depth of every shadowed light's faces, all in one atlas."""
    if not spec.light_kinds:
        return ()
    faces = spec.light_faces(spec.map_sizes)
    largest = max((f.resolution for f in faces), default=0)
    p = geometry_pass("shadows", "shadow/shadow.frag.glsl", ("base_color",)).attachment("shadow_atlas")
    for name in ("shadow_atlas", *["fixed_shadow_atlas"] * keeps_fixed_maps(spec)):
        p.allocate(
            Resource.texture(
                name,
                pack(faces, spec.tuning.texture_limit)[1],
                dtype="depth",
                label="shadow atlas",
                what=f"an atlas of {len(faces)} shadow map{'s' * (len(faces) != 1)} of up to {largest} texels",
                hint="lower --shadow-size or --shadow-lights",
            )
        )
    for posed, primitive in spec.draw_kinds:
        key = spec.material_key(primitive, ())
        p.drawn.append(_variant(key, posed, primitive.material in spec.colored)[0])
    return (p,)


def fixed_draws(scene: Scene, draws: tuple[Draw, ...]) -> Array:
    """Draws that no animation moves, bends or hides, (D,) bool."""
    moves = moved_nodes(scene, scene.channels)
    return np.array([not (d.posed or moves[d.node]) for d in draws], dtype=bool)


def keeps_fixed_maps(spec: FrameSpec) -> bool:
    """Whether what stands still has maps of its own: it is much to draw, and something else moves."""
    moves = moved_nodes(spec.scene, spec.scene.channels)
    fixed = [(n, p) for n, p in spec.animated.drawn if not moves[n] and not spec.is_posed(n, p)]
    instances = spec.scene.nodes.instances
    triangles = sum(len(p.triangles) * len(instances.get(n, (None,))) for n, p in fixed)
    return len(fixed) < len(spec.animated.drawn) and triangles >= FIXED_TRIANGLES


def _variant(key: MaterialKey, posed: bool, colored: bool) -> Variant:
    slots = tuple(s for s in key.slots if s == "base_color") if key.alpha_test else ()
    drawn = MaterialKey(slots, key.alpha_test, True, stochastic=key.stochastic)
    return geometry_variant(drawn, posed, (), colored), slots


class AnchoredRecords(Owner):
    """A record table relative to a fixed point instead of the camera.

    What is drawn with it has the same bits wherever the camera is, so a map drawn in an earlier frame is the map that
    would be drawn now.  The vertices of posed draws are relative to the camera, and stay so.
    """

    def __init__(self, gpu: Gpu, draws: tuple[Draw, ...], origin: Array):
        super().__init__()
        self.origin = np.asarray(origin, dtype=np.float64)
        self._table = RecordTable(draws)
        self._posed = np.array([d.posed for d in draws], dtype=bool)
        self.buffer = self.own(gpu.ctx.buffer(reserve=max(len(draws), 1) * RECORD.dtype.itemsize, dynamic=True))
        self._written = b""

    def update(self, placement: Placement, order: Array) -> None:
        """Follow the draws, in the ``order`` of SceneBuffers; nothing is uploaded while they stand still."""
        state = placement.world.tobytes() + order.tobytes()
        if state == self._written:
            return
        self._written = state
        relative = placement.world.copy()
        relative[:, :3, 3] -= self.origin
        relative[self._posed] = np.eye(4)
        at = dataclasses.replace(placement, relative=relative)
        self.buffer.write(self._table.update(at, at)[order].tobytes())


def merged(
    runs: Iterable[tuple[Group, int, int]], variant_of: Callable[[Group], Variant]
) -> list[tuple[Group, Variant, int, int]]:
    """(group, variant, first, count) of ``runs``; neighbors that differ in nothing but an unread material are one."""
    out: list[tuple[Group, Variant, int, int]] = []
    for group, first, count in runs:
        variant = variant_of(group)
        if out:
            before, same, start, length = out[-1]
            alike = same[0] is variant[0] and before.posed == group.posed and not reads_material(variant[0])
            if alike and start + length == first:
                out[-1] = before, variant, start, length + count
                continue
        out.append((group, variant, first, count))
    return out


PlacedFace = tuple[Face, tuple[int, int], StaleFace]
"""A face that is out of date, with its place in the atlas."""


class FaceDrawer:
    """Draws faces into one framebuffer."""

    def __init__(
        self,
        context: GpuContext,
        framebuffer: moderngl.Framebuffer,
        declaration: RasterPass,
        *,
        depth_test: bool = True,
    ):
        gpu = self._gpu = context.gpu
        self._framebuffer, self._raster, self._depth_test = framebuffer, context.raster(declaration), depth_test
        self._frames = gpu.ctx.buffer(reserve=STRIDE * 8, dynamic=True)
        self._commands = gpu.ctx.buffer(reserve=COMMAND.itemsize * 1024, dynamic=True)

    def draw(
        self,
        frame: FrameContext,
        stale: Sequence[tuple[Face, tuple[int, int], Array]],
        variant_of: Callable[[Group], Variant],
        *,
        anchor: AnchoredRecords | None = None,
        parts: Sequence[Rect] | None = None,
        clear: bool = True,
    ) -> None:
        """Redraw each face, without ``clear`` over what is there.

        Nothing is culled by facing: both sides of a surface stop light.
        ``parts``: x, y, width, height of what to redraw of each, texels of the face; the rest stays as it is.
        ``anchor``: up to date, for maps that must not depend on where the camera was when they were drawn.
        """
        if not stale:
            return
        ctx, view, scene = self._gpu.ctx, frame.view, frame.buffers
        framebuffer, raster = self._framebuffer, self._raster
        runs = self._upload([seen for _, _, seen in stale], scene)
        origins = [view.position if anchor is None else anchor.origin, view.position]  # of fixed and of posed draws
        self._upload_frames([face.clip_from_relative(o) for face, _, _ in stale for o in origins], stale)
        framebuffer.use()
        ctx.enable_only(ctx.DEPTH_TEST if self._depth_test else ctx.NOTHING)
        ctx.depth_func = ">"
        records = scene.records if anchor is None else anchor.buffer
        for at, ((face, (x, y), _), groups) in enumerate(zip(stale, runs, strict=True)):
            viewport = (x, y, face.resolution, face.resolution)
            part = viewport if parts is None else (x + parts[at][0], y + parts[at][1], *parts[at][2:])
            if clear:
                framebuffer.clear(0.0, 0.0, 0.0, 0.0, depth=0.0, viewport=part)
            framebuffer.viewport = viewport
            if parts is not None:
                framebuffer.scissor = part
            for group, (variant, slots), first, count in merged(groups, variant_of):
                row = 2 * at + group.posed
                binding = raster.bindings["F"]
                self._frames.bind_to_uniform_block(binding, offset=row * STRIDE, size=FRAME.dtype.itemsize)
                if reads_material(variant):
                    frame.materials.bind(group.material, raster.bindings, slots)
                triangles = self._triangles[first : first + count]
                scene.draw_commands(group, raster.program(variant), self._commands, first, triangles, records)
        if parts is not None:
            framebuffer.scissor = None
        frame.materials.unbind()

    def draw_stale(
        self,
        frame: FrameContext,
        stale: Sequence[PlacedFace],
        variant_of: Callable[[Group], Variant],
        anchor: AnchoredRecords,
        *,
        ordered: bool,
    ) -> None:
        """``draw`` of faces that are out of date, on llvmpipe without most of what is hidden: the maps are the same.

        ``ordered``: of equal depths the first one drawn counts, in the order of the scene's draws.
        """
        triangles = frame.buffers.triangles
        queues = {
            i: occlusion.NearestFirst(s.shown, s.rect, triangles)
            for i, (*_, s) in enumerate(stale)
            if self._gpu.software and triangles[s.shown.draws].sum() >= occlusion.LARGE
        }

        def draw(numbers: Iterable[int], draws: list[Array], clear: bool) -> None:
            faces = [stale[i] for i in numbers]
            drawn = [(face, place, some) for (face, place, _), some in zip(faces, draws, strict=True)]
            self.draw(frame, drawn, variant_of, anchor=anchor, parts=[s.rect for *_, s in faces], clear=clear)

        nearest = [queues[i].take() if i in queues else s.shown.draws for i, (*_, s) in enumerate(stale)]
        draw(range(len(stale)), nearest, clear=True)
        for turn in range(occlusion.TURNS):
            if turn:
                draw(queues, [queue.take() for queue in queues.values()], clear=False)
            for i, queue in queues.items():  # the reading also waits for what is drawn (``_upload_frames``)
                queue.leave_out(self._depths(stale[i][1], queue.rect))
        draw(queues, [queue.seen if ordered else queue.rest.draws for queue in queues.values()], clear=ordered)

    def _depths(self, place: tuple[int, int], rect: Rect) -> Array:
        """Reversed depth in ``rect`` of the face at ``place``, (h, w) float32, row 0 at the bottom."""
        (x, y), (dx, dy, width, height) = place, rect
        viewport = x + dx, y + dy, width, height
        depths = self._framebuffer.read(viewport=viewport, components=1, attachment=-1, dtype="f4")
        return np.frombuffer(depths, np.float32).reshape(height, width)

    def _upload_frames(self, matrices: list[Array], stale: Sequence[tuple[Face, tuple[int, int], Array]]) -> None:
        """Two records per face, for fixed and for posed draws, all written before the first draw.

        Rewriting one record between draws would be a race on Mesa's llvmpipe: it shades fragments later, and they would
        read the last face's record.
        """
        payload = np.zeros((len(matrices), STRIDE), dtype=np.uint8)
        for i, matrix in enumerate(matrices):
            record = FRAME.zeros()
            record["clip_from_relative"] = column_major(matrix)
            record["forward"][:3] = stale[i // 2][0].forward
            payload[i, : FRAME.dtype.itemsize] = np.frombuffer(record.tobytes(), dtype=np.uint8)
        self._frames = fitted(self._gpu, self._frames, payload)

    def _upload(self, seen: list[Array], scene: SceneBuffers) -> list[list[tuple[Group, int, int]]]:
        """Commands of all faces in one buffer; per face its (group, first, count) runs."""
        payload, runs, size = [], [], 0
        for draws in seen:
            commands, groups = scene.subset(draws)
            runs.append([(group, first + size, count) for group, first, count in groups])
            payload.append(commands)
            size += len(commands)
        every = np.concatenate(payload)
        self._commands, self._triangles = fitted(self._gpu, self._commands, every), triangles_of(every)
        return runs

    def release(self) -> None:
        self._frames.release()
        self._commands.release()


class ShadowPass(Owner):
    """Owns the atlas.  Each light of ``spec.shadowed`` keeps its place in the atlas."""

    def __init__(self, context: GpuContext, spec: FrameSpec, draws: tuple[Draw, ...]):
        super().__init__()
        (declaration,) = shadow_maps(spec)
        gpu = self._gpu = context.gpu
        self._spec = spec
        self.redrawn = 0  # faces drawn in the last run
        faces = spec.light_faces(spec.map_sizes)
        self._first_faces = first_faces(faces)
        self._offsets, _ = pack(faces, spec.tuning.texture_limit)
        tables = context.allocate_all([declaration])
        self.atlas, self._fixed_maps = tables["shadow_atlas"], tables.get("fixed_shadow_atlas")
        self._drawer, self._cache = self._drawing(context, declaration, self.atlas), ShadowMapCache(len(faces))
        if self._fixed_maps is not None:
            self._fixed = fixed_draws(spec.scene, draws)
            self._fixed_drawer = self._drawing(context, declaration, self._fixed_maps)
            self._fixed_cache = ShadowMapCache(len(faces))
        self.rows = FACE.zeros(max(len(faces), 1))
        self._padded = FACE.zeros(-(-len(self.rows) // FACE_ROW) * FACE_ROW)
        size = len(FACE.fields) * FACE_ROW, len(self._padded) // FACE_ROW
        self._table = self.own(gpu.ctx.texture(size, 4, dtype="f4"))
        self._anchor = self.own(AnchoredRecords(gpu, draws, spec.animated.bounds[0]))

    def _drawing(self, context: GpuContext, declaration: RasterPass, atlas: moderngl.Texture) -> FaceDrawer:
        """What draws faces into ``atlas``, which is cleared."""
        ctx = self._gpu.ctx
        self.own(atlas).compare_func = ""
        atlas.filter = (ctx.NEAREST, ctx.NEAREST)
        framebuffer = self.own(ctx.framebuffer(depth_attachment=atlas))
        framebuffer.clear(depth=0.0)
        return self.own(FaceDrawer(context, framebuffer, declaration))

    def depths(self) -> Array:
        """The atlas, (h, w) float32 reversed Z, row 0 at the bottom."""
        return np.frombuffer(self.atlas.read(), np.float32).reshape(self.atlas.height, self.atlas.width)

    def run(self, frame: FrameContext) -> None:
        """Redraw stale faces and fill in the face table and the lights' shadow fields for this frame's camera."""
        spec, light_rows = self._spec, frame.light_rows
        faces = faces_of(spec.scene, frame.state, spec.shadowed, spec.animated.bounds, spec.map_sizes, spec.sun)
        light_rows["color"][:, 3] = -1.0
        for row, first in self._first_faces.items():
            light_rows["color"][row, 3] = first
        FaceTable(faces).fill(self.rows[: len(faces)], self._offsets, frame.view.position)
        # Nothing reads the maps of a light that is off.
        on = [i for i, face in enumerate(faces) if np.any(light_rows["color"][face.light, :3])]
        self._padded[: len(self.rows)] = self.rows
        self._table.write(self._padded.tobytes())
        frame.tables |= {"shadow_atlas": self.atlas, "shadow_faces": self._table, "shadow_face_rows": self.rows}
        self.redrawn = self._redraw(frame, {i: faces[i] for i in on}) if on else 0
        self._gpu.hazards.wrote([self.atlas], drawn=True)

    def _redraw(self, frame: FrameContext, faces: Mapping[int, Face]) -> int:
        """Redraw what is out of date of ``faces``, by number; how many were."""
        rows, table, casters = np.array(list(faces)), FaceTable(list(faces.values())), frame.casters

        @cache
        def variant(group: Group) -> Variant:
            key = frame.materials.keys[group.material + 1]
            return _variant(key, group.posed, group.material in self._spec.colored)

        def placed(stale: list[StaleFace]) -> list[PlacedFace]:
            return [(faces[s.number], self._offsets[s.number], s) for s in stale]

        dirty = self._cache.update(rows, table, casters)
        if dirty:
            self._anchor.update(frame.placement, frame.buffers.order)
        if self._fixed_maps is None:
            self._drawer.draw_stale(frame, placed(dirty), variant, self._anchor, ordered=False)
            return len(dirty)
        still = self._fixed_cache.update(rows, table, casters.only(self._fixed))
        self._fixed_drawer.draw_stale(frame, placed(still), variant, self._anchor, ordered=False)
        moving = [(face, place, s.shown.draws[~self._fixed[s.shown.draws]]) for face, place, s in placed(dirty)]
        parts = [s.rect for s in dirty]
        corners = [place for _, place, _ in moving]
        rects = [(x + px, y + py, w, h) for (x, y), (px, py, w, h) in zip(corners, parts, strict=True)]
        self._gpu.copy_texels(self._fixed_maps, self.atlas, rects)
        self._drawer.draw(frame, moving, variant, anchor=self._anchor, parts=parts, clear=False)
        return len(dirty)
