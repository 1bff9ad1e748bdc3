"""Meshes: vertex attributes, triangles, morph targets and skin weights."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Hashable
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from taubench_gl.math3d import normalize
from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.accessors import COMPONENT_NAMES, Accessors, decode_draco
from taubench_gl.scene.gltf.document import Document
from taubench_gl.scene.model import Material, Mesh, MorphTarget, Primitive
from taubench_gl.stage_log import progressed

Array = np.ndarray

BYTE, UBYTE, SHORT, USHORT, FLOAT = 5120, 5121, 5122, 5123, 5126
_FLOAT = {(FLOAT, False)}
_UNSIGNED = {(UBYTE, True), (USHORT, True)}
_SIGNED = {(BYTE, True), (SHORT, True)}
_ANY = {(c, n) for c in (BYTE, UBYTE, SHORT, USHORT) for n in (False, True)}

REPORTED_MESHES = 64
"""Meshes between two reports of how far reading is: a report takes as long as reading a small mesh."""

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

APPEARANCE = ("NORMAL", "TANGENT", "TEXCOORD", "COLOR")
"""Attributes without which a primitive can be drawn."""

_SEMANTIC = re.compile(r"POSITION|NORMAL|TANGENT|(?:TEXCOORD|COLOR|JOINTS|WEIGHTS)_(?:0|[1-9]\d{0,3})")


def known_attributes(document: Document, primitive: schema.Primitive, pointer: str) -> dict[str, int]:
    """The attributes that glTF defines: name -> accessor.

    Checks names, which are glTF's or begin with an underscore, and numbers, which are consecutive from 0.
    """
    sets: dict[str, set[int]] = {}
    attributes: dict[str, int] = {}
    for name, index in primitive.attributes.items():
        if name.startswith("_"):
            attributes[name] = index
            continue
        where = f"{pointer}/attributes/{name}"
        if _SEMANTIC.fullmatch(name) is None:
            message, hint = "is not an attribute of glTF 2.0", "custom names begin with an underscore"
            document.repair("unknown-attribute", message, where, hint, detail=name[:40])
            continue
        attributes[name] = index
        base, _, number = name.partition("_")
        if number:
            sets.setdefault(base, set()).add(int(number))
    where = f"{pointer}/attributes"
    for base, numbers in sets.items():
        if max(numbers) != len(numbers) - 1:
            document.repair("attribute-numbers", f"numbers of {base}_n are not consecutive from 0", where)
    if sets.get("JOINTS", set()) != sets.get("WEIGHTS", set()):
        document.repair("joints-without-weights", "JOINTS_n and WEIGHTS_n do not come in pairs", where)
        paired = sets.get("JOINTS", set()) & sets.get("WEIGHTS", set())
        attributes = {
            name: index
            for name, index in attributes.items()
            if not name.startswith(("JOINTS_", "WEIGHTS_")) or int(name.partition("_")[2]) in paired
        }
    return attributes


def check_format(
    document: Document, accessors: Accessors, name: str, index: int, formats: Formats, pointer: str
) -> bool:
    """Whether the accessor's type, component type and normalization are those of its semantic.

    Raises SceneError for positions, joints and weights that cannot be read.
    """
    accessor = accessors.get(index, pointer)
    if name.startswith("_"):
        if accessor.component_type == 5125:
            document.repair("attribute-format", "vertex attributes cannot be UNSIGNED_INT", pointer, detail=name[:40])
        return True
    semantic = name.partition("_")[0]
    if semantic not in formats:
        document.repair("morph-attribute", "is not an attribute of a morph target", pointer)
        return False
    types, core, quantized = formats[semantic]
    declared = "KHR_mesh_quantization" in (document.root.extensions_used or [])
    allowed = core | quantized if declared else core
    if accessor.type in types and (accessor.component_type, accessor.normalized) in allowed:
        return True
    hint = "KHR_mesh_quantization is not declared" if quantized and not declared else None
    message = f"{semantic} is {accessors.describe(index, pointer)}, which glTF does not allow"
    if accessor.component_type == 5125:
        message = "vertex attributes cannot be UNSIGNED_INT"
    if accessor.type in types and (accessor.component_type, accessor.normalized) in quantized:
        document.repair("quantization", message, pointer, hint)
        return True
    if semantic == "JOINTS" and accessor.type in types and accessor.component_type == 5125:
        document.repair("attribute-format", message, pointer, detail=name)
        return True
    if semantic in APPEARANCE:
        document.repair("attribute-ignored", message, pointer, hint, detail=name)
        return False
    raise document.error(message, pointer, hint)


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
        message, where = f"vertex {int(np.argmax(negative))} has a negative weight", f"{pointer}/attributes/WEIGHTS_0"
        document.repair("negative-weight", message, where, count=int(negative.sum()))
        weights = np.maximum(weights, 0.0)
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


def _lengths(vectors: Array) -> Array:
    return np.sqrt(np.einsum("ij,ij->i", vectors[:, :3], vectors[:, :3], dtype=np.float64))


def _not_unit(vectors: Array) -> Array:
    """Which vectors have another length than 1.  (V, 3 or more) -> (V,) bool."""
    return ~(np.abs(_lengths(vectors) - 1.0) <= UNIT_TOLERANCE)


def _length(vectors: Array, bad: Array) -> float:
    return float(_lengths(vectors)[np.argmax(bad)])


def repaired_normals(normals: Array, bad: Array, positions: Array, triangles: Array) -> Array:
    """``normals`` with the ``bad`` ones normalized; zero and non-finite ones become the mean face normal.

    The mean is weighted by area; (0, 0, 1) where all faces of a vertex are degenerate.  (V, 3) float32.
    """
    out = normals.astype(np.float64)
    lost = bad & ~((_lengths(normals) > 1e-12) & np.all(np.isfinite(normals), axis=1))
    out[bad & ~lost] = normalize(out[bad & ~lost])
    if np.any(lost):
        corners = positions.astype(np.float64)[triangles]
        face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        total = np.zeros(positions.shape)
        for corner in range(3):
            np.add.at(total, triangles[:, corner], face)
        mean = normalize(total[lost])
        usable = np.any(total[lost] != 0.0, axis=1) & np.all(np.isfinite(mean), axis=1)
        out[lost] = np.where(usable[:, None], mean, [0.0, 0.0, 1.0])
    result = np.where(bad[:, None], out, normals).astype(np.float32)
    result.flags.writeable = False
    return result


def repaired_tangents(tangents: Array) -> Array | None:
    """``tangents`` with unit length and w of 1 or -1; None, to be rebuilt, where some have no direction or sign."""
    sign = np.sign(tangents[:, 3])
    if not (np.all(np.isfinite(tangents)) and np.all(_lengths(tangents) > 1e-12) and np.all(sign != 0)):
        return None
    out = np.concatenate([normalize(tangents[:, :3]), sign[:, None]], axis=1).astype(np.float32)
    out.flags.writeable = False
    return out


EMPTY = "glTF forbids empty arrays: omit the property"

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
        meshes, listed = [], self.document.root.meshes or []
        for i, mesh in enumerate(listed):
            meshes.append(self._mesh(mesh, f"/meshes/{i}"))
            if i % REPORTED_MESHES == 0:
                progressed(i / len(listed))
        if self.undrawn:
            parts = ", ".join(f"{n} {kind}" for kind, n in self.undrawn.items() if kind != "primitives")
            self.document.note(f"{self.undrawn['primitives']} primitives of points or lines are not drawn ({parts})")
        for message, count in self.fixes.items():
            self.document.note(f"{count} {message}")
        return tuple(meshes)

    def _mesh(self, mesh: schema.Mesh, pointer: str) -> Mesh:
        document = self.document
        if not mesh.primitives:
            message = "Expected array of length >= 1"
            document.repair("empty-array", message, f"{pointer}/primitives", EMPTY, detail="primitives")
        targets = {len(p.targets or []) for p in mesh.primitives}
        count = max(targets, default=0)
        if len(targets) > 1:
            message = f"primitives have different numbers of morph targets {sorted(targets)}"
            document.repair("morph-count", message, pointer)
        weights = np.zeros(count) if mesh.weights is None else morph_weights(document, mesh.weights, count, pointer)
        read = (self._primitive(p, f"{pointer}/primitives/{i}") for i, p in enumerate(mesh.primitives))
        return Mesh(mesh.name, tuple(_padded(p, count) for p in read if p is not None), weights)

    def _primitive(self, primitive: schema.Primitive, pointer: str) -> Primitive | None:
        document = self.document
        if not primitive.attributes:
            message = "Expected object of length >= 1"
            document.repair("empty-array", message, f"{pointer}/attributes", EMPTY, detail="attributes")
        names = self._readable(known_attributes(document, primitive, pointer), pointer)
        for name, index in names.items():
            self.accessors.use(index, "vertex attributes", f"{pointer}/attributes/{name}")
        if primitive.indices is not None:
            self._check_indices(primitive.indices, f"{pointer}/indices")
        morphs = [
            self._readable_target(target, names, f"{pointer}/targets/{i}")
            for i, target in enumerate(primitive.targets or [])
        ]
        if "POSITION" not in names:
            document.remark("primitive-without-positions", pointer)
            return None
        draco = self._draco(primitive, pointer)
        positions = draco.attributes.get("POSITION")
        count = self.accessors.get(names["POSITION"], pointer).count if positions is None else len(positions)
        arrays = {name: self._attribute(name, index, count, draco, f"{pointer}/attributes/{name}")
                  for name, index in names.items() if not name.startswith("_")}  # fmt: skip
        triangles = self._triangles(primitive, count, draco, pointer)
        targets = tuple(self._target(target, count, f"{pointer}/targets/{i}") for i, target in enumerate(morphs))
        texcoords = self._texcoords(primitive, arrays, count, pointer)
        skinning = tuple((n, names[n]) for n in sorted(names) if n.startswith(("JOINTS", "WEIGHTS")))
        joints, weights = self._share(
            ("skin", skinning, draco.key), lambda: skin_weights(document, self.fixes, arrays, pointer)
        )
        colors = self._share(("rgba", names.get("COLOR_0"), draco.key), lambda: _rgba(arrays.get("COLOR_0")))
        bad_normals = self._share(
            ("normal-length", names.get("NORMAL"), draco.key), lambda: self._bad_normals(arrays, pointer)
        )
        tangents = self._share(("tangents", names.get("TANGENT"), draco.key), lambda: self._tangents(arrays, pointer))
        if triangles is None:
            return None
        frame = (names["POSITION"], names.get("NORMAL"), primitive.indices, primitive.mode)
        normals = self._share(("normals", *frame, draco.key), lambda: self._normals(arrays, bad_normals, triangles))
        return Primitive(
            positions=arrays["POSITION"],
            triangles=triangles,
            material=self._material(primitive, pointer),
            normals=normals,
            tangents=None if normals is None else tangents,
            texcoords=texcoords,
            colors=colors,
            joints=joints,
            weights=weights,
            targets=targets,
        )

    def _readable(self, names: dict[str, int], pointer: str) -> dict[str, int]:
        """``names`` without attributes that cannot be used and need not be."""
        out = {}
        count = None
        if "POSITION" in names:
            count = self.accessors.get(names["POSITION"], f"{pointer}/attributes/POSITION").count
        for name, index in names.items():
            where = f"{pointer}/attributes/{name}"
            if not check_format(self.document, self.accessors, name, index, FORMATS, where):
                continue
            elements = self.accessors.get(index, where).count
            if name.startswith(APPEARANCE) and count is not None and elements != count:
                message = f"has {elements} elements; POSITION has {count}"
                self.document.repair("attribute-ignored", message, where, detail=name)
                continue
            out[name] = index
        return out

    def _material(self, primitive: schema.Primitive, pointer: str) -> int:
        """Index of the primitive's material; -1 for glTF's default one."""
        index, where = primitive.material, f"{pointer}/material"
        usable = index is not None and self.document.has("materials", index, where, "material-reference")
        return index if usable else -1

    def _bad_normals(self, arrays: dict[str, Array], pointer: str) -> Array | None:
        """Which normals have another length than 1, (V,) bool; None: none."""
        normals = arrays.get("NORMAL")
        if normals is None or not np.any(bad := _not_unit(normals)):
            return None
        message = f"element {int(np.argmax(bad))} has length {_length(normals, bad):.6g}, must be 1"
        self.document.repair("normal-length", message, f"{pointer}/attributes/NORMAL", count=int(bad.sum()))
        return bad

    @staticmethod
    def _normals(arrays: dict[str, Array], bad: Array | None, triangles: Array) -> Array | None:
        normals = arrays.get("NORMAL")
        return normals if bad is None else repaired_normals(normals, bad, arrays["POSITION"], triangles)

    def _tangents(self, arrays: dict[str, Array], pointer: str) -> Array | None:
        """Tangents with unit length and a sign of 1 or -1; None: the file has none, or they must be rebuilt."""
        tangents = arrays.get("TANGENT")
        if tangents is None:
            return None
        off, sign = _not_unit(tangents), np.abs(tangents[:, 3]) != 1.0
        if not (np.any(off) or np.any(sign)):
            return tangents
        message = f"element {int(np.argmax(sign))} has w = {tangents[np.argmax(sign), 3]:g}, must be 1 or -1"
        if np.any(off):
            message = f"element {int(np.argmax(off))} has length {_length(tangents, off):.6g}, must be 1"
        self.document.repair("tangent", message, f"{pointer}/attributes/TANGENT", count=int((off | sign).sum()))
        return repaired_tangents(tangents)

    def _share(self, key: Hashable, make: Callable[[], T]) -> T:
        if key not in self._shared:
            self._shared[key] = make()
        return self._shared[key]

    def _attribute(self, name: str, index: int, count: int, draco: DracoData, pointer: str) -> Array:
        """One vertex attribute, (V, n): uint32 for joints, float32 otherwise."""
        accessor = self.accessors.get(index, pointer)
        unpacked = draco.attributes.get(name)
        elements = accessor.count if unpacked is None else len(unpacked)
        if elements != count:
            raise self.document.error(f"has {elements} elements; POSITION has {count}", pointer)

        def make() -> Array:
            if name.startswith("JOINTS"):
                raw = self.accessors.raw(index, pointer) if unpacked is None else unpacked
                array = raw.astype(np.uint32)
            elif unpacked is not None:
                array = self.accessors.to_float(accessor, unpacked)
            else:
                array = self.accessors.floats(index, pointer, allow_nonfinite=name.startswith(APPEARANCE))
            return self._valid_values(name, array, pointer, accessor.component_type)

        return self._share(("attribute", name, index, draco.key if unpacked is not None else None), make)

    def _valid_values(self, name: str, array: Array, pointer: str, component_type: int) -> Array:
        """``array`` with colors limited to 0..1, and NaN and infinite texture coordinates and colors replaced."""
        if not name.startswith(("TEXCOORD", "COLOR")) or COMPONENT_NAMES[component_type] != "FLOAT":
            return array
        if not np.all(finite := np.isfinite(array)):
            wild = ~np.all(finite, axis=1)
            message = f"element {int(np.argmax(wild))} is NaN or infinite"
            self.document.repair("nonfinite-attribute", message, pointer, count=int(wild.sum()))
            array = np.where(wild[:, None], np.float32(name.startswith("COLOR")), array)
        if name.startswith("COLOR"):
            outside = np.any((array < 0.0) | (array > 1.0), axis=1)
            if np.any(outside):
                at = int(np.argmax(outside))
                message = f"element {at} is {array[at].tolist()}, must lie in 0..1"
                self.document.repair("color-range", message, pointer, count=int(outside.sum()))
                array = np.clip(array, 0.0, 1.0)
        return array

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
            self.document.remark("surplus-indices", pointer)
        triangles = self._share(
            ("triangles", primitive.indices, count, mode, draco.key), lambda: triangle_list(mode, indices)
        )
        if not len(triangles):
            self.document.remark("primitive-without-triangles", pointer)
            return None
        triangles.flags.writeable = False
        return triangles

    def _texcoords(
        self, primitive: schema.Primitive, arrays: dict[str, Array], count: int, pointer: str
    ) -> tuple[Array | None, Array | None]:
        texcoords = [arrays.get("TEXCOORD_0"), arrays.get("TEXCOORD_1")]
        if self._material(primitive, pointer) < 0:
            return texcoords[0], texcoords[1]
        material = self.materials[primitive.material]
        for texture in (material.base_color_texture, material.metallic_roughness_texture, material.normal_texture,
                        material.occlusion_texture, material.emissive_texture, material.specular_texture,
                        material.specular_color_texture, material.transmission_texture):  # fmt: skip
            if texture is not None and texcoords[texture.texcoord] is None:
                # OpenGL's default for a missing attribute; all viewers draw such files.
                texcoords[texture.texcoord] = self._share(("zeros", count), lambda: np.zeros((count, 2), np.float32))
                self.document.remark("missing-texcoord", pointer, detail=f"TEXCOORD_{texture.texcoord}")
        return texcoords[0], texcoords[1]

    def _readable_target(self, target: dict[str, int], base: dict[str, int], pointer: str) -> dict[str, int]:
        """The attributes of a morph target that can be used."""
        out = {}
        for name, index in target.items():
            where = f"{pointer}/{name}"
            if not name.startswith("_") and name not in base:
                self.document.repair("morph-attribute", "the primitive has no such attribute", where)
                continue
            if check_format(self.document, self.accessors, name, index, TARGET_FORMATS, where):
                self.accessors.use(index, "vertex attributes", where)
                out[name] = index
        return out

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
            if array.shape[1] != expected[1]:
                raise self.document.error(f"decodes to {array.shape}; the accessor declares {expected}", at)
            if len(array) != expected[0] and semantic == "POSITION":
                self.document.remark("draco-vertices", pointer, detail=f"{len(array)} for {expected[0]}")
            if not np.all(np.isfinite(array)):
                raise self.document.error("decodes to NaN or infinity", at)
            attributes[semantic] = array.astype(self.accessors.dtype(accessor))
        if primitive.indices is not None:
            declared = self.accessors.get(primitive.indices, f"{pointer}/indices").count
            if declared != faces.size:
                self.document.remark("draco-indices", pointer)
        key = (packed.buffer_view, tuple(sorted(packed.attributes.items())))
        return DracoData(key, faces.reshape(-1), attributes)


def morph_weights(document: Document, weights: list[float], count: int, pointer: str) -> Array:
    """Weights of ``count`` morph targets, of the mesh or node at ``pointer``; missing ones are 0.  (count,)."""
    if len(weights) != count:
        message = f"{len(weights)} weights for {count} morph targets"
        document.repair("morph-weights", message, f"{pointer}/weights")
    out = np.zeros(count)
    out[: len(weights)] = weights[:count]
    return out


def _padded(primitive: Primitive, count: int) -> Primitive:
    """``primitive`` with ``count`` morph targets: those added change nothing."""
    missing = count - len(primitive.targets)
    return replace(primitive, targets=primitive.targets + (MorphTarget(),) * missing) if missing else primitive


def _rgba(colors: Array | None) -> Array | None:
    """Linear RGBA (V, 4) float32; RGB is opaque."""
    if colors is None or colors.shape[1] == 4:
        return colors
    out = np.ones((len(colors), 4), np.float32)
    out[:, :3] = colors
    out.flags.writeable = False
    return out
