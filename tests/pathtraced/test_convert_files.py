"""Files that conversions once got wrong, at their right values: FBX, USD, Collada, PLY (``reports4``)."""

from __future__ import annotations

import math
import subprocess

import numpy as np
import pytest

from taubench_gl.animation import choose_camera, pose_vertices, sample
from taubench_gl.effects.lighting import environment_for
from taubench_gl.errors import SceneError
from taubench_gl.pathtraced.blender.cache import converted
from taubench_gl.pathtraced.blender.convert import convert
from taubench_gl.scene import load_scene

pytestmark = pytest.mark.long

LUMENS = 683.0


@pytest.fixture
def made(data, tmp_path, blender):
    """Converts a file of ``reports4``: -> (what was read and lost, the scene)."""

    def make(name: str, **options):
        target = tmp_path / "out.glb"
        result = convert(data / "reports4" / name, target, python=blender, **options)
        return result, load_scene(target)

    return make


def eye(scene, seconds: float) -> np.ndarray:
    return choose_camera(scene).view_at(sample(scene, seconds)).position


def names_of(scene, lights: bool = False) -> dict[str, int]:
    kind = scene.nodes.light if lights else scene.nodes.mesh
    return {scene.nodes.names[n]: n for n in np.flatnonzero(kind >= 0).tolist()}


def opacities(scene) -> list[float]:
    return [float(material.base_color[3]) for material in scene.materials]


def triangles(scene) -> int:
    return sum(len(p.triangles) for mesh in scene.meshes for p in mesh.primitives)


def test_camera_whose_object_and_data_share_a_name(made):
    _, scene = made("keys/camera-same-name.fbx")
    assert scene.duration == pytest.approx(1.0)
    moved = eye(scene, 1.0) - eye(scene, 0.0)
    assert np.abs(moved).max() > 0.5, "the camera moves"


def test_rate_of_a_usd_file_and_its_samples(made):
    result, scene = made("keys/timecodes48.usda")
    assert result.fps == 48.0 and scene.duration == pytest.approx(2.0)
    for second in (0.5, 1.0, 1.5):  # 0.8 m in 2 s
        np.testing.assert_allclose(eye(scene, second) - eye(scene, 0.0), (0.4 * second, 0.0, 0.0), atol=1e-5)
    meshes, lights = names_of(scene), names_of(scene, lights=True)
    for frame in (0, 23, 24, 43, 44, 96):
        visible = sample(scene, frame / 48).visible
        assert visible[meshes["visbox"]] == (frame >= 24), frame
    by_name = {scene.nodes.names[n]: scene.nodes.light[n] for n in lights.values()}
    assert not any("isib" in line or "intensity" in line for line in result.lost)
    area = 4 * math.pi * 0.05**2
    for frame in (0, 48, 96):  # radiance 1000 to 3000 of a sphere of radius 0.05: pi L area watts, over 4 pi
        expected = (1000 + 2000 * frame / 96) * area / 4 * LUMENS
        found = sample(scene, frame / 48).lights[by_name["lampA"]].intensity
        assert found == pytest.approx(expected, rel=1e-4), frame
    # A sun that is not normalized has the radiance 2 over 0.53 degrees.
    irradiance = 2.0 * math.pi * math.sin(math.radians(0.265)) ** 2
    sun = sample(scene, 0.0).lights[by_name["sun"]].intensity
    assert sun == pytest.approx(irradiance * LUMENS, rel=1e-4)


SUNS = """#usda 1.0
(
    timeCodesPerSecond = 29.97
    startTimeCode = 0
    endTimeCode = 10
)
def Xform "group"
{
    token visibility.timeSamples = { 0: "inherited", 5: "invisible" }
    def Mesh "triangle"
    {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    }
}
def DistantLight "normalized"
{
    float inputs:intensity = 2
    bool inputs:normalize = 1
    float inputs:exposure = 1
}
def DistantLight "point"
{
    float inputs:intensity = 3
    float inputs:angle = 0
}
def SphereLight "late"
{
    float inputs:intensity.timeSamples = { 0: 0, 10: 8 }
    color3f inputs:color.timeSamples = { 0: (1, 0, 0), 10: (0, 1, 0) }
    bool inputs:normalize = 1
    float inputs:radius = 0.5
    float inputs:radius.timeSamples = { 0: 0.5, 10: 1 }
}
"""


def test_suns_and_samples_of_light_and_groups(tmp_path, blender):
    (tmp_path / "suns.usda").write_text(SUNS)
    result = convert(tmp_path / "suns.usda", tmp_path / "suns.glb", python=blender)
    scene = load_scene(tmp_path / "suns.glb")
    assert result.fps == pytest.approx(29.97) and scene.duration == pytest.approx(10 / 29.97)
    lights = names_of(scene, lights=True)
    of = {name: scene.nodes.light[node] for name, node in lights.items()}
    first, last = sample(scene, 0.0).lights, sample(scene, 10 / 29.97).lights
    assert first[of["normalized"]].intensity == pytest.approx(4.0 * LUMENS, rel=1e-5)
    assert first[of["point"]].intensity == pytest.approx(3.0 * LUMENS, rel=1e-5)
    assert first[of["late"]].intensity == 0.0
    assert last[of["late"]].intensity == pytest.approx(8 * math.pi / (4 * math.pi) * LUMENS, rel=1e-4)
    np.testing.assert_allclose(last[of["late"]].color, (0, 1, 0), atol=1e-6)
    (triangle,) = names_of(scene).values()
    assert [bool(sample(scene, f / 29.97).visible[triangle]) for f in (0, 4, 5, 9)] == [True, True, False, False]
    assert any("late" in line for line in result.lost if "size" in line and "animated" in line)


def test_opacity_of_old_fbx_and_of_collada(made):
    assert opacities(made("sweep/white_transparent_color.fbx")[1]) == [1.0]
    assert opacities(made("sweep/rgb_zero.dae")[1]) == [1.0]


@pytest.mark.parametrize(
    ("mode", "color", "transparency", "opacity"),
    [
        ("A_ONE", "1 1 1 0.75", 1.0, 0.75),
        ("A_ONE", "1 1 1 1", 0.25, 0.25),
        ("RGB_ZERO", "0.5 0.5 0.5 1", 0.5, 0.75),
        ("RGB_ZERO", "0 1 0 1", 1.0, 1 - 0.715160),
        ("A_ZERO", "1 1 1 0.25", 1.0, 0.75),
        ("RGB_ONE", "0.5 0.5 0.5 1", 1.0, 0.5),
    ],
)
def test_opacity_by_the_modes_of_collada(data, tmp_path, blender, mode, color, transparency, opacity):
    text = (data / "reports4" / "sweep" / "rgb_zero.dae").read_text()
    text = text.replace("RGB_ZERO", mode).replace("<color>0 0 0 1<", f"<color>{color}<")
    text = text.replace("<transparency><float>1<", f"<transparency><float>{transparency}<")
    (tmp_path / "a.dae").write_text(text)
    convert(tmp_path / "a.dae", tmp_path / "a.glb", python=blender)
    assert opacities(load_scene(tmp_path / "a.glb")) == [pytest.approx(opacity, abs=1e-6)]


def test_ascii_fbx(made):
    assert triangles(made("sweep/ascii.fbx")[1]) == 1


@pytest.mark.parametrize("name", ["ambient_light.dae", "hemi_light.dae"])
def test_ambient_lights_light_nothing(made, name):
    result, scene = made(f"sweep/{name}")
    assert not scene.lights and any("mbient" in line for line in result.lost)
    assert environment_for(scene).value is not None, "the default environment"


@pytest.mark.parametrize(("name", "lost"), [("missing_image.dae", "lost.png"), ("texture_file.ply", "colors.png")])
def test_images_that_are_not_read(made, name, lost):
    result, scene = made(f"sweep/{name}")
    assert [line for line in result.lost if f"(1: {lost})" in line]
    assert sum("lost in the conversion" in note.message for note in scene.notes) == 1


@pytest.mark.parametrize(("name", "what"), [("armature_only.fbx", "an armature"), ("points.ply", "points")])
def test_files_with_nothing_to_draw_are_named(data, blender, monkeypatch, tmp_path, name, what):
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path))
    source = data / "reports4" / "sweep" / name
    with pytest.raises(SceneError) as caught:
        converted(source)
    assert caught.value.where == str(source) and what in caught.value.what


def test_takes_by_the_option_of_animations(data, blender, monkeypatch, tmp_path):
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path))
    source = data / "reports4" / "sweep" / "takes.fbx"
    ends = {}
    for names in (None, ("Run",)):
        scene = load_scene(converted(source, names), animation=names)
        (cube,) = scene.mesh_nodes.tolist()
        ends[names] = sample(scene, 1.0).world[cube, :3, 3] - sample(scene, 0.0).world[cube, :3, 3]
    assert np.abs(ends[("Run",)]).max() == pytest.approx(5.0, abs=1e-4) and np.abs(ends[None]).max() < 1.0
    with pytest.raises(SceneError) as caught:
        converted(source, ("Jump",))
    assert "'Idle', 'Run'" in caught.value.what


def test_up_axis_of_files_that_name_none(data, tmp_path, blender):
    source = data / "reports4" / "sweep" / "texture_file.ply"
    points = {}
    for axis in (None, "Y"):
        convert(source, tmp_path / "a.glb", up_axis=axis, python=blender)
        scene = load_scene(tmp_path / "a.glb")
        (node,) = scene.mesh_nodes.tolist()
        points[axis] = pose_vertices(scene, sample(scene, 0.0), node, scene.meshes[0].primitives[0]).round(6)
    np.testing.assert_allclose(sorted(points["Y"].tolist()), [[0, 0, 0], [0, 1, 0], [1, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(sorted(points[None].tolist()), [[0, 0, -1], [0, 0, 0], [1, 0, 0]], atol=1e-6)
    with pytest.raises(SceneError):
        convert(data / "reports4" / "sweep" / "takes.fbx", tmp_path / "b.glb", up_axis="Y", python=blender)


BOUND = """
import os, sys
sys.path.insert(0, sys.argv[1])
import bpy, convert_motion
from convert_losses import Losses
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.frame_start, scene.frame_end = 0, 9
for name, divisions in (("small", 2), ("large", 20)):
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=divisions, y_subdivisions=divisions)
    bpy.context.object.name = name
    bpy.context.object.modifiers.new("wave", "WAVE")
convert_motion.MAX_BYTES = 3 * 21 * 21 * 12
losses = Losses()
convert_motion.bake_motion(scene, losses)
keys = {o.name: len(o.data.shape_keys.key_blocks) if o.data.shape_keys else 0 for o in scene.objects}
print("@", keys["small"], keys["large"], len(losses.lines()), "large" in losses.lines()[0])
sys.stdout.flush()
os._exit(0)
"""


def test_the_largest_deforming_mesh_gives_way_at_the_bound(blender):
    """The other keeps every shape: it is far below the bound."""
    from taubench_gl.pathtraced.blender import convert as module

    folder = module.__file__.rpartition("/")[0]
    out = subprocess.run([blender, "-c", BOUND, folder], check=True, capture_output=True, text=True).stdout
    small, large, lines, named = next(line for line in out.splitlines() if line.startswith("@")).split()[1:]
    assert int(small) == 10 and int(large) == 0 and (lines, named) == ("1", "True")
