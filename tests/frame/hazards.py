"""What GL leaves to the caller: barriers between shader writes and later reads, and one unit for each image.

Mesa's llvmpipe ends a dispatch before it returns, so a missing barrier shows in no image here; a GPU may read the old
contents.  ``Hazards`` watches the calls instead, and follows of every texture and buffer which ways of reading
it no barrier has made safe yet.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

import moderngl
import pytest

from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.declare import BUFFER
from taubench_gl.gpu.passes import CompiledCompute

IMAGE, FETCH = moderngl.SHADER_IMAGE_ACCESS_BARRIER_BIT, moderngl.TEXTURE_FETCH_BARRIER_BIT
STORAGE, ATTRIBUTE = moderngl.SHADER_STORAGE_BARRIER_BIT, moderngl.VERTEX_ATTRIB_ARRAY_BARRIER_BIT
TEXTURE_UPDATE, BUFFER_UPDATE = moderngl.TEXTURE_UPDATE_BARRIER_BIT, moderngl.BUFFER_UPDATE_BARRIER_BIT
FRAMEBUFFER = moderngl.FRAMEBUFFER_BARRIER_BIT

DRAWN = IMAGE
"""Drawn pixels: samplers and framebuffers see them without a barrier, image loads need one."""

STORED_TEXTURE = IMAGE | FETCH | TEXTURE_UPDATE | FRAMEBUFFER
STORED_BUFFER = STORAGE | ATTRIBUTE | BUFFER_UPDATE

_ACTIVE_UNIFORMS, _BLOCKS, _ACTIVE_RESOURCES, _BUFFER_BINDING = 0x8B86, 0x92E6, 0x92F5, 0x9302
_SAMPLER_TYPES, _IMAGE_TYPES = {0x8B5E, 0x8DCA, 0x8DD2}, {0x904D, 0x9058, 0x9063}  # 2D: float, int, unsigned


@dataclass(frozen=True)
class Bindings:
    """What a linked program names, without what the compiler left out: (name, unit) of images and samplers, and the
    bindings of its storage blocks."""

    images: tuple[tuple[str, int], ...]
    samplers: tuple[tuple[str, int], ...]
    storage: tuple[int, ...]


def bindings_of(gpu: Gpu, program: int) -> Bindings:
    """As GL itself reports them; units of samplers are those set last."""

    def call(name: str, result: Any, *arguments: Any) -> Any:
        kinds = [ctypes.c_uint if isinstance(a, int) else ctypes.c_void_p for a in arguments]
        return ctypes.CFUNCTYPE(result, *kinds)(gpu._function(name))(*arguments)

    def number(name: str, *arguments: Any) -> int:
        out = ctypes.c_int()
        call(name, None, *arguments, ctypes.byref(out))
        return out.value

    found: dict[str, list[tuple[str, int]]] = {"image": [], "sampler": []}
    for i in range(number("glGetProgramiv", program, _ACTIVE_UNIFORMS)):
        text, size, kind = ctypes.create_string_buffer(256), ctypes.c_int(), ctypes.c_uint()
        out = (None, ctypes.byref(size), ctypes.byref(kind), text)
        call("glGetActiveUniform", None, program, i, 256, *out)
        what = "image" if kind.value in _IMAGE_TYPES else "sampler" if kind.value in _SAMPLER_TYPES else None
        if what:
            place = call("glGetUniformLocation", ctypes.c_int, program, text)
            found[what].append((text.value.decode(), number("glGetUniformiv", program, place)))
    storage = []
    for i in range(number("glGetProgramInterfaceiv", program, _BLOCKS, _ACTIVE_RESOURCES)):
        property_, out = ctypes.c_uint(_BUFFER_BINDING), ctypes.c_int()
        rest = (1, ctypes.byref(property_), 1, None, ctypes.byref(out))
        call("glGetProgramResourceiv", None, program, _BLOCKS, i, *rest)
        storage.append(out.value)
    return Bindings(tuple(found["image"]), tuple(found["sampler"]), tuple(storage))


class Hazards:
    """Watches every call of moderngl until the test ends; ``faults`` lists what was read too early.

    A program counts as writing every storage buffer that it names, unless its pass declares it as read, and every image
    bound for writing.
    """

    def __init__(self, gpu: Gpu, monkeypatch: pytest.MonkeyPatch):
        self._gpu = gpu
        self.faults: list[str] = []
        self.dispatches = 0
        self._unsafe: dict[Any, int] = {}  # object -> ways of reading it that still need a barrier
        self._images: dict[int, tuple[moderngl.Texture, bool, bool]] = {}
        self._samplers: dict[int, moderngl.Texture] = {}
        self._storage: dict[int, moderngl.Buffer] = {}
        self._target: moderngl.Framebuffer | None = None
        watch = {
            (moderngl.Texture, "bind_to_image"): self._bind_image,
            (moderngl.Texture, "use"): lambda texture, location=0: self._samplers.update({location: texture}),
            (moderngl.Buffer, "bind_to_storage_buffer"): self._bind_storage,
            (moderngl.Framebuffer, "use"): lambda target: setattr(self, "_target", target),
            (moderngl.Framebuffer, "clear"): lambda target, *a, **k: self._draw_into(target),
            (moderngl.Framebuffer, "read"): lambda target, *a, **k: self._see_target(target, "read back"),
            (moderngl.VertexArray, "render"): self._draw,
            (moderngl.VertexArray, "render_indirect"): self._draw,
            (moderngl.ComputeShader, "run"): self._dispatch,
            (moderngl.Context, "memory_barrier"): self._barrier,
        }
        for name in ("read", "read_into", "write"):
            watch[moderngl.Texture, name] = lambda t, *a, **k: self._see(t, TEXTURE_UPDATE, "a copy of a texture")
            watch[moderngl.Buffer, name] = lambda b, *a, **k: self._see(b, BUFFER_UPDATE, "a copy of a buffer")
        watch[moderngl.Buffer, "clear"] = watch[moderngl.Buffer, "write"]
        for (kind, name), before in watch.items():
            monkeypatch.setattr(kind, name, self._watched(getattr(kind, name), before))
        self._readonly: set[int] = set()  # bindings of storage buffers that the running pass cannot write
        monkeypatch.setattr(CompiledCompute, "run", self._declared(CompiledCompute.run))

    def _declared(self, run):
        """Buffers that a pass declares as read are ``readonly`` in its shader, so it does not write them."""

        def call(compiled: CompiledCompute, *arguments, **named):
            bindings = compiled.declaration.bindings()
            self._readonly = {b for use, b in bindings if use.form == BUFFER and not use.writes}
            try:
                return run(compiled, *arguments, **named)
            finally:
                self._readonly = set()

        return call

    @staticmethod
    def _watched(method, before):
        def call(self, *arguments, **named):
            before(self, *arguments, **named)
            return method(self, *arguments, **named)

        return call

    def _see(self, what: Any, way: int, who: str) -> None:
        if self._unsafe.get(what, 0) & way:
            self.faults.append(f"{who} without a barrier")

    def _barrier(self, ctx: moderngl.Context, barriers: int = moderngl.ALL_BARRIER_BITS, by_region: bool = False):
        self._unsafe = {what: ways & ~barriers for what, ways in self._unsafe.items() if ways & ~barriers}

    def _bind_image(self, texture, unit, read=True, write=True, level=0, format=0) -> None:
        self._images[unit] = texture, read, write

    def _bind_storage(self, buffer, binding=0, offset=0, size=-1) -> None:
        self._storage[binding] = buffer

    def _dispatch(self, program: moderngl.ComputeShader, *groups: int) -> None:
        self.dispatches += 1
        named = self._run(program.glo)
        for binding in named.storage:
            self._see(self._storage[binding], STORAGE, f"storage buffer {binding} read")
        self._store(named)

    def _draw(self, array: moderngl.VertexArray, *arguments, **named) -> None:
        for buffer, *_ in array._content:
            self._see(buffer, ATTRIBUTE, "vertices drawn")
        self._draw_into(self._target)
        # Fragments only set bits of storage buffers, by atomics: among themselves these need no order.
        self._store(self._run(array.program.glo))

    def _run(self, program: int) -> Bindings:
        """Look at everything that a program is about to read, but for storage buffers."""
        named = bindings_of(self._gpu, program)
        units = [unit for _, unit in named.images]
        for name, unit in named.images:
            if units.count(unit) > 1:
                self.faults.append(f"image {name} shares unit {unit}")
            texture, read, _ = self._images[unit]
            if read:
                self._see(texture, IMAGE, f"image {name} read")
        for name, unit in named.samplers:
            self._see(self._samplers.get(unit), FETCH, f"sampler {name} read")
        return named

    def _store(self, named: Bindings) -> None:
        for _, unit in named.images:
            texture, _, write = self._images[unit]
            if write:
                self._unsafe[texture] = STORED_TEXTURE
        written = set(named.storage) - self._readonly
        self._unsafe |= {self._storage[binding]: STORED_BUFFER for binding in written}

    def _see_target(self, target: moderngl.Framebuffer, who: str) -> None:
        for texture in _attachments(target):
            self._see(texture, FRAMEBUFFER, f"a framebuffer {who}")

    def _draw_into(self, target: moderngl.Framebuffer) -> None:
        self._see_target(target, "drawn into")
        for texture in _attachments(target):
            self._unsafe[texture] = self._unsafe.get(texture, 0) | DRAWN


def _attachments(target: moderngl.Framebuffer) -> list[Any]:
    return [a for a in (*(target.color_attachments or ()), target.depth_attachment) if a is not None]
