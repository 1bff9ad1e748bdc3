"""Rejection tests as reuse methods: folders that the methods' contract accepts, compile, and run."""

from __future__ import annotations

import json
import struct

import pytest
from click.testing import CliRunner

from taubench_gl.apps.cli import cli
from taubench_gl.errors import OutputError
from taubench_gl.gpu.shader import resolve
from taubench_gl.paths import ASSETS
from taubench_gl.reject.as_method import difference as method_difference
from taubench_gl.reject.as_method import write_methods
from taubench_gl.reject.contract import builtin_tests, load_tests
from taubench_gl.reuse.glsl_method import GlslPasses
from taubench_gl.reuse.loading import load_method

pytestmark = pytest.mark.usefixtures("fixed_light")

COMBINED = ("svgf+color_clamp", "footprint_depth+footprint_position+object_id")


def test_every_test_compiles_as_a_method(gpu, tmp_path):
    tests = load_tests([*builtin_tests(), *COMBINED])
    for folder, test in zip(write_methods(tests, tmp_path), tests, strict=True):
        method = load_method(folder)
        assert method.settings["threshold"].default == test.threshold
        GlslPasses(gpu, method, (16, 9), (16, 9)).release()


OWN = """\
title = "own"
kind = "geometry"
unit = "m"
threshold = {threshold}

[settings.depth]
default = {depth}
doc = "a name of a member"

[settings.threshold]
default = 2.0
doc = "a name of the method"
"""

SHADER = """\
struct Mine { float depth; vec3 normal; }; // depth: a member
const float cap = 3.0, mean[2] = float[2](1.0, 2.0);
float slope(Point p, float x);
float slope(Point p, float x) { return abs(p . depth - x); }
float difference(Point now, Point history, Pixel pixel) {
    Mine mine;
    mine.depth = depth * now.depth;
    return slope(now, mine.depth) / threshold + 0.0 * (cap + mean[1]);
}
"""


def test_names_of_parts_are_their_own(gpu, tmp_path):
    """Names of settings, helpers, structs and constants may be those of members, of other parts and of the method."""
    for name, depth, threshold in (("a", 0.5, 0.25), ("b", 1.0, 0.5)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "test.toml").write_text(OWN.format(depth=depth, threshold=threshold))
        (tmp_path / name / "test.glsl").write_text(SHADER)
    tests = load_tests([str(tmp_path / "a"), f"{tmp_path / 'a'}+{tmp_path / 'b'}"])
    for folder in write_methods(tests, tmp_path / "methods"):
        GlslPasses(gpu, load_method(folder), (16, 9), (16, 9)).release()
    # The value of the combination, as the method's shader computes it: max(|d - d / 2| / 2 / 0.25, |d - d| / 2 / 0.5).
    contract = resolve("reject/contract.glsl").text.partition("\n")[2]
    body = f"""#version 450
layout(local_size_x = 1) in;
layout(std430, binding = 0) buffer Result {{ float result; }};
{contract}
{method_difference(tests[1])}
void main() {{ Point now, history; Pixel pixel; now.depth = 6.0; result = difference(now, history, pixel); }}"""
    buffer, program = gpu.ctx.buffer(reserve=4), gpu.ctx.compute_shader(body)
    buffer.bind_to_storage_buffer(0)
    program.run(1)
    assert struct.unpack("f", buffer.read())[0] == 6.0
    buffer.release(), program.release()


def test_an_existing_folder_is_kept(tmp_path):
    tests = load_tests(["position"])
    write_methods(tests, tmp_path)
    with pytest.raises(OutputError):
        write_methods(tests, tmp_path)


@pytest.mark.long
def test_a_test_that_rejects_everything_reuses_nothing(tmp_path):
    """A running mean without any history has another error than one whose test of 10^6 m lets all history pass."""
    run = CliRunner()
    out = tmp_path / "methods"
    for name, threshold in (("all", "0"), ("none", "1000000")):
        done = run.invoke(cli, ["reject", "method", "--tests", f"position={threshold}", "--out", str(out / name)])
        assert done.exit_code == 0, done.output
    # Two names are two settings: methods of the same name are refused.
    methods = ",".join(f"{out / name / 'reject_position'}@cap={cap}" for name, cap in (("all", 4), ("none", 5)))
    done = run.invoke(cli, [
        "reuse", "evaluate", str(ASSETS / "demo.glb"), "--size", "32x18", "--frames", "20:23", "--methods", methods,
        "--video", "none", "--reference-samples", "1", "--light", "raster", "--input", "full", "--shadow-size", "64",
        "--vpls", "256", "--out", str(tmp_path / "reuse"),
    ])  # fmt: skip
    assert done.exit_code == 0, done.output
    summary = json.loads((tmp_path / "reuse" / "reuse.json").read_text())
    everything, nothing = (m["reuse"]["mean_weight"] for m in summary["methods"].values())
    # Sky has no position to reject; of the surfaces a moving camera changes the position of every one.
    assert everything < 0.35 * nothing and nothing > 0.3
