"""The cases of the suite: one scene and one property each."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pygltflib as gl

from taubench_gl.animation.jitter import halton_jitter
from taubench_gl.conformance.stage import EYE, FRAMES, PACE, YFOV, Stage, along, rotations
from taubench_gl.datasets import shapes
from taubench_gl.datasets.gltf_writer import Writer
from taubench_gl.errors import SettingsError
from taubench_gl.scene import load_scene
from taubench_gl.scene.builder import turn
from taubench_gl.scene.model import Scene

Array = np.ndarray
CASES: dict[str, Case] = {}
SWITCH = np.array([0, 0, 1, 1, 0])
"""State at the keys of what appears at frame 2."""


@dataclass(frozen=True, slots=True)
class Case:
    """One scene.  ``about``: the classes of pixels that it must have; ``text``: what it shows, for its page."""

    name: str
    text: str
    about: tuple[str, ...]
    build: Callable[[Stage], None]
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    offsets: Callable[[tuple[int, int]], Array] | None = None  # size -> (FRAMES, 2) pixels, +x right, +y up
    cut: int | None = None  # first frame of a new shot
    edges: bool = False  # the edge band is what is scored

    def document(self) -> Writer:
        """The glTF document of the scene."""
        stage = Stage(self.origin)
        self.build(stage)
        return stage.document()

    @property
    def extensions(self) -> tuple[str, ...]:
        """Names of the glTF extensions that the scene uses."""
        return tuple(self.document().gltf.extensionsUsed)

    def jitter(self, size: tuple[int, int]) -> Array:
        """Where each frame is sampled: pixel i at i + offset.  (FRAMES, 2) pixels, +x right, +y up."""
        return np.zeros((FRAMES, 2)) if self.offsets is None else self.offsets(size)


@cache
def scene_of(name: str) -> Scene:
    """The scene of a case as its file has it: what an engine reads."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.glb"
        CASES[name].document().save(path)
        return load_scene(path)


def select(names: tuple[str, ...]) -> list[Case]:
    """Cases whose names contain one of ``names``; all without names.  Raises SettingsError where one names none."""
    for name in names:
        if not any(name in case for case in CASES):
            raise SettingsError(f"no case is named {name!r}", hint="see 'taubench-gl conformance list'")
    return [case for case in CASES.values() if not names or any(name in case.name for name in names)]


def _case(name: str, about: str, **fields) -> Callable:
    """Register a function that builds a scene; its docstring is the case's text.  ``about``: classes, in one text."""

    def register(build: Callable[[Stage], None]) -> Callable[[Stage], None]:
        text = " ".join((build.__doc__ or "").split())
        CASES[name] = Case(name, text, tuple(about.split()), build, **fields)
        return build

    return register


def _turned_eye(stage: Stage, axis: tuple[float, float, float], degrees: Array, pitch: float = -8.0) -> None:
    """The furniture, and a camera that turns about ``axis`` of the world."""
    stage.animate(stage.furnished(pitch=pitch), "rotation", rotations(axis, degrees, turn((1, 0, 0), pitch)))


@_case("still", "still sky")
def _still(stage: Stage) -> None:
    """Nothing moves.  Every vector is exactly zero, on surfaces and in the sky: not a small number, zero."""
    stage.furnished()


@_case("yaw", "still sky")
def _yaw(stage: Stage) -> None:
    """The camera turns about the vertical.  Surfaces and sky move alike, without parallax; pixels that enter at the
    side have no history."""
    _turned_eye(stage, (0, 1, 0), 1.3 * PACE)


@_case("pitch", "still sky")
def _pitch(stage: Stage) -> None:
    """The camera tilts downward.  A flipped y axis shows here and hides in yaw."""
    _turned_eye(stage, (1, 0, 0), -1.1 * PACE, pitch=-2.0)


@_case("roll", "still sky")
def _roll(stage: Stage) -> None:
    """The camera rolls about its axis: vectors circle around the center of the image and are zero in it."""
    _turned_eye(stage, (0, 0, 1), 2.0 * PACE, pitch=0.0)


@_case("dolly", "still sky")
def _dolly(stage: Stage) -> None:
    """The camera moves forward and to the side: near surfaces move more than far ones, and the sky does not move."""
    stage.animate(stage.furnished(), "translation", along(EYE, (0.05, 0.01, -0.12)))


@_case("zoom", "still sky")
def _zoom(stage: Stage) -> None:
    """The field of view of the camera narrows by KHR_animation_pointer.  The previous frame has another projection
    matrix: a vector made with one projection for both frames is zero."""
    stage.furnished()
    stage.animate("/cameras/0/perspective/yfov", "pointer", np.radians(YFOV - 1.5 * PACE))


@_case("orthographic", "still")
def _orthographic(stage: Stage) -> None:
    """A parallel camera moves sideways and up: all surfaces have one vector, whatever their depth."""
    stage.add("wall", shapes.quad((-9, -1, -4), (18, 0, 0), (0, 12, 0)))
    eye = stage.furnished(at=(0.0, 1.6, 6.0), pitch=0.0, ymag=1.5)
    stage.animate(eye, "translation", along((0.0, 1.6, 6.0), (0.06, 0.03, 0.0)))


@_case("off-axis", "still sky", offsets=lambda size: np.tile(np.array([0.15, -0.1]) * size, (FRAMES, 1)))
def _off_axis(stage: Stage) -> None:
    """The projection is off its axis, as for a tile of a large image or an eye: every frame is sampled at the same
    large offset, 15 % of the width and 10 % of the height.  The offset is in both frames and no part of a vector."""
    _dolly(stage)


def _moving(stage: Stage, path: str, values: Array, half: tuple = (0.7, 0.6, 0.6), **fields) -> tuple[int, int]:
    """The furniture and a box before it whose ``path`` has keys.  Returns the camera, which stands, and the box."""
    eye, box = stage.furnished(), stage.box("moving box", (0.1, 1.1, 1.0), half, **fields)
    stage.animate(box, path, values)
    return eye, box


@_case("translate", "still rigid sky")
def _translate(stage: Stage) -> None:
    """A box moves sideways and toward a camera that stands still.  Camera-only vectors are zero on it."""
    _moving(stage, "translation", along((-0.4, 1.1, 1.0), (0.07, 0.03, 0.05)))


@_case("rotate", "still rigid sky")
def _rotate(stage: Stage) -> None:
    """A box turns about an oblique axis: vectors differ from pixel to pixel of one face."""
    _moving(stage, "rotation", rotations((0.4, 1.0, 0.2), 3.0 * PACE))


@_case("scale", "still rigid sky")
def _scale(stage: Stage) -> None:
    """A box grows in one axis and shrinks in another: the previous matrix is no rotation."""
    _moving(stage, "scale", np.stack([0.8 + 0.06 * PACE, 1.2 - 0.05 * PACE, 1.0 + 0.0 * PACE], axis=-1))


@_case("mirror", "still rigid sky")
def _mirror(stage: Stage) -> None:
    """Two boxes below a node with a negative scale move and turn.  The mirror reverses the winding of their triangles,
    and a previous matrix that is made of position, rotation and a positive scale puts their points elsewhere."""
    places = along((-0.2, 1.1, 1.0), (0.05, 0.02, 0.03))
    _, node = _moving(stage, "translation", places, (0.4, 0.7, 0.4), scale=(-1.0, 1.0, 1.0))
    stage.animate(node, "rotation", rotations((0, 1, 0), 2.0 * PACE))
    stage.box("arm", (0.7, 0.3, 0.2), (0.4, 0.2, 0.3), parent=node)


@_case("chain", "still rigid sky")
def _chain(stage: Stage) -> None:
    """Three boxes, each the child of the one before, turn at their joints: the previous world matrix of a child needs
    the previous matrices of all its ancestors."""
    stage.furnished()
    parent, at = None, (-1.2, 0.9, 1.2)
    for k in range(3):
        parent = stage.node(f"pivot {k}", parent=parent, translation=at)
        stage.animate(parent, "rotation", rotations((0, 0.3, 1), (1.5 + k) * PACE))
        stage.box(f"link {k}", (0.45, 0.0, 0.0), (0.4, 0.3, 0.3), parent=parent)
        at = (0.9, 0.0, 0.0)


@_case("attached", "still rigid sky")
def _attached(stage: Stage) -> None:
    """A box is a child of the camera, which moves and turns: it stands still on the screen, before a world that does
    not.  Vectors from depth and camera matrices alone give it the motion of the world."""
    eye = stage.furnished()
    stage.animate(eye, "translation", along(EYE, (0.05, 0.0, -0.05)))
    stage.animate(eye, "rotation", rotations((0, 1, 0), 1.0 * PACE, turn((1, 0, 0), -8.0)))
    stage.box("held box", (0.35, -0.25, -1.6), (0.3, 0.2, 0.3), parent=eye)


def _strip(stage: Stage, *, skin: bool, morph: bool) -> None:
    """A still camera, the furniture and an upright strip that a skin, a morph target or both deform."""
    stage.furnished()
    shape = shapes.join([shapes.quad((-0.4, y, 0), (0.8, 0, 0), (0, 0.3, 0)) for y in 0.3 * np.arange(8)])
    height, place, morphed = shape["POSITION"][:, 1], (-0.3, 0.1, 1.2), {}
    if morph:
        bulge = np.sin(np.pi * height / 2.4)[:, None] * [0.5, 0.15, 0.3]
        morphed = {"targets": [{"POSITION": bulge}], "weights": [0.0]}
    if skin:
        at = np.minimum(height / 0.8, 2.0)
        weights = np.pad(np.clip(1.0 - np.abs(at[:, None] - np.arange(3)), 0.0, 1.0), ((0, 0), (0, 1)))
        shape |= {"JOINTS_0": np.where(weights > 0, [0, 1, 2, 0], 0), "WEIGHTS_0": weights}
        joints: list[int] = []
        inverse_bind = np.tile(np.eye(4), (3, 1, 1))
        for k in range(3):
            where = {"parent": joints[-1], "translation": (0.0, 0.8, 0.0)} if k else {"translation": place}
            joints.append(stage.node(f"joint {k}", **where))
            stage.animate(joints[k], "rotation", rotations((0.3, 0.4 * k, 1.0), (1.0 + 1.5 * k) * PACE))
            inverse_bind[k, 1, 3] = -0.8 * k
    mesh = stage.mesh("strip", shape, stage.material((0.8, 0.3, 0.2), doubleSided=True), **morphed)
    placed = {"skin": stage.writer.skin("skin", joints, inverse_bind)} if skin else {"translation": place}
    node = stage.node("strip", mesh, **placed)
    if morph:
        stage.animate(node, "weights", 0.1 * PACE + 0.1)


@_case("skin", "still skinned sky")
def _skin(stage: Stage) -> None:
    """Three joints bend a strip.  The previous position of a vertex needs the joint matrices of the previous frame; the
    bind pose or the current ones give other vectors."""
    _strip(stage, skin=True, morph=False)


@_case("morph", "still morphed sky")
def _morph(stage: Stage) -> None:
    """A morph target bends a strip.  The previous position of a vertex needs the weights of the previous frame; the
    base shape or the current weights give other vectors."""
    _strip(stage, skin=False, morph=True)


@_case("skin-morph", "still skinned sky")
def _skin_morph(stage: Stage) -> None:
    """A morph target and three joints deform one strip: first the target, then the joints, in both frames."""
    _strip(stage, skin=True, morph=True)


@_case("instances", "still rigid sky")
def _instances(stage: Stage) -> None:
    """Five instances of one box below a node that turns: previous matrices are those of the node times each
    instance's."""
    stage.furnished()
    places = np.array([(-1.4, 0, 0), (-0.6, 0.5, 0.2), (0.1, -0.2, 0.5), (0.8, 0.4, 0.1), (1.5, 0.1, -0.2)])
    extension = stage.writer.uses("EXT_mesh_gpu_instancing")
    extensions = {extension: {"attributes": {"TRANSLATION": stage.writer.accessor(places)}}}
    node = stage.box("swarm", (0.0, 1.1, 0.8), (0.28, 0.28, 0.28), extensions=extensions)
    stage.animate(node, "rotation", rotations((0, 1, 0.2), 2.0 * PACE))


def _appearing(stage: Stage) -> tuple[int, int]:
    """A still camera, the furniture and two boxes: one is to appear, one to vanish at frame 2."""
    stage.furnished()
    return stage.box("appearing box", (0.9, 0.9, 1.2)), stage.box("vanishing box", (-0.7, 0.9, 1.2))


@_case("visibility", "still sky")
def _visibility(stage: Stage) -> None:
    """At frame 2 one box appears and another vanishes by KHR_node_visibility.  Neither the new surface nor what the old
    one hid has a history."""
    for node, keys in zip(_appearing(stage), (SWITCH, 1 - SWITCH), strict=True):
        extension = stage.writer.uses("KHR_node_visibility")
        stage.writer.gltf.nodes[node].extensions[extension] = {"visible": bool(keys[0])}
        stage.animate(f"/nodes/{node}/extensions/{extension}/visible", "pointer", keys > 0, "STEP")


@_case("zero-scale", "still sky")
def _zero_scale(stage: Stage) -> None:
    """At frame 2 one box appears and another vanishes by a scale of zero, which every viewer knows.  A surface that was
    scaled to a point has no previous position."""
    for node, keys in zip(_appearing(stage), (SWITCH, 1 - SWITCH), strict=True):
        stage.animate(node, "scale", np.repeat(keys[:, None], 3, axis=1), "STEP")


@_case("teleport", "still rigid sky")
def _teleport(stage: Stage) -> None:
    """A box is at another place from frame 2 on, by STEP keys.  It is the same box: its vectors point to where it
    was."""
    places = np.where(SWITCH[:, None] > 0, (0.8, 1.1, 0.9), (-0.9, 0.9, 1.2))
    stage.furnished()
    stage.animate(stage.box("hopping box", places[0]), "translation", places, "STEP")


@_case("enter", "still rigid sky")
def _enter(stage: Stage) -> None:
    """A box enters at the side.  Its vectors lead out of the previous image, where there is no history."""
    _moving(stage, "translation", along((-3.9, 1.3, 0.8), (0.28, 0.0, 0.0)), (0.9, 0.8, 0.6))


@_case("near", "still rigid sky")
def _near(stage: Stage) -> None:
    """A long bar slides past the camera and reaches behind it: triangles cross the near plane, and a vertex behind the
    camera must not be divided by its depth."""
    _moving(stage, "translation", along((-0.3, 0.7, 3.5), (0.03, 0.01, 0.3)), (0.5, 0.25, 5.0))


@_case("behind", "still sky behind")
def _behind(stage: Stage) -> None:
    """The camera moves backward near the ground: what is in front of it now was behind it before.  Such pixels have no
    place in the previous image, and a division by their depth puts them into it."""
    eye = stage.furnished(cells=8, at=(0.2, 0.2, 1.2), pitch=-14.0)
    stage.animate(eye, "translation", along((0.2, 0.2, 1.2), (0.02, 0.0, 0.8)))


@_case("disocclusion-object", "still rigid sky")
def _disocclusion_object(stage: Stage) -> None:
    """A board slides away before a wall: the wall that it uncovers has right vectors and no history."""
    stage.ground()
    stage.add("wall", shapes.quad((-5, 0, -2), (10, 0, 0), (0, 2.2, 0)))
    stage.eye()
    board = stage.box("board", (0, 0, 0), (1.0, 0.8, 0.05))
    stage.animate(board, "translation", along((-0.6, 1.2, 1.0), (0.17, 0.0, 0.0)))


@_case("disocclusion-camera", "still sky")
def _disocclusion_camera(stage: Stage) -> None:
    """The camera moves sideways past two pillars: by parallax they uncover what is behind them."""
    for k, x in enumerate((-0.6, 1.0)):
        stage.box(f"pillar {k}", (x, 1.2, 2.2), (0.2, 1.2, 0.2))
    stage.animate(stage.furnished(), "translation", along((-0.4, 1.4, 5.0), (0.16, 0.0, 0.0)))


@_case("line", "still rigid", edges=True)
def _line(stage: Stage) -> None:
    """Thin rods, a pixel wide, move before the ground.  All of a rod is edge: a vector buffer that is filtered,
    dilated or drawn at lower resolution loses it."""
    stage.ground()
    stage.eye(pitch=-18.0)
    rods = shapes.join([shapes.box((-2.4 + 0.4 * k, -1.5, 0), (-2.376 + 0.4 * k, 1.5, 0.02)) for k in range(13)])
    node = stage.add("rods", rods)
    stage.animate(node, "translation", along((0.05, 1.0, 1.8), (0.05, 0.02, 0.02)))
    stage.animate(node, "rotation", rotations((0, 0, 1), 12.0 + 1.0 * PACE))


@_case("grid", "still rigid", edges=True)
def _grid(stage: Stage) -> None:
    """A board with holes by an alpha mask moves: in a hole are the vectors of what is behind it, and none of the
    board."""
    stage.furnished()
    w = stage.writer
    texels = np.tile(np.array([200, 160, 60, 255], dtype=np.uint8), (64, 64, 1))
    texels[(np.indices((64, 64)) % 8 >= 3).all(axis=0), 3] = 0
    w.gltf.samplers.append(gl.Sampler(magFilter=gl.NEAREST, minFilter=gl.NEAREST))
    material = stage.material(texture=w.texture(texels), alphaMode="MASK", doubleSided=True)
    w.gltf.materials[material].alphaCutoff = 0.5
    board = stage.add("board", shapes.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), 0.5), material)
    stage.animate(board, "translation", along((0.05, 1.3, 2.0), (0.04, 0.02, 0.03)))


@_case("leaf", "still rigid sky")
def _leaf(stage: Stage) -> None:
    """Double-sided leaves turn over: the back of a leaf is drawn, faces the camera, and has the vectors of the leaf."""
    stage.furnished()
    green, shape = (
        stage.material((0.2, 0.6, 0.2), doubleSided=True),
        shapes.quad((-0.4, -0.4, 0), (0.8, 0, 0), (0, 0.8, 0)),
    )
    for k in range(3):
        node = stage.add(f"leaf {k}", shape, green, translation=(-1.0 + k, 1.1, 1.4))
        stage.animate(node, "rotation", rotations((0.2, 1.0, 0.1 * k), 60.0 * (k + 1) + 8.0 * PACE))


def _checkers(stage: Stage) -> int:
    """A texture of squares; its index."""
    squares = np.indices((16, 16)).sum(axis=0) // 2 % 2
    return stage.writer.texture(np.repeat((60 + 150 * squares)[..., None], 3, axis=-1).astype(np.uint8))


@_case("texture", "still sky")
def _texture(stage: Stage) -> None:
    """The texture of a board moves by KHR_texture_transform, the board does not: its vectors are exactly zero."""
    stage.furnished()
    material = stage.material(texture=_checkers(stage), doubleSided=True)
    stage.add("board", shapes.quad((-1, 0.4, 1), (2, 0, 0), (0, 1.5, 0)), material)
    extension = stage.writer.uses("KHR_texture_transform")
    texture = stage.writer.gltf.materials[material].pbrMetallicRoughness.baseColorTexture
    texture.extensions = {extension: {"offset": [0.0, 0.0]}}
    pointer = f"/materials/{material}/pbrMetallicRoughness/baseColorTexture/extensions/{extension}/offset"
    stage.animate(pointer, "pointer", 0.05 * np.stack([PACE, PACE], axis=-1))


@_case("seam", "still rigid sky")
def _seam(stage: Stage) -> None:
    """A board whose right half mirrors the texture coordinates of the left one moves: vectors are continuous across the
    seam."""
    stage.furnished()
    left, right = (shapes.quad((x, -0.7, 0), (1, 0, 0), (0, 1.4, 0)) for x in (-1, 0))
    right["TEXCOORD_0"] = right["TEXCOORD_0"] * [-1, 1] + [1, 0]
    material = stage.material(texture=_checkers(stage), doubleSided=True)
    board = stage.add("board", shapes.join([left, right]), material)
    stage.animate(board, "translation", along((-0.3, 1.2, 1.2), (0.06, 0.03, 0.02)))
    stage.animate(board, "rotation", rotations((0, 1, 0), 10.0 + 2.0 * PACE))


def _far(stage: Stage) -> None:
    """Builds the scene of ``far`` and ``kilometer``: a moving camera and a moving box."""
    eye, _ = _moving(stage, "translation", along((-0.3, 1.1, 1.0), (0.06, 0.03, 0.04)))
    stage.animate(eye, "translation", along(EYE, (0.04, 0.0, -0.05)))


@_case("kilometer", "still rigid sky", origin=(1500.0, 40.0, -1200.0))
def _kilometer(stage: Stage) -> None:
    """Camera and box move two kilometers from the origin, where a step of half precision is a meter."""
    _far(stage)


@_case("far", "still rigid sky", origin=(1e5, 0.0, 1e5))
def _hundred_kilometers(stage: Stage) -> None:
    """Camera and box move 100 km from the origin along two axes, where a step of single precision is 8 mm: matrices
    must be relative to the camera before they are single precision."""
    _far(stage)


@_case("sky", "sky")
def _sky(stage: Stage) -> None:
    """The camera looks up and turns: nearly all of the image is sky, infinitely far away."""
    turned = rotations((0.3, 1.0, 0.1), 1.6 * PACE, turn((1, 0, 0), 22.0))
    stage.animate(stage.furnished(pitch=22.0, yfov=60.0), "rotation", turned)


@_case("cut", "still sky", cut=2)
def _cut(stage: Stage) -> None:
    """The camera is elsewhere from frame 2 on, and the list of frames says that this is a cut: all history is to be
    rejected there, and no vector of that frame is scored."""
    places = np.where(SWITCH[:, None] > 0, (-2.5, 1.0, 3.0), EYE)
    stage.animate(stage.furnished(), "translation", places, "STEP")


@_case("jitter", "still rigid sky", offsets=lambda size: np.array([halton_jitter(frame) for frame in range(FRAMES)]))
def _jitter(stage: Stage) -> None:
    """Each frame is sampled at another offset within the pixel (Halton 2, 3).  The mapping says whether vectors contain
    the difference of the offsets; without it still surfaces before the still camera have exactly zero."""
    _translate(stage)


def _sun(stage: Stage) -> int:
    """A sun; its node."""
    light = stage.writer.light(type="directional", intensity=3.0, name="sun")
    return stage.node("sun", rotation=turn((1, 0.4, 0), -50.0), extensions=light)


@_case("shadow", "still rigid sky")
def _shadow(stage: Stage) -> None:
    """A box moves over the ground in sunlight, and its shadow with it.  The ground under the shadow does not move: its
    vectors are zero and its history is valid, though its light changes."""
    _sun(stage)
    _moving(stage, "translation", along((-0.4, 1.4, 1.0), (0.07, 0.0, 0.05)), (0.6, 0.3, 0.5))


@_case("light", "still sky")
def _light(stage: Stage) -> None:
    """The sun turns over a scene that stands still: every vector is zero and all history is valid, though the light of
    every pixel changes."""
    stage.furnished()
    stage.animate(_sun(stage), "rotation", rotations((0, 1, 0), 6.0 * PACE, turn((1, 0.4, 0), -50.0)))
