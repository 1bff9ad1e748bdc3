"""``stress``: the written file has the requested camera statistics, in free space, and is otherwise unchanged."""

from __future__ import annotations

import csv
import dataclasses
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image as PillowImage
from repeated import few
from row_files import row_file
from shapes import box
from validator import errors

from taubench_gl.animation import Poser, choose_camera
from taubench_gl.apps.cli import cli
from taubench_gl.datasets.camera_path import CameraSpec, chase, generate
from taubench_gl.datasets.free_space import (
    SAMPLES,
    VOXELS,
    VoxelSpace,
    surface_points,
    winding_number,
    world_triangles,
)
from taubench_gl.datasets.gltf_edit import GltfEditor
from taubench_gl.datasets.gltf_writer import Writer
from taubench_gl.datasets.motion_stats import MotionStats
from taubench_gl.datasets.registry import Entry
from taubench_gl.datasets.stress import CAMERA_NAME, Moves, stress
from taubench_gl.effects.census import census
from taubench_gl.errors import SceneError, SettingsError, TaubenchError
from taubench_gl.metrics.activity import camera_activity, summarize
from taubench_gl.paths import PACKAGE
from taubench_gl.scene import load_scene

pytestmark = pytest.mark.usefixtures("coarse_metering", "coarse_space", "fixed_light")

DEMO = PACKAGE.parent / "assets" / "demo.glb"
SPEC = CameraSpec(
    MotionStats(0.2, 0.02, 1.0), MotionStats(3.365, 8.887), MotionStats(1.55, 2.839), MotionStats(0.5, 0.2),
    frames=121, fps=60.0,
)  # fmt: skip


STILL = CameraSpec(frames=3, fps=60.0)


@pytest.fixture
def default_voxels(monkeypatch):
    """The number of voxels of the command."""
    monkeypatch.setattr(VoxelSpace.__init__, "__defaults__", (VOXELS,))
    monkeypatch.setattr(surface_points, "__defaults__", (SAMPLES,))


def walked(path, fps=60.0, frames=121):
    """Camera statistics of the file's default camera, and its positions."""
    scene = load_scene(path)
    poser, camera = Poser(scene), choose_camera(scene)
    views = [camera.view_at(poser.sample(i / fps)) for i in range(frames)]
    position = np.array([v.position for v in views])
    activity = camera_activity(position, np.array([v.world_from_view for v in views]))
    return summarize(activity, None, fps), position, camera


@pytest.mark.parametrize("name", ["out.glb", "out.gltf"])
def test_the_written_camera_has_the_requested_statistics(tmp_path, name):
    stress(DEMO, tmp_path / name, SPEC)
    found, _, camera = walked(tmp_path / name)
    assert camera.node_name == CAMERA_NAME
    for key, stats in (("position", SPEC.translation), ("yaw", SPEC.yaw), ("pitch", SPEC.pitch), ("roll", SPEC.roll)):
        assert found[key]["mean"] == pytest.approx(stats.mean, rel=1e-3)
        assert found[key]["variance"] == pytest.approx(stats.variance, rel=1e-3)
    assert found["position"]["max"] == pytest.approx(1.0, rel=1e-3)
    assert any("stressed" in str(note) for note in load_scene(tmp_path / name).notes)


def test_a_repaired_file_can_be_extended(tmp_path):
    """Null and empty members, a byte order mark and a missing image of a file are not in the file that is written."""
    stress(DEMO, tmp_path / "demo.gltf", STILL)
    document = json.loads((tmp_path / "demo.gltf").read_text(encoding="utf-8"))
    document["nodes"][0] |= {"children": [], "name": None}
    document["images"] = [*document.get("images", ()), {"uri": "gone.png"}]
    path = tmp_path / "departed.gltf"
    path.write_bytes(b"\xef\xbb\xbf" + json.dumps(document).encode())
    stress(path, tmp_path / "out.glb", STILL)
    load_scene(tmp_path / "out.glb", strict=True)
    with pytest.raises(SceneError):
        stress(path, tmp_path / "strict.glb", STILL, strict=True)
    assert not (tmp_path / "strict.glb").exists()


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        spec = CameraSpec(SPEC.translation, SPEC.yaw, frames=61, seed=seed)
        stress(DEMO, tmp_path / f"{name}.glb", spec, Moves(1, 2), seed)
    a, b, c = ((tmp_path / f"{name}.glb").read_bytes() for name in "abc")
    assert a == b and a != c


def test_the_camera_stays_away_from_triangles_and_inside_walls(default_voxels):
    scene = load_scene(DEMO)
    space = VoxelSpace(scene)
    path = generate(SPEC, space)
    assert np.all(space.clearance(path.position) > 0)
    low, high = np.array([-8.0, 0.0, -6.0]), np.array([8.0, 4.2, 6.0])  # the court
    assert np.all((path.position > low) & (path.position < high))
    corners = world_triangles(scene, Poser(scene).sample(0.0)).reshape(-1, 3)
    gap = np.linalg.norm(path.position[:, None] - corners[None], axis=-1).min()
    assert gap > 0.5 * space.size


def test_the_camera_circles_an_object_without_ground(tmp_path):
    w = Writer("CC0-1.0", "test")
    w.node("box", mesh=w.mesh("box", w.primitive(box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)), w.material("m"))))
    w.save(tmp_path / "box.glb")
    scene = load_scene(tmp_path / "box.glb")
    space = VoxelSpace(scene)
    path = generate(CameraSpec(MotionStats(0.05, 0.001), MotionStats(2.0, 1.0), frames=200), space)
    assert np.all(np.abs(path.position).max(axis=1) > 0.5)  # never inside
    forward = -path.world_from_view[:, :, 2]
    towards = -path.position / np.linalg.norm(path.position, axis=1, keepdims=True)
    assert np.median(np.sum(forward * towards, axis=1)) > 0.7
    corners = world_triangles(scene, Poser(scene).sample(0.0))
    assert winding_number(corners, np.zeros(3)) == pytest.approx(1.0)
    assert winding_number(corners, np.array([0.0, 0.0, 2.0])) == pytest.approx(0.0, abs=1e-9)


def test_angles_stay_within_the_limit():
    rng = np.random.default_rng(0)
    turns = rng.uniform(0, 75, 500)
    angle = chase(200 * rng.standard_normal(501), turns, 0.0, 7.0, 75.0)
    assert np.abs(angle).max() <= 75.0
    np.testing.assert_allclose(np.abs(np.diff(angle)), turns, atol=1e-9)


def test_only_the_chosen_nodes_move(tmp_path):
    stress(DEMO, tmp_path / "out.glb", CameraSpec(frames=61), Moves(-1, 3, MotionStats(0.02, 1e-4)))
    times = [i / 60 for i in range(61)]
    before, after = census(load_scene(DEMO), times), census(load_scene(tmp_path / "out.glb"), times)
    assert after["static_point_lights"] == 0
    assert after["dynamic_point_lights"] == before["static_point_lights"] + before["dynamic_point_lights"]
    assert before["dynamic_rigid_objects"] <= after["dynamic_rigid_objects"] <= before["dynamic_rigid_objects"] + 3
    for key in ("armatures", "bones", "morphs", "triangles", "drawn_meshes"):
        assert after[key] == before[key]


def test_unknown_properties_are_kept(tmp_path):
    source = json.loads((_gltf := tmp_path / "in.gltf", stress(DEMO, _gltf, CameraSpec(frames=3)))[0].read_text())
    source["extras"] = {"mine": [1, {"deep": True}]}
    source["nodes"][0]["extensions"] = {"VENDOR_thing": {"x": 1.5}}
    source["extensionsUsed"].append("VENDOR_thing")
    (tmp_path / "in.gltf").write_text(json.dumps(source))
    stress(tmp_path / "in.gltf", tmp_path / "out.gltf", STILL)
    out = json.loads((tmp_path / "out.gltf").read_text())
    assert out["extras"] == source["extras"] and out["nodes"][: len(source["nodes"])] == source["nodes"]
    for key in ("meshes", "materials", "skins", "textures"):
        assert out[key] == source[key]


def test_external_buffers_are_embedded(tmp_path):
    editor = GltfEditor(DEMO)
    (tmp_path / "data.bin").write_bytes(editor._blob)
    editor.root["buffers"] = [{"byteLength": len(editor._blob), "uri": "data.bin"}]
    (tmp_path / "in.gltf").write_text(json.dumps(editor.root))
    (tmp_path / "elsewhere").mkdir()
    stress(tmp_path / "in.gltf", tmp_path / "elsewhere" / "out.glb", STILL)
    theirs, ours = load_scene(DEMO), load_scene(tmp_path / "elsewhere" / "out.glb")
    for a, b in zip(theirs.meshes, ours.meshes, strict=True):
        np.testing.assert_array_equal(a.primitives[0].positions, b.primitives[0].positions)


@pytest.mark.parametrize("moves", [Moves(), Moves(-1, -1)])
def test_khronos_validator(tmp_path, moves):
    stress(DEMO, tmp_path / "out.glb", SPEC, moves)
    assert errors(tmp_path / "out.glb") == []


@pytest.mark.parametrize(
    "file", few(["gltf_transform/BoxMeshopt.glb", "tauray_test/test.glb", "gltf_transform/BoxDraco.gltf"])
)
def test_real_scenes(data, tmp_path, file):
    source = data / file
    if not source.is_file():
        pytest.skip(f"no {file}")
    stress(source, tmp_path / "out.glb", CameraSpec(MotionStats(0.02, 1e-4), MotionStats(2.0), frames=31))
    found, _, _ = walked(tmp_path / "out.glb", frames=31)
    assert found["yaw"]["mean"] == pytest.approx(2.0, rel=1e-3)
    assert found["position"]["mean"] == pytest.approx(0.02, rel=1e-3)


def test_a_step_larger_than_the_scene_is_refused():
    with pytest.raises(SettingsError, match="mean 60"):
        generate(CameraSpec(MotionStats(60.0), frames=30), VoxelSpace(load_scene(DEMO)))


@pytest.mark.usefixtures("plots")
def test_sweep_writes_a_table_and_plots(tmp_path, gpu):
    out = tmp_path / "sweep"
    arguments = [str(DEMO), "--sweep", "yaw=0:9:3", "--size", "32x18", "--columns", "frustum", "--seconds", "0.1"]
    done = CliRunner().invoke(cli, ["stress", *arguments, "--out", str(out)])
    assert done.exit_code == 0, done.output
    with open(out / "sweep.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["requested_yaw_deg"]) for row in rows] == [0.0, 4.5, 9.0]
    np.testing.assert_allclose([float(row["mean_yaw_deg"]) for row in rows], [0, 4.5, 9], atol=1e-9)
    frustum = [float(row["frustum_percent"]) for row in rows]
    assert frustum[0] == 0.0 and np.all(np.diff(frustum) > 0)
    assert rows[0]["color_percent"] == "" and rows[0]["pairs"] == "6" and rows[0]["fps"] == "60.0"
    assert (out / "sweep.png").stat().st_size > 5000 and (out / "sweep.svg").is_file()
    table = (out / "sweep.csv").read_bytes()
    (kept, *others) = sorted((out / "records").iterdir())
    for file in others:
        file.unlink()
    written = kept.stat().st_mtime_ns
    assert CliRunner().invoke(cli, ["stress", *arguments, "--out", str(out)]).exit_code == 0
    assert (out / "sweep.csv").read_bytes() == table and kept.stat().st_mtime_ns == written


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--yaw", "3,-1"], "-1"),
        (["--yaw", "3,1,2"], "max 2"),
        (["--camera", "nope"], "'nope'"),
        (["--camera", "vr", "--seconds", "2"], "120 steps"),
        (["--camera", "missing.csv"], "missing.csv"),
        (["--yaw", "400"], "175"),
        (["--sweep", "spin=0:1:3"], "'spin'"),
        (["--sweep", "yaw=3:1:3"], "3 to 1"),
        (["--fps", "0"], "0 fps"),
        (["--seconds", "1e9"], "1,000,000 frames"),
        (["--size", "480x270"], "--size"),
        (["--columns", "frustum"], "--columns"),
        (["--motion", "0.1,0.01"], "--move-lights"),
        (["--motion", "0.1,0.01", "--sweep", "yaw=0:9:3"], "--motion"),
    ],
)
def test_invalid_options_give_one_line_and_exit_code_2(tmp_path, taubench, options, named):
    code, _, err = taubench("stress", DEMO, *options, "--out", tmp_path / "out.glb")
    assert code == 2 and err.count("\n") == 1 and named in err
    assert not (tmp_path / "out.glb").exists()


@pytest.mark.parametrize(
    ("sweep", "place", "named"),
    [
        ("yaw=0:300:3", "out", "mean 300"),
        ("yaw=0:2:2", "file", "--out"),
    ],
)
def test_impossible_sweep_writes_nothing(tmp_path, taubench, sweep, place, named):
    """The last speed is impossible; nothing is rendered and no partial table is written."""
    (tmp_path / "file").write_text("mine")
    code, _, err = taubench("stress", DEMO, "--sweep", sweep, "--size", "32x18", "--out", tmp_path / place)
    assert code == 2 and err.count("\n") == 1 and named in err
    assert [path.name for path in tmp_path.iterdir()] == ["file"] and (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("out", ["scene.glb", "link.glb"])
def test_the_source_is_not_overwritten(tmp_path, out):
    scene = tmp_path / "scene.glb"
    scene.write_bytes(DEMO.read_bytes())
    (tmp_path / "link.glb").symlink_to(scene)
    with pytest.raises(SettingsError):
        stress(scene, tmp_path / out, CameraSpec(frames=3))
    assert scene.read_bytes() == DEMO.read_bytes()


def test_other_formats_and_unwritable_places_are_refused(tmp_path):
    with pytest.raises(SceneError, match=r"\.abc"):
        stress(Path("scene.abc"), tmp_path / "out.glb", SPEC)
    with pytest.raises(SceneError, match=r"taubench-gl convert scene\.fbx scene\.glb"):
        stress("scene.fbx", tmp_path / "out.glb", SPEC)
    with pytest.raises(SettingsError, match="exr:renders"):
        stress("exr:renders", tmp_path / "out.glb", SPEC)
    with pytest.raises(SettingsError, match=r"\.glb or \.gltf"):
        stress(DEMO, tmp_path / "out.fbx", CameraSpec(frames=3))
    (tmp_path / "file").write_text("")
    with pytest.raises(TaubenchError):
        stress(DEMO, tmp_path / "file" / "out.glb", CameraSpec(frames=3))


def test_the_camera_avoids_moving_objects(tmp_path):
    """A wall sweeps half of a court; only the other half is free at all times."""
    w = Writer("CC0-1.0", "test")
    gray = w.material("gray")
    w.node("floor", mesh=w.mesh("floor", w.primitive(box((-12, -0.2, -6), (12, 0, 6)), gray)))
    w.node("far wall", mesh=w.mesh("far wall", w.primitive(box((-12, 0, -6.2), (12, 4, -6)), gray)))
    wall = w.node("wall", mesh=w.mesh("wall", w.primitive(box((-0.1, 0, -6), (0.1, 4, 6)), gray)),
                  translation=[-11.5, 0, 0])  # fmt: skip
    w.animation("sweep", (wall, "translation", [0.0, 1.0, 2.0], [[-11.5, 0, 0], [0, 0, 0], [-11.5, 0, 0]], "LINEAR"))
    w.save(tmp_path / "court.glb")
    scene = load_scene(tmp_path / "court.glb")
    space = VoxelSpace(scene, voxels=100_000)
    swept = np.stack([np.linspace(-11.0, 0.0, 400), np.full(400, 1.7), np.zeros(400)], axis=1)
    assert np.all(space.clearance(swept) <= 0), "no gaps between the sampled times"
    path = generate(CameraSpec(MotionStats(0.2, 0.01), MotionStats(2.0, 1.0), frames=241), space)
    assert np.all(path.position[:, 0] > 0.1) and np.ptp(path.position[:, 0]) > 3.0
    still = VoxelSpace(dataclasses.replace(scene, channels=()), voxels=100_000)
    assert np.all(still.clearance(swept[50:]) > 0), "free without the motion"


OTHERS = ("obj", "sequence", "aff")


@pytest.fixture(params=OTHERS)
def other(request, tmp_path):
    """A scene of another format, as argument of ``load_scene``."""
    if request.param == "aff":
        with zipfile.ZipFile(row_file(Entry(title="x", format="aff", scene="x.aff"), tmp_path)) as archive:
            archive.extractall(tmp_path)
        return str(tmp_path / "bart" / "x.aff")
    with zipfile.ZipFile(row_file(Entry(title="x", format="obj sequence"), tmp_path)) as archive:
        archive.extractall(tmp_path)
    folder = tmp_path / "toasters"
    return str(folder) if request.param == "sequence" else str(folder / "toasters000.obj")


def test_other_formats_are_written_as_gltf(other, tmp_path):
    """World-space vertices equal those of the source at and between frames; the camera is new."""
    done = stress(other, tmp_path / "out.glb", CameraSpec(MotionStats(0.01, 1e-5), MotionStats(2.0), frames=31), seed=1)
    theirs, ours = load_scene(other), load_scene(tmp_path / "out.glb")
    assert done.path is not None and choose_camera(ours).node_name == CAMERA_NAME
    for t in np.linspace(0.0, theirs.duration, 9):
        a, b = (world_triangles(s, Poser(s).sample(float(t))) for s in (theirs, ours))
        assert a.shape == b.shape
        np.testing.assert_allclose(b, a, atol=2e-6)
    assert [m.base_color for m in ours.materials] == [pytest.approx(m.base_color) for m in theirs.materials]
    theirs_lit, ours_lit = ([s.lights[i] for i in s.nodes.light[s.light_nodes]] for s in (theirs, ours))
    assert [(x.kind, x.constant, x.intensity) for x in ours_lit] == [
        (x.kind, x.constant, pytest.approx(x.intensity)) for x in theirs_lit
    ]
    assert errors_or_none(tmp_path / "out.glb") == []


def test_visibility_and_textures_are_kept(tmp_path):
    """Objects appear and disappear at the same frames; textures are equal; lost cuts are noted."""
    PillowImage.new("RGB", (4, 2), (200, 30, 10)).save(tmp_path / "red.png")
    (tmp_path / "m.mtl").write_text("newmtl red\nmap_Kd red.png\nKe 3 0 0\n")
    quad = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl red\n"
    for i, faces in enumerate(("1/1 2/2 3/3 4/4", "1/1 2/2 3/3 4/4", "1/1 2/2 3/3", "1/1 2/2 3/3")):
        (tmp_path / f"s{i}.obj").write_text(f"{quad}o one\nf {faces}\n")
    stress(str(tmp_path), tmp_path / "out.glb", CameraSpec(frames=5, fps=24.0))
    theirs, ours = load_scene(tmp_path), load_scene(tmp_path / "out.glb")
    assert len(theirs.replacements) == 1 and any("1 cuts" in str(n) for n in ours.notes)
    for frame in range(4):
        a, b = (world_triangles(s, Poser(s).sample(frame / 24)) for s in (theirs, ours))
        b = b[np.ptp(b, axis=1).max(axis=-1) > 0]  # invisible objects have scale 0
        np.testing.assert_allclose(b, a, atol=1e-7)
    (material,) = ours.materials
    assert material.emissive == pytest.approx((3, 0, 0))
    pixels = ours.images[material.base_color_texture.image].decode()
    np.testing.assert_array_equal(pixels, theirs.images[theirs.materials[0].base_color_texture.image].decode())
    assert errors_or_none(tmp_path / "out.glb") == []


def errors_or_none(path):
    """Errors of the Khronos validator; none if it is not installed."""
    try:
        return errors(path)
    except pytest.skip.Exception:
        return []
