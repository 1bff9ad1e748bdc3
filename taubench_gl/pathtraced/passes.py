"""Planes of a file -> the quantities the masks compare, in our axes, units and signs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import numpy as np

from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced.exr import ExrImage
from taubench_gl.pathtraced.mapping import BOUNCES, LOBES, ChannelIndex, PassMap

Array = np.ndarray
UNIT_ROUNDING = 5e-7
_NEEDED_LOBES = LOBES[:3]  # a file without volume passes has no volume; without glossy passes it has half a picture


@dataclass(frozen=True, slots=True)
class PathTracedFrame:
    """One path-traced frame.  Row 0 is the top; glTF axes (+Y up), metres; None where the file has no such pass.

    NaN marks pixels outside the data window.  Radiance is linear; ``motion`` previous - current, pixels, +y down.
    """

    size: tuple[int, int]
    sky: Array  # (h, w) bool, no surface
    normal: Array | None  # (h, w, 3) float32, unit, world
    position: Array | None  # (h, w, 3) float32, world, as rendered
    depth: Array | None  # (h, w) float32, planar or distance as ``depth_kind`` says
    depth_kind: str
    prev_position: Array | None  # (h, w, 3) float32, world
    motion: Array | None  # (h, w, 2) float32
    combined: Array | None  # (h, w, 3) float32
    emission: Array | None
    environment: Array | None
    radiance: Mapping[str, Array]  # direct, indirect; (h, w, 3) float32
    lobes: Mapping[str, Array]  # "diffuse_direct", ... those that were asked for
    missing: Mapping[str, str] = field(default_factory=dict)  # column -> which pass would give it
    color_encoded: bool = False  # combined is display-encoded already
    relative: bool = False  # positions are relative to the frame's camera, previous ones to the previous camera


def read_frame(image: ExrImage, index: ChannelIndex, lobes: Collection[str] = ()) -> PathTracedFrame:
    """Quantities of one file.  ``lobes``: those of LOBES to give apart as well.

    Raises PathTracedError where neither position nor depth says what is seen.
    """
    mapping = index.mapping

    def take(name: str) -> Array | None:
        if name not in index:
            return None
        return np.stack([image.plane(channel) for channel in index.channels(name)], axis=-1)

    position, normal, depth = take("position"), take("normal"), take("depth")
    if position is None and depth is None:
        names = f"{mapping.file_name('position')} and {mapping.file_name('depth')}"
        raise PathTracedError(
            f"has neither of the passes {names}",
            where=str(image.path),
            hint=f"switch them on in the renderer, or give --mapping; it has {_listed(image.names)}",
        )
    depth = None if depth is None else depth[..., 0]
    sky = find_sky(position, normal, depth, mapping.background_depth)
    radiance, apart = _light(index, take, lobes)
    prev = take("prev_position")
    return PathTracedFrame(
        size=image.size,
        sky=sky,
        normal=None if normal is None else unit(to_y_up(normal, mapping.up)),
        position=None if position is None else to_y_up(position, mapping.up),
        depth=depth,
        depth_kind=mapping.depth,
        prev_position=None if prev is None else to_y_up(prev, mapping.up),
        motion=_motion(take("motion"), mapping, image.size),
        combined=take("combined"),
        emission=take("emission"),
        environment=take("environment"),
        radiance=radiance,
        lobes=apart,
        missing=missing_columns(index, lobes),
        color_encoded=mapping.color == "encoded",
        relative=mapping.positions == "relative",
    )


def find_sky(position: Array | None, normal: Array | None, depth: Array | None, background: float) -> Array:
    """Pixels without a surface.  (h, w) bool.

    With a depth pass: depth 0, infinite, or at or beyond ``background`` (Cycles writes 1e10).  Without: position and
    normal (where there is one) exactly 0.  NaN is no sky but invalid.
    """
    if depth is not None:
        return (depth >= background) | (depth == 0)
    zero = np.all(position == 0, axis=-1)
    return zero if normal is None else zero & np.all(normal == 0, axis=-1)


def to_y_up(vectors: Array, up: str) -> Array:
    """Blender's (x, y, z), +Z up -> glTF's (x, z, -y), +Y up.  (..., 3) -> (..., 3)."""
    if up == "y":
        return vectors
    return np.stack([vectors[..., 0], vectors[..., 2], -vectors[..., 1]], axis=-1)


def unit(normals: Array) -> Array:
    """Unit vectors; Cycles averages normals over the pixel, which shortens them.  Zero stays zero, NaN stays NaN.

    What is a unit vector already, but for the rounding of float32, keeps its bits.
    """
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    scale = np.where((length > 0) & (np.abs(length - 1) > UNIT_ROUNDING), length, 1)
    return normals / scale.astype(normals.dtype)


def _motion(motion: Array | None, mapping: PassMap, size: tuple[int, int]) -> Array | None:
    if motion is None:
        return None
    factor = np.ones(2, dtype=np.float32)
    if mapping.motion_unit == "uv":
        factor *= size
    if mapping.motion_direction == "current-previous":
        factor *= -1
    if mapping.motion_y == "up":
        factor[1] *= -1
    return motion * factor + np.float32(0)  # + 0: no negative zeros


def _light(
    index: ChannelIndex, take: Callable[[str], Array | None], lobes: Collection[str]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """direct and indirect: sum over lobes of Direct x Color (volume has no colour); the lobes asked for, apart."""
    radiance, apart = {}, {}
    colors = {lobe: take(f"{lobe}_color") for lobe in _NEEDED_LOBES}
    for bounce in BOUNCES:
        whole, total = take(bounce), None
        summed = whole is None and not _lacking(index, bounce)
        for lobe in LOBES:
            light = take(f"{lobe}_{bounce}") if summed or lobe in lobes else None
            if light is None or (lobe in colors and colors[lobe] is None):
                continue
            scattered = light * colors[lobe] if lobe in colors else light
            if lobe in lobes:
                apart[f"{lobe}_{bounce}"] = scattered
            if summed:
                total = scattered if total is None else total + scattered
        if whole is not None or total is not None:
            radiance[bounce] = total if whole is None else whole
    return radiance, apart


def missing_columns(index: ChannelIndex, lobes: Collection[str] = ()) -> dict[str, str]:
    """Columns, and ``lobe_bounce`` of the lobes asked for, that these passes cannot give -> which pass would."""
    missing = {}
    for column, name in (("normal", "normal"), ("color", "combined")):
        if name not in index:
            missing[column] = _needs([name], index.mapping)
    for bounce in BOUNCES:
        lacking = _lacking(index, bounce)
        if bounce not in index and lacking:
            missing[bounce] = _needs(lacking, index.mapping)
        for lobe in lobes:
            wanted = [f"{lobe}_{bounce}"] + ([f"{lobe}_color"] if lobe in _NEEDED_LOBES else [])
            lacking = [n for n in wanted if n not in index]
            if lacking:
                missing[f"{lobe}_{bounce}"] = _needs(lacking, index.mapping)
    return missing


def _lacking(index: ChannelIndex, bounce: str) -> list[str]:
    wanted = [n for lobe in _NEEDED_LOBES for n in (f"{lobe}_{bounce}", f"{lobe}_color")]
    return [n for n in wanted if n not in index]


def _needs(names: list[str], mapping: PassMap) -> str:
    listed = ", ".join(mapping.file_name(n) for n in dict.fromkeys(names))
    return f"the files lack the {'passes' if len(set(names)) > 1 else 'pass'} {listed}"


def _listed(names: Collection[str], most: int = 8) -> str:
    return ", ".join(list(names)[:most]) + (", ..." if len(names) > most else "")
