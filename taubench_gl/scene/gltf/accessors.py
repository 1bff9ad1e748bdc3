"""Buffer views and accessors: from bytes to checked arrays.  Every length is checked before memory is allocated."""

from __future__ import annotations

import importlib
from types import ModuleType

import numpy as np

from taubench_gl import math3d
from taubench_gl.errors import SceneError
from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.document import MESHOPT, Document

Array = np.ndarray


def _library(document: Document, module: str, extra: str, pointer: str) -> ModuleType:
    try:
        return importlib.import_module(module)
    except ImportError:
        raise document.error(
            f"is {extra}-compressed, and the Python module {module} is not installed",
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
    except Exception as e:  # the library raises direct subclasses of Exception
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
    # The library stores 16-bit indices at the start of its 32-bit array.
    return memoryview(out.view(np.uint8))[:size]


DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
COMPONENT_NAMES = {5120: "BYTE", 5121: "UNSIGNED_BYTE", 5122: "SHORT", 5123: "UNSIGNED_SHORT", 5125: "UNSIGNED_INT",
                   5126: "FLOAT"}  # fmt: skip
FLOAT = 5126
ROWS_COLUMNS = {"SCALAR": (1, 1), "VEC2": (2, 1), "VEC3": (3, 1), "VEC4": (4, 1), "MAT2": (2, 2), "MAT3": (3, 3),
                "MAT4": (4, 4)}  # fmt: skip

MAX_FILLED_BYTES = 256 << 20
"""Limit on the total size of accessors without a bufferView, and of the instances that they place: a few bytes of JSON
can request terabytes of zeros."""


class Accessors:
    """Decoded accessors of one document, each decoded and checked once."""

    def __init__(self, document: Document):
        self.document = document
        self._all = document.root.accessors or []
        self._views: dict[int, memoryview] = {}
        self._raw: dict[int, Array] = {}
        self._floats: dict[int, Array] = {}
        self._usage: dict[int, str] = {}
        self._nonfinite: dict[int, SceneError] = {}  # accessors with NaN or infinity -> the error of their use
        self._filled = 0

    def check_all(self) -> None:
        """Check every bufferView, and every accessor with data, also unused ones.  Raises SceneError."""
        for index, view in enumerate(self.document.root.buffer_views or []):
            if view.byte_length == 0:
                self._empty("byteLength is 0", f"/bufferViews/{index}/byteLength", "bufferViews")
            self._check_view(index)
        for index, accessor in enumerate(self.document.root.accessors or []):
            if accessor.count == 0:
                self._empty("count is 0", f"/accessors/{index}/count", "accessors")
            elif accessor.buffer_view is not None or accessor.sparse is not None:
                self._check_layout(accessor, f"/accessors/{index}")
                if self._has_data(accessor):
                    self.raw(index, f"/accessors/{index}", allow_nonfinite=True)

    def _empty(self, message: str, pointer: str, collection: str) -> None:
        self.document.repair("empty-object", message, pointer, detail=collection)

    def _check_layout(self, accessor: schema.Accessor, pointer: str) -> None:
        """Checks that need no data, also for accessors in buffers without data."""
        if accessor.buffer_view is not None:
            view = self.document.item("buffer_views", accessor.buffer_view, f"{pointer}/bufferView")
            self._layout(accessor, view.byte_length, accessor.byte_offset, accessor.count, view, pointer)
        if accessor.sparse is not None:
            self._sparse_parts(accessor, pointer)

    def _has_data(self, accessor: schema.Accessor) -> bool:
        sparse = accessor.sparse
        used = [accessor.buffer_view] + ([sparse.indices.buffer_view, sparse.values.buffer_view] if sparse else [])
        views = [self.document.root.buffer_views[v] for v in used if v is not None]
        return all(self.document.buffers[v.buffer] is not None or MESHOPT & v.extensions.keys() for v in views)

    def get(self, index: int, pointer: str) -> schema.Accessor:
        return self._all[index] if index < len(self._all) else self.document.item("accessors", index, pointer)

    def describe(self, index: int, pointer: str) -> str:
        """Type for error messages, such as ``VEC3 of FLOAT``."""
        a = self.get(index, pointer)
        return f"{a.type} of {'normalized ' if a.normalized else ''}{COMPONENT_NAMES[a.component_type]}"

    def raw(self, index: int, pointer: str, *, allow_nonfinite: bool = False) -> Array:
        """Components as stored, sparse values applied.  (count, n), the component type's dtype, read-only.

        Raises SceneError for NaN and infinity unless ``allow_nonfinite``; strict documents never have them.
        """
        accessor = self.get(index, pointer)
        if index not in self._raw:
            array = self._decode(accessor, f"/accessors/{index}")
            array.flags.writeable = False
            self._raw[index] = array
        if index in self._nonfinite and not allow_nonfinite:
            raise self._nonfinite[index]
        return self._raw[index]

    def floats(self, index: int, pointer: str, *, allow_nonfinite: bool = False) -> Array:
        """Values as float32: normalized integers by glTF's formulas, others as they are.  (count, n), read-only."""
        raw = self.raw(index, pointer, allow_nonfinite=allow_nonfinite)
        if index not in self._floats:
            if raw.dtype != np.float32 or not raw.flags.c_contiguous:
                self.document.reserve("decoded data", raw.size * 4, pointer)
            self._floats[index] = self.to_float(self.get(index, pointer), raw)
        return self._floats[index]

    @staticmethod
    def dtype(accessor: schema.Accessor) -> np.dtype:
        return np.dtype(DTYPES[accessor.component_type])

    @staticmethod
    def shape(accessor: schema.Accessor) -> tuple[int, int]:
        rows, columns = ROWS_COLUMNS[accessor.type]
        return accessor.count, rows * columns

    @staticmethod
    def to_float(accessor: schema.Accessor, raw: Array) -> Array:
        if raw.dtype == np.float32:
            array = np.ascontiguousarray(raw, dtype=np.float32)
        elif accessor.normalized:
            array = np.maximum(raw / np.float64(np.iinfo(raw.dtype).max), -1.0).astype(np.float32)
        else:
            array = raw.astype(np.float32)
        array.flags.writeable = False
        return array

    def use(self, index: int, usage: str, pointer: str) -> None:
        """Record that an accessor's bufferView contains vertex attributes or indices; glTF forbids both in one."""
        view = self.get(index, pointer).buffer_view
        if view is None:
            return
        target = self.document.item("buffer_views", view, pointer).target
        declared = {34962: "vertex attributes", 34963: "indices"}.get(target, usage)
        if self._usage.setdefault(view, declared) != usage:
            message = f"bufferViews[{view}] contains {self._usage[view]} and {usage}"
            self.document.repair("buffer-target", message, pointer)

    def no_stride(self, index: int, pointer: str) -> None:
        """Check for a bufferView with byteStride, which glTF allows for vertex attributes only."""
        view = self.get(index, pointer).buffer_view
        if view is not None and self.document.item("buffer_views", view, pointer).byte_stride is not None:
            message = "its bufferView has a byteStride, which only vertex attributes may have"
            self.document.repair("stride", message, pointer)

    def fill(self, size: int, pointer: str) -> None:
        """Count bytes that no byte of the file stands for.  Raises SceneError."""
        self._filled += size
        if self._filled > MAX_FILLED_BYTES:
            message = f"accessors without a bufferView request more than {MAX_FILLED_BYTES >> 20} MiB"
            raise self.document.error(message, pointer)

    def view_bytes(self, index: int, pointer: str) -> memoryview:
        """Bytes of one bufferView, decompressed where necessary."""
        view = self.document.item("buffer_views", index, pointer)
        if index not in self._views:
            where = f"/bufferViews/{index}"
            self._check_view(index)
            data = self._meshopt(view, where)
            if data is None:
                buffer = self.document.buffers[view.buffer]
                if buffer is None:
                    raise self.document.error("is in a buffer without data", where)
                data = buffer[view.byte_offset : view.byte_offset + view.byte_length]
                if len(data) < view.byte_length:  # only of a short buffer
                    raise self.document.error(f"{len(data)} of {view.byte_length} bytes are there", where)
            self._views[index] = data
        return self._views[index]

    def _check_view(self, index: int) -> None:
        view, pointer = self.document.root.buffer_views[index], f"/bufferViews/{index}"
        buffer = self.document.item("buffers", view.buffer, f"{pointer}/buffer")
        if view.byte_offset + view.byte_length > buffer.byte_length:
            raise self.document.error(
                f"bytes {view.byte_offset} to {view.byte_offset + view.byte_length} do not fit the "
                f"{buffer.byte_length} bytes of buffers[{view.buffer}]",
                pointer,
            )
        stride = view.byte_stride
        if stride is None:
            return
        if stride % 4 or not 4 <= stride <= 252:
            message = f"byteStride {stride} is not a multiple of 4 from 4 to 252"
            self.document.repair("stride", message, f"{pointer}/byteStride")
        if stride > view.byte_length:
            self.document.repair("stride", f"byteStride {stride} exceeds byteLength {view.byte_length}", pointer)

    def _meshopt(self, view: schema.BufferView, pointer: str) -> memoryview | None:
        for name in sorted(MESHOPT):
            packed = self.document.extension(view, name, schema.Meshopt, pointer)
            if packed is None:
                continue
            where = f"{pointer}/extensions/{name}"
            self.document.item("buffers", packed.buffer, where)
            buffer = self.document.buffers[packed.buffer]
            end = packed.byte_offset + packed.byte_length
            if buffer is None or end > len(buffer):
                raise self.document.error(f"bytes {packed.byte_offset} to {end} do not fit its buffer", where)
            if packed.count * packed.byte_stride != view.byte_length:
                raise self.document.error(
                    f"{packed.count} x {packed.byte_stride} bytes differ from byteLength {view.byte_length}", where
                )
            self.document.reserve("decoded data", view.byte_length, where)
            return decode_meshopt(self.document, packed, buffer[packed.byte_offset : end], where)
        return None

    def _decode(self, accessor: schema.Accessor, pointer: str) -> Array:
        dtype, (count, components) = self.dtype(accessor), self.shape(accessor)
        if count == 0:
            return np.zeros((0, components), dtype)
        if accessor.buffer_view is not None:
            view = self.document.item("buffer_views", accessor.buffer_view, f"{pointer}/bufferView")
            data = self.view_bytes(accessor.buffer_view, f"{pointer}/bufferView")
            array = self._elements(accessor, data, accessor.byte_offset, accessor.count, view, pointer)
        else:
            self.fill(count * components * dtype.itemsize, pointer)
            array = np.zeros((count, components), dtype)
        if not array.flags.aligned:
            array = array.copy()
        if accessor.sparse is not None:
            array = self._apply_sparse(accessor, array, pointer)
        if accessor.buffer_view is not None or accessor.sparse is not None:
            self._check_values(accessor, array, pointer)
        return array

    def _elements(
        self,
        accessor: schema.Accessor,
        data: memoryview,
        offset: int,
        count: int,
        view: schema.BufferView,
        pointer: str,
    ) -> Array:
        """View of ``count`` elements at ``offset`` in ``data``.  (count, n)."""
        dtype = self.dtype(accessor)
        rows, columns = ROWS_COLUMNS[accessor.type]
        stride, column = self._layout(accessor, len(data), offset, count, view, pointer)
        if columns == 1:
            return np.ndarray((count, rows), dtype, data, offset, (stride, dtype.itemsize))
        matrix = np.ndarray((count, columns, rows), dtype, data, offset, (stride, column, dtype.itemsize))
        return matrix.reshape(count, rows * columns)

    def _layout(
        self,
        accessor: schema.Accessor,
        length: int,
        offset: int,
        count: int,
        view: schema.BufferView,
        pointer: str,
    ) -> tuple[int, int]:
        """Stride in bytes of elements and of matrix columns.

        Raises SceneError where the data exceeds ``length`` bytes.
        """
        dtype = self.dtype(accessor)
        if accessor.normalized and accessor.component_type in (FLOAT, 5125):
            message = "only 8- and 16-bit integers can be normalized"
            self.document.repair("normalized-number", message, f"{pointer}/normalized")
        rows, columns = ROWS_COLUMNS[accessor.type]
        # Columns of matrices are aligned to four bytes.
        column = rows * dtype.itemsize
        column = -(-column // 4) * 4 if columns > 1 else column
        # The last column has no padding, but all writers and the validator count it with padding.
        size = column * columns
        stride = view.byte_stride or size
        if stride < size:
            raise self.document.error(f"byteStride {stride} is less than an element's {size} bytes", pointer)
        start = view.byte_offset
        if offset % dtype.itemsize or (start + offset) % dtype.itemsize or stride % dtype.itemsize:
            message = f"byte offset {offset} (total {start + offset}) is not a multiple of the component's "
            self.document.repair("alignment", f"{message}{dtype.itemsize} bytes", pointer)
        if offset + stride * (count - 1) + size > length:
            raise self.document.error(
                f"{count} elements of {size} bytes with stride {stride}, from byte {offset}, do not fit {length} bytes",
                pointer,
                "the accessor's count, offset or type is wrong",
            )
        return stride, column

    def _sparse_parts(
        self, accessor: schema.Accessor, pointer: str
    ) -> list[tuple[schema.Accessor, schema.SparseIndices | schema.SparseValues, schema.BufferView, str]]:
        """Indices and values with checked layout: (element accessor, part, bufferView, JSON pointer) of each."""
        sparse, where = accessor.sparse, f"{pointer}/sparse"
        if sparse.count > accessor.count:
            raise self.document.error(f"replaces {sparse.count} of {accessor.count} elements", f"{where}/count")
        parts = []
        for name, part, element in (
            ("indices", sparse.indices, schema.Accessor(component_type=sparse.indices.component_type, count=1,
                                                        type="SCALAR")),
            ("values", sparse.values, accessor),
        ):  # fmt: skip
            at = f"{where}/{name}"
            view = self.document.item("buffer_views", part.buffer_view, f"{at}/bufferView")
            if view.byte_stride is not None:
                message = "its bufferView has a byteStride, which only vertex attributes may have"
                self.document.repair("stride", message, f"{at}/bufferView")
            self._layout(element, view.byte_length, part.byte_offset, sparse.count, view, at)
            parts.append((element, part, view, at))
        return parts

    def _apply_sparse(self, accessor: schema.Accessor, base: Array, pointer: str) -> Array:
        sparse, where = accessor.sparse, f"{pointer}/sparse"
        indices, values = (
            self._elements(element, self.view_bytes(part.buffer_view, at), part.byte_offset, sparse.count, view, at)
            for element, part, view, at in self._sparse_parts(accessor, pointer)
        )
        indices = indices[:, 0].astype(np.int64)
        if np.any(np.diff(indices) <= 0):
            self.document.repair("sparse-order", "sparse indices do not strictly increase", f"{where}/indices")
        if indices.max() >= accessor.count:
            raise self.document.error(
                f"sparse index {indices.max()} of an accessor with {accessor.count} elements", f"{where}/indices"
            )
        self.document.reserve("decoded data", base.nbytes, where)
        out = base.copy()
        out[indices] = values
        return out

    def _check_values(self, accessor: schema.Accessor, array: Array, pointer: str) -> None:
        low, high = math3d.bounds(array)
        if array.dtype == np.float32 and not (low.min() > -np.inf and high.max() < np.inf):  # also where NaN is
            bad = int(np.argmin(np.all(np.isfinite(array), axis=1)))
            fault = self.document.error(f"element {bad} is NaN or infinite", pointer, "repair the file")
            if self.document.strict:
                raise fault
            self._nonfinite[int(pointer.rpartition("/")[2])] = fault  # an error only where it cannot be repaired
            return
        for name, actual, declared in (("min", low, accessor.min), ("max", high, accessor.max)):
            if declared is None:
                continue
            where = f"{pointer}/{name}"
            if len(declared) != len(actual):
                message = f"{name} has {len(declared)} numbers, expected {len(actual)}"
                self.document.repair("bounds", message, where)
                continue
            with np.errstate(over="ignore"):
                expected = np.array(declared).astype(array.dtype if array.dtype == np.float32 else np.float64)
            wrong = np.flatnonzero(expected != actual)
            if len(wrong):
                at = int(wrong[0])
                self.document.repair(
                    "bounds",
                    f"declared {name} {declared[at]:g} is not the data's {name} {actual[at]:g}",
                    f"{where}/{at}",
                    "the data does not match the accessor: export the file again",
                )
