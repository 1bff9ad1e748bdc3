"""Hostile files: truncated files, paths outside the folder, bombs.  Each is one SceneError and allocates little."""

from __future__ import annotations

import base64
import os
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gltf_builders import png, refuse, textured
from gltf_files import Gltf, triangle_scene

from taubench_gl.memory_budget import VARIABLE
from taubench_gl.scene import load_scene

# Files


def test_missing_empty_and_unusable_paths(tmp_path: Path) -> None:
    refuse(tmp_path / "no.gltf", "")
    (tmp_path / "folder.gltf").mkdir()
    refuse(tmp_path / "folder.gltf", "")
    (tmp_path / "empty.glb").touch()
    refuse(tmp_path / "empty.glb", "")
    refuse(tmp_path / ("x" * 300 + ".gltf"), "")
    refuse(Path("nul\0.gltf"))


def test_pipes_are_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.gltf")
    refuse(tmp_path / "pipe.gltf", "")
    os.mkfifo(tmp_path / "pipe.bin")
    gltf = triangle_scene()
    gltf.json["buffers"] = [{"byteLength": 36, "uri": "pipe.bin"}]
    refuse(gltf.save(tmp_path), "/buffers/0/uri", "pipe.bin")


def test_json_errors_have_line_and_column(tmp_path: Path) -> None:
    path = tmp_path / "a.gltf"
    path.write_text('{\n  "asset": {"version": "2.0"},\n  "nodes": [,]\n}')
    refuse(path, "", "line 3 column 13")
    path.write_bytes(b"\xef\xbb\xbf{}")
    refuse(path, "")
    path.write_text('{"asset": {"version": "2.0"}')
    refuse(path, "")
    path.write_text("[1]")
    refuse(path, "")
    path.write_text('{"asset": {"version": "2.0"}, "nodes": [{"translation": [NaN, 0, 0]}]}')
    refuse(path, "")


@pytest.mark.parametrize("place", ["extras", "extensions", "nodes"])
def test_deep_json(tmp_path: Path, place: str) -> None:
    path = tmp_path / "deep.gltf"
    opening, closing = '{"a":[' * 200_000, "]}" * 200_000
    path.write_text('{"asset": {"version": "2.0"}, "' + place + '": ' + opening + closing + "}")
    refuse(path)


# URIs


@pytest.mark.parametrize(
    "uri",
    ["../secret.bin", "sub/../../secret.bin", "%2e%2e/secret.bin", "%2E%2E%2Fsecret.bin", "..%2fsecret.bin", "link.bin",
     "linked/secret.bin", "/etc/hostname", "%2Fetc%2Fhostname", "//host/a.bin", "\\\\host\\a.bin", "C:\\a.bin",
     "http://example.com/a.bin", "https://example.com/a.bin", "file:///etc/hostname", "FILE:/etc/hostname", "%66ile:/x",
     "HERE/scene.gltf", "", ".", "sub", "a%00.bin", "%FF.bin", "x" * 5000, "loop"],
    ids=lambda uri: uri[:24],
)  # fmt: skip
@pytest.mark.parametrize("kind", ["buffer", "image"])
def test_uris_outside_the_folder_are_refused(tmp_path: Path, uri: str, kind: str) -> None:
    folder = tmp_path / "scene"
    (folder / "sub").mkdir(parents=True)
    secret, uri = png() if kind == "image" else bytes(100), uri.replace("HERE", str(folder))
    (tmp_path / "secret.bin").write_bytes(secret)
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    (folder / "linked").symlink_to(tmp_path)
    (folder / "loop").symlink_to(folder / "loop")
    if kind == "buffer":
        gltf = triangle_scene()
        gltf.json["buffers"] = [{"byteLength": 36, "uri": uri}]
    else:
        gltf = textured({})
        gltf.json["images"][0]["uri"] = uri
    refuse(gltf.save(folder), f"/{kind}s/0/uri")


def test_links_within_the_folder_are_followed(tmp_path: Path) -> None:
    gltf = triangle_scene()
    (tmp_path / "real.bin").write_bytes(gltf.blob)
    (tmp_path / "link.bin").symlink_to(tmp_path / "real.bin")
    gltf.json["buffers"] = [{"byteLength": len(gltf.blob), "uri": "link.bin"}]
    assert load_scene(gltf.save(tmp_path)).meshes


# Bombs: peak allocation, which tracemalloc also records for NumPy, stays small


def change(**changes: Any) -> Callable[[Gltf], None]:
    def apply(gltf: Gltf) -> None:
        gltf.json["accessors"][0].update(changes)

    return apply


def no_view(gltf: Gltf) -> None:
    del gltf.json["accessors"][0]["bufferView"]
    gltf.json["accessors"][0]["count"] = 10**9


def no_view_many(gltf: Gltf) -> None:
    """Each accessor is below the limit, their sum is not."""
    accessor = {"componentType": 5126, "type": "MAT4", "count": 2**21}
    first = len(gltf.json["accessors"])
    gltf.json["accessors"] += [dict(accessor) for _ in range(100)]
    position = {"componentType": 5126, "type": "VEC3", "count": 10**7}
    gltf.json["accessors"] += [position] * 3
    for i in range(3):
        gltf.json["meshes"].append({"primitives": [{"attributes": {"POSITION": first + 100 + i}}]})


def huge_sparse(gltf: Gltf) -> None:
    gltf.json["accessors"][0]["sparse"] = {"count": 10**12, "indices": {"bufferView": 0, "componentType": 5125},
                                           "values": {"bufferView": 0}}  # fmt: skip


def zeros_under_sparse(gltf: Gltf) -> None:
    del gltf.json["accessors"][0]["bufferView"]
    gltf.json["accessors"][0].update(count=10**12, sparse={
        "count": 1, "indices": {"bufferView": 0, "componentType": 5125}, "values": {"bufferView": 0}})  # fmt: skip


@pytest.mark.parametrize(
    "bomb",
    [change(count=10**12), change(count=2**63), change(count=10**30), change(count=1e300), change(byteOffset=2**62),
     no_view, no_view_many, huge_sparse, zeros_under_sparse],
    ids=["count-1e12", "count-2^63", "count-1e30", "count-float", "offset", "no-view", "no-view-many", "sparse",
         "zeros-under-sparse"],
)  # fmt: skip
def test_bombs_allocate_little(tmp_path: Path, bomb: Callable[[Gltf], None]) -> None:
    gltf = triangle_scene()
    bomb(gltf)
    path = gltf.save(tmp_path)
    tracemalloc.start()
    try:
        refuse(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < (400 << 20 if bomb is no_view_many else 8 << 20)


def test_image_bombs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "2GiB")  # 16384 x 16384 pixels take 4
    for width, height in ((16385, 1), (16384, 16384), (2**31 - 1, 2**31 - 1)):
        data = bytearray(png((1, 1)))
        data[16:24] = width.to_bytes(4, "big") + height.to_bytes(4, "big")
        data[29:33] = zlib.crc32(data[12:29]).to_bytes(4, "big")
        gltf = textured({})
        gltf.json["images"][0]["uri"] = "data:image/png;base64," + base64.b64encode(data).decode()
        refuse(gltf.save(tmp_path), "/images/0")


def test_long_chain_of_nodes(tmp_path: Path) -> None:
    gltf = Gltf()
    for i in range(1500):
        gltf.node(children=[i + 1])
    gltf.node()
    assert len(load_scene(gltf.save(tmp_path)).nodes.levels()) == 1501
    for i in range(1500, 5000):
        gltf.json["nodes"][i]["children"] = [i + 1]
        gltf.node()
    refuse(gltf.save(tmp_path), "/nodes/2000", 2000)


def test_shared_accessors_share_memory(tmp_path: Path) -> None:
    """A thousand primitives on one accessor of ten thousand vertices: hundreds of megabytes without sharing."""
    gltf = Gltf()
    points = np.random.default_rng(0).random((10_000, 3), np.float32)
    weights = np.tile([0.5, 0.5, 0, 0], (10_000, 1))
    gltf.mesh(points, COLOR_0=gltf.accessor(points), WEIGHTS_0=gltf.accessor(weights),
              JOINTS_0=gltf.accessor(np.zeros((10_000, 4)), "u1"))  # fmt: skip
    gltf.json["meshes"] *= 1000
    gltf.node()
    gltf.animation({"node": 0, "path": "translation"}, np.arange(10_000), points)
    gltf.json["nodes"] *= 1000
    channel = gltf.json["animations"][0]["channels"][0]
    gltf.json["animations"][0]["channels"] = [
        {**channel, "target": {"node": i, "path": "translation"}} for i in range(1000)
    ]
    path = gltf.save(tmp_path)
    tracemalloc.start()
    try:
        scene = load_scene(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(scene.meshes) == len(scene.channels) == 1000 and peak < 32 << 20


@pytest.mark.long
def test_a_million_materials_are_refused(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.json["materials"] = [{}] * 1_000_000
    refuse(gltf.save(tmp_path), "/materials/65536", 1_000_000)
    gltf.json["materials"] = [{}] * 1000
    assert len(load_scene(gltf.save(tmp_path)).materials) == 1000
