"""assets/conformance (``tools/record assets``): the scenes of the conformance suite.

What each of them shows is in taubench_gl/conformance/cases.toml.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pygltflib as gl
import shapes

from taubench_gl.conformance.cases import CAMERA, FPS, FRAMES
from taubench_gl.datasets.gltf_writer import Writer
from taubench_gl.math3d import quat_multiply
from taubench_gl.scene.builder import turn

Array = np.ndarray
PACE = np.array([0.0, 1.0, 3.5, 5.0, 8.7])
"""Progress of every motion at the keys, which lie on frames 0 to 4: no two steps are alike, so that a vector of another
frame, of half the rate or of twice the length differs from the right one."""

EYE = (0.3, 1.4, 5.0)
YFOV = 50.0


def rotations(axis: Sequence[float], degrees: Array, base: Array | None = None) -> Array:
    """Quaternions xyzw (K, 4) of turns by ``degrees`` (K,) about ``axis``, after ``base``."""
    turned = np.array([turn(axis, angle) for angle in degrees])
    return turned if base is None else quat_multiply(turned, np.broadcast_to(base, turned.shape))


def along(start: Sequence[float], step: Sequence[float], pace: Array = PACE) -> Array:
    """Positions (K, 3) of a motion by ``step`` meters per unit of ``pace`` from ``start``."""
    return np.asarray(start, dtype=float) + np.asarray(pace)[:, None] * np.asarray(step, dtype=float)


class Stage:
    """One scene of the suite under construction.  Objects stand on the ground y = 0; methods return node indices."""

    def __init__(self, origin: Sequence[float] = (0.0, 0.0, 0.0)):
        """``origin``: where the whole scene stands, meters."""
        self.writer = Writer("CC0-1.0", "taubench-gl conformance")
        self.root = self.writer.node("root", translation=list(origin)) if any(origin) else None
        self._tracks: list[tuple] = []

    def material(self, color: tuple[float, ...] = (0.6, 0.6, 0.6), **rest: Any) -> int:
        """A rough material of a linear ``color``; its index."""
        return self.writer.material(f"material {len(self.writer.gltf.materials)}", color, **rest)

    def mesh(self, name: str, shape: shapes.Shape, material: int | None = None, **morph: list) -> int:
        """A mesh of one primitive; its index among the meshes.  ``morph``: its targets and their weights."""
        material = self.material() if material is None else material
        if self.writer.gltf.materials[material].pbrMetallicRoughness.baseColorTexture is None:
            shape = {name: values for name, values in shape.items() if name != "TEXCOORD_0"}
        primitive = self.writer.primitive(shape, material, morph.get("targets"))
        return self.writer.mesh(name, primitive, weights=morph.get("weights"))

    def node(self, name: str, mesh: int | None = None, parent: int | None = None, **fields: Any) -> int:
        """A node below ``parent``, or below the root of the scene."""
        fields = {key: [float(x) for x in value] if key in ("translation", "rotation", "scale") else value
                  for key, value in fields.items()}  # fmt: skip
        return self.writer.node(name, self.root if parent is None else parent, mesh=mesh, **fields)

    def add(self, name: str, shape: shapes.Shape, material: int | None = None, **fields: Any) -> int:
        """A node with a mesh of one primitive; ``fields`` as for ``node``."""
        return self.node(name, self.mesh(name, shape, material), **fields)

    def box(self, name: str, at: Sequence[float], half: Sequence[float] = (0.5, 0.5, 0.5), **fields: Any) -> int:
        """A box around ``at``, ``half`` its size; its color depends on its name."""
        shade = np.random.default_rng(list(name.encode())).uniform(0.2, 0.9, 3).round(3)
        shape = shapes.box(-np.asarray(half), np.asarray(half))
        return self.add(name, shape, self.material(tuple(shade.tolist())), translation=at, **fields)

    def ground(self, cells: int = 1) -> int:
        """The ground, a square of 40 m around the origin of ``cells`` times ``cells`` quads, seen from both sides.

        Rasterizers clip smaller triangles more exactly.
        """
        size, corners = 40.0 / cells, itertools.product(np.linspace(-20.0, 20.0, cells, endpoint=False), repeat=2)
        shape = shapes.join([shapes.quad((x, 0, z + size), (size, 0, 0), (0, 0, -size)) for x, z in corners])
        return self.add("ground", shape, self.material((0.4, 0.5, 0.3), doubleSided=True))

    def eye(self, at: Sequence[float] = EYE, pitch: float = -8.0, yfov: float = YFOV, ymag: float | None = None) -> int:
        """The camera.  ``pitch``, ``yfov``: degrees; ``ymag``: half the height that a parallel one sees, meters."""
        camera = self.writer.camera(CAMERA, float(np.radians(yfov)), 0.1, 200.0)
        if ymag is not None:
            lens = gl.Orthographic(xmag=ymag * 16 / 9, ymag=ymag, znear=0.1, zfar=100.0)
            self.writer.gltf.cameras[camera] = gl.Camera(name=CAMERA, type="orthographic", orthographic=lens)
        return self.node(CAMERA, translation=at, rotation=turn((1, 0, 0), pitch), camera=camera)

    def furnished(self, cells: int = 1, **eye: Any) -> int:
        """The ground of ``cells`` times ``cells`` quads, two boxes that stand still on it, and the camera ``eye``."""
        self.ground(cells)
        self.box("left box", (-1.6, 0.6, -0.5), (0.5, 0.6, 0.5), rotation=turn((0, 1, 0), 20.0))
        self.box("right box", (1.9, 0.4, -2.0), (0.6, 0.4, 0.4), rotation=turn((0, 1, 0), -35.0))
        return self.eye(**eye)

    def animate(self, node: int | str, path: str, values: Any, interpolation: str = "LINEAR") -> None:
        """Keys of ``path`` of ``node`` for frames 0 to 4: ``values`` (5, ...); those of STEP a quarter frame earlier.

        With the path "pointer", ``node`` is the JSON pointer of a property.  Files hold float32 times; a jump on a
        frame would come a frame late where they are rounded up.
        """
        times = np.maximum(np.arange(FRAMES + 1) - 0.25 * (interpolation == "STEP"), 0.0) / FPS
        self._tracks.append((node, path, times, values, interpolation))

    def document(self) -> Writer:
        """The glTF document, complete: once.

        Extensions are listed as used and none as required: a loader without one shows the rest of the scene.
        """
        if self._tracks:
            self.writer.animation("motion", *self._tracks)
        return self.writer


SCENES: dict[str, Callable[[], Writer]] = {}
"""Case -> what makes its glTF document."""

SWITCH = np.array([0, 0, 1, 1, 0])
"""State at the keys of what appears at frame 2."""


def _case(name: str, origin: Sequence[float] = (0.0, 0.0, 0.0)) -> Callable:
    """Register a function that builds the scene of the case ``name``, which stands at ``origin``."""

    def register(build: Callable[[Stage], None]) -> Callable[[Stage], None]:
        def document() -> Writer:
            stage = Stage(origin)
            build(stage)
            return stage.document()

        SCENES[name] = document
        return build

    return register


def _turned_eye(stage: Stage, axis: tuple[float, float, float], degrees: Array, pitch: float = -8.0) -> None:
    """The furniture, and a camera that turns about ``axis`` of the world."""
    stage.animate(stage.furnished(pitch=pitch), "rotation", rotations(axis, degrees, turn((1, 0, 0), pitch)))


@_case("still")
def _still(stage: Stage) -> None:
    stage.furnished()


@_case("yaw")
def _yaw(stage: Stage) -> None:
    _turned_eye(stage, (0, 1, 0), 1.3 * PACE)


@_case("pitch")
def _pitch(stage: Stage) -> None:
    _turned_eye(stage, (1, 0, 0), -1.1 * PACE, pitch=-2.0)


@_case("roll")
def _roll(stage: Stage) -> None:
    _turned_eye(stage, (0, 0, 1), 2.0 * PACE, pitch=0.0)


@_case("dolly")
def _dolly(stage: Stage) -> None:
    stage.animate(stage.furnished(), "translation", along(EYE, (0.05, 0.01, -0.12)))


@_case("zoom")
def _zoom(stage: Stage) -> None:
    stage.furnished()
    stage.animate("/cameras/0/perspective/yfov", "pointer", np.radians(YFOV - 1.5 * PACE))


@_case("orthographic")
def _orthographic(stage: Stage) -> None:
    stage.add("wall", shapes.quad((-9, -1, -4), (18, 0, 0), (0, 12, 0)))
    eye = stage.furnished(at=(0.0, 1.6, 6.0), pitch=0.0, ymag=1.5)
    stage.animate(eye, "translation", along((0.0, 1.6, 6.0), (0.06, 0.03, 0.0)))


@_case("off-axis")
def _off_axis(stage: Stage) -> None:
    _dolly(stage)


def _moving(stage: Stage, path: str, values: Array, half: tuple = (0.7, 0.6, 0.6), **fields) -> tuple[int, int]:
    """The furniture and a box before it whose ``path`` has keys.  Returns the camera, which stands, and the box."""
    eye, box = stage.furnished(), stage.box("moving box", (0.1, 1.1, 1.0), half, **fields)
    stage.animate(box, path, values)
    return eye, box


@_case("translate")
def _translate(stage: Stage) -> None:
    _moving(stage, "translation", along((-0.4, 1.1, 1.0), (0.07, 0.03, 0.05)))


@_case("rotate")
def _rotate(stage: Stage) -> None:
    _moving(stage, "rotation", rotations((0.4, 1.0, 0.2), 3.0 * PACE))


@_case("scale")
def _scale(stage: Stage) -> None:
    _moving(stage, "scale", np.stack([0.8 + 0.06 * PACE, 1.2 - 0.05 * PACE, 1.0 + 0.0 * PACE], axis=-1))


@_case("mirror")
def _mirror(stage: Stage) -> None:
    places = along((-0.2, 1.1, 1.0), (0.05, 0.02, 0.03))
    _, node = _moving(stage, "translation", places, (0.4, 0.7, 0.4), scale=(-1.0, 1.0, 1.0))
    stage.animate(node, "rotation", rotations((0, 1, 0), 2.0 * PACE))
    stage.box("arm", (0.7, 0.3, 0.2), (0.4, 0.2, 0.3), parent=node)


@_case("chain")
def _chain(stage: Stage) -> None:
    stage.furnished()
    parent, at = None, (-1.2, 0.9, 1.2)
    for k in range(3):
        parent = stage.node(f"pivot {k}", parent=parent, translation=at)
        stage.animate(parent, "rotation", rotations((0, 0.3, 1), (1.5 + k) * PACE))
        stage.box(f"link {k}", (0.45, 0.0, 0.0), (0.4, 0.3, 0.3), parent=parent)
        at = (0.9, 0.0, 0.0)


@_case("attached")
def _attached(stage: Stage) -> None:
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


@_case("skin")
def _skin(stage: Stage) -> None:
    _strip(stage, skin=True, morph=False)


@_case("morph")
def _morph(stage: Stage) -> None:
    _strip(stage, skin=False, morph=True)


@_case("skin-morph")
def _skin_morph(stage: Stage) -> None:
    _strip(stage, skin=True, morph=True)


@_case("instances")
def _instances(stage: Stage) -> None:
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


@_case("visibility")
def _visibility(stage: Stage) -> None:
    for node, keys in zip(_appearing(stage), (SWITCH, 1 - SWITCH), strict=True):
        extension = stage.writer.uses("KHR_node_visibility")
        stage.writer.gltf.nodes[node].extensions[extension] = {"visible": bool(keys[0])}
        stage.animate(f"/nodes/{node}/extensions/{extension}/visible", "pointer", keys > 0, "STEP")


@_case("zero-scale")
def _zero_scale(stage: Stage) -> None:
    for node, keys in zip(_appearing(stage), (SWITCH, 1 - SWITCH), strict=True):
        stage.animate(node, "scale", np.repeat(keys[:, None], 3, axis=1), "STEP")


@_case("teleport")
def _teleport(stage: Stage) -> None:
    places = np.where(SWITCH[:, None] > 0, (0.8, 1.1, 0.9), (-0.9, 0.9, 1.2))
    stage.furnished()
    stage.animate(stage.box("hopping box", places[0]), "translation", places, "STEP")


@_case("enter")
def _enter(stage: Stage) -> None:
    _moving(stage, "translation", along((-3.9, 1.3, 0.8), (0.28, 0.0, 0.0)), (0.9, 0.8, 0.6))


@_case("near")
def _near(stage: Stage) -> None:
    _moving(stage, "translation", along((-0.3, 0.7, 3.5), (0.03, 0.01, 0.3)), (0.5, 0.25, 5.0))


@_case("behind")
def _behind(stage: Stage) -> None:
    eye = stage.furnished(cells=8, at=(0.2, 0.2, 1.2), pitch=-14.0)
    stage.animate(eye, "translation", along((0.2, 0.2, 1.2), (0.02, 0.0, 0.8)))


@_case("disocclusion-object")
def _disocclusion_object(stage: Stage) -> None:
    stage.ground()
    stage.add("wall", shapes.quad((-5, 0, -2), (10, 0, 0), (0, 2.2, 0)))
    stage.eye()
    board = stage.box("board", (0, 0, 0), (1.0, 0.8, 0.05))
    stage.animate(board, "translation", along((-0.6, 1.2, 1.0), (0.17, 0.0, 0.0)))


@_case("disocclusion-camera")
def _disocclusion_camera(stage: Stage) -> None:
    for k, x in enumerate((-0.6, 1.0)):
        stage.box(f"pillar {k}", (x, 1.2, 2.2), (0.2, 1.2, 0.2))
    stage.animate(stage.furnished(), "translation", along((-0.4, 1.4, 5.0), (0.16, 0.0, 0.0)))


@_case("line")
def _line(stage: Stage) -> None:
    stage.ground()
    stage.eye(pitch=-18.0)
    rods = shapes.join([shapes.box((-2.4 + 0.4 * k, -1.5, 0), (-2.376 + 0.4 * k, 1.5, 0.02)) for k in range(13)])
    node = stage.add("rods", rods)
    stage.animate(node, "translation", along((0.05, 1.0, 1.8), (0.05, 0.02, 0.02)))
    stage.animate(node, "rotation", rotations((0, 0, 1), 12.0 + 1.0 * PACE))


@_case("grid")
def _grid(stage: Stage) -> None:
    stage.furnished()
    w = stage.writer
    texels = np.tile(np.array([200, 160, 60, 255], dtype=np.uint8), (64, 64, 1))
    texels[(np.indices((64, 64)) % 8 >= 3).all(axis=0), 3] = 0
    w.gltf.samplers.append(gl.Sampler(magFilter=gl.NEAREST, minFilter=gl.NEAREST))
    material = stage.material(texture=w.texture(texels), alphaMode="MASK", doubleSided=True)
    w.gltf.materials[material].alphaCutoff = 0.5
    board = stage.add("board", shapes.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), 0.5), material)
    stage.animate(board, "translation", along((0.05, 1.3, 2.0), (0.04, 0.02, 0.03)))


@_case("leaf")
def _leaf(stage: Stage) -> None:
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


@_case("texture")
def _texture(stage: Stage) -> None:
    stage.furnished()
    material = stage.material(texture=_checkers(stage), doubleSided=True)
    stage.add("board", shapes.quad((-1, 0.4, 1), (2, 0, 0), (0, 1.5, 0)), material)
    extension = stage.writer.uses("KHR_texture_transform")
    texture = stage.writer.gltf.materials[material].pbrMetallicRoughness.baseColorTexture
    texture.extensions = {extension: {"offset": [0.0, 0.0]}}
    pointer = f"/materials/{material}/pbrMetallicRoughness/baseColorTexture/extensions/{extension}/offset"
    stage.animate(pointer, "pointer", 0.05 * np.stack([PACE, PACE], axis=-1))


@_case("seam")
def _seam(stage: Stage) -> None:
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


@_case("kilometer", origin=(1500.0, 40.0, -1200.0))
def _kilometer(stage: Stage) -> None:
    _far(stage)


@_case("far", origin=(1e5, 0.0, 1e5))
def _hundred_kilometers(stage: Stage) -> None:
    _far(stage)


@_case("sky")
def _sky(stage: Stage) -> None:
    turned = rotations((0.3, 1.0, 0.1), 1.6 * PACE, turn((1, 0, 0), 22.0))
    stage.animate(stage.furnished(pitch=22.0, yfov=60.0), "rotation", turned)


@_case("cut")
def _cut(stage: Stage) -> None:
    places = np.where(SWITCH[:, None] > 0, (-2.5, 1.0, 3.0), EYE)
    stage.animate(stage.furnished(), "translation", places, "STEP")


@_case("jitter")
def _jitter(stage: Stage) -> None:
    _translate(stage)


def _sun(stage: Stage) -> int:
    """A sun; its node."""
    light = stage.writer.light(type="directional", intensity=3.0, name="sun")
    return stage.node("sun", rotation=turn((1, 0.4, 0), -50.0), extensions=light)


@_case("shadow")
def _shadow(stage: Stage) -> None:
    _sun(stage)
    _moving(stage, "translation", along((-0.4, 1.4, 1.0), (0.07, 0.0, 0.05)), (0.6, 0.3, 0.5))


@_case("light")
def _light(stage: Stage) -> None:
    stage.furnished()
    stage.animate(_sun(stage), "rotation", rotations((0, 1, 0), 6.0 * PACE, turn((1, 0.4, 0), -50.0)))
