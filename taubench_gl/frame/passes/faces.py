"""Drawing the scene into faces of lights: what the shadow pass and the reflective shadow maps have in common."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.frame.geometry import Draw
from taubench_gl.frame.materials import MaterialTable
from taubench_gl.frame.passes.gbuffer import FRAME
from taubench_gl.frame.records import RECORD, Placement, RecordTable
from taubench_gl.frame.scene_buffers import COMMAND, Group, SceneBuffers
from taubench_gl.frame.shadow_faces import Face
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.layout import column_major

Array = np.ndarray
STRIDE = 256  # bytes; no driver asks for a larger alignment of uniform buffer offsets


@dataclass(frozen=True, slots=True)
class Program:
    """How to draw one group: the shader variant, and the texture slots it samples."""

    program: moderngl.Program
    slots: tuple[str, ...]


class Casters:
    """World bounds of every draw, and a version number that grows when a draw moves, bends, appears or vanishes."""

    def __init__(self, count: int):
        self.centers, self.radii = np.zeros((count, 3)), np.zeros(count)
        self.versions = np.zeros(count, dtype=np.int64)
        self.visible = np.zeros(count, dtype=bool)
        self._poses: list[bytes] = [b""] * count

    def update(self, bounds: tuple[Array, Array], poses: list[bytes], visible: Array) -> None:
        """``bounds``: centres (D, 3) and radii (D,), world; ``poses``: equal bytes for equal pose, per draw."""
        self.centers, self.radii = bounds
        for i, pose in enumerate(poses):
            if pose != self._poses[i]:
                self._poses[i] = pose
                self.versions[i] += 1
        self.visible = visible

    def key(self) -> bytes:
        """Equal exactly while nothing moves, bends, appears or vanishes."""
        return self.visible.tobytes() + self.versions[self.visible].tobytes()

    def seen_by(self, face: Face) -> tuple[Array, bytes]:
        """Draws that can be seen in ``face``, and bytes that are equal while the face's picture is."""
        seen = np.flatnonzero(self.visible & face.sees(self.centers, self.radii))
        return seen, face.key + seen.tobytes() + self.versions[seen].tobytes()


class AnchoredRecords:
    """A record table relative to a fixed point instead of the camera.

    What is drawn with it has the same bits wherever the camera is, so a map drawn long ago is the map that would be
    drawn now.  Posed draws have their place in their vertices, which are relative to the camera: they keep that.
    """

    def __init__(self, gpu: Gpu, draws: tuple[Draw, ...], origin: Array):
        self.origin = np.asarray(origin, dtype=np.float64)
        self._table = RecordTable(draws)
        self._posed = np.array([d.posed for d in draws], dtype=bool)
        self.buffer = gpu.ctx.buffer(reserve=max(len(draws), 1) * RECORD.dtype.itemsize, dynamic=True)
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

    def release(self) -> None:
        self.buffer.release()


class FaceDrawer:
    """Draws lists of (face, atlas offset, seen draws) into one framebuffer."""

    def __init__(self, gpu: Gpu):
        self._gpu = gpu
        self._frames = gpu.ctx.buffer(reserve=STRIDE * 8, dynamic=True)
        self._commands = gpu.ctx.buffer(reserve=COMMAND.itemsize * 1024, dynamic=True)

    def draw(
        self,
        stale: list[tuple[Face, tuple[int, int], Array]],
        framebuffer: moderngl.Framebuffer,
        view: View,
        scene: SceneBuffers,
        materials: MaterialTable,
        program_of: Callable[[Group], Program],
        *,
        depth_test: bool = True,
        anchor: AnchoredRecords | None = None,
        parts: list[tuple[int, int, int, int]] | None = None,
    ) -> None:
        """Clear and redraw each face.  Nothing is culled by facing: both sides of a surface stop light.

        ``parts``: x, y, width, height of what to redraw of each, texels of the face; the rest stays as it is.
        ``anchor``: up to date, for maps that must not depend on where the camera was when they were drawn.
        """
        if not stale:
            return
        ctx = self._gpu.ctx
        runs = self._upload([seen for _, _, seen in stale], scene)
        origins = [view.position if anchor is None else anchor.origin, view.position]  # of fixed and of posed draws
        self._upload_frames([face.clip_from_relative(o) for face, _, _ in stale for o in origins], stale)
        framebuffer.use()
        ctx.enable_only(moderngl.DEPTH_TEST if depth_test else moderngl.NOTHING)
        ctx.depth_func = ">"
        records = scene.records if anchor is None else anchor.buffer
        for at, ((face, (x, y), _), groups) in enumerate(zip(stale, runs, strict=True)):
            viewport = (x, y, face.resolution, face.resolution)
            part = viewport if parts is None else (x + parts[at][0], y + parts[at][1], *parts[at][2:])
            framebuffer.clear(0.0, 0.0, 0.0, 0.0, depth=0.0, viewport=part)
            framebuffer.viewport = viewport
            if parts is not None:
                framebuffer.scissor = part
            for group, first, count in groups:
                row = 2 * at + group.posed
                self._frames.bind_to_uniform_block(2, offset=row * STRIDE, size=FRAME.dtype.itemsize)
                how = program_of(group)
                materials.bind(group.material, how.program, how.slots)
                scene.draw_commands(group, how.program, self._commands, first, count, records)
        if parts is not None:
            framebuffer.scissor = None
        materials.unbind()

    def _upload_frames(self, matrices: list[Array], stale: list[tuple[Face, tuple[int, int], Array]]) -> None:
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
        self._frames = self._fitted(self._frames, payload)

    def _fitted(self, buffer: moderngl.Buffer, payload: Array) -> moderngl.Buffer:
        """``buffer`` with ``payload`` in it, reallocated only when it has grown."""
        if buffer.size < payload.nbytes:
            buffer.release()
            buffer = self._gpu.ctx.buffer(reserve=payload.nbytes * 3 // 2, dynamic=True)
        if payload.nbytes:
            buffer.write(payload.tobytes())
        return buffer

    def _upload(self, seen: list[Array], scene: SceneBuffers) -> list[list[tuple[Group, int, int]]]:
        """Commands of all faces in one buffer; per face its (group, first, count) runs."""
        payload, runs, size = [], [], 0
        for draws in seen:
            commands, groups = scene.subset(draws)
            runs.append([(group, first + size, count) for group, first, count in groups])
            payload.append(commands)
            size += len(commands)
        commands = np.concatenate(payload)
        self._commands = self._fitted(self._commands, commands)
        return runs

    def release(self) -> None:
        self._frames.release()
        self._commands.release()
