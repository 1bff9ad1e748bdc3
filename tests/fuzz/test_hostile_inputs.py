"""Files from anywhere: pipes, loops of links, names and headers of any bytes, sparse files, small files that want much.

Each is one TaubenchError, without waiting, and allocates little.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from taubench_gl.apps.cli import cli
from taubench_gl.data_files import MAX_VALUES, read_json, read_toml, stored_arrays
from taubench_gl.datasets import scene_cache
from taubench_gl.datasets.scene_cache import unpack
from taubench_gl.effects.lighting import without_auto
from taubench_gl.errors import DatasetError, OutputError, PathTracedError, SceneError, SettingsError, TaubenchError
from taubench_gl.frame.memory import memory_of_frame
from taubench_gl.frame.plan import frame_spec
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.memory_budget import VARIABLE, Budget, _limit_files, limit, machine_bytes, parse_bytes
from taubench_gl.paths import PACKAGE
from taubench_gl.pathtraced.exr import read_exr, read_header, write_exr
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.scene import load_scene
from taubench_gl.scene.environment import environment_bytes, read_environment
from taubench_gl.scene.files import read_image
from taubench_gl.scene.memory import memory_of
from taubench_gl.settings import Settings
from taubench_gl.study.engines import worker_environment

sys.path.append(str(Path(__file__).parents[1] / "scene"))
from gltf_files import Gltf

pytestmark = pytest.mark.usefixtures("fixed_light")

DEMO = PACKAGE.parent / "assets" / "demo.glb"
NOT_UTF8 = os.fsdecode(b"caf\xe9")
SMALL = 64 << 20


@pytest.fixture(autouse=True)
def deadline():
    """A test that waits for a writer of a pipe, or parses for minutes, fails."""

    def late(*_):
        raise AssertionError("waited for 60 s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def refused(kind: type[TaubenchError], work: Callable[[], object], most: int = SMALL) -> TaubenchError:
    """The error that ``work`` raises; its allocations in Python and NumPy stay below ``most`` bytes."""
    tracemalloc.start()
    try:
        with pytest.raises(kind) as caught:
            work()
        assert tracemalloc.get_traced_memory()[1] < most
    finally:
        tracemalloc.stop()
    assert "\n" not in str(caught.value)
    return caught.value


def frame(path: Path, **attributes: object) -> Path:
    plane = np.arange(16 * 8, dtype=np.float32).reshape(8, 16)
    write_exr(path, {f"Combined.{c}": plane for c in "RGBA"}, attributes)
    return path


def sparse(path: Path, head: bytes = b"") -> Path:
    """3 GiB of which the disk holds ``head``."""
    with path.open("wb") as file:
        file.write(head)
        file.truncate(3 << 30)
    return path


@pytest.mark.parametrize("text", [b"Combined.R", b"Combined"])
def test_names_in_an_exr_header_that_are_not_utf8_are_refused(tmp_path, text):
    path = frame(tmp_path / "a.exr")
    path.write_bytes(path.read_bytes().replace(text, text[:-1] + b"\xe9"))
    for read in (read_exr, read_header):
        assert refused(PathTracedError, lambda read=read: read(path)).where == str(path)


def test_file_names_of_any_bytes_are_read(tmp_path):
    folder = tmp_path / NOT_UTF8
    folder.mkdir()
    frame(folder / f"{NOT_UTF8}_0001.exr")
    assert PathTracedSequence.open(f"exr:{folder}").radiance(1).shape == (8, 16, 3)
    scene = folder / f"{NOT_UTF8}.glb"
    scene.write_bytes(DEMO.read_bytes())
    assert load_scene(scene).sha256 == load_scene(DEMO).sha256
    image = frame(folder / "environment.exr")
    image.write_bytes(image.read_bytes().replace(b"Combined.", b""))
    write_exr(image, {c: np.ones((4, 8), np.float32) for c in "RGB"})
    assert read_environment(image).size == (8, 4) and environment_bytes(image) == 4 * 8 * 12


@pytest.mark.parametrize(
    "arguments",
    [("inspect", "l.glb"), ("inspect", "l.aff"), ("inspect", "l.obj"), ("inspect", "l.blend"), ("inspect", "l/a.glb"),
     ("evaluate", "exr:l"), ("evaluate", str(DEMO), "--out", "l"), ("evaluate", str(DEMO), "--environment", "l.hdr"),
     ("evaluate", str(DEMO), "--preset", "l.toml"), ("compare", "l", "l"), ("report", "l"), ("batch", "l.toml"),
     ("export", str(DEMO), "--out", "l"), ("reuse", "check", "l.toml"), ("reuse", "check", "l")],
)  # fmt: skip
def test_loops_of_links_are_one_line(tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    for name in {part.removeprefix("exr:").split("/")[0] for part in arguments if part.removeprefix("exr:")[0] == "l"}:
        (tmp_path / name).symlink_to(name)
    small = ("--size", "32x18") if arguments[0] in ("evaluate", "export") else ()
    result = CliRunner().invoke(cli, [*arguments, *small])
    assert isinstance(result.exception, TaubenchError | SystemExit) and result.exit_code != 0


def test_keys_of_toml_are_limited_before_they_are_parsed(tmp_path):
    """The parser of Python takes 6 GB for 78 KB of dots."""
    path = tmp_path / "a.toml"
    for key in (".".join("a" * 39_000), ' . "b" . '[1:].join("a" * 100), ".".join(["'c'"] * 70)):
        for text in (f"{key} = 1", f"[{key}]", f"[[{key}]]", f"x = {{ {key} = 1 }}"):
            path.write_text(text)
            refused(OutputError, lambda: read_toml(path))
    path.write_text(".".join("a" * 60) + ' = "1.2.3"\nb = "' + "word. " * 500 + '"')
    assert read_toml(path)["b"].startswith("word.")


def test_values_of_json_are_limited_before_they_are_parsed(tmp_path):
    path = tmp_path / "a.json"
    path.write_text("[" + "{}," * MAX_VALUES + "{}]")
    refused(OutputError, lambda: read_json(path))
    path.write_text("[" + "0," * 1000 + "0]")
    assert len(read_json(path)) == 1001


def test_sparse_images_and_archives_are_refused_before_they_are_read(tmp_path):
    header = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n"
    refused(SettingsError, lambda: read_environment(sparse(tmp_path / "a.hdr", header)))
    write_exr(tmp_path / "b.exr", {c: np.ones((4, 8), np.float32) for c in "RGB"})
    whole = (tmp_path / "b.exr").read_bytes()
    refused(SettingsError, lambda: read_environment(sparse(tmp_path / "c.exr", whole)))
    refused(PathTracedError, lambda: read_exr(sparse(tmp_path / "d.exr", whole[:200])))
    for name in ("a.zip", "a.tar.gz", "a.tar.xz"):
        refused(DatasetError, lambda name=name: unpack(sparse(tmp_path / name), tmp_path / f"{name} unpacked"))


@pytest.mark.parametrize("name", ["a.zip", "a.tar.gz", "a.glb", "a.gltf", "a.obj", "a.blend"])
def test_sparse_local_files_are_refused_before_their_checksum_is_taken(tmp_path, monkeypatch, name):
    monkeypatch.setenv(VARIABLE, "2GiB")
    monkeypatch.setattr(scene_cache, "hashed", lambda *_: pytest.fail("was read"))
    entry = scene_cache.Entry(title="x", format="gltf")
    cached = scene_cache.CachedScene("x", entry, tmp_path / "cache")
    assert refused(DatasetError, lambda: cached.take(sparse(tmp_path / name))).where == str(tmp_path / name)
    assert not (tmp_path / "cache").exists()


def test_stored_arrays_are_limited_and_hold_no_objects(tmp_path, monkeypatch):
    np.savez_compressed(tmp_path / "zeros.npz", a=np.zeros(1 << 25, np.uint8))
    np.savez(tmp_path / "objects.npz", a=np.array([print], dtype=object))
    monkeypatch.setenv(VARIABLE, "16MiB")

    def read(name):
        with stored_arrays(tmp_path / name) as arrays:
            return arrays["a"]

    for name in ("zeros.npz", "objects.npz"):
        refused(OutputError, lambda name=name: read(name))
    monkeypatch.setenv(VARIABLE, "64MiB")
    assert read("zeros.npz").shape == (1 << 25,)


def png(path: Path, side: int) -> Path:
    """A valid gray image of ``side`` squared pixels, a thousandth of its size."""
    Image.new("L", (side, side)).save(path, compress_level=1)
    return path


@pytest.mark.long
def test_the_largest_image_is_not_called_damaged(tmp_path):
    assert read_image(png(tmp_path / "a.png", 16384), check=True).size == (16384, 16384)
    refused(SceneError, lambda: read_image(png(tmp_path / "b.png", 16385), check=True))


def gltf(path: Path, node: dict, primitives: int, buffers: list[np.ndarray], **more: object) -> Path:
    """A file whose mesh has ``primitives`` with positions of accessor 0 and indices of accessor 1."""
    made = Gltf()
    for array in buffers:
        made.accessor(array, "f4" if array.dtype == np.float32 else "u4")
    made.json["accessors"] += more.pop("accessors", [])
    made.add("meshes", {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}] * primitives})
    made.node(**node)
    made.json |= {"scenes": [{"nodes": [0]}], "scene": 0} | more
    return made.save(path.parent, path.name)


TRIANGLE = [np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.uint32([0, 1, 2])]
INSTANCED = {"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2}}}}


@pytest.mark.parametrize("count", [10_000_000, 20_000_000, 400_000_000])
def test_instances_without_data_are_refused(tmp_path, count):
    more = {"extensionsUsed": ["EXT_mesh_gpu_instancing"]}
    zeros = [{"componentType": 5126, "type": "VEC3", "count": count}]
    path = gltf(tmp_path / "a.gltf", INSTANCED, 1, TRIANGLE, accessors=zeros, **more)
    assert "/nodes/0" in refused(SceneError, lambda: load_scene(path)).where


def test_instances_are_counted_before_they_are_made(tmp_path, monkeypatch):
    moved = np.zeros((100_000, 3), np.float32)
    more = {"extensionsUsed": ["EXT_mesh_gpu_instancing"]}
    path = gltf(tmp_path / "a.gltf", INSTANCED, 1, [*TRIANGLE, moved], **more)
    assert memory_of(load_scene(path))["instances"] > 100_000 * 128
    monkeypatch.setenv(VARIABLE, "32MiB")
    assert refused(SceneError, lambda: load_scene(path), 16 << 20).where.endswith("EXT_mesh_gpu_instancing/attributes")


def test_primitives_that_share_indices_are_counted_before_they_are_expanded(tmp_path, monkeypatch):
    indices = (np.arange(120_000) % 3).astype(np.uint32)
    path = gltf(tmp_path / "a.gltf", {"mesh": 0}, 300, [TRIANGLE[0], indices])
    sums = memory_of(load_scene(path))
    assert sums["primitives"] > 300 * 120_000 * 72  # of a flat triangle, each corner is a vertex of its own
    monkeypatch.setenv(VARIABLE, "2GiB")
    error = refused(SceneError, lambda: load_scene(path))
    assert "mesh 0" in error.what and "primitives" in error.what


@pytest.mark.parametrize("limit_text", ["8MiB", "24MiB", "1GiB"])
def test_images_are_counted_before_they_are_decoded(tmp_path, monkeypatch, limit_text):
    """1024 x 1024 pixels take 6 MiB, whatever the file has, and one at a time 20 more; the sum names all of them."""
    names = [png(tmp_path / f"{i}.png", 1024).name for i in range(2)]
    texture = {"materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
                              "emissiveTexture": {"index": 1}}],
               "textures": [{"source": 0}, {"source": 1}], "images": [{"uri": name} for name in names]}  # fmt: skip
    path = gltf(tmp_path / "a.gltf", {"mesh": 0}, 1, TRIANGLE, **texture)
    monkeypatch.setenv(VARIABLE, limit_text)
    if limit_text == "1GiB":
        assert memory_of(load_scene(path))["images"] == (2 * 6 + 20) << 20
    else:
        error = refused(SceneError, lambda: load_scene(path))
        assert error.where.endswith("/images/0") if limit_text == "8MiB" else "32 MiB of it for images" in error.what


def test_inspect_prints_the_same_sum_as_is_checked(tmp_path):
    path = gltf(tmp_path / "a.gltf", {"mesh": 0}, 3, TRIANGLE)
    result = CliRunner().invoke(cli, ["inspect", str(path), "--json"])
    printed, scene = json.loads(result.stdout)["memory_bytes"], load_scene(path)
    spec = frame_spec(AnimatedScene(scene), without_auto(scene, Settings()))
    assert printed == memory_of_frame(spec) and printed.items() >= memory_of(scene).items()
    assert printed["channels"] > 5 * 1920 * 1080


def test_the_option_limits_one_command(tmp_path, monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    path = gltf(tmp_path / "a.gltf", {"mesh": 0}, 10, [TRIANGLE[0], np.zeros(30_000, np.uint32)])
    limited = CliRunner().invoke(cli, ["inspect", str(path), "--max-memory", "8MiB"])
    assert isinstance(limited.exception, SceneError) and VARIABLE not in os.environ
    assert CliRunner().invoke(cli, ["inspect", str(path)]).exit_code == 0
    wrong = CliRunner().invoke(cli, ["inspect", str(path), "--max-memory", "much"])
    assert isinstance(wrong.exception, SettingsError)


def test_the_default_is_the_limit_of_the_container_divided_by_the_workers(tmp_path, monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    assert limit() == machine_bytes() <= os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    assert int(worker_environment(4)[VARIABLE]) == limit() // 4
    monkeypatch.setenv(VARIABLE, "3GiB")
    assert limit() == 3 << 30 and worker_environment(4)[VARIABLE] == "3GiB"
    groups = tmp_path / "cgroup"
    groups.write_text("0::/user/job\n4:memory:/docker/1\n2:cpu:/x\n5:memory:/../..\n")
    found = {str(p.relative_to(tmp_path)) for p in _limit_files(groups, tmp_path / "fs")}
    assert {"fs/memory.max", "fs/user/memory.max", "fs/user/job/memory.max"} <= found
    assert {"fs/memory/memory.limit_in_bytes", "fs/memory/docker/1/memory.limit_in_bytes"} <= found
    assert not any(".." in name or (name[-1] == "x" and "cpu" in name) for name in found)


@pytest.mark.parametrize(
    ("text", "count"),
    [("4GiB", 4 << 30), ("4G", 4 << 30), ("4GB", 4 * 10**9), ("1.5 MiB", 3 << 19), ("1048576", 1 << 20),
     ("2097152B", 2 << 20), ("", None), ("-1G", None), ("1K", None), ("inf", None), ("1e9", None),
     ("9" * 15 + "T", None)],
)  # fmt: skip
def test_sizes(text, count):
    if count is None:
        with pytest.raises(SettingsError):
            parse_bytes(text)
    else:
        assert parse_bytes(text) == count


def test_a_budget_says_what_it_holds(monkeypatch):
    monkeypatch.setenv(VARIABLE, "2MiB")
    budget = Budget()
    assert budget.add("images", 1 << 20) is None and budget.add("files", 1 << 20) is None
    assert "images" in budget.add("images", 1) and budget.total == (2 << 20) + 1
