"""The glTF file of a captured scene: what moves, appears and shines over the times of its keys.

Readers give world axes with +Z up in units of the game, and triangles clockwise or not; the file has meters and +Y up.
A jump gets a second key one float32 step before it, so that nothing moves through the space between.
"""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.capture.recording import rows_along
from taubench_gl.datasets.gltf_writer import Writer
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.math3d import normalize, quat_from_mat3
from taubench_gl.scene.files import open_image
from taubench_gl.scene.gltf.container import add_facts

Array = np.ndarray

Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""Axes of the file from those of the game."""
MIRROR = [0, 2, 1]
"""Order of the corners by which a triangle that is clockwise in the game is counter-clockwise in the file."""
_IMAGES = ("TGA", "JPEG", "PNG")


def y_up(vectors: Array) -> Array:
    """``vectors`` (..., 3) of the game, +Z up, with the axes of the file, +Y up."""
    return np.asarray(vectors, dtype=float) @ Y_UP.T


def rotations(axes: Array) -> Array:
    """Rotations of the nodes of models, (n, 4) quaternions, continuous in sign.  ``axes``: (n, 3, 3) rows forward,
    left, up.
    """
    q = quat_from_mat3(Y_UP @ np.swapaxes(axes, -1, -2) @ Y_UP.T)
    return continuous(q)


def view_rotations(axes: Array) -> Array:
    """Rotations of nodes that look along their -Z, as cameras do, (n, 4).  ``axes``: (n, 3, 3) rows forward, left,
    up.
    """
    forward, left, up = np.moveaxis(y_up(axes), 1, 0)
    return continuous(quat_from_mat3(np.stack([-left, up, -forward], -1)))


def continuous(q: Array) -> Array:
    """Quaternions (n, 4), each with the sign that is nearest to the one before."""
    flips = np.where(np.einsum("ij,ij->i", q[1:], q[:-1]) < 0, -1.0, 1.0)
    return q * np.concatenate([[1.0], np.cumprod(flips)])[:, None]


def texture_pixels(source: Path | bytes, where: str, most: int) -> Array:
    """Pixels of a game's image, (h, w, 4) uint8, at most ``most`` a side; ``where``: names it.  Raises SceneError."""

    def fault(what: str, hint: str | None) -> SceneError:
        return SceneError(what, where=where, hint=hint)

    with open_image(source, _IMAGES, fault) as image:
        scale = min(1.0, most / max(image.size))
        size = [max(1, round(side * scale)) for side in image.size]
        try:
            image.draft("RGB", size)  # a JPEG is decoded at a fraction of its size
            return np.asarray(image.convert("RGBA").resize(size))
        except (OSError, ValueError, SyntaxError, struct.error, IndexError) as error:
            raise fault(f"image is damaged: {error!s:.200}", None) from None


@dataclass(frozen=True)
class Motion:
    """Where something is at each of n keys.  ``places``: (n, 3) units; ``axes``: (n, 3, 3); the others are (n,), None:
    unused.
    """

    places: Array
    axes: Array | None = None
    shown: Array | None = None
    scale: Array | None = None
    jumps: Array | None = None


class SceneFile:
    """A scene under construction.  ``times``: (n,) seconds of the keys; ``unit``: meters per unit of the game.

    ``counts``: what is in the file by kind; ``lost``: what the game draws and the file has not.
    """

    def __init__(self, times: Array, unit: float, license_text: str):
        self.times, self.unit = np.asarray(times, "f4"), unit
        self.writer = Writer(license_text, "taubench-gl capture", share=True)
        self.counts: Counter[str] = Counter()
        self.lost: Counter[str] = Counter()
        self._tracks: list[tuple] = []

    # -------------------------------------------------------------------------------------------------------- surfaces
    def primitive(
        self, places: Array, normals: Array, uvs: Array, triangles: Array, material: int, frames: tuple = ()
    ) -> Any:
        """A primitive of counter-clockwise ``triangles``, with vertices in units; ``frames``: (places, normals) of each
        morph target.
        """
        first = y_up(places) * self.unit, y_up(normals)
        shape = {"POSITION": first[0], "NORMAL": normalize(first[1]), "TEXCOORD_0": uvs, "indices": triangles}
        targets = [{"POSITION": y_up(p) * self.unit - first[0], "NORMAL": y_up(n) - first[1]} for p, n in frames]
        return self.writer.primitive(shape, material, targets)

    def emissive(self, name: str, color: Array, luminance: float, texture: int | None = None, **properties: Any) -> int:
        """A material that sends ``luminance``, cd/m^2, of a color, and reflects nothing unless it has a texture."""
        color = np.asarray(color, dtype=float)
        color = color / max(color.max(), 1e-9) if texture is None else np.ones(3)
        strength = {"emissiveStrength": float(luminance)}
        extensions = {self.writer.uses("KHR_materials_emissive_strength"): strength}
        info = {} if texture is None else {"emissiveTexture": {"index": texture}}
        base = (0.0, 0.0, 0.0) if texture is None else (1.0, 1.0, 1.0)
        return self.writer.material(
            name, base, texture=texture, emissiveFactor=color.tolist(), extensions=extensions, **info, **properties
        )

    # ---------------------------------------------------------------------------------------------------------- motion
    def place(self, name: str, kind: str, mesh: int | None, motion: Motion, weights: Array | None = None) -> None:
        """Add a node with ``mesh`` that moves as ``motion``; None: add nothing.  ``kind``: what is counted, if any;
        ``weights``: of morphs, (n, targets).
        """
        if mesh is None:
            return
        node = self._node(name, motion, None if motion.axes is None else rotations(motion.axes), {"mesh": mesh})
        if weights is not None and weights.shape[1]:
            self._animate(node, "weights", weights, motion.jumps)
        self.counts[kind] += bool(kind)

    def camera(self, motion: Motion, near: float, far: float = 1000.0, width: float = 90.0) -> int:
        """Add the recording player's camera; returns its node.  ``near``, ``far``: meters; ``width``: degrees across an
        image of 16:9.
        """
        height = 2 * np.arctan(np.tan(np.radians(width / 2)) * 9 / 16)
        lens = self.writer.camera("player", float(height), near, far)
        return self._node("player camera", motion, view_rotations(motion.axes), {"camera": lens})

    def point_light(
        self, name: str, kind: str, places: Array, color: tuple, candela: Array, jumps: Array | None = None, **rest: Any
    ) -> None:
        """Add a point light, one more of its ``kind``, whose intensity ``candela`` (n,) changes in steps; none where it
        is never on.

        ``rest``: properties of KHR_lights_punctual, such as the range in meters.
        """
        if np.max(candela) <= 0:
            return
        self.counts[kind] += 1
        light = {"type": "point", "color": [float(c) for c in color], "intensity": float(candela[0]), "name": name}
        extensions = self.writer.light(**light, **rest)
        self._node(name, Motion(places, jumps=jumps), None, {"extensions": extensions})
        number = extensions["KHR_lights_punctual"]["light"]
        if len(candela) > 1 and (candela != candela[0]).any():
            pointer = f"/extensions/KHR_lights_punctual/lights/{number}/intensity"
            self._tracks.append((pointer, "pointer", *self._steps(np.asarray(candela, "f4")), "STEP"))

    def sun(self, toward: Array, color: tuple, lux: float) -> None:
        """Add a directional light that shines from the direction ``toward``, (3,), with illuminance ``lux``."""
        light = {"type": "directional", "color": [float(c) for c in color], "intensity": float(lux), "name": "sun"}
        turn = view_rotations(rows_along(-toward[None]))[0]
        self.writer.node("sun", rotation=turn.tolist(), extensions=self.writer.light(**light))

    def _node(self, name: str, motion: Motion, quats: Array | None, properties: dict[str, Any]) -> int:
        places = y_up(motion.places) * self.unit
        node = self.writer.node(name, translation=places[0].tolist(), **properties)
        item = self.writer.gltf.nodes[node]
        self._animate(node, "translation", places, motion.jumps)
        if quats is not None:
            item.rotation = quats[0].tolist()
            self._animate(node, "rotation", quats, motion.jumps)
        if motion.scale is not None:
            item.scale = [float(motion.scale[0])] * 3
            self._animate(node, "scale", np.repeat(motion.scale[:, None], 3, 1), None)
        if motion.shown is not None:
            visible = {"visible": bool(motion.shown[0])}
            item.extensions = {**item.extensions, self.writer.uses("KHR_node_visibility"): visible}
            if not (motion.shown == motion.shown[0]).all():
                pointer = f"/nodes/{node}/extensions/KHR_node_visibility/visible"
                self._tracks.append((pointer, "pointer", *self._steps(motion.shown), "STEP"))
        return node

    def _animate(self, node: int, path: str, values: Array, jumps: Array | None) -> None:
        """Add a linear track of ``values`` (n, k) at the times of the keys, without keys between equal ones; none where
        nothing moves.
        """
        times, values = self.times, np.asarray(values, "f4")
        if len(times) < 2 or np.abs(values - values[0]).max() < 1e-7:
            return
        if jumps is not None and jumps[1:].any():
            at = np.flatnonzero(jumps[1:]) + 1
            times = np.insert(times, at, np.nextafter(times[at], np.float32(-1)))
            values = np.insert(values, at, values[at - 1], axis=0)
        same = (values[1:] == values[:-1]).all(1)
        keep = np.concatenate([[True], ~(same[:-1] & same[1:]), [True]])
        self._tracks.append((node, path, times[keep], values[keep], "LINEAR"))

    def _steps(self, values: Array) -> tuple[Array, Array]:
        """Times and values of the keys at which ``values`` (n,) change."""
        keep = np.concatenate([[True], values[1:] != values[:-1]])
        return self.times[keep], values[keep]

    # ------------------------------------------------------------------------------------------------------------ file
    def save(self, path: Path, name: str, note: str) -> None:
        """Write the scene, whose first node is the world, as .glb.  Every evaluation of it says ``note`` and what is
        lost.  Raises OutputError."""
        if path.suffix.lower() != ".glb":
            raise SettingsError(f"{path.name} does not end in .glb", hint="captured scenes are written as one file")
        w, last = self.writer, float(self.times[-1])
        if last > 0 and not any(float(track[2][-1]) == last for track in self._tracks):
            # The file lasts as long as the window, also where nothing moves: the world stays.
            self._tracks.append((0, "translation", self.times[[0, -1]], np.zeros((2, 3)), "STEP"))
        if self._tracks:
            w.animation("game", *self._tracks)
        root = {"asset": {}}
        lost = [f"{number:,} {kind}" for kind, number in self.lost.items() if number]
        add_facts(root, {"name": name, "note": note, "lost": lost})
        w.gltf.asset.extras = root["asset"]["extras"]
        w.gltf.scenes[0].name = name
        w.save(path)
