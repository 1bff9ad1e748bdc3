"""One random scene written in several ways by pygltflib: the same counts."""

from __future__ import annotations

import base64

import numpy as np
import pygltflib as gl
import pytest

from taubench_gl.evaluation import evaluate_scene
from taubench_gl.scene.builder import box, sphere, turn
from taubench_gl.settings import Settings


class Writer:
    """A room, three moving objects and a camera; ``wide``: 32-bit indices instead of 16-bit ones."""

    def __init__(self, rng: np.random.Generator, wide: bool = False, shuffled: bool = False):
        self.blob = b""
        self.gltf = gl.GLTF2(asset=gl.Asset(version="2.0"))
        self.wide = wide
        g = self.gltf
        meshes = [self.mesh(box((5, 3, 6), inside=True)), *(self.mesh(s) for s in (box(), sphere(1.0, 8), box()))]
        order = [2, 0, 3, 1] if shuffled else [0, 1, 2, 3]
        g.meshes = [meshes[i] for i in order]
        for i in range(4):
            node = gl.Node(mesh=order.index(i), name=f"object {i}" if not shuffled else None)
            if i:
                node.rotation = turn(rng.normal(size=3), float(rng.uniform(-170, 170))).tolist()
                node.scale = [0.5] * 3
            g.nodes.append(node)
        g.cameras.append(gl.Camera(type="perspective", perspective=gl.Perspective(yfov=1.1, znear=0.05, zfar=50.0)))
        g.nodes.append(gl.Node(camera=0))
        g.scenes, g.scene = [gl.Scene(nodes=[4, 3, 2, 1, 0] if shuffled else [0, 1, 2, 3, 4])], 0
        animation = gl.Animation()
        for node in (1, 2, 3, 4):
            keys = rng.integers(-24, 24, (3, 3)) / 16 - ([0, 0, 2] if node < 4 else [0, 0, 0])
            self.translate(animation, node, keys)
        g.animations.append(animation)

    def translate(self, animation: gl.Animation, node: int, keys: np.ndarray) -> None:
        times = self.accessor(np.float32([0.0, 0.5, 1.0]), gl.SCALAR, bounds=True)
        values = self.accessor(np.float32(keys), gl.VEC3)
        animation.samplers.append(gl.AnimationSampler(input=times, output=values, interpolation="LINEAR"))
        target = gl.AnimationChannelTarget(node=node, path="translation")
        animation.channels.append(gl.AnimationChannel(sampler=len(animation.samplers) - 1, target=target))

    def mesh(self, primitive) -> gl.Mesh:
        position = self.accessor(primitive.positions, gl.VEC3, bounds=True)
        normal = self.accessor(primitive.normals, gl.VEC3)
        indices = self.accessor(primitive.triangles.ravel().astype(np.uint32 if self.wide else np.uint16), gl.SCALAR)
        attributes = gl.Attributes(POSITION=position, NORMAL=normal)
        return gl.Mesh(primitives=[gl.Primitive(attributes=attributes, indices=indices)])

    def accessor(self, values: np.ndarray, kind: str, bounds: bool = False) -> int:
        self.blob += bytes(-len(self.blob) % 4)
        view = gl.BufferView(buffer=0, byteOffset=len(self.blob), byteLength=values.nbytes)
        self.gltf.bufferViews.append(view)
        self.blob += values.tobytes()
        component = {"f": gl.FLOAT, "H": gl.UNSIGNED_SHORT, "I": gl.UNSIGNED_INT}[values.dtype.char]
        rows = values.reshape(len(values), -1)
        accessor = gl.Accessor(
            bufferView=len(self.gltf.bufferViews) - 1, componentType=component, count=len(values), type=kind,
            min=rows.min(axis=0).tolist() if bounds else None, max=rows.max(axis=0).tolist() if bounds else None,
        )  # fmt: skip
        self.gltf.accessors.append(accessor)
        return len(self.gltf.accessors) - 1

    def save(self, path) -> str:
        if path.suffix == ".glb":
            self.gltf.buffers = [gl.Buffer(byteLength=len(self.blob))]
            self.gltf.set_binary_blob(self.blob)
            self.gltf.save_binary(str(path))
        else:
            uri = "data:application/octet-stream;base64," + base64.b64encode(self.blob).decode()
            self.gltf.buffers = [gl.Buffer(byteLength=len(self.blob), uri=uri)]
            self.gltf.save_json(str(path))
        return str(path)


def rows_of(path: str, mode: str) -> list[dict]:
    columns = ("frustum", "position", "normal")
    settings = Settings(width=64, height=40, fps=8, reprojection=mode, columns=columns, backend="egl")
    return evaluate_scene(path, settings).frames


@pytest.mark.parametrize("mode", ["camera", "motion"])
@pytest.mark.parametrize("seed", [1, 2])
def test_counts_do_not_depend_on_container_index_width_or_order(tmp_path, seed, mode):
    """GLB and glTF, 16-bit and 32-bit indices, node names, and the order of meshes and scene nodes."""
    plain = rows_of(Writer(np.random.default_rng(seed)).save(tmp_path / "a.gltf"), mode)
    assert len(plain) == 8 and sum(row["position"] for row in plain) > 0
    for name, options in (("b.glb", {}), ("c.glb", {"wide": True}), ("d.gltf", {"shuffled": True})):
        other = rows_of(Writer(np.random.default_rng(seed), **options).save(tmp_path / name), mode)
        assert other == plain, name
