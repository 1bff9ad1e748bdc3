"""Running the passes of a GLSL method: its textures, its uniforms, its dispatches."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np

from taubench_gl.errors import GraphicsError, MethodError
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.layout import column_major
from taubench_gl.gpu.shader import compile_compute
from taubench_gl.reuse.contract import RESULT, RESULT_FORMAT, Format, Method, PassInfo, Value
from taubench_gl.reuse.frame import FrameInputs
from taubench_gl.reuse.preamble import FRAME, build_source


class GlslPasses:
    """Programs and textures of one method at one size.  Raises MethodError where a shader does not compile."""

    def __init__(self, gpu: Gpu, method: Method, size: tuple[int, int]):
        self._gpu, self._method, self._size = gpu, method, size
        self._group = (32, 1) if gpu.software else (8, 8)  # llvmpipe keeps textures by scanline, GPUs in square tiles
        self._programs: list[moderngl.ComputeShader] = []
        self._parameters: moderngl.Buffer | None = None
        self._now: dict[str, moderngl.Texture] = {}
        self._before: dict[str, moderngl.Texture] = {}
        self._spare: dict[str, moderngl.Texture] = {}
        self._key_view = None
        self._key_age = 0
        try:
            self._programs = [self._compile(info) for info in method.passes]
            self._parameters = gpu.ctx.buffer(reserve=FRAME.dtype.itemsize)
            kept = {**method.history, **method.buffers, RESULT: RESULT_FORMAT}
            for name, form in kept.items():
                self._now[name] = self._texture(form)
                if name in method.history:
                    self._before[name] = self._texture(form)
                if name in method.spares:
                    self._spare[name] = self._texture(form)
        except BaseException:
            self.release()
            raise

    def _compile(self, info: PassInfo) -> moderngl.ComputeShader:
        source = build_source(self._method, info, self._group)
        try:
            return compile_compute(self._gpu.ctx, source)
        except GraphicsError as error:
            what = error.what.removesuffix("; candidates are:")  # a list follows, which one line has no room for
            raise MethodError(what, where=self._method.label) from None

    def _texture(self, form: Format) -> moderngl.Texture:
        texture = self._gpu.ctx.texture(self._size, form.components, dtype=form.dtype)
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return texture

    def clear(self) -> None:
        """All history, buffers and the result become 0; the next frame is a key frame."""
        self._key_view = None
        for texture in (*self._now.values(), *self._before.values(), *self._spare.values()):
            width, height = texture.size
            texture.write(np.zeros((height, width * texture.components), dtype=texture.dtype))

    def run(self, frame: FrameInputs, values: Mapping[str, Value], has_history: bool) -> moderngl.Texture:
        """All passes of one frame.  -> the result; what was written to histories is ``prev_`` next time."""
        self._write_frame(frame, values, has_history)
        self._parameters.bind_to_storage_buffer(0)
        for info, program in zip(self._method.passes, self._programs, strict=True):
            self._set(program, {name: s.number(values[name]) for name, s in self._method.settings.items()})
            for iteration in range(self._method.number(info.repeat, values)):
                self._set(program, {"iteration": iteration})
                self._dispatch(info, program, frame)
        for name in self._method.history:
            self._now[name], self._before[name] = self._before[name], self._now[name]
        return self._now[RESULT]

    def _dispatch(self, info: PassInfo, program: moderngl.ComputeShader, frame: FrameInputs) -> None:
        unit = 0
        for name in info.reads:
            if f"{name}_texture" in program:  # GL drops what a shader does not use
                self._readable(name, frame).use(unit)
                program[f"{name}_texture"] = unit
                unit += 1
        for binding, name in enumerate(info.writes):
            target = self._spare if name in info.reads else self._now
            target[name].bind_to_image(binding, read=False, write=True)
        program.run(-(-self._size[0] // self._group[0]), -(-self._size[1] // self._group[1]))
        self._gpu.ctx.memory_barrier()
        for name in info.writes:
            if name in info.reads:
                self._now[name], self._spare[name] = self._spare[name], self._now[name]

    def _readable(self, name: str, frame: FrameInputs) -> moderngl.Texture:
        if name in self._now:
            return self._now[name]
        history = name.removeprefix("prev_")
        return self._before[history] if history in self._before else frame.textures[name]

    @staticmethod
    def _set(program: moderngl.ComputeShader, uniforms: Mapping[str, float | int | bool]) -> None:
        for name, value in uniforms.items():
            if name in program:
                program[name] = value

    def _write_frame(self, frame: FrameInputs, values: Mapping[str, Value], has_history: bool) -> None:
        pair, record = frame.pair, FRAME.zeros()
        every = self._method.number(self._method.keyframe, values)
        if every is not None:
            self._key_age += 1
            if self._key_view is None or not has_history or self._key_age >= every:
                self._key_view, self._key_age = frame.view, 0
            record["key_clip_from_key"] = column_major(self._key_view.clip_from_relative(*self._size))
            record["key_delta"][:3] = frame.view.position - self._key_view.position
            record["is_key"], record["key_age"] = self._key_age == 0, self._key_age
        record["clip_from_current"] = column_major(pair.clip_from_current)
        record["prev_clip_from_prev"] = column_major(pair.prev_clip_from_prev)
        record["sky_origin"], record["sky_dx"], record["sky_dy"] = pair.sky_origin, pair.sky_dx, pair.sky_dy
        record["prev_forward"][:3], record["camera_delta"][:3] = pair.prev_forward, pair.camera_delta
        record["size"][:2] = self._size
        record["jitter_px"], record["prev_jitter_px"] = frame.jitter_px, frame.prev_jitter_px
        record["time"], record["exposure"] = frame.time, frame.exposure
        record["near"], record["prev_near"] = pair.near, pair.prev_near
        record["index"], record["has_history"] = frame.index, has_history
        self._parameters.write(record.tobytes())

    def release(self) -> None:
        for item in (*self._programs, *self._now.values(), *self._before.values(), *self._spare.values()):
            item.release()
        if self._parameters is not None:
            self._parameters.release()
        self._programs, self._parameters = [], None
        for textures in (self._now, self._before, self._spare):
            textures.clear()
