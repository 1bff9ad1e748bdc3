"""What the OpenGL and the libraries of this machine can do."""

from __future__ import annotations

import importlib.metadata
from typing import Any

from taubench_gl.errors import GraphicsError
from taubench_gl.gpu.context import open_gpu
from taubench_gl.gpu.timing import probe_timer

_LIBRARIES = ("moderngl", "glcontext", "numpy", "pyrr", "imageio", "pygltflib", "msgspec", "OpenEXR", "matplotlib")
_EXTRAS = ("DracoPy", "meshoptimizer", "glfw", "scipy")


def capability_report(backend: str = "auto", device: int | None = None) -> dict[str, Any]:
    """What ``taubench-gl doctor`` prints, as JSON values.

    Tries to open every backend.  Raises GraphicsError only if none opens.
    """
    backends = {}
    for name in ("egl", "osmesa"):
        try:
            found = open_gpu(name)
            backends[name] = {"usable": True, "why": f"{found.renderer}, {found.version}"}
        except GraphicsError as error:
            backends[name] = {"usable": False, "why": error.what}
    gpu = open_gpu(backend, device)
    with gpu:
        timer = probe_timer(gpu)
        info = gpu.ctx.info
        limits = {
            "texture size": info["GL_MAX_TEXTURE_SIZE"],
            "color attachments": info["GL_MAX_COLOR_ATTACHMENTS"],
            "work group invocations": info["GL_MAX_COMPUTE_WORK_GROUP_INVOCATIONS"],
            "storage blocks (compute)": info["GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS"],
            "storage block bytes": info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"],
            "sub-pixel bits": info["GL_SUBPIXEL_BITS"],
        }
    return {
        "backend": gpu.backend,
        "renderer": gpu.renderer,
        "vendor": gpu.vendor,
        "version": gpu.version,
        "glsl": "4.50",
        "software": gpu.software,
        "limits": limits,
        "timer": {"usable": timer.usable, "why": timer.why},
        "libraries": {name: _version(name) for name in (*_LIBRARIES, *_EXTRAS)},
        "backends": backends,
    }


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
