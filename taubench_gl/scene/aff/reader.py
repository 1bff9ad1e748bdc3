"""Reads one AFF or NFF file into a Scene.

Axes are the model's: right-handed, cameras look along -Z with +Y up; units are meters.  Time 0 of the scene is the
start of the ``a`` statement, or the earliest key without one.  Colors are linear coefficients; the diffuse color
becomes the base color, and the Phong exponent n a roughness of (2 / (n + 2)) ^ 1/4.  AFF's lights are not attenuated
with distance: a light of color c is a constant light of pi c lux, so that a Lambertian surface of color k that faces it
has radiance k c, as in AFF.  Texture coordinate v increases downwards from the top row of the image.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from taubench_gl import math3d
from taubench_gl.errors import SceneError
from taubench_gl.scene.aff import splines
from taubench_gl.scene.aff.parser import Fill, Motion, Parser
from taubench_gl.scene.build import Phong, only_animation
from taubench_gl.scene.files import ImagePool, shortened
from taubench_gl.scene.model import Camera, Channel, Light, Material, Mesh, Scene
from taubench_gl.scene.notes import Notes

Array = np.ndarray

CAMERA = "camera"
"""Name of the animation that moves the viewpoint."""
SMALLEST_HITHER = 1e-4
"""A smaller hither is replaced by 1, as in BART's parser."""


def read_aff(path: Path, scene: str | int | None, animation: Sequence[str | int] | None, strict: bool = False) -> Scene:
    """``load_scene`` for .aff and .nff.  Raises SceneError with file and line."""
    if scene is not None:
        raise SceneError("AFF files contain one scene", where=path.name, hint="omit the scene's name")
    return _Assembly(Parser(path, Notes(strict)), path, animation).scene()


class _Assembly:
    """Converts the content of a file to a Scene."""

    def __init__(self, file: Parser, path: Path, animation: Sequence[str | int] | None):
        self.file, self.path = file, path
        self.meshes: list[Mesh] = []
        self.cameras: list[Camera] = []
        self.channels: list[Channel] = []
        self.images = ImagePool(file.notes)
        self.plays = animation is None or len(animation) > 0
        self.window = self._window()

    def scene(self) -> Scene:
        file = self.file
        materials = tuple(self._material(f, i) for i, f in enumerate(file.fills))
        self._add_meshes()
        self._add_channels()
        self._add_camera()
        lights = self._lights()
        if self.channels and self.duration > 0:
            # The root's visibility is constant; its last key sets the duration of the scene.
            self._channel(0, "visible", "STEP", np.array([0.0, self.duration]), np.ones((2, 1)))
        for image in self.images.files:
            file.identity.add_file(image)
        return Scene(
            name=self.path.stem,
            nodes=file.nodes.nodes(),
            meshes=tuple(self.meshes),
            materials=materials,
            images=tuple(self.images.images),
            cameras=tuple(self.cameras),
            lights=lights,
            **only_animation("keyframes", self.channels, self.plays),
            notes=file.notes.all(),
            path=self.path,
            sha256=file.identity.hexdigest(),
            files=file.identity.files,
        )

    @property
    def duration(self) -> float:
        return self.window[1] - self.window[0]

    def _window(self) -> tuple[float, float]:
        """Displayed time range of the file, (start, end) in seconds."""
        file = self.file
        if file.window is not None:
            start, end, frames = file.window
            if end > start:
                file.notes.add(
                    f"the file declares {frames} frames in {end - start:g} s: --fps {frames / (end - start):g}"
                )
            return start, end
        spans = [splines.key_window(rows[:, 0]) if kind != "visibility" else (rows[:, 0].min(), rows[:, 0].max())
                 for motion in file.motions.values() for kind, rows in motion.tracks.items()]  # fmt: skip
        spans += [(t[0], t[-1]) for c in file.drawn.values() for _, t in c.moving]
        return (float(min(a for a, _ in spans)), float(max(b for _, b in spans))) if spans else (0.0, 0.0)

    # ------------------------------------------------------------------------------------------------------ surfaces
    def _add_meshes(self) -> None:
        nodes = self.file.nodes
        for node, collector in self.file.drawn.items():
            mesh = collector.mesh(nodes[node].name)
            if collector.crossing:
                self.file.notes.remark("polygon-crossing", detail=nodes[node].name, count=collector.crossing)
            if mesh is not None:
                nodes[node].mesh = len(self.meshes)
                self.meshes.append(mesh)
            for times, moving in collector.moving_meshes(nodes[node].name):
                child = nodes.add(f"{nodes[node].name} animated triangles", node, mesh=len(self.meshes))
                self.meshes.append(moving)
                if len(times) > 1 and self.plays:
                    weights = np.eye(len(times))[:, 1:]
                    keys = splines.linear_keys(np.array(times), weights, self.window)
                    self._channel(child, "weights", "LINEAR", *keys)

    def _material(self, fill: Fill, index: int) -> Material:
        texture = None if fill.texture is None else self.images.texture(fill.texture)
        alpha = float(np.clip(1.0 - fill.transmittance, 0.0, 1.0))
        # A surface without diffuse and specular parts has only its ambient color.
        only_ambient = not any(fill.diffuse) and not any(fill.specular)
        emission = self.file.ambient * fill.ambient if only_ambient else np.zeros(3)
        glow = texture if np.any(emission) else None
        look = Phong(fill.diffuse, fill.specular, fill.shine, alpha, texture, tuple(emission.tolist()), glow)
        return look.material(f"fill {index}")

    # ----------------------------------------------------------------------------------------------- view and light
    def _add_camera(self) -> None:
        nodes, view = self.file.nodes, self.file.camera
        motion = self.file.motions.get(CAMERA)
        if view is None and motion is None:
            return
        if view is None:
            self.cameras.append(Camera(CAMERA))
            node = nodes.add(CAMERA, camera=0)
        else:
            hither = float(view["hither"][0])
            znear = hither if hither >= SMALLEST_HITHER else 1.0
            if znear != hither:
                self.file.notes.add(f"hither of {hither:g} is replaced by 1")
            width, height = view["resolution"].tolist()
            yfov = float(np.radians(view["angle"][0]))
            self.cameras.append(Camera(CAMERA, yfov=yfov, aspect=width / height, znear=znear))
            z = view["from"] - view["at"]
            rotation = math3d.orthonormal(np.stack([np.cross(view["up"], z), view["up"], z], axis=1))
            node = nodes.add(CAMERA, translation=view["from"], rotation=math3d.quat_from_mat3(rotation), camera=0)
        if motion is not None:
            self._move(motion, [node], ("transl", "rot"))

    def _lights(self) -> tuple[Light, ...]:
        nodes, lights = self.file.nodes, []
        for parent, position, color in self.file.lights:
            nodes.add(f"light {len(lights)}", parent, translation=position, light=len(lights))
            lights.append(Light(f"light {len(lights)}", color=tuple(color.tolist()), intensity=np.pi, constant=True))
        return tuple(lights)

    # ----------------------------------------------------------------------------------------------------- animation
    def _add_channels(self) -> None:
        for name, motion in self.file.motions.items():
            movers = self.file.movers.get(name, [])
            if movers:
                self._move(motion, movers, ("transl", "rot", "scale", "visibility"))
            elif name != CAMERA:
                self.file.notes.remark("aff-no-target", motion.where, detail=shortened(name, 40))
        for name in self.file.movers:
            if name not in self.file.motions:
                self.file.notes.remark("aff-static", detail=shortened(name, 40), key=name)

    def _move(self, motion: Motion, nodes: list[int], kinds: tuple[str, ...]) -> None:
        for kind in kinds:
            rows = motion.tracks.get(kind)
            if rows is None:
                continue
            times = rows[:, 0]
            if kind == "visibility":
                path, interpolation, keys = "visible", "STEP", splines.visible_keys(times, rows[:, 1], self.window)
            elif kind == "rot":
                for k in splines.long_turns(rows[:, 1:4], rows[:, 4])[:1].tolist():
                    detail = f"{shortened(motion.name, 40)}, keys {k + 1} and {k + 2}"
                    self.file.notes.remark("aff-long-turn", motion.where, detail=detail)
                path, interpolation = "rotation", "CUBICSPLINE"
                keys = splines.rotation_keys(times, rows[:, 1:4], rows[:, 4], rows[:, 5:], self.window)
            else:
                path, interpolation = "translation" if kind == "transl" else "scale", "CUBICSPLINE"
                keys = splines.position_keys(times, rows[:, 1:4], rows[:, 4:], self.window)
            added = ~np.isin(keys[0], times - self.window[0]) if kind == "rot" else None
            for node in nodes:
                if path != "visible":
                    setattr(self.file.nodes[node], path, keys[1][0, 1])
                if self.plays:
                    self._channel(node, path, interpolation, *keys, added)

    def _channel(
        self, node: int, path: str, interpolation: str, times: Array, values: Array, resampled: Array | None = None
    ) -> None:
        self.channels.append(Channel("node", node, path, interpolation, times, values, resampled))
