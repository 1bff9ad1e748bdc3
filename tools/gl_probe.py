"""Checks whether EGL and OSMesa work on this machine, with the standard library only.

Prints one line for each and exits with 0 if at least one works, otherwise 1.  Loading the library is not enough: EGL is
a dispatcher, and no display initializes without a vendor driver.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import sys

EGL_PLATFORM_DEVICE = 0x313F
EGL_PLATFORM_SURFACELESS = 0x31DD


def probe_egl() -> str | None:
    """None if EGL with desktop OpenGL works, else the missing part."""
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return "libEGL.so.1 is not installed"
    # glcontext uses the same lookup for both libraries.
    for name in ("EGL", "GL"):
        if ctypes.util.find_library(name) is None:
            return f"lib{name}.so is not installed"
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    egl.eglInitialize.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]
    query = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
    platform = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
    if not query or not platform:
        return "libEGL.so.1 is too old to open a device without a display"
    query_devices = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(query)
    get_display = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p)(platform)
    devices, count = (ctypes.c_void_p * 32)(), ctypes.c_int(0)
    query_devices(32, ctypes.addressof(devices), ctypes.addressof(count))
    tries = [(EGL_PLATFORM_DEVICE, device) for device in devices[: count.value]] + [(EGL_PLATFORM_SURFACELESS, None)]
    for kind, native in tries:
        display = get_display(kind, native, None)
        if display and egl.eglInitialize(display, None, None):
            return None
    return "libEGL.so.1 finds no driver"


def probe_osmesa() -> str | None:
    """None if OSMesa can be loaded, else the missing part."""
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
