"""What the OpenGL and the libraries of this machine can do."""

from __future__ import annotations

import importlib.metadata
import json
import subprocess
import sys
from typing import Any

from taubench_gl.gpu.context import open_gpu
from taubench_gl.gpu.timing import probe_timer

_LIBRARIES = ("moderngl", "glcontext", "numpy", "pyrr", "imageio", "pygltflib", "msgspec", "OpenEXR", "matplotlib")
_EXTRAS = ("DracoPy", "meshoptimizer", "glfw", "scipy")


def capability_report(backend: str = "auto", device: int | None = None) -> dict[str, Any]:
    """What ``taubench-gl doctor`` prints, as JSON values.

    Tries to open every backend, each in a process of its own: two drivers in one process can crash it.  Raises
    GraphicsError only if none opens.
    """
    backends = {name: _probe(name) for name in ("egl", "osmesa")}
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


_PROBE = """
import json, os, sys
from taubench_gl.errors import GraphicsError
from taubench_gl.gpu.context import open_gpu
try:
    found = open_gpu(sys.argv[1])
    print(json.dumps({"usable": True, "why": f"{found.renderer}, {found.version}"}), flush=True)
except GraphicsError as error:
    print(json.dumps({"usable": False, "why": error.what}), flush=True)
os._exit(0)
"""
_PROBE_SECONDS = 120


def _probe(backend: str) -> dict[str, Any]:
    """Whether ``backend`` opens in a process of its own, and its renderer or the reason why not."""
    command = [sys.executable, "-c", _PROBE, backend]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PROBE_SECONDS)
    except subprocess.TimeoutExpired:
        return {"usable": False, "why": f"did not open within {_PROBE_SECONDS} s"}
    except OSError as error:
        return {"usable": False, "why": f"cannot be tried: {error.strerror}"}
    lines = done.stdout.splitlines()
    if done.returncode or not lines:
        return {"usable": False, "why": f"its driver ended the process with code {done.returncode}"}
    return json.loads(lines[-1])


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
