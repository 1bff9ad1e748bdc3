"""Structs shared between Python and GLSL, declared once: a NumPy dtype and std430 GLSL text from the same table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

TYPES = {  # GLSL type: (NumPy base, shape, std430 alignment in bytes)
    "float": (np.float32, (), 4),
    "int": (np.int32, (), 4),
    "uint": (np.uint32, (), 4),
    "vec2": (np.float32, (2,), 8),
    "vec4": (np.float32, (4,), 16),
    "ivec4": (np.int32, (4,), 16),
    "uvec4": (np.uint32, (4,), 16),
    "mat4": (np.float32, (4, 4), 16),  # GLSL is column-major: store the transpose, see ``column_major``
}


@dataclass(frozen=True, slots=True)
class Field:
    """``name`` and GLSL ``type``; ``count`` > 0 makes an array; ``doc`` gives unit, range and formula."""

    name: str
    type: str
    doc: str
    count: int = 0


class Struct:
    """A std430 struct.  There is no vec3: its 16-byte alignment with 12-byte size invites errors."""

    def __init__(self, name: str, *fields: Field):
        self.name, self.fields = name, fields
        names, formats, offsets = [], [], []
        offset, alignment = 0, 4
        for f in fields:
            base, shape, align = TYPES[f.type]
            alignment = max(alignment, align)
            offset = -(-offset // align) * align
            names.append(f.name)
            formats.append((base, (f.count, *shape) if f.count else shape))
            offsets.append(offset)
            offset += int(np.dtype(base).itemsize * np.prod(shape, dtype=int)) * max(f.count, 1)
        size = -(-offset // alignment) * alignment
        self.dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})

    @property
    def glsl(self) -> str:
        """``struct Name { ... };`` with each field's documentation as a comment."""
        lines = [f"struct {self.name} {{"]
        for f in self.fields:
            array = f"[{f.count}]" if f.count else ""
            lines.append(f"    {f.type} {f.name}{array};" + (f" // {f.doc}" if f.doc else ""))
        return "\n".join([*lines, "};"])

    def zeros(self, count: int | None = None) -> np.ndarray:
        """A zeroed record () or array (count,)."""
        return np.zeros(() if count is None else count, dtype=self.dtype)


def column_major(matrix: np.ndarray) -> np.ndarray:
    """A row-indexed NumPy matrix (..., 4, 4) as GLSL's column-major mat4, float32."""
    return np.swapaxes(np.asarray(matrix, dtype=np.float32), -1, -2)
