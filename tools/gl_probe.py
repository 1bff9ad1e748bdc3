"""Which way to OpenGL works here, without installing or importing anything (standard library only).

Prints one line per way and exits 0 when at least one of EGL and OSMesa can work, 1 when neither can.  A library that
loads is not enough: EGL is a switchboard, and without a vendor driver behind it no display initialises.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import sys

EGL_PLATFORM_DEVICE = 0x313F
EGL_PLATFORM_SURFACELESS = 0x31DD


def probe_egl() -> str | None:
    """None when EGL with desktop GL works, else what is missing."""
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return "libEGL.so.1 is not installed"
    # glcontext finds both by this lookup, so what only the loader finds would not be found later.
    for name in ("EGL", "GL"):
        if ctypes.util.find_library(name) is None:
            return f"lib{name}.so is not installed"
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    egl.eglInitialize.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]
    query = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
    platform = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
    if not query or not platform:
        return "libEGL.so.1 is too old to open a device without a screen"
    query_devices = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(query)
    get_display = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p)(platform)
    devices, count = (ctypes.c_void_p * 32)(), ctypes.c_int(0)
    query_devices(32, ctypes.addressof(devices), ctypes.addressof(count))
    tries = [(EGL_PLATFORM_DEVICE, device) for device in devices[: count.value]] + [(EGL_PLATFORM_SURFACELESS, None)]
    for kind, native in tries:
        display = get_display(kind, native, None)
        if display and egl.eglInitialize(display, None, None):
            return None
    return "libEGL.so.1 has no driver behind it"


def probe_osmesa() -> str | None:
    """None when OSMesa can be loaded, else what is missing."""
    for name in ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"):
        try:
            ctypes.CDLL(name)
            return None
        except OSError:
            continue
    return "libOSMesa is not installed"


def main() -> int:
    faults = {"EGL": probe_egl(), "OSMesa": probe_osmesa()}
    for name, fault in faults.items():
        print(f"{name}: {fault or 'usable'}")
    return 1 if all(faults.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
