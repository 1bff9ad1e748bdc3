"""Methods that compute their direct light themselves: each function of the contract against float64."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner
from references import own_light
from references.stochastic import random4
from reuse_scenes import glowing
from reuse_tools import PLAIN_TOML, write_method
from sample_tools import SIZE, lamps, opened, run_seeds, t_values, triangles_of

from taubench_gl.apps.cli import cli
from taubench_gl.errors import MethodError
from taubench_gl.metrics.environment import directions, lookup, solid_angles
from taubench_gl.metrics.stochastic import light_choice
from taubench_gl.reuse.check import check_method, write_example
from taubench_gl.reuse.frame import read_result
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.scene.builder import SceneBuilder, quad, turn_x
from taubench_gl.selftest.scenes import sky_file

TOML = """light = "own"
[structs.Probe]
numbers = "vec4"
drawn = "vec4"
now = "vec4"
before = "vec4"
arrives = "vec4"
light = "vec4"
sight = "vec4"
[history]
probe = "Probe"
[[pass]]
shader = "a.glsl"
writes = ["probe", "result"]
"""
GLSL = """
void reuse(ivec2 p) {
    SurfacePoint x = surface_at(p), past = prev_surface_at(p);
    Probe r;
    r.numbers = random(p, 3);
    LightSample s = sample_light(r.numbers);
    r.drawn = vec4(float(s.light), s.uv, s.density);
    int light = p.x % 12;
    LightPoint at = light_at(light, vec2(0.5)), was = prev_light_at(light, vec2(0.5));
    r.now = vec4(at.record.position.xyz, at.record.color.r);
    r.before = vec4(was.record.position.xyz, was.record.color.r);
    Incident arriving = incident(at, x.p);
    r.arrives = vec4(arriving.l, arriving.radiance.r);
    r.light = vec4(reflected(x, at), brdf(x, arriving.l).g);
    r.sight = vec4(x.lit && visible(x, at), past.lit && prev_visible(past, was), past.p.x, past.g.y);
    write_probe(p, r);
    write_result(p, vec3(0.25, 0.5, 1.0));
}
"""


@pytest.fixture
def probe(tmp_path):
    return load_method(write_method(tmp_path / "probe", TOML, a=GLSL))


def test_functions_equal_their_references(gpu, probe):
    """Over a moving camera, a moving lamp and one that is switched off in the third frame; an occluder between."""
    scene = lamps(moving=(20.0, 0.0, 0.0), switched=((1, (0, 1)),), camera_speed=6.0, occluder=True, glossy=True)
    before = None
    with opened(gpu, scene, probe.reads) as inputs, MethodRunner(gpu, probe, inputs.size, count=True) as runner:
        for number in range(3):
            frame = inputs.advance(number)
            result = read_result(runner.step(frame))
            got, rows = runner._backend.records("probe"), frame.light.lights.copy()
            surfaces, triangles = frame.light.surfaces().copy(), triangles_of(scene, frame.view)
            before, last = (surfaces, rows, triangles), before
        counts = runner.light_counts()
    np.testing.assert_array_equal(result[..., :3], np.broadcast_to(np.float32([0.25, 0.5, 1.0]), result[..., :3].shape))
    np.testing.assert_array_equal(result[..., 3], -1.0)
    numbers = random4(SIZE, 2, 0, 3)
    np.testing.assert_array_equal(got["numbers"], numbers.astype(np.float32))
    choice = light_choice(rows["color"][:, :3].max(axis=-1))
    light, density = own_light.sample_light(numbers, choice)
    np.testing.assert_array_equal(got["drawn"][..., 0], light)
    np.testing.assert_allclose(got["drawn"][..., 3], density, rtol=1e-6)
    np.testing.assert_array_equal(got["drawn"][..., 1:3], numbers[..., 1:3].astype(np.float32))
    assert not np.any(light == 1), "a lamp that is off is never drawn"
    column = np.broadcast_to(np.arange(SIZE[0]) % 12, SIZE[::-1])
    for name, table in (("now", rows), ("before", last[1])):
        np.testing.assert_array_equal(got[name][..., :3], table["position"][column][..., :3])
        np.testing.assert_array_equal(got[name][..., 3], table["color"][column][..., 0])
    assert (got["now"] != got["before"])[column == 0].any() and (got["before"][column == 1, 3] > 0).all()
    lit = surfaces["position"][..., 3] > 0
    assert lit.mean() > 0.5 and np.all(counts[..., 1] == 1) and np.all(counts[..., 2] == 1)
    np.testing.assert_array_equal(counts[..., 0], lit.astype(int) + (last[0]["position"][..., 3] > 0))
    for k in range(12):
        here = lit & (column == k)
        to_light, radiance = own_light.incident(rows[k], surfaces["position"][..., :3].astype(np.float64))
        np.testing.assert_allclose(got["arrives"][here, :3], to_light[here], atol=2e-6)
        np.testing.assert_allclose(got["arrives"][here, 3], radiance[here, 0], rtol=2e-5)
        np.testing.assert_allclose(
            got["light"][here, :3], own_light.reflected(surfaces, rows[k])[here], rtol=2e-4, atol=1e-7
        )
        np.testing.assert_allclose(
            got["light"][here, 3], own_light.brdf(surfaces, to_light)[here, 1], rtol=2e-4, atol=1e-7
        )
        sees = ~own_light.shadowed(surfaces, rows[k], triangles)
        np.testing.assert_array_equal(got["sight"][here, 0], sees[here])
        then = (last[0]["position"][..., 3] > 0) & (column == k)
        saw = ~own_light.shadowed(last[0], last[1][k], last[2])
        np.testing.assert_array_equal(got["sight"][then, 1], saw[then])
    assert 0.05 < got["sight"][lit, 0].mean() < 0.95
    np.testing.assert_array_equal(got["sight"][..., 2], last[0]["position"][..., 0])
    np.testing.assert_array_equal(got["sight"][..., 3], last[0]["geometric_normal"][..., 1])


def panel(speed: float) -> tuple:
    """A floor below an emissive panel that moves along x, and one lamp."""
    b = SceneBuilder()
    gray = b.material(base_color=(0.7, 0.6, 0.5, 1.0), metallic=0.0, roughness=1.0, specular=0.0)
    b.node(mesh=b.mesh(quad(4.0, 4.0, material=gray)), rotation=turn_x(-90.0))
    panel = b.node(mesh=b.mesh(quad(0.4, 0.3, material=glowing(b, (3.0, 2.0, 1.0)))), rotation=turn_x(90.0))
    b.animate(panel, "translation", [0.0, 1.0], [(0.0, 1.5, -1.0), (speed, 1.5, -1.0)])
    b.light(translation=(1.0, 1.0, -0.5), intensity=0.5)
    b.camera(translation=(0.0, 1.2, 2.0), rotation=turn_x(-35.0), yfov=np.radians(50.0), znear=0.1)
    return b.build()


def test_points_of_a_moving_panel(gpu, tmp_path):
    """In this frame and in the previous one; what arrives from them; a tenth of the samples of each kind at least."""
    text = GLSL.replace("int light = p.x % 12;", "int light = 1 + p.x % 2; r.numbers = random(p, 3);")
    text = text.replace("vec2(0.5)", "r.numbers.yz")
    method, scene = load_method(write_method(tmp_path / "probe", TOML, a=text)), panel(6.0)
    with opened(gpu, scene, method.reads) as inputs, MethodRunner(gpu, method, inputs.size) as runner:
        for number in range(2):
            frame = inputs.advance(number)
            runner.step(frame)
        got, surfaces = runner._backend.records("probe"), frame.light.surfaces()
    corners = np.array([[-0.4, 0.3, 0.0], [0.4, 0.3, 0.0], [0.4, -0.3, 0.0], [-0.4, -0.3, 0.0]])
    turned = np.stack([corners[:, 0], np.full(4, 1.5), -1.0 + corners[:, 1]], axis=-1)
    triangles = [turned[[3, 2, 1]], turned[[3, 1, 0]]]
    uv, column = random4(SIZE, 1, 0, 3)[..., 1:3], np.arange(SIZE[0]) % 2
    points = surfaces["position"][..., :3].astype(np.float64)
    for k, triangle in enumerate(triangles):
        here = np.broadcast_to(column == k, SIZE[::-1]) & (surfaces["position"][..., 3] > 0)
        for name, shift in (("now", 0.25), ("before", 0.0)):
            at = triangle + np.array([shift, 0.0, 0.0]) - frame.view.position
            np.testing.assert_allclose(got[name][here, :3], own_light.emitter_point(at, uv)[here], atol=2e-6)
            if name == "now":
                to_light, radiance = own_light.area_incident(at, np.array([3.0, 2.0, 1.0]), uv, points)
                np.testing.assert_allclose(got["arrives"][here, :3], to_light[here], atol=3e-6)
                np.testing.assert_allclose(got["arrives"][here, 3], radiance[here, 0], rtol=1e-4)
        assert (got["sight"][here, 0] == 1).all(), "the panel does not hide itself"
    drawn = got["drawn"][..., 0]
    assert all((drawn == k).mean() > 0.1 for k in (0, 1, 2))
    np.testing.assert_allclose(got["drawn"][drawn == 0, 3], 0.5)
    np.testing.assert_allclose(got["drawn"][drawn > 0, 3], 0.25, rtol=1e-6)


def test_the_result_is_completed_by_the_rest_of_the_light(gpu, probe):
    """Exposure for the method's light; indirect light and emission of the input, which are radiance - direct."""
    with opened(gpu, lamps(), (*probe.reads, "direct"), bounces=3, indirect="auto", exposure=2.0) as inputs:
        frame = inputs.advance(0)
        with MethodRunner(gpu, probe, inputs.size) as runner:
            result = read_result(runner.step(frame))[..., :3]
        radiance, direct = (read_result(frame.textures[n])[..., :3] for n in ("radiance", "direct"))
    rest = radiance - direct
    assert rest.mean() > 1e-3
    np.testing.assert_allclose(result, rest + 2.0 * np.array([0.25, 0.5, 1.0]), rtol=1e-4, atol=1e-5)


def floor(lamp: bool):
    """A white Lambert floor, perhaps below a lamp."""
    b = SceneBuilder()
    white = b.material(base_color=(0.8, 0.8, 0.8, 1.0), metallic=0.0, roughness=1.0, specular=0.0)
    b.node(mesh=b.mesh(quad(40.0, 40.0, material=white)), rotation=turn_x(-90.0))
    if lamp:
        b.light(translation=(0.0, 1.0, -1.0), intensity=1.0)
    b.camera(translation=(0.0, 1.2, 2.0), rotation=turn_x(-60.0), yfov=np.radians(50.0), znear=0.1)
    return b.build()


@pytest.mark.parametrize("lamp", [False, True])
def test_a_uniform_sky_is_sampled_without_bias(gpu, lamp):
    """A Lambert floor reflects albedo x radiance of the sky; with a lamp, its light besides."""
    sky = {"environment": "0.5,0.2,0.1"}
    results, surfaces, rows, _ = run_seeds(gpu, floor(lamp), load_method("ris"), 1, range(64), {"candidates": 4}, **sky)
    exact = 0.8 * np.broadcast_to([0.5, 0.2, 0.1], (*surfaces.shape, 3))
    exact = exact + (own_light.reflected(surfaces, rows[0]) if lamp else 0.0)
    assert np.abs(t_values(results, exact)).max() < 4.9


def test_an_environment_image_is_sampled_without_bias(gpu):
    """A gradient of the sky over a floor that sees half of it: against quadrature over its texels."""
    height, width = 16, 32
    rows = np.linspace(2.0, 0.0, height)[:, None, None] * np.array([1.0, 0.5, 0.25]) * np.ones((1, width, 1))
    rows[2:4, 5:8] = 20.0
    with sky_file(rows) as path:
        results, surfaces, *_ = run_seeds(gpu, floor(False), load_method("ris"), 1, range(64), {"candidates": 4},
                                          environment=path)  # fmt: skip
    d, each = directions(512), solid_angles(512)[:, None, None]
    irradiance = np.sum(lookup(rows, d) * np.maximum(d[..., 1:2], 0.0) * each, axis=(0, 1))
    exact = np.broadcast_to(0.8 / np.pi * irradiance, (*surfaces.shape, 3))
    assert np.abs(t_values(results, exact)).max() < 4.9


def test_frames_without_lights_are_refused(gpu, probe):
    with (
        opened(gpu, lamps(), probe.reads, kind="full") as inputs,
        MethodRunner(gpu, probe, inputs.size) as runner,
        pytest.raises(MethodError, match="path-traced@N") as caught,
    ):
        runner.step(inputs.advance(0))
    assert "lights" in str(caught.value) and "\n" not in str(caught.value)


def test_a_struct_needs_no_lights(tmp_path):
    """A method of shaded frames can have records, too; their bytes count."""
    toml = PLAIN_TOML.replace(
        "[[pass]]", '[structs]\nPair = { a = "vec2", b = "float" }\n[history]\nx = "Pair"\n[[pass]]'
    )
    toml = toml.replace('["result"]', '["result", "x"]')
    glsl = "void reuse(ivec2 p) { Pair x = fetch_prev_x(p); x.b += 1.0; write_x(p, x); write_result(p, vec3(x.b)); }"
    method = load_method(write_method(tmp_path / "m", toml, a=glsl))
    assert method.bytes((10, 10)) == 100 * (16 + 2 * 16) and not method.own_light


def test_new_with_samples_and_check(gpu, tmp_path, monkeypatch):
    """The example runs, reuses more than half, and has less error than one sample of one frame."""
    monkeypatch.chdir(tmp_path)
    made = CliRunner().invoke(cli, ["reuse", "new", "mine", "--samples"], catch_exceptions=False)
    assert made.exit_code == 0
    lines = sum(len(path.read_text().splitlines()) for path in (tmp_path / "mine").iterdir())
    assert lines <= 41
    report, plain = check_method(gpu, "mine"), check_method(gpu, "ris", {"candidates": 1})
    assert report.error < 0.8 * plain.error and report.reused > 0.5 and report.error_without_reuse is None
    refused = CliRunner().invoke(cli, ["reuse", "new", "other", "--samples", "--python"])
    assert refused.exit_code != 0 and not (tmp_path / "other.py").exists()
    assert [path.name for path in write_example(tmp_path / "third", samples=True)] == ["method.toml", "reuse.glsl"]


def test_more_textures_than_the_device_has_are_refused(gpu, tmp_path, monkeypatch):
    """One line with the numbers, before anything is compiled."""
    monkeypatch.setitem(gpu.ctx.info, "GL_MAX_COMPUTE_TEXTURE_IMAGE_UNITS", 3)
    toml = TOML.replace('light = "own"', 'light = "own"\nreads = ["motion", "mask", "radiance"]', 1)
    method = load_method(write_method(tmp_path / "probe", toml, a=GLSL))
    with (
        opened(gpu, lamps(), method.reads) as inputs,
        MethodRunner(gpu, method, inputs.size) as runner,
        pytest.raises(MethodError, match=r"needs \d+ textures.* has 3") as caught,
    ):
        runner.step(inputs.advance(0))
    assert "\n" not in str(caught.value)
