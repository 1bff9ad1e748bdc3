"""Skins: joints, inverse bind matrices and the rules on their hierarchy."""

from __future__ import annotations

import numpy as np

from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.accessors import FLOAT, Accessors
from taubench_gl.scene.gltf.document import Document
from taubench_gl.scene.model import Skin

Array = np.ndarray


def read_skins(document: Document, accessors: Accessors, parent: Array) -> tuple[Skin, ...]:
    """All skins of the file.  ``parent`` (N,) of the nodes, loops already refused."""
    return tuple(
        _skin(document, accessors, skin, parent, f"/skins/{i}") for i, skin in enumerate(document.root.skins or [])
    )


def _skin(document: Document, accessors: Accessors, skin: schema.Skin, parent: Array, pointer: str) -> Skin:
    for k, joint in enumerate(skin.joints):
        document.item("nodes", joint, f"{pointer}/joints/{k}")
    if len(set(skin.joints)) != len(skin.joints):
        raise document.error("lists a joint twice", f"{pointer}/joints")
    _check_common_root(document, skin, parent, pointer)
    count = len(skin.joints)
    inverse_bind = np.tile(np.eye(4), (count, 1, 1))
    if skin.inverse_bind_matrices is not None:
        where = f"{pointer}/inverseBindMatrices"
        accessor = accessors.get(skin.inverse_bind_matrices, where)
        if accessor.type != "MAT4" or accessor.component_type != FLOAT:
            raise document.error(
                f"is {accessors.describe(skin.inverse_bind_matrices, where)}, must be MAT4 of FLOAT", where
            )
        accessors.no_stride(skin.inverse_bind_matrices, where)
        if accessor.count < count:
            raise document.error(f"{accessor.count} matrices for {count} joints", where)
        # glTF stores columns, so the rows of the reshaped array are columns.
        raw = accessors.raw(skin.inverse_bind_matrices, where)[:count].astype(np.float64)
        inverse_bind = raw.reshape(count, 4, 4).swapaxes(1, 2)
        if np.any(inverse_bind[:, 3] != (0, 0, 0, 1)):
            at = int(np.argmax(np.any(inverse_bind[:, 3] != (0, 0, 0, 1), axis=1)))
            raise document.error(f"matrix {at} does not end in the row 0 0 0 1", where)
    joints = np.array(skin.joints, dtype=np.int32)
    joints.flags.writeable = inverse_bind.flags.writeable = False
    return Skin(skin.name, joints, inverse_bind)


def _lineage(node: int, parent: Array) -> list[int]:
    out = [node]
    while parent[out[-1]] >= 0:
        out.append(int(parent[out[-1]]))
    return out


def _check_common_root(document: Document, skin: schema.Skin, parent: Array, pointer: str) -> None:
    common: set[int] | None = None
    seen: set[int] = set()
    for joint in skin.joints:
        if common is not None and parent[joint] in seen:
            seen.add(joint)  # its ancestors are those of a joint already counted, and itself
            continue
        lineage = _lineage(joint, parent)
        common = set(lineage) if common is None else common & set(lineage)
        seen.add(joint)
    if not common:
        raise document.error("joints have no common root", f"{pointer}/joints")
    if skin.skeleton is not None:
        document.item("nodes", skin.skeleton, f"{pointer}/skeleton")
        if skin.skeleton not in common:
            raise document.error(f"nodes[{skin.skeleton}] is not a common root of the joints", f"{pointer}/skeleton")
