"""Maps, models and their materials in a scene file."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np

from taubench_gl.capture import light
from taubench_gl.capture.parts import MIRROR, SceneFile
from taubench_gl.capture.quake3.bsp import FLARE, Bsp
from taubench_gl.capture.quake3.md3 import Md3
from taubench_gl.capture.quake3.paks import Paks
from taubench_gl.capture.quake3.shaders import Look, describe, number, read_scripts
from taubench_gl.errors import SceneError
from taubench_gl.srgb import srgb_decode

Array = np.ndarray

TEXTURE = 256
"""Most pixels a side of a texture."""
_WHITE = np.array([0.2126, 0.7152, 0.0722])


def _once(method: Callable) -> Callable:
    """A method of Surfaces whose results are kept in the object, by its arguments."""

    @wraps(method)
    def call(self: Surfaces, *arguments: Any) -> Any:
        key = (method.__name__, *arguments)
        if key not in self.made:
            self.made[key] = method(self, *arguments)
        return self.made[key]

    return call


class Surfaces:
    """What a scene is drawn with.  Images and models that no archive has are counted as lost."""

    def __init__(self, file: SceneFile, paks: Paks):
        self.file, self.paks = file, paks
        self._scripts = read_scripts(paks)
        self.made: dict[tuple, Any] = {}

    # ------------------------------------------------------------------------------------------------------- materials
    def look(self, name: str) -> Look:
        """A shader; a name with the ending of an image means the shader without it, where there is one."""
        stem = name.rpartition(".")[0] if name.endswith((".tga", ".jpg", ".png")) else name
        return describe(name, self._scripts.get(stem) or self._scripts.get(name))

    def material(self, name: str, lost: str, number_: int) -> int | None:
        """The material of a shader; None for what is not drawn.

        What the game draws and the file cannot have is counted: ``number_`` more of ``lost``.
        """
        look = self.look(name)
        if look.drawn and look.left_out and not look.sky:
            self.file.lost[f"{lost}{look.left_out}"] += number_
            return None
        return self._material(name) if look.drawn else None

    @_once
    def _material(self, name: str) -> int:
        look = self.look(name)
        if look.sky:
            luminance = light.surface_luminance(look.surface_light) if look.surface_light else light.FULL_BRIGHT
            return self.file.emissive(name, self._color(look), luminance)
        image = next(filter(None, map(self.paks.image_name, look.images)), None)
        rest = {"roughness": 0.9, "doubleSided": look.double_sided or None}
        if look.animated:
            self.file.lost["animated textures, which stand still"] += 1
        if image is None:
            self.file.lost[f"no image of {name}"] += 1
            return self.file.writer.material(name, (0.5, 0.5, 0.5), **rest)
        texture, color = self._texture(image, look.alpha != "OPAQUE")
        if look.alpha != "OPAQUE":
            rest["alphaMode"] = look.alpha
        if look.surface_light:
            self.file.counts["emissive materials"] += 1
            luminance = light.surface_luminance(look.surface_light) * (self._color(look) @ _WHITE)
            index = self.file.emissive(name, color, luminance / max(color @ _WHITE, 1e-3), texture, **rest)
        else:
            index = self.file.writer.material(name, texture=texture, **rest)
        if look.alpha == "MASK":
            self.file.writer.gltf.materials[index].alphaCutoff = look.cutoff
        return index

    @_once
    def _texture(self, image: str, alpha: bool) -> tuple[int, Array]:
        """An image of the archives, and its mean linear color."""
        pixels = self._pixels(image)
        texture = self.file.writer.texture(pixels if alpha else np.ascontiguousarray(pixels[..., :3]), lossy=True)
        return texture, srgb_decode(pixels[..., :3] / 255.0).reshape(-1, 3).mean(0)

    def _pixels(self, image: str) -> Array:
        try:
            return self.paks.image(image, TEXTURE)
        except SceneError as error:  # one image of a thousand: the game goes on as well
            self.file.lost[f"image {image} {error.what}"] += 1
            return np.full((1, 1, 4), 128, np.uint8)

    def _color(self, look: Look) -> Array:
        """Color of the light of a surface: the mean of its light image, its largest part 1, as q3map takes it."""
        names = [name for name in (look.light_image, *look.images) if name]
        image = next(filter(None, map(self.paks.image_name, names)), None)
        color = np.ones(3) if image is None else self._pixels(image)[..., :3].reshape(-1, 3).mean(0)
        return color / max(color.max(), 1e-6) if color.max() > 0 else np.ones(3)

    # ------------------------------------------------------------------------------------------------------------- map
    def brush_mesh(self, bsp: Bsp, model: int, name: str) -> int | None:
        """A model of the map: 0 is the world, the others are doors and lifts."""
        primitives = []
        for shader, mesh in bsp.meshes(model).items():
            material = self.material(bsp.shaders[shader], "triangles of ", len(mesh.triangles))
            if material is None:
                continue
            self.file.counts["triangles of the map"] += len(mesh.triangles)
            corners = mesh.triangles[:, MIRROR]
            primitives.append(self.file.primitive(mesh.places, mesh.normals, mesh.uvs, corners, material))
        return self.file.writer.mesh(name, *primitives) if primitives else None

    def add_lights(self, bsp: Bsp) -> None:
        """Add the suns of the map's shaders and its light entities; the sky is among the surfaces."""
        suns = {sun for name in {*bsp.shaders} for sun in self.look(name).suns}
        for red, green, blue, intensity, yaw, elevation in sorted(suns):
            y, e = np.radians([yaw, elevation])
            color = np.array([red, green, blue]).clip(0)
            toward = np.array([np.cos(y) * np.cos(e), np.sin(y) * np.cos(e), np.sin(e)])
            self.file.sun(toward, tuple(color / max(color.max(), 1e-6)), light.sun_lux(max(intensity, 0)))
            self.file.counts["suns"] += 1
        for entity in bsp.entities:
            place = [number(word) for word in entity.get("origin", "").split()]
            if entity.get("classname") != "light" or len(place) != 3:
                continue
            color = np.array([number(w) for w in entity.get("_color", "1 1 1").split()][:3] or [1.0, 1, 1]).clip(0)
            color = np.ones(3) if len(color) < 3 or color.max() <= 0 else color / color.max()
            value = number(entity.get("light", "300")) or 300.0
            candela = light.entity_candela(max(value, 0), self.file.unit)
            self.file.point_light("light", "light entities", np.array([place]), tuple(color), np.array([candela]))
        self.file.lost["flares"] += int((bsp.surfaces["kind"] == FLARE).sum())

    # ---------------------------------------------------------------------------------------------------------- models
    @_once
    def model(self, path: str) -> Md3 | None:
        """A model of the archives; None if there is none."""
        data = self.paks.read(path)
        if data is None:
            self.file.lost[f"no model {path}"] += 1
            return None
        return Md3(data, self.paks.where(path))

    def model_primitives(self, model: Md3, skin: dict[str, str], frames: list[int]) -> list:
        """Primitives of a model in the first of ``frames``, with the others as morph targets; ``skin``: surface ->
        shader.
        """
        out = []
        for surface in model.surfaces:
            shader = skin.get(surface.name, surface.shader)
            if not shader or not len(surface.triangles):
                continue
            material = self.material(shader, "surfaces of models: ", 1)
            if material is None:
                continue
            shapes = [surface.shape(frame) for frame in frames]
            corners = surface.triangles[:, MIRROR]
            out.append(self.file.primitive(*shapes[0], surface.uvs, corners, material, tuple(shapes[1:])))
        return out

    @_once
    def still_mesh(self, path: str) -> int | None:
        """Mesh of the first frame of a model; None if there is nothing to draw."""
        model = self.model(path)
        primitives = [] if model is None else self.model_primitives(model, {}, [0])
        return self.file.writer.mesh(path, *primitives) if primitives else None

    @_once
    def bolt(self, color: tuple[float, float, float], radius: float) -> int:
        """Mesh of an octahedron that shines, where the game draws a sprite that faces the camera."""
        name, corners = f"bolt {color}", np.concatenate([np.eye(3), -np.eye(3)])
        faces = np.array([[0, 1, 2], [3, 5, 4], [1, 3, 2], [0, 2, 4], [0, 5, 1], [3, 4, 2], [1, 5, 3], [0, 4, 5]])
        material = self.file.emissive(name, np.array(color), light.FULL_BRIGHT * 10)
        shape = self.file.primitive(corners * radius, corners, np.zeros((6, 2)), faces, material)
        return self.file.writer.mesh(name, shape)
