"""Running declared passes: the GPU context they are made from, barriers, compiled compute and raster passes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from taubench_gl.errors import GraphicsError
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.declare import BUFFER, IMAGE, TEXTURE, ComputePass, Pass, RasterPass, Resource, Use
from taubench_gl.gpu.hazards import COMMAND, FETCH, IMAGE_ACCESS, STORAGE, Hazards
from taubench_gl.gpu.memory import require_memory
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.gpu.timing import PassTimer

if TYPE_CHECKING:
    import moderngl

_WAYS = {TEXTURE: FETCH, IMAGE: IMAGE_ACCESS, BUFFER: STORAGE}


class GpuContext:
    """An OpenGL context, the programs compiled for it and the timer of its passes.

    Owns ``shaders`` unless it was given: ``release`` frees it.
    """

    def __init__(self, gpu: Gpu, shaders: ShaderCache | None = None, timer: PassTimer | None = None):
        """``timer``: None measures nothing and never waits."""
        self.gpu = gpu
        self.shaders = ShaderCache(gpu.ctx) if shaders is None else shaders
        self.timer = PassTimer(gpu, enabled=False) if timer is None else timer
        self._owned = shaders is None

    def allocate(self, resource: Resource) -> moderngl.Texture | moderngl.Buffer:
        """The texture or buffer that ``resource`` declares, not filled.

        Raises GraphicsError where the device has no room for it.
        """
        require_room(self.gpu, resource)
        if resource.size is None:
            return self.gpu.ctx.buffer(reserve=resource.bytes)
        if resource.dtype == "depth":
            return self.gpu.depth_texture(resource.size)
        return self.gpu.texture(resource.size, resource.components, resource.dtype)

    def allocate_all(self, passes: Iterable[Pass]) -> dict[str, Any]:
        """Everything that ``passes`` own, by name."""
        return {r.name: self.allocate(r) for p in passes for r in p.resources}

    def compute(self, declaration: ComputePass) -> CompiledCompute:
        return CompiledCompute(self, declaration)

    def raster(self, declaration: RasterPass) -> CompiledRaster:
        return CompiledRaster(self, declaration)

    def release(self) -> None:
        """Free the programs that this context compiled."""
        if self._owned:
            self.shaders.release()


def require_room(gpu: Gpu, resource: Resource) -> None:
    """Raise GraphicsError where the device has no room for ``resource``."""
    label, hint = resource.what or resource.label, resource.hint
    if resource.size is not None:
        limit = gpu.ctx.info["GL_MAX_TEXTURE_SIZE"]
        if max(resource.size) > limit:
            needed = f"{resource.size[0]}x{resource.size[1]} texels"
            raise GraphicsError(f"{label} would need {needed}, this device's textures end at {limit}", hint=hint)
    elif hint:
        limit = gpu.ctx.info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"]
        if resource.bytes > limit:
            needed = f"{resource.bytes} bytes"
            raise GraphicsError(f"{label} would need {needed}, this device's buffers end at {limit}", hint=hint)
    require_memory(gpu, resource.bytes, label, hint)


class _Constants:
    """The uniform blocks of a pass, filled for every run."""

    def __init__(self, gpu: Gpu, declaration: Pass):
        self._blocks = []
        for use, binding in declaration.bindings():
            if use.name in declaration.fills:
                struct, fill = declaration.fills[use.name]
                rows = struct.zeros(use.count or None)
                buffer = gpu.ctx.buffer(reserve=rows.nbytes, dynamic=True)
                self._blocks.append((binding, buffer, rows, fill))

    def bind(self, frame: Any) -> None:
        for binding, buffer, rows, fill in self._blocks:
            values = fill(frame)
            if isinstance(values, Mapping):
                for name, value in values.items():
                    rows[name] = value
            else:
                rows[...] = values
            buffer.write(rows.tobytes())
            buffer.bind_to_uniform_block(binding)

    def release(self) -> None:
        for _, buffer, _, _ in self._blocks:
            buffer.release()


def bind_uses(hazards: Hazards, bindings: Iterable[tuple[Use, int]], resources: Mapping[str, Any]) -> None:
    """Bind every texture, image and buffer of a pass, after the barrier for what earlier passes wrote."""
    uses = [(use, binding, resources[use.key]) for use, binding in bindings if use.form in _WAYS]
    hazards.before((resource, _WAYS[use.form]) for use, _, resource in uses)
    for use, binding, resource in uses:
        if use.form == TEXTURE:
            resource.use(binding)
        elif use.form == IMAGE:
            resource.bind_to_image(binding, read=use.reads, write=use.writes)
        else:
            resource.bind_to_storage_buffer(binding)


class CompiledCompute:
    """A compute pass ready to run."""

    def __init__(self, context: GpuContext, declaration: ComputePass):
        self.declaration = declaration
        self._hazards = context.gpu.hazards
        self.program = context.shaders.compute(declaration.shaders[0], declaration.defines, declaration.interface())
        self._constants = _Constants(context.gpu, declaration)
        self._bindings = declaration.bindings()
        self._written = [(use.key, _WAYS[use.form]) for use in declaration.uses if use.form in _WAYS and use.writes]

    def run(
        self,
        frame: Any,
        resources: Mapping[str, Any],
        groups_at: tuple[str, int] | None = None,
        rows: int | None = None,
        again: bool = False,
        **uniforms: Any,
    ) -> None:
        """Bind everything declared, wait for what earlier passes wrote, dispatch.

        ``frame`` goes to the fills of constants; ``resources``: textures and buffers by ``Use.key``.  ``groups_at``:
        the buffer, and the byte in it, that holds the numbers of work groups; ``rows``: of invocations; None: as
        declared; ``again``: it was the pass before, with the same resources, so that all is bound.
        """
        if again:
            self._hazards.before((resources[key], way) for key, way in self._written)
        else:
            self._constants.bind(frame)
            bind_uses(self._hazards, self._bindings, resources)
        for name, value in uniforms.items():
            self.program[name] = value
        if groups_at is None:
            across, down = self.declaration.groups
            self.program.run(across, down if rows is None else -(-rows // self.declaration.group[1]))
        else:
            buffer = resources[groups_at[0]]
            self._hazards.before([(buffer, COMMAND)])
            self.program.run_indirect(buffer, groups_at[1])
        self._hazards.wrote(resources[key] for key, _ in self._written)

    def release(self) -> None:
        """Free the constants; the program belongs to the shader cache."""
        self._constants.release()


class CompiledRaster:
    """A raster pass: its programs, compiled when a group of draws first needs one."""

    def __init__(self, context: GpuContext, declaration: RasterPass):
        self.declaration = declaration
        self.bindings = {use.name: binding for use, binding in declaration.bindings()}
        self._shaders = context.shaders
        self._interface, self._outputs = declaration.interface(), declaration.fragment_outputs()
        self._programs: dict[int, tuple[Mapping[str, object], moderngl.Program]] = {}  # by identity of the macros

    def program(self, defines: Mapping[str, object]) -> moderngl.Program:
        """The variant with these macros, which stay as they are: draws pass the same mapping frame after frame."""
        known = self._programs.get(id(defines))
        if known is None:
            macros = {**self.declaration.defines, **defines}
            program = self._shaders.render(*self.declaration.shaders, macros, self._interface, self._outputs)
            known = self._programs[id(defines)] = defines, program
        return known[1]


def fitted(gpu: Gpu, buffer: moderngl.Buffer, payload: np.ndarray) -> moderngl.Buffer:
    """``buffer`` with ``payload`` in it, reallocated only when it has grown."""
    if buffer.size < payload.nbytes:
        buffer.release()
        buffer = gpu.ctx.buffer(reserve=payload.nbytes * 3 // 2, dynamic=True)
    if payload.nbytes:
        buffer.write(payload.tobytes())
    return buffer
