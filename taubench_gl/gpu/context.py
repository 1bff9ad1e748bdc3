"""OpenGL 4.5 contexts without a screen: EGL through glcontext, OSMesa through a loader.

``auto`` tries EGL first (hardware drivers and Mesa), then OSMesa.  A context belongs to the process and the thread that
opened it: each thread has one per backend and device.  Drivers do not survive a fork, so a child of a process that has
opened a context gets a GraphicsError instead of a call that never returns.
"""

from __future__ import annotations

import ctypes
import os
import re
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from taubench_gl.errors import GraphicsError
from taubench_gl.gpu.hazards import Hazards
from taubench_gl.gpu.shared import Shared

if TYPE_CHECKING:
    import moderngl

BACKEND_VARIABLE = "TAUBENCH_BACKEND"
REQUIRED_VERSION = 450
_GL_LOWER_LEFT, _GL_ZERO_TO_ONE = 0x8CA1, 0x935F
_GL_RGBA8, _GL_SRGB8_ALPHA8 = 0x8058, 0x8C43
_GL_TEXTURE_2D, _GL_DEPTH_COMPONENT, _GL_DEPTH_COMPONENT32F, _GL_FLOAT = 0x0DE1, 0x1902, 0x8CAC, 0x1406
_INSTALL = {
    "egl": "apt-get install libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri, or a vendor driver with EGL",
    "osmesa": "apt-get install libosmesa6, on distributions that still have it",
}
_NO_DEVICE = re.compile(r"requested device index \d+, but found (\d+) devices")  # glcontext's words
OSMESA_LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
EGL_LIBRARIES = ("libEGL.so.1", "libEGL.so")

_GL_UNSIGNED_BYTE = 0x1401
_OSMESA_FORMAT, _OSMESA_DEPTH_BITS, _OSMESA_STENCIL_BITS = 0x22, 0x30, 0x31
_OSMESA_PROFILE, _OSMESA_CORE_PROFILE = 0x33, 0x34
_OSMESA_MAJOR, _OSMESA_MINOR = 0x36, 0x37
_OSMESA_RGBA = 0x1908

SUBMITTED_TRIANGLES = 1 << 18
"""Triangles that llvmpipe may have to draw at a time (``Gpu.portions``)."""


@dataclass(slots=True)
class Gpu:
    """A current GL context and the few facts about it that code may depend on."""

    ctx: moderngl.Context
    backend: str  # egl | osmesa
    renderer: str
    vendor: str
    version: str
    software: bool
    _keep: Any = field(default=None, repr=False)  # objects the context needs alive
    _function: Callable[[str], int] = field(default=lambda name: 0, repr=False)  # address of a GL function
    _entered: int = field(default=0, repr=False)  # how many ``with`` blocks are open
    _submitted: int = field(default=0, repr=False)  # triangles since llvmpipe was waited for
    _nothing: moderngl.Framebuffer | None = field(default=None, repr=False)  # framebuffer 0
    hazards: Hazards | None = field(default=None, repr=False)  # barriers; one for all copies of this record
    shared: Shared = field(default_factory=Shared, repr=False)  # one for all copies of this record
    _owner: tuple[int, int] = field(default_factory=lambda: _this_thread(), repr=False)  # process, thread

    def __post_init__(self) -> None:
        if self.hazards is None:
            self.hazards = Hazards(self.ctx)

    def __enter__(self) -> Gpu:
        self._require_owner()
        # An evaluation inside a caller's ``with gpu`` must leave the context current.
        if self._entered == 0:
            self.ctx.__enter__()
        self._entered += 1
        return self

    def __exit__(self, *exc: Any) -> None:
        self._entered -= 1
        if self._entered == 0:
            self.ctx.__exit__(*exc)

    def _require_owner(self) -> None:
        """Raises GraphicsError in a forked child and on another thread than the context's."""
        process, thread = _this_thread()
        if process != self._owner[0]:
            raise _after_fork()
        if thread != self._owner[1]:
            message = "an OpenGL context was used on another thread than the one that opened it"
            raise GraphicsError(message, hint="start and finish an evaluation on one thread; each thread opens its own")

    def finish(self) -> None:
        """Wait until everything submitted is done."""
        self.ctx.finish()

    def portions(self, triangles: np.ndarray) -> Iterator[tuple[int, int]]:
        """First and end of the draws, of so many ``triangles`` (N,), to submit at a time.

        llvmpipe keeps what it has made of triangles, some 250 bytes of each, in up to 64 buffers of 36 MB, which it
        fills while others are drawn and does not free: it has to wait before there are more than a few of them.
        """
        submitted, first = self._submitted + np.cumsum(triangles), 0
        self._submitted = int(submitted[-1]) % SUBMITTED_TRIANGLES
        if self.software and submitted[-1] >= SUBMITTED_TRIANGLES:
            for end in np.flatnonzero(np.diff(submitted // SUBMITTED_TRIANGLES, prepend=0)) + 1:
                yield first, int(end)
                self.finish()
                first = int(end)
        if first < len(triangles):
            yield first, len(triangles)

    def flush(self) -> None:
        """Let everything submitted begin, without waiting: llvmpipe otherwise draws only what it must."""
        ctypes.CFUNCTYPE(None)(self._function("glFlush"))()

    def depth_texture(self, size: tuple[int, int]) -> moderngl.Texture:
        """A depth texture of 32-bit floats.

        moderngl's own is 24-bit fixed point, with which reversed Z is no better than standard Z: near 1e-4 puts
        everything beyond 1700 m on one value.
        """
        texture = self.ctx.depth_texture(size)
        texture.use(0)
        integers = [ctypes.c_int] * 5
        prototype = ctypes.CFUNCTYPE(None, ctypes.c_uint, *integers, ctypes.c_uint, ctypes.c_uint, ctypes.c_void_p)
        define_image = prototype(self._function("glTexImage2D"))
        define_image(_GL_TEXTURE_2D, 0, _GL_DEPTH_COMPONENT32F, *size, 0, _GL_DEPTH_COMPONENT, _GL_FLOAT, None)
        return texture

    def mipmapped(self, size: tuple[int, int], *, srgb: bool) -> moderngl.Texture:
        """An RGBA8 texture with room for all its levels; ``srgb``: texels are sRGB-encoded.

        moderngl's own has room for one: building mipmaps moves it, which takes its memory twice.
        """
        owner, kind = self.ctx.texture((1, 1), 4), _GL_SRGB8_ALPHA8 if srgb else _GL_RGBA8
        integer, unsigned = ctypes.c_int, ctypes.c_uint
        prototype = ctypes.CFUNCTYPE(None, unsigned, integer, unsigned, integer, integer)
        prototype(self._function("glTextureStorage2D"))(owner.glo, max(size).bit_length(), kind, *size)
        texture = self.ctx.external_texture(owner.glo, size, 4, 0, "f1")  # which frees nothing itself
        texture.release = owner.release
        return texture

    def copy_texels(self, source: moderngl.Texture, target: moderngl.Texture, rects: Iterable[tuple]) -> None:
        """Copy ``rects`` (x, y, width, height) of ``source`` to the same texels of ``target``, bit for bit."""
        place = [ctypes.c_uint, ctypes.c_uint, *[ctypes.c_int] * 4]
        copy = ctypes.CFUNCTYPE(None, *place, *place, *[ctypes.c_int] * 3)(self._function("glCopyImageSubData"))
        for x, y, width, height in rects:
            place = _GL_TEXTURE_2D, 0, x, y, 0
            copy(source.glo, *place, target.glo, *place, width, height, 1)

    def texture(self, size: tuple[int, int], components: int = 4, dtype: str = "f4") -> moderngl.Texture:
        """A texture whose texels are read one by one, not filtered.  ``dtype``: as in moderngl."""
        texture = self.ctx.texture(size, components, dtype=dtype)
        texture.filter = (self.ctx.NEAREST, self.ctx.NEAREST)
        return texture

    def unbind_framebuffer(self) -> None:
        """Bind framebuffer 0: moderngl re-binds what was bound before it made one, and a deleted one is an error."""
        if self._nothing is None:
            self._nothing = self.ctx.detect_framebuffer(0)
        self._nothing.use()

    def collect(self) -> int:
        """Release GL objects without references; the number released."""
        count = 0
        while self.ctx.objects:  # ctx.gc() itself stumbles over objects that were released by hand
            release = getattr(self.ctx.objects.popleft(), "release", None)
            if release is not None:
                release()
                count += 1
        return count

    def check(self, where: str) -> None:
        """Raise if GL has recorded an error: a clean error state is part of every result."""
        error = self.ctx.error
        if error != "GL_NO_ERROR":
            raise GraphicsError(f"{error} after {where}", hint="this is a fault of taubench-gl or of the driver")


def open_library(names: tuple[str, ...]) -> ctypes.CDLL | None:
    """The first of ``names`` that loads, or None."""
    for name in names:
        try:
            return ctypes.CDLL(name, mode=ctypes.RTLD_GLOBAL)
        except OSError:
            continue
    return None


class OSMesaContext:
    """An OSMesa core context that moderngl can use: ``moderngl.create_context(context=OSMesaContext())``.

    Raises OSError with the reason when libOSMesa is absent or gives no GL 4.5 core context.
    """

    def __init__(self, version: tuple[int, int] = (4, 5)):
        library = open_library(OSMESA_LIBRARIES)
        if library is None:
            raise OSError("libOSMesa is not installed (Mesa 25.1 and later no longer has it)")
        self._library = library
        self._get = library.OSMesaGetProcAddress
        self._get.restype, self._get.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
        create = library.OSMesaCreateContextAttribs
        create.restype, create.argtypes = ctypes.c_void_p, [ctypes.POINTER(ctypes.c_int), ctypes.c_void_p]
        attributes = [_OSMESA_FORMAT, _OSMESA_RGBA, _OSMESA_DEPTH_BITS, 24, _OSMESA_STENCIL_BITS, 8]
        attributes += [_OSMESA_PROFILE, _OSMESA_CORE_PROFILE, _OSMESA_MAJOR, version[0], _OSMESA_MINOR, version[1], 0]
        self._handle = create((ctypes.c_int * len(attributes))(*attributes), None)
        if not self._handle:
            raise OSError(f"OSMesa gives no GL {version[0]}.{version[1]} core context")
        # OSMesa draws its default framebuffer into our memory; everything here goes to framebuffer objects instead.
        self._pixels = ctypes.create_string_buffer(4 * 4 * 4)
        self._make_current = library.OSMesaMakeCurrent
        self._make_current.restype = ctypes.c_ubyte
        self._make_current.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_int]
        self.__enter__()

    def load_opengl_function(self, name: str) -> int:
        """Address of a GL function, 0 if there is none (moderngl calls this)."""
        return self._get(name.encode()) or 0

    load = load_opengl_function

    def __enter__(self) -> OSMesaContext:
        if not self._make_current(self._handle, self._pixels, _GL_UNSIGNED_BYTE, 4, 4):
            raise OSError("OSMesaMakeCurrent failed")
        return self

    def __exit__(self, *exc: Any) -> None:
        pass

    def release(self) -> None:
        if self._handle:
            self._library.OSMesaDestroyContext.argtypes = [ctypes.c_void_p]
            self._library.OSMesaDestroyContext(self._handle)
            self._handle = None


def egl_function(name: str) -> int:
    """Address of a GL function of the current EGL context, 0 if there is none."""
    library = open_library(EGL_LIBRARIES)
    if library is None:
        return 0
    get = library.eglGetProcAddress
    get.restype, get.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    return get(name.encode()) or 0


class _Contexts(threading.local):
    """The contexts of one thread, by backend and device."""

    def __init__(self) -> None:
        self.by_name: dict[tuple[str, int | None], Gpu] = {}


_open = _Contexts()
_opened_in: set[int] = set()
"""Processes that have opened a context: this one, and those it was forked from."""


def _this_thread() -> tuple[int, int]:
    return os.getpid(), threading.get_ident()


def _after_fork() -> GraphicsError:
    why = "this process was forked from one that had opened OpenGL, which drivers do not survive"
    return GraphicsError(why, hint="use the start method 'spawn' or 'forkserver', or fork before the first evaluation")


def _require_unforked() -> None:
    if _opened_in - {os.getpid()}:
        raise _after_fork()


def open_gpu(backend: str = "auto", device: int | None = None) -> Gpu:
    """This thread's context on ``backend`` (auto | egl | osmesa; TAUBENCH_BACKEND replaces auto).

    ``device`` selects the EGL device.  Raises GraphicsError listing everything that was tried and how to get it, and in
    a process that was forked after its parent opened a context.
    """
    _require_unforked()
    if backend == "auto":
        backend = os.environ.get(BACKEND_VARIABLE, "auto") or "auto"
    if backend not in ("auto", "egl", "osmesa"):
        raise GraphicsError(f"no backend is named {backend!r}", hint="choose from auto, egl, osmesa")
    if device is not None and backend == "osmesa":
        raise GraphicsError("OSMesa has no devices to choose from", hint="leave --device out, or use --backend egl")
    faults = []
    for name in ("egl", "osmesa") if backend == "auto" and device is None else (backend.replace("auto", "egl"),):
        if (name, device) in _open.by_name:
            return _open.by_name[name, device]
        try:
            gpu = _create(name, device)
        except Exception as error:
            # Drivers and loaders raise anything from OSError to bare Exception; all of it means "not here".
            if device is not None and (counted := _NO_DEVICE.search(str(error))):
                there = ", ".join(map(str, range(int(counted[1]))))
                hint = f"the devices there are: {there}" if there else "there is none"
                raise GraphicsError(f"no EGL device has number {device}", hint=hint) from None
            faults.append(f"{name}: {error} ({_INSTALL[name]})")
            continue
        _open.by_name[name, device] = gpu
        return gpu
    raise GraphicsError("no OpenGL 4.5 context: " + "; ".join(faults), hint="see 'taubench-gl doctor'")


def _create(name: str, device: int | None) -> Gpu:
    import moderngl

    if name == "egl":
        arguments = {} if device is None else {"device_index": device}
        ctx = moderngl.create_context(standalone=True, backend="egl", require=REQUIRED_VERSION, **arguments)
        keep, function = None, egl_function
    else:
        keep = OSMesaContext()
        ctx = moderngl.create_context(context=keep)
        function = keep.load_opengl_function
    return adopt_context(ctx, name, function, keep)


def adopt_context(ctx: moderngl.Context, backend: str, function: Callable[[str], int], keep: Any = None) -> Gpu:
    """A Gpu of an existing current context, such as a window's; ``function``: address of a GL function.

    Sets the clip control that reversed Z needs.  Raises OSError where the context is not enough.
    """
    _opened_in.add(os.getpid())
    if ctx.version_code < REQUIRED_VERSION:
        raise OSError(f"the driver offers GL {ctx.version_code / 100:.1f}, 4.5 is needed")
    address = function("glClipControl")
    if not address:
        raise OSError("the driver has no glClipControl")
    # Reversed Z needs depth in [0, 1] (conventions): with [-1, 1] the subtraction throws the precision away again.
    ctypes.CFUNCTYPE(None, ctypes.c_uint, ctypes.c_uint)(address)(_GL_LOWER_LEFT, _GL_ZERO_TO_ONE)
    ctx.gc_mode = "context_gc"
    info = ctx.info
    renderer = info["GL_RENDERER"]
    software = any(word in renderer.lower() for word in ("llvmpipe", "softpipe", "swrast"))
    return Gpu(ctx, backend, renderer, info["GL_VENDOR"], info["GL_VERSION"], software, keep, function)
