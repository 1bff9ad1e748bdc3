"""Lights that shaders are compiled for one by one: what never changes of them is known, the rest at constant places.

llvmpipe reads what lies at a constant place of a uniform block once for all lanes, and a texel lane by lane: a light's
record and its shadow face are nine texels, dearer than all that is computed from them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taubench_gl.frame.lights import LIGHT
from taubench_gl.frame.shadow_faces import FACE
from taubench_gl.gpu.context import Gpu

Array = np.ndarray

MAX_LISTED = 8
"""More lights would compile for longer than they save."""

LIGHT_BLOCK, FACE_BLOCK = 2, 3
"""Bindings of the uniform blocks in common/lights.glsl and common/shadow.glsl."""


@dataclass(frozen=True, slots=True)
class Listing:
    """The listed lights of a scene, by their rows of the light table."""

    rows: tuple[int, ...] = ()
    kinds: tuple[int, ...] = ()  # as LIGHT.direction.w
    first_faces: tuple[int, ...] = ()  # as LIGHT.color.w
    faces: int = 0  # shadow faces of the scene

    @property
    def defines(self) -> dict[str, int]:
        return {"LISTED_LIGHTS": len(self.rows)}

    @property
    def glsl(self) -> str:
        """Preamble for common/lights.glsl: the constants, and a macro that does something with the number of each."""
        if not self.rows:
            return ""
        count, numbers = len(self.rows), range(len(self.rows))
        return "\n".join(
            (
                f"const float LISTED_KINDS[{count}] = float[]({', '.join(f'{k}.0' for k in self.kinds)});",
                f"const float LISTED_FACES[{count}] = float[]({', '.join(f'{f}.0' for f in self.first_faces)});",
                f"#define EACH_LISTED_LIGHT(DO) {' '.join(f'DO({i})' for i in numbers)}",
                f"const int FACES = {max(self.faces, 1)};",
            )
        )


def list_lights(kinds: tuple[int, ...], first_faces: dict[int, int], faces: int) -> Listing:
    """All lights where they are few, else those that have shadow maps where these are few, else none.

    ``kinds``: of every row of the light table; ``first_faces``: row -> first shadow face, of the lights that have maps.
    """
    rows = range(len(kinds)) if len(kinds) <= MAX_LISTED else sorted(first_faces)
    if len(rows) > MAX_LISTED:
        return Listing()
    return Listing(tuple(rows), tuple(kinds[r] for r in rows), tuple(first_faces.get(r, -1) for r in rows), faces)


class LightBlocks:
    """The uniform blocks that listed lights are read from."""

    def __init__(self, gpu: Gpu, listing: Listing):
        self._rows = list(listing.rows)
        self._lights = gpu.ctx.buffer(reserve=LIGHT.dtype.itemsize * max(len(self._rows), 1), dynamic=True)
        self._faces = gpu.ctx.buffer(reserve=FACE.dtype.itemsize * max(listing.faces, 1), dynamic=True)

    def bind(self, light_rows: Array, face_rows: Array | None) -> None:
        """``light_rows``: the table of this frame; ``face_rows``: its FACE records, None where nothing has shadows."""
        self._lights.write(light_rows[self._rows].tobytes())
        self._lights.bind_to_uniform_block(LIGHT_BLOCK)
        if face_rows is not None:
            self._faces.write(face_rows.tobytes())
            self._faces.bind_to_uniform_block(FACE_BLOCK)

    def release(self) -> None:
        self._lights.release()
        self._faces.release()
