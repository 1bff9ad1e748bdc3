"""Draco meshes and meshopt buffers, by libraries that are imported only when a file needs them."""

from __future__ import annotations

import importlib
from types import ModuleType

import numpy as np

from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.document import Document

Array = np.ndarray


def _library(document: Document, module: str, extra: str, pointer: str) -> ModuleType:
    try:
        return importlib.import_module(module)
    except ImportError:
        raise document.error(
            f"is {extra}-compressed and the Python module {module} is not installed",
            pointer,
            f"pip install 'taubench-gl[{extra}]'",
        ) from None


def decode_draco(document: Document, data: memoryview, pointer: str) -> tuple[Array, dict[int, Array]]:
    """Triangles (T, 3) uint32 and, by unique id, attributes (V, n) in the dtype they were stored in."""
    library = _library(document, "DracoPy", "draco", pointer)
    try:
        mesh = library.decode(bytes(data))
        faces = np.asarray(mesh.faces, dtype=np.uint32).reshape(-1, 3)
        attributes = {int(a["unique_id"]): np.asarray(a["data"]) for a in mesh.attributes}
    except Exception as e:  # the library raises bare Exception subclasses of its own
        raise document.error(f"Draco data cannot be decoded: {e}", pointer, "export the file again") from None
    return faces, {k: v.reshape(len(v), -1) for k, v in attributes.items()}


FILTERS = {"OCTAHEDRAL": "decode_filter_oct", "QUATERNION": "decode_filter_quat", "EXPONENTIAL": "decode_filter_exp"}


def decode_meshopt(document: Document, packed: schema.Meshopt, data: memoryview, pointer: str) -> memoryview:
    """The ``count * byteStride`` bytes of one compressed bufferView."""
    library = _library(document, "meshoptimizer", "meshopt", pointer)
    size = packed.count * packed.byte_stride
    if packed.filter != "NONE" and (packed.filter not in FILTERS or packed.mode != "ATTRIBUTES"):
        raise document.error(f"filter {packed.filter} is not supported with mode {packed.mode}", f"{pointer}/filter")
    if packed.filter in ("OCTAHEDRAL", "QUATERNION"):
        allowed = (4, 8) if packed.filter == "OCTAHEDRAL" else (8,)
        if packed.byte_stride not in allowed:
            raise document.error(f"filter {packed.filter} with byteStride {packed.byte_stride}", pointer)
    try:
        if packed.mode == "ATTRIBUTES":
            out = library.decode_vertex_buffer(
                packed.count, packed.byte_stride, bytes(data), dtype=f"V{packed.byte_stride}"
            )
            if packed.filter != "NONE":
                out = getattr(library, FILTERS[packed.filter])(out, packed.count, packed.byte_stride)
        elif packed.mode == "TRIANGLES":
            if packed.count % 3:
                raise ValueError(f"{packed.count} indices are not whole triangles")
            out = library.decode_index_buffer(packed.count, packed.byte_stride, bytes(data))
        else:
            out = library.decode_index_sequence(packed.count, packed.byte_stride, bytes(data))
    except (RuntimeError, ValueError, TypeError) as e:
        raise document.error(f"meshopt data cannot be decoded: {e}", pointer, "export the file again") from None
    # 16-bit indices are packed into the front of the library's 32-bit array.
    return memoryview(out.view(np.uint8))[:size]
