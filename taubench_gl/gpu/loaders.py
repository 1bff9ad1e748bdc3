"""Ways to a GL context with no window: EGL through glcontext, OSMesa through a loader of our own.

glcontext has no OSMesa backend; ``moderngl.create_context(context=obj)`` takes any object that can load functions.
"""

from __future__ import annotations

import ctypes
import ctypes.util
from typing import Any

OSMESA_LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
EGL_LIBRARIES = ("libEGL.so.1", "libEGL.so")

_GL_UNSIGNED_BYTE = 0x1401
_OSMESA_FORMAT, _OSMESA_DEPTH_BITS, _OSMESA_STENCIL_BITS = 0x22, 0x30, 0x31
_OSMESA_PROFILE, _OSMESA_CORE_PROFILE = 0x33, 0x34
_OSMESA_MAJOR, _OSMESA_MINOR = 0x36, 0x37
_OSMESA_RGBA = 0x1908


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
