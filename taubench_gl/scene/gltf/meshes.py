"""Meshes: vertex attributes, triangles, morph targets and skin weights."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Hashable
from typing import Any, NamedTuple, TypeVar

import numpy as np

from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.accessors import COMPONENT_NAMES, Accessors, decode_draco
from taubench_gl.scene.gltf.document import Document
from taubench_gl.scene.model import Material, Mesh, MorphTarget, Primitive

Array = np.ndarray

BYTE, UBYTE, SHORT, USHORT, FLOAT = 5120, 5121, 5122, 5123, 5126
_FLOAT = {(FLOAT, False)}
_UNSIGNED = {(UBYTE, True), (USHORT, True)}
_SIGNED = {(BYTE, True), (SHORT, True)}
_ANY = {(c, n) for c in (BYTE, UBYTE, SHORT, USHORT) for n in (False, True)}

Formats = dict[str, tuple[tuple[str, ...], set[tuple[int, bool]], set[tuple[int, bool]]]]

FORMATS: Formats = {
    "POSITION": (("VEC3",), _FLOAT, _ANY),
    "NORMAL": (("VEC3",), _FLOAT, _SIGNED),
    "TANGENT": (("VEC4",), _FLOAT, _SIGNED),
    "TEXCOORD": (("VEC2",), _FLOAT | _UNSIGNED, _ANY),
    "COLOR": (("VEC3", "VEC4"), _FLOAT | _UNSIGNED, set()),
    "JOINTS": (("VEC4",), {(UBYTE, False), (USHORT, False)}, set()),
    "WEIGHTS": (("VEC4",), _FLOAT | _UNSIGNED, set()),
}
"""Semantic -> accessor types, (component, normalized) of the core specification, those that KHR_mesh_quantization
adds."""

TARGET_FORMATS: Formats = {
    "POSITION": (("VEC3",), _FLOAT, {(c, n) for c in (BYTE, SHORT) for n in (False, True)}),
    "NORMAL": (("VEC3",), _FLOAT, _SIGNED),
    "TANGENT": (("VEC3",), _FLOAT, _SIGNED),
    "TEXCOORD": (("VEC2",), _FLOAT | _UNSIGNED | _SIGNED, _ANY),
    "COLOR": (("VEC3", "VEC4"), _FLOAT | _UNSIGNED | _SIGNED, set()),
}

_SEMANTIC = re.compile(r"POSITION|NORMAL|TANGENT|(?:TEXCOORD|COLOR|JOINTS|WEIGHTS)_(?:0|[1-9]\d{0,3})")


def check_semantics(document: Document, primitive: schema.Primitive, pointer: str) -> None:
    """Check attribute names: glTF's, or with a leading underscore; numbers consecutive from 0."""
    sets: dict[str, set[int]] = {}
    for name in primitive.attributes:
        if name.startswith("_"):
            continue
        where = f"{pointer}/attributes/{name}"
        if _SEMANTIC.fullmatch(name) is None:
            raise document.error("is not an attribute of glTF 2.0", where, "custom names begin with an underscore")
        base, _, number = name.partition("_")
        if number:
            sets.setdefault(base, set()).add(int(number))
    for base, numbers in sets.items():
        if max(numbers) != len(numbers) - 1:
            raise document.error(f"numbers of {base}_n are not consecutive from 0", f"{pointer}/attributes")
    if sets.get("JOINTS", set()) != sets.get("WEIGHTS", set()):
        raise document.error("JOINTS_n and WEIGHTS_n do not come in pairs", f"{pointer}/attributes")


def check_format(
    document: Document, accessors: Accessors, name: str, index: int, formats: Formats, pointer: str
) -> None:
    """Check that the accessor's type, component type and normalization are allowed for its semantic."""
    accessor = accessors.get(index, pointer)
    if accessor.component_type == 5125:
        raise document.error("vertex attributes cannot be UNSIGNED_INT", pointer)
    if name.startswith("_"):
        return
    semantic = name.partition("_")[0]
    if semantic not in formats:
        raise document.error("is not an attribute of a morph target", pointer)
    types, core, quantized = formats[semantic]
    allowed = core | quantized if "KHR_mesh_quantization" in (document.root.extensions_used or []) else core
    if accessor.type not in types or (accessor.component_type, accessor.normalized) not in allowed:
        hint = "KHR_mesh_quantization is not declared" if quantized and allowed is core else None
        raise document.error(f"{semantic} is {accessors.describe(index, pointer)}, which glTF does not allow", pointer,
                             hint)  # fmt: skip


POINTS, LINES, LINE_LOOP, LINE_STRIP, TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN = range(7)


def triangle_list(mode: int, indices: Array) -> Array:
    """Corners of every triangle, with glTF's winding.  (n,) -> (T, 3) uint32.

    A list keeps its degenerate triangles.  Degenerate triangles of strips and fans, which only connect pieces, are
    removed.  Surplus indices at the end are ignored.
    """
    indices = indices.astype(np.uint32, copy=False)
    if mode == TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    count = max(len(indices) - 2, 0)
    i = np.arange(count)
    if mode == TRIANGLE_STRIP:
        corners = np.stack([i, i + 1 + i % 2, i + 2 - i % 2], axis=1)
    elif mode == TRIANGLE_FAN:
        corners = np.stack([i + 1, i + 2, np.zeros_like(i)], axis=1)
    else:
        raise ValueError(f"mode {mode} has no triangles")
    triangles = indices[corners].reshape(-1, 3)
    a, b, c = triangles.T
    return triangles[(a != b) & (b != c) & (c != a)]


def line_count(mode: int, count: int) -> int:
    """Number of segments of ``count`` indices in a line mode."""
    return {LINES: count // 2, LINE_LOOP: count if count > 1 else 0, LINE_STRIP: max(count - 1, 0)}[mode]


SUM_TOLERANCE = 1e-3


def skin_weights(
    document: Document, fixes: Counter[str], arrays: dict[str, Array], pointer: str
) -> tuple[Array | None, Array | None]:
    """Joints (V, 4 k) uint32 and weights (V, 4 k) float32, or (None, None).  ``fixes`` counts repairs."""
    sets = sorted(int(name[7:]) for name in arrays if name.startswith("JOINTS_"))
    if not sets:
        return None, None
    joints = np.concatenate([arrays[f"JOINTS_{i}"] for i in sets], axis=1)
    weights = np.concatenate([arrays[f"WEIGHTS_{i}"] for i in sets], axis=1).astype(np.float64)
    negative = np.any(weights < 0, axis=1)
    if np.any(negative):
        raise document.error(
            f"vertex {int(np.argmax(negative))} has a negative weight", f"{pointer}/attributes/WEIGHTS_0"
        )
    total = weights.sum(axis=1)
    empty = total == 0
    if np.any(empty):
        # The first joint of such a vertex; with weights of 0 it would collapse into the origin.
        weights[empty, 0], total[empty] = 1.0, 1.0
        fixes["vertices without any skin weight follow their first joint"] += int(empty.sum())
    off = np.abs(total - 1.0) > SUM_TOLERANCE
    if np.any(off):
        fixes["vertices had skin weights that did not sum to 1; they were normalized"] += int(off.sum())
    weights = (weights / total[:, None]).astype(np.float32)
    joints.flags.writeable = weights.flags.writeable = False
    return joints, weights


UNIT_TOLERANCE = 0.00674  # on a vector's length; half a step of a normalized byte, as in the Khronos validator


T = TypeVar("T")


class DracoData(NamedTuple):
    """``key`` identifies the decoded data; ``indices`` (3 T,) uint32; ``attributes`` by semantic, as stored."""

    key: Hashable
    indices: Array | None
    attributes: dict[str, Array]


class MeshReader:
    """Reads the meshes of one document, after its ``materials``."""

    def __init__(self, document: Document, accessors: Accessors, materials: tuple[Material, ...]):
        self.document, self.accessors, self.materials = document, accessors, materials
        self.undrawn: Counter[str] = Counter()
        self.fixes: Counter[str] = Counter()
        # Primitives with equal accessors share arrays: a file of a few kilobytes can refer to one large accessor in
        # thousands of primitives.
        self._shared: dict[Hashable, Any] = {}

    def read(self) -> tuple[Mesh, ...]:
        meshes = tuple(self._mesh(mesh, f"/meshes/{i}") for i, mesh in enumerate(self.document.root.meshes or []))
        if self.undrawn:
            parts = ", ".join(f"{n} {what}" for what, n in self.undrawn.items() if what != "primitives")
            self.document.note(f"{self.undrawn['primitives']} primitives of points or lines are not drawn ({parts})")
        for what, count in self.fixes.items():
            self.document.note(f"{count} {what}")
        return meshes

    def _mesh(self, mesh: schema.Mesh, pointer: str) -> Mesh:
        targets = {len(p.targets or []) for p in mesh.primitives}
        if len(targets) > 1:
            raise self.document.error(f"primitives have different numbers of morph targets {sorted(targets)}", pointer)
        (count,) = targets
        if mesh.weights is not None and len(mesh.weights) != count:
            raise self.document.error(f"{len(mesh.weights)} weights for {count} morph targets", f"{pointer}/weights")
        weights = np.array(mesh.weights, dtype=np.float64) if mesh.weights is not None else np.zeros(count)
        primitives = (self._primitive(p, f"{pointer}/primitives/{i}") for i, p in enumerate(mesh.primitives))
        return Mesh(mesh.name, tuple(p for p in primitives if p is not None), weights)

    def _primitive(self, primitive: schema.Primitive, pointer: str) -> Primitive | None:
        document, names = self.document, primitive.attributes
        check_semantics(document, primitive, pointer)
        for name, index in names.items():
            check_format(document, self.accessors, name, index, FORMATS, f"{pointer}/attributes/{name}")
            self.accessors.use(index, "vertex attributes", f"{pointer}/attributes/{name}")
        if primitive.indices is not None:
            self._check_indices(primitive.indices, f"{pointer}/indices")
        for i, target in enumerate(primitive.targets or []):
            self._check_target(target, names, f"{pointer}/targets/{i}")
        if "POSITION" not in names:
            document.note("primitive without POSITION is not drawn", pointer)
            return None
        count = self.accessors.get(names["POSITION"], pointer).count
        draco = self._draco(primitive, pointer)
        arrays = {name: self._attribute(name, index, count, draco, f"{pointer}/attributes/{name}")
                  for name, index in names.items() if not name.startswith("_")}  # fmt: skip
        triangles = self._triangles(primitive, count, draco, pointer)
        targets = tuple(
            self._target(target, count, f"{pointer}/targets/{i}") for i, target in enumerate(primitive.targets or [])
        )
        texcoords = self._texcoords(primitive, arrays, count, pointer)
        skinning = tuple((n, names[n]) for n in sorted(names) if n.startswith(("JOINTS", "WEIGHTS")))
        joints, weights = self._share(
            ("skin", skinning, draco.key), lambda: skin_weights(document, self.fixes, arrays, pointer)
        )
        colors = self._share(("rgba", names.get("COLOR_0"), draco.key), lambda: _rgba(arrays.get("COLOR_0")))
        if triangles is None:
            return None
        return Primitive(
            positions=arrays["POSITION"],
            triangles=triangles,
            material=-1 if primitive.material is None else primitive.material,
            normals=arrays.get("NORMAL"),
            tangents=arrays.get("TANGENT") if "NORMAL" in arrays else None,
            texcoords=texcoords,
            colors=colors,
            joints=joints,
            weights=weights,
            targets=targets,
        )

    def _share(self, key: Hashable, make: Callable[[], T]) -> T:
        if key not in self._shared:
            self._shared[key] = make()
        return self._shared[key]

    def _attribute(self, name: str, index: int, count: int, draco: DracoData, pointer: str) -> Array:
        """One vertex attribute, (V, n): uint32 for joints, float32 otherwise."""
        accessor = self.accessors.get(index, pointer)
        if accessor.count != count:
            raise self.document.error(f"has {accessor.count} elements; POSITION has {count}", pointer)
        unpacked = draco.attributes.get(name)

        def make() -> Array:
            if name.startswith("JOINTS"):
                raw = self.accessors.raw(index, pointer) if unpacked is None else unpacked
                array = raw.astype(np.uint32)
            elif unpacked is not None:
                array = self.accessors.to_float(accessor, unpacked)
            else:
                array = self.accessors.floats(index, pointer)
            self._check_values(name, array, pointer, accessor.component_type)
            return array

        return self._share(("attribute", name, index, draco.key if unpacked is not None else None), make)

    def _check_values(self, name: str, array: Array, pointer: str, component_type: int) -> None:
        if name in ("NORMAL", "TANGENT"):
            length = np.sqrt(np.einsum("ij,ij->i", array[:, :3], array[:, :3], dtype=np.float64))
            bad = np.abs(length - 1.0) > UNIT_TOLERANCE
            if np.any(bad):
                at = int(np.argmax(bad))
                raise self.document.error(f"element {at} has length {length[at]:.6g}, must be 1", pointer)
        if name == "TANGENT" and np.any(np.abs(array[:, 3]) != 1.0):
            at = int(np.argmax(np.abs(array[:, 3]) != 1.0))
            raise self.document.error(f"element {at} has w = {array[at, 3]:g}, must be 1 or -1", pointer)
        if name.startswith("COLOR") and COMPONENT_NAMES[component_type] == "FLOAT":
            bad = np.any((array < 0.0) | (array > 1.0), axis=1)
            if np.any(bad):
                at = int(np.argmax(bad))
                raise self.document.error(f"element {at} is {array[at].tolist()}, must lie in 0..1", pointer)

    def _check_indices(self, index: int, pointer: str) -> None:
        accessor = self.accessors.get(index, pointer)
        if accessor.type != "SCALAR" or accessor.component_type not in (5121, 5123, 5125) or accessor.normalized:
            raise self.document.error(
                f"indices are {self.accessors.describe(index, pointer)}, must be SCALAR of unsigned integers", pointer
            )
        self.accessors.no_stride(index, pointer)
        self.accessors.use(index, "indices", pointer)

    def _triangles(self, primitive: schema.Primitive, count: int, draco: DracoData, pointer: str) -> Array | None:
        """Triangle list (T, 3) uint32, or None, with a note, for a primitive without triangles."""
        if draco.indices is not None:
            indices, mode = draco.indices, TRIANGLES
        elif primitive.indices is not None:
            indices, mode = self.accessors.raw(primitive.indices, f"{pointer}/indices")[:, 0], primitive.mode
        else:
            indices = self._share(("order", count), lambda: np.arange(count, dtype=np.uint32))
            mode = primitive.mode
        if len(indices) and int(indices.max()) >= count:
            at = int(np.argmax(indices >= count))
            raise self.document.error(
                f"index {indices[at]} at position {at}; the primitive has {count} vertices", f"{pointer}/indices"
            )
        if mode < TRIANGLES:
            self.undrawn["primitives"] += 1
            self.undrawn["points" if mode == POINTS else "lines"] += (
                len(indices) if mode == POINTS else line_count(mode, len(indices))
            )
            return None
        if mode == TRIANGLES and len(indices) % 3:
            self.document.note(f"{len(indices) % 3} surplus indices at the end are ignored", pointer)
        triangles = self._share(
            ("triangles", primitive.indices, count, mode, draco.key), lambda: triangle_list(mode, indices)
        )
        if not len(triangles):
            self.document.note("primitive without triangles is not drawn", pointer)
            return None
        triangles.flags.writeable = False
        return triangles

    def _texcoords(
        self, primitive: schema.Primitive, arrays: dict[str, Array], count: int, pointer: str
    ) -> tuple[Array | None, Array | None]:
        texcoords = [arrays.get("TEXCOORD_0"), arrays.get("TEXCOORD_1")]
        if primitive.material is None:
            return texcoords[0], texcoords[1]
        self.document.item("materials", primitive.material, f"{pointer}/material")
        material = self.materials[primitive.material]
        for texture in (material.base_color_texture, material.metallic_roughness_texture, material.normal_texture,
                        material.occlusion_texture, material.emissive_texture):  # fmt: skip
            if texture is not None and texcoords[texture.texcoord] is None:
                # OpenGL's default for a missing attribute; all viewers draw such files.
                texcoords[texture.texcoord] = self._share(("zeros", count), lambda: np.zeros((count, 2), np.float32))
                self.document.note(
                    f"TEXCOORD_{texture.texcoord}, which a texture of the material uses, is missing: set to 0, 0",
                    pointer,
                )
        return texcoords[0], texcoords[1]

    def _check_target(self, target: dict[str, int], base: dict[str, int], pointer: str) -> None:
        for name, index in target.items():
            where = f"{pointer}/{name}"
            if not name.startswith("_") and name not in base:
                raise self.document.error("the primitive has no such attribute", where)
            check_format(self.document, self.accessors, name, index, TARGET_FORMATS, where)
            self.accessors.use(index, "vertex attributes", where)

    def _target(self, target: dict[str, int], count: int, pointer: str) -> MorphTarget:
        arrays: dict[str, Array] = {}
        for name, index in target.items():
            where = f"{pointer}/{name}"
            accessor = self.accessors.get(index, where)
            if accessor.count != count:
                raise self.document.error(f"has {accessor.count} elements; POSITION has {count}", where)
            if name in ("POSITION", "NORMAL", "TANGENT"):
                arrays[name] = self.accessors.floats(index, where)
            elif not name.startswith("_"):
                self.document.note(f"morphing of {re.sub('_[0-9]+$', '', name)} is not simulated")
        return MorphTarget(arrays.get("POSITION"), arrays.get("NORMAL"), arrays.get("TANGENT"))

    def _draco(self, primitive: schema.Primitive, pointer: str) -> DracoData:
        """Decoded Draco data of one primitive; None and empty where it is not compressed."""
        name = "KHR_draco_mesh_compression"
        packed = self.document.extension(primitive, name, schema.Draco, pointer)
        if packed is None:
            return DracoData(None, None, {})
        where = f"{pointer}/extensions/{name}"
        data = self.accessors.view_bytes(packed.buffer_view, f"{where}/bufferView")
        faces, by_id = self._share(
            ("draco", packed.buffer_view), lambda: decode_draco(self.document, data, f"{where}/bufferView")
        )
        attributes: dict[str, Array] = {}
        for semantic, unique_id in packed.attributes.items():
            at = f"{where}/attributes/{semantic}"
            if semantic not in primitive.attributes:
                raise self.document.error("the primitive has no such attribute", at)
            array = by_id.get(unique_id)
            if array is None:
                raise self.document.error(f"the Draco data has no attribute with id {unique_id}", at)
            accessor = self.accessors.get(primitive.attributes[semantic], at)
            expected = self.accessors.shape(accessor)
            if array.shape != expected:
                raise self.document.error(f"decodes to {array.shape}; the accessor declares {expected}", at)
            if not np.all(np.isfinite(array)):
                raise self.document.error("decodes to NaN or infinity", at)
            attributes[semantic] = array.astype(self.accessors.dtype(accessor))
        if primitive.indices is not None:
            declared = self.accessors.get(primitive.indices, f"{pointer}/indices").count
            if declared != faces.size:
                self.document.note(f"Draco data has {faces.size} indices; the accessor declares {declared}", pointer)
        key = (packed.buffer_view, tuple(sorted(packed.attributes.items())))
        return DracoData(key, faces.reshape(-1), attributes)


def _rgba(colors: Array | None) -> Array | None:
    """Linear RGBA (V, 4) float32; RGB is opaque."""
    if colors is None or colors.shape[1] == 4:
        return colors
    out = np.ones((len(colors), 4), np.float32)
    out[:, :3] = colors
    out.flags.writeable = False
    return out
