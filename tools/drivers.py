"""Environments that select an OpenGL driver: python tools/drivers.py NAME prints them as shell assignments.

    llvmpipe   Mesa's software rasterizer, the reference of the goldens
    zink       OpenGL over Vulkan, here over lavapipe, a Vulkan driver that needs no GPU: runs the paths of GPUs
    osmesa     Mesa without EGL

Standard library only.  Exits with 1 and one line on stderr where a driver is not installed.
"""

from __future__ import annotations

import ctypes
import glob
import os
import shlex
import sys
import tempfile

PACKAGES = {"llvmpipe": "libegl-mesa0", "zink": "mesa-vulkan-drivers", "osmesa": "libosmesa6"}
"""Package of Debian and Ubuntu that has the driver."""
_LAVAPIPE = "/usr/share/vulkan/icd.d/lvp_icd*.json"
_SELECTING = (
    "EGL_PLATFORM", "GALLIUM_DRIVER", "LIBGL_ALWAYS_SOFTWARE", "LIBGL_KOPPER_DISABLE", "MESA_LOADER_DRIVER_OVERRIDE",
    "TAUBENCH_BACKEND", "VK_ICD_FILENAMES",
)  # fmt: skip
"""Variables that may select another driver: all are set or removed."""


def environment(name: str) -> dict[str, str | None]:
    """Variables of the driver ``name``; None: to be removed.  Raises OSError where it is not installed."""
    unset: dict[str, str | None] = dict.fromkeys(_SELECTING)
    if name == "llvmpipe":
        return unset | {"LIBGL_ALWAYS_SOFTWARE": "1"}
    if name == "osmesa":
        if not any(_loads(library) for library in ("libOSMesa.so.8", "libOSMesa.so.6")):
            raise OSError("libOSMesa is not installed (Mesa 25.1 and later no longer has it)")
        return unset | {"TAUBENCH_BACKEND": "osmesa"}
    if name != "zink":
        raise OSError(f"no driver is named {name!r}: choose from {', '.join(PACKAGES)}")
    icd = sorted(glob.glob(_LAVAPIPE))
    if not icd:
        raise OSError("zink needs lavapipe, a Vulkan driver, which is not installed")
    return unset | {
        "EGL_PLATFORM": "surfaceless",
        "LIBGL_ALWAYS_SOFTWARE": "1",
        "LIBGL_KOPPER_DISABLE": "true",
        "MESA_LOADER_DRIVER_OVERRIDE": "zink",
        "GALLIUM_DRIVER": "zink",
        "VK_ICD_FILENAMES": icd[0],
        "XDG_RUNTIME_DIR": os.environ.get("XDG_RUNTIME_DIR") or tempfile.mkdtemp(prefix="taubench-driver-"),
    }


def environ(name: str) -> dict[str, str]:
    """The environment of this process with the driver ``name``.  Raises OSError."""
    merged = os.environ | environment(name)
    return {key: value for key, value in merged.items() if value is not None}


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def main(arguments: list[str]) -> int:
    if len(arguments) != 1:
        print(f"usage: python tools/drivers.py {'|'.join(PACKAGES)}", file=sys.stderr)
        return 2
    try:
        found = environment(arguments[0])
    except OSError as error:
        print(error, file=sys.stderr)
        return 1
    for key, value in found.items():
        print(f"unset {key}" if value is None else f"export {key}={shlex.quote(value)}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
