"""Reads one AFF or NFF file into a Scene.

Axes are the model's already: right-handed, cameras look along -Z with +Y up; ``m`` is taken as metres.  Time 0 of the
scene is the start of the ``a`` statement (without one, the earliest key).  Colours are linear coefficients; diffuse
becomes the base colour, the Phong exponent n a roughness of (2 / (n + 2)) ^ 1/4.  AFF's lights do not fade,
ours do: a light of colour c gets pi c R^2 candela, so that at R, half the diagonal of the scene's box, it lights as
AFF's does.  Texture coordinates run down from the picture's top row.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from taubench_gl import math3d
from taubench_gl.errors import SceneError
from taubench_gl.scene.aff import splines
from taubench_gl.scene.aff.parser import AffFile, Fill, Motion, Parser
from taubench_gl.scene.build import half_diagonal
from taubench_gl.scene.files import read_image
from taubench_gl.scene.model import Animation, Camera, Channel, Image, Light, Material, Mesh, Scene, Texture

Array = np.ndarray

CAMERA = "camera"
"""Name of the animation that moves the viewpoint."""
SMALLEST_HITHER = 1e-4
"""A hither nearer than this is taken as 1, as BART's parser does."""


def read_aff(path: Path, scene: str | int | None, animation: Sequence[str | int] | None) -> Scene:
    """``load_scene`` for .aff and .nff.  Raises SceneError with file and line."""
    if scene is not None:
        raise SceneError("AFF files hold one scene", where=path.name, hint="leave the scene's name out")
    return _Assembly(Parser(path).parse(), path, animation).scene()


class _Assembly:
    """From what the file says to a Scene."""

    def __init__(self, file: AffFile, path: Path, animation: Sequence[str | int] | None):
        self.file, self.path = file, path
        self.meshes: list[Mesh] = []
        self.cameras: list[Camera] = []
        self.channels: list[Channel] = []
        self.images: dict[Path, int] = {}
        self.pictures: list[Image] = []
        self.plays = animation is None or len(animation) > 0
        self.window = self._window()

    def scene(self) -> Scene:
        file = self.file
        materials = tuple(self._material(f, i) for i, f in enumerate(file.fills))
        self._draw()
        self._animate()
        self._view()
        lights = self._lights()
        if self.channels and self.duration > 0:
            # The root's visibility never changes; its last key says how long the animation is.
            self._channel(0, "visible", "STEP", np.array([0.0, self.duration]), np.ones((2, 1)))
        played = Animation("keyframes", tuple(self.channels))
        playing = self.plays and bool(self.channels)
        return Scene(
            name=self.path.stem,
            nodes=file.nodes.nodes(),
            meshes=tuple(self.meshes),
            materials=materials,
            images=tuple(self.pictures),
            cameras=tuple(self.cameras),
            lights=lights,
            animations=(played,) if self.channels else (),
            channels=played.channels if playing else (),
            playing=(played.name,) if playing else (),
            notes=tuple(file.notes),
            path=self.path,
            sha256=file.identity.hexdigest(),
            files=file.identity.files,
        )

    @property
    def duration(self) -> float:
        return self.window[1] - self.window[0]

    def _window(self) -> tuple[float, float]:
        """Seconds of the file that are shown, (start, end)."""
        file = self.file
        if file.window is not None:
            start, end, frames = file.window
            if end > start:
                file.note(f"the file asks for {frames} frames in {end - start:g} s: --fps {frames / (end - start):g}")
            return start, end
        spans = [splines.key_window(rows[:, 0]) if kind != "visibility" else (rows[:, 0].min(), rows[:, 0].max())
                 for motion in file.motions.values() for kind, rows in motion.tracks.items()]  # fmt: skip
        spans += [(t[0], t[-1]) for c in file.drawn.values() for _, t in c.moving]
        return (float(min(a for a, _ in spans)), float(max(b for _, b in spans))) if spans else (0.0, 0.0)

    # ------------------------------------------------------------------------------------------------------ surfaces
    def _draw(self) -> None:
        nodes = self.file.nodes
        for node, collector in self.file.drawn.items():
            mesh = collector.mesh(nodes.names[node])
            if mesh is not None:
                nodes.mesh[node] = len(self.meshes)
                self.meshes.append(mesh)
            for times, moving in collector.moving_meshes(nodes.names[node]):
                child = nodes.add(f"{nodes.names[node]} animated triangles", node, mesh=len(self.meshes))
                self.meshes.append(moving)
                if len(times) > 1 and self.plays:
                    weights = np.eye(len(times))[:, 1:]
                    keys = splines.linear_keys(np.array(times), weights, self.window)
                    self._channel(child, "weights", "LINEAR", *keys)

    def _material(self, fill: Fill, index: int) -> Material:
        texture = None
        if fill.texture is not None:
            if fill.texture not in self.images:
                self.images[fill.texture] = len(self.pictures)
                self.file.identity.add_file(fill.texture)
                self.pictures.append(read_image(fill.texture))
            texture = Texture(self.images[fill.texture])
        alpha = float(np.clip(1.0 - fill.transmittance, 0.0, 1.0))
        if alpha < 0.5:
            self.file.note("surfaces that let through more than half of the light are not drawn")
        # A surface without diffuse and specular parts shows its ambient colour whatever lights there are.
        shows_only_ambient = not any(fill.diffuse) and not any(fill.specular)
        glow = self.file.ambient * fill.ambient if shows_only_ambient else np.zeros(3)
        return Material(
            name=f"fill {index}",
            base_color=(*np.clip(fill.diffuse, 0.0, 1.0).tolist(), alpha),
            base_color_texture=texture,
            metallic=0.0,
            roughness=float((2.0 / (max(fill.shine, 0.0) + 2.0)) ** 0.25),
            emissive=tuple(glow.tolist()),
            emissive_texture=texture if np.any(glow) else None,
            alpha_mode="BLEND" if alpha < 1.0 else "OPAQUE",
            double_sided=True,
            specular=1.0 if any(fill.specular) else 0.0,
        )

    # ----------------------------------------------------------------------------------------------- view and light
    def _view(self) -> None:
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
                self.file.note(f"hither of {hither:g} is taken as 1")
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
        if not self.file.lights:
            return ()
        reach = half_diagonal(nodes.nodes(), tuple(self.meshes))
        for parent, position, color in self.file.lights:
            nodes.add(f"light {len(lights)}", parent, translation=position, light=len(lights))
            lights.append(Light(f"light {len(lights)}", color=tuple(color.tolist()), intensity=np.pi * reach * reach))
        self.file.note(f"lights of AFF do not fade; taken as point lights that shine alike at {reach:.3g} m")
        return tuple(lights)

    # ----------------------------------------------------------------------------------------------------- animation
    def _animate(self) -> None:
        for name, motion in self.file.motions.items():
            movers = self.file.movers.get(name, [])
            if movers:
                self._move(motion, movers, ("transl", "rot", "scale", "visibility"))
            elif name != CAMERA:
                self.file.note(f"animation {name} moves nothing", motion.where)
        for name in self.file.movers:
            if name not in self.file.motions:
                self.file.note(f"no animation is called {name}: it stands still")

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
                    self.file.note(f"{motion.name} turns more than 180 degrees between keys {k + 1} and {k + 2}, taken "
                                   "as written; BART's own code takes the shorter way", motion.where)  # fmt: skip
                path, interpolation = "rotation", "CUBICSPLINE"
                keys = splines.rotation_keys(times, rows[:, 1:4], rows[:, 4], rows[:, 5:], self.window)
            else:
                path, interpolation = "translation" if kind == "transl" else "scale", "CUBICSPLINE"
                keys = splines.position_keys(times, rows[:, 1:4], rows[:, 4:], self.window)
            for node in nodes:
                if path != "visible":
                    getattr(self.file.nodes, path)[node] = keys[1][0, 1]
                if self.plays:
                    self._channel(node, path, interpolation, *keys)

    def _channel(self, node: int, path: str, interpolation: str, times: Array, values: Array) -> None:
        self.channels.append(Channel("node", node, path, interpolation, times, values))
