"""Mutants of small real files: each loads or raises SceneError, with a limit on allocated memory."""

from __future__ import annotations

import json
import random
import shutil
import tracemalloc
from pathlib import Path
from typing import Any

import pytest
from gltf_files import glb, read_json
from repeated import few

from taubench_gl.errors import SceneError
from taubench_gl.scene import load_scene

SEEDS = [
    "khronos/BoxInterleaved/BoxInterleaved.glb",
    "khronos/SimpleSkin/SimpleSkin.gltf",
    "khronos/SimpleSparseAccessor/SimpleSparseAccessor.gltf",
    "khronos/AnimatedMorphCube/AnimatedMorphCube.glb",
    "khronos/Cameras/Cameras.gltf",
    "gltf_transform/BoxMeshopt.glb",
    "blender_io/04_lights/04_lights.gltf",
]
FEW, MANY = 20, 60  # mutants of each kind and file
MAX_PEAK = 512 << 20

VALUES: list[Any] = [
    -1, 0, 1, 2, 3, 255, 65535, 2**31, 2**32 - 1, 2**53, 10**12, 10**30, 0.5, -0.0, 1e308, 1e-308, True, False, None,
    "", "x", "../..", "data:,", [], [0], {}, {"a": 1}, [[]], 5120, 5121, 5123, 5125, 5126, "SCALAR", "VEC4", "MAT4",
]  # fmt: skip


def places(value: Any, path: tuple = ()) -> list[tuple]:
    """Paths of all values in a JSON document, long arrays by a few of their elements."""
    out = [path] if path else []
    if isinstance(value, dict):
        for key, item in value.items():
            out += places(item, (*path, key))
    elif isinstance(value, list):
        for i, item in list(enumerate(value))[:6]:
            out += places(item, (*path, i))
    return out


def mutate_json(document: Any, rng: random.Random) -> None:
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        *parents, last = rng.choice(places(document) or [("asset",)])
        owner = document
        for key in parents:
            owner = owner[key]
        kind = rng.random()
        if kind < 0.15:
            del owner[last]
        elif kind < 0.3 and isinstance(owner, list):
            owner.append(owner[last])
        elif kind < 0.5 and isinstance(owner[last], (int, float)):
            owner[last] = owner[last] + rng.choice((-1, 1, 4, 1000))
        else:
            owner[last] = rng.choice(VALUES)


def mutate_bytes(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 2, 8, 64))):
        at = rng.randrange(len(out))
        out[at] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
    if rng.random() < 0.2:
        del out[rng.randrange(len(out)) :]
    return bytes(out)


def try_load(path: Path) -> bool:
    tracemalloc.reset_peak()
    try:
        scene = load_scene(path)
    except SceneError as e:
        assert "\n" not in str(e)
        loaded = False
    else:
        for primitive in (p for mesh in scene.meshes for p in mesh.primitives):
            assert primitive.triangles.size == 0 or primitive.triangles.max() < len(primitive.positions)
        loaded = True
    assert tracemalloc.get_traced_memory()[1] < MAX_PEAK
    return loaded


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", few(SEEDS, 3), ids=[Path(s).stem for s in SEEDS])
def test_mutants(data: Path, tmp_path: Path, name: str, count: int) -> None:
    source = data / name
    for file in source.parent.iterdir():
        if file.is_file():
            shutil.copyfile(file, tmp_path / file.name)
    original, document = source.read_bytes(), read_json(source)
    chunk = None
    if original[:4] == b"glTF":
        start = 20 + int.from_bytes(original[12:16], "little")
        chunk = original[start + 8 :]
    path, rng = tmp_path / source.name, random.Random(name)
    assert try_load_traced(path)
    refused = 0
    tracemalloc.start()
    try:
        for i in range(count):
            mutant = json.loads(json.dumps(document))
            mutate_json(mutant, rng)
            text = json.dumps(mutant).encode()
            path.write_bytes(text if chunk is None else glb(text, chunk))
            refused += not try_load(path)
            # Bytes of the container or of the buffers; the JSON is unchanged in half of the cases.
            if chunk is None or i % 2:
                path.write_bytes(mutate_bytes(original, rng))
            else:
                path.write_bytes(glb(json.dumps(document).encode(), mutate_bytes(chunk, rng)))
            refused += not try_load(path)
    finally:
        tracemalloc.stop()
    assert refused > count // 2  # the mutations have an effect


def try_load_traced(path: Path) -> bool:
    tracemalloc.start()
    try:
        return try_load(path)
    finally:
        tracemalloc.stop()
