"""The contract of methods: valid folders and classes, and one line with the key or place of every error."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
from reuse_tools import PLAIN_GLSL, PLAIN_TOML, write_method

from taubench_gl.errors import MethodError
from taubench_gl.reuse.contract import FORMATS
from taubench_gl.reuse.frame import INPUTS
from taubench_gl.reuse.loading import builtin_methods, load_method

PASS = '[[pass]]\nshader = "a.glsl"\nwrites = ["result"]\n'
READS = 'reads = ["radiance", "motion"]\n'
UPSCALES = "upscales = true\n" + READS + PASS
RECORDS = 'light = "own"\n' + PASS + '[structs]\nR = { a = "vec4" }\n[history]\nh = "R"\n'
STAGE = '[stages.mean]\ndoc = "mean"\npaper = "Eq. (1)"\nshader = "a.glsl"\n'


def error_of(tmp_path, toml: str, glsl: str = PLAIN_GLSL) -> str:
    with pytest.raises(MethodError) as caught:
        load_method(write_method(tmp_path / "m", toml, a=glsl))
    text = str(caught.value)
    assert "\n" not in text and caught.value.where == str(tmp_path / "m" / "method.toml")
    return caught.value.what


@pytest.mark.parametrize(
    ("toml", "parts"),
    [
        ("", ["reads: ", "pass: "]),
        ('reads = ["radience"]\n' + PASS, ["reads: ", "'radience'", "'radiance'"]),
        ('reads = ["radiance", "reference"]\ngenerates = "interpolate"\n' + PASS, ["reads: ", "'reference'"]),
        ("reads = 3\n" + PASS, ["reads "]),
        ('base = "svfg"\n' + READS + PASS, ["base: ", "'svfg'", "'svgf'"]),
        ('title = " "\n' + READS + PASS, ["title: "]),
        ("histori = 1\n" + READS + PASS, ["histori "]),
        (READS + PASS + '[history]\na = "rgb32f"\n', ["history.a: 'rgb32f'", "rgba32f"]),
        (READS + PASS + '[history]\nposition = "r32f"\n', ["history: 'position'"]),
        (READS + PASS + '[history]\nprev_x = "r32f"\n', ["history: 'prev_x'"]),
        (READS + PASS + '[buffers]\nresult = "r32f"\n', ["buffers: 'result'"]),
        (READS + PASS + '[buffers]\nBig = "r32f"\n', ["buffers: 'Big'"]),
        (READS + PASS + '[history]\na = "r32f"\n[buffers]\na = "r32f"\n', ["buffers: 'a'"]),
        (READS + PASS + '[history]\na = "r32f"\n', ["pass: ", "'a' (history)"]),
        (READS + '[[pass]]\nshader = "a.glsl"\nwrites = []\n', ["pass: ", "'result'"]),
        (READS + '[[pass]]\nshader = "a.glsl"\nwrites = ["resulted"]\n', ["pass[0].writes: ", "'resulted'"]),
        (READS + '[[pass]]\nwrites = ["result"]\n', ["pass[0].shader "]),
        (READS + '[[pass]]\nshader = "b.glsl"\nwrites = ["result"]\n', ["pass[0].shader: b.glsl: "]),
        (READS + '[[pass]]\nshader = "a.glsl"\nwrites = ["result"]\nreads = ["normal"]\n',
         ["pass[0].reads: ", "'normal'"]),
        (READS + '[buffers]\nb = "r32f"\n[[pass]]\nshader = "a.glsl"\nwrites = ["result"]\nreads = ["b", "radiance"]\n',
         ["pass[0].reads: 'b'", "'b' (buffer)"]),
        (READS + PASS + "repeat = 0\n", ["pass[0].repeat: 0 ", "64"]),
        (READS + PASS + "block = [32, 7]\n", ["pass[0].block[1]: ", "8"]),
        (READS + PASS + "block = [16, 16]\n", ["pass[0].shader: a.glsl ", "reuse_block("]),
        (READS + '[settings]\nn = 3\n' + PASS + 'repeat = "n"\n', ["pass[0].repeat: ", "'n'", "min >= 1"]),
        (READS + 'keyframe = "every"\n' + PASS, ["keyframe: 'every'"]),
        (READS + "[settings]\nalpha = { min = 1 }\n" + PASS, ["settings.alpha.default "]),
        (READS + "[settings]\nalpha = { default = 2.0, max = 1.0 }\n" + PASS,
         ["settings.alpha.default: 2.0 ", "1"]),
        (READS + '[settings]\nmode = { default = "c", choices = ["a", "b"] }\n' + PASS,
         ["settings.mode.default: 'c'", "a, b"]),
        (READS + '[settings]\nalpha = { default = 0.1, scale = "log" }\n' + PASS, ["settings.alpha.scale: log"]),
        (READS + "[settings]\nfloat = 0.1\n" + PASS, ["settings: 'float'"]),
        ("reads = [\n", ["TOML"]),
        (READS + "[settings]\nn = 2147483648\n" + PASS, ["settings.n.default: 2147483648 "]),
        (READS + "[settings]\nn = -9223372036854775808\n" + PASS, ["settings.n.default: -9223372036854775808 "]),
        (READS + "[settings]\nx = 1e39\n" + PASS, ["settings.x.default: 1e+39 "]),
        (READS + "[settings]\nx = nan\n" + PASS, ["settings.x.default: nan "]),
        ('reads = ["x", "y"]\n[settings]\nint = 1\n', ["'x'", "'y'", "settings: 'int'", "pass: "]),
        # Names of inputs that are read, and functions that are generated for them.
        ('reads = ["variance"]\n' + PASS + '[history]\nvariance = "r32f"\n', ["history: 'variance'"]),
        ('reads = ["material"]\n' + PASS + "[settings]\nroughness = 0.5\n", ["settings: 'roughness'"]),
        ('reads = ["emitted"]\n' + PASS + "[settings]\nremodulate = 0.5\n", ["settings: 'remodulate'"]),
        # Sizes of methods that upscale.
        (READS + PASS + 'size = "input"\n', ["upscales = true"]),
        (UPSCALES + '[history]\nh = { format = "r32f", size = "half" }\n', ["history.h.size: "]),
        (UPSCALES + '[history]\nh = { size = "input" }\n', ["history.h.format "]),
        (UPSCALES.replace('["result"]', '["h", "result"]') + '[history]\nh = { format = "r32f", size = "input" }\n',
         ["pass[0].writes: 'h'"]),
        (UPSCALES + '[history]\ninput_size = "rgba32f"\n', ["history: 'input_size'"]),
        # Methods that compute their light, and records.
        ('light = "mine"\n' + PASS, ["light: "]),
        ('light = "own"\n' + UPSCALES, ["light: "]),
        (RECORDS.replace('h = "R"', 'h = "S"'), ["history.h: 'S'"]),
        (RECORDS.replace("vec4", "vec3"), ["structs.R.a: "]),
        (RECORDS.replace("R", "r"), ["structs.r: "]),
        (RECORDS.replace("h =", "light_at ="), ["history: 'light_at'"]),
        (RECORDS.replace(PASS, PASS + "block = [8, 8]\n"), ["pass[0].block: "]),
        (READS + PASS.replace('["result"]', '["result", "kept_sample"]'), ["pass[0].writes: "]),
        # Stages of a paper; a missing one is in the name of the method.
        (READS + PASS + STAGE.replace("mean", "Mean"), ["stages.Mean: "]),
        (READS + PASS + STAGE.replace("a.glsl", "b.glsl"), ["stages.mean.shader: 'b.glsl'"]),
        (READS + PASS + STAGE.replace("paper", "page"), ["stages.mean.page "]),
        (READS + PASS + STAGE + 'missing = "x"\n', ["stages.mean: "]),
        (READS + PASS + '[stages.clip]\ndoc = "clip"\npaper = "2"\nmissing = "no box"\n', ["m_without_clip"]),
    ],
)  # fmt: skip
def test_errors_of_method_toml(tmp_path, toml, parts):
    """The message contains the key of every error in the values, or that of the first of another type."""
    text = error_of(tmp_path, toml)
    for part in parts:
        assert part in text, text


@pytest.mark.parametrize(
    ("glsl", "part"),
    [
        ("void main() {}\n", "pass[0].shader: a.glsl "),
        ("// void reuse(ivec2 p) {}\n", "pass[0].shader: a.glsl "),
        ("void reuse(ivec2 p) {\n  write_result(p, fetch_normal(p).xyz);\n}\n",
         "a.glsl:2: fetch_normal: 'normal'"),
        ("void reuse(ivec2 p) {\n\n  write_motion(p, vec2(0));\n}\n", "a.glsl:3: write_motion: 'motion'"),
        ('#include "gone.glsl"\n' + PLAIN_GLSL, "pass[0].shader: a.glsl: "),
    ],
)  # fmt: skip
def test_errors_of_shaders_are_found_without_opengl(tmp_path, glsl, part):
    assert part in error_of(tmp_path, PLAIN_TOML, glsl)


def test_user_functions_and_comments_are_no_errors(tmp_path):
    """Functions whose names resemble generated ones, and names in comments."""
    glsl = "float sample_disk(float x) { return x; }\n// fetch_normal(p)\n" + PLAIN_GLSL
    assert load_method(write_method(tmp_path / "m", PLAIN_TOML, a=glsl)).reads == ("radiance",)


def test_method_of_a_valid_description(tmp_path):
    toml = (
        'title = "T"\ncite = "C"\nreads = ["radiance", "radiance"]\n[history]\nh = "rg16f"\n[buffers]\nb = "r32f"\n'
        '[settings]\nalpha = 0.5\nlevels = { default = 2, min = 1, max = 4 }\non = true\n'
        'mode = { default = "b", choices = ["a", "b"] }\n'
        '[[pass]]\nshader = "a.glsl"\nwrites = ["b", "h"]\n'
        '[[pass]]\nshader = "a.glsl"\nwrites = ["b", "result"]\nreads = ["b", "prev_h"]\nrepeat = "levels"\n'
    )  # fmt: skip
    method = load_method(write_method(tmp_path / "m", toml, a="void reuse(ivec2 p) {}\n"))
    assert (method.name, method.title, method.cite, method.reads) == ("m", "T", ("C",), ("radiance",))
    assert {n: s.kind for n, s in method.settings.items()} == {
        "alpha": "float", "levels": "int", "on": "bool", "mode": "choice"}  # fmt: skip
    assert method.passes[0].reads == ("radiance", "prev_h") and method.spares == {"b"}
    # result 16, history rg16f twice, buffer r32f twice (one pass reads and writes it)
    assert method.bytes((10, 10)) == 100 * (16 + 2 * 4 + 2 * 4)
    assert method.values({"alpha": 1, "mode": "a"}) == {"alpha": 1.0, "levels": 2, "on": True, "mode": "a"}
    assert method.settings["mode"].number("b") == 1
    assert method.settings["levels"].parse("3") == 3 and method.settings["on"].parse("false") is False


def test_all_wrong_settings_are_reported_together():
    with pytest.raises(MethodError) as caught:
        load_method("taa_clamp").values({"alpha": 3.0, "alhpa": 1.0, "filtering": "cubic", "rounded": 1})
    text = str(caught.value)
    for part in ("setting alpha: 3.0", "0.01", "'alhpa'", "'cubic'", "nearest", "setting rounded: 1", "'taa_clamp'"):
        assert part in text
    for value in (float("nan"), "0.1", None, True):
        with pytest.raises(MethodError):
            load_method("taa_clamp").values({"alpha": value})
    for value in (2**31, -(2**31) - 1, 10**400):
        with pytest.raises(MethodError):
            load_method("taa_clamp").values({"alpha": 10.0 * value if value < 10**300 else value})
        with pytest.raises(MethodError):
            load_method("svgf").values({"levels": value})
    with pytest.raises(MethodError, match=r"setting levels: 2\.5"):
        load_method("svgf").settings["levels"].parse("2.5")


# ------------------------------------------------------------------------------------------------------------ loading
class Plain:
    reads = ("radiance",)

    def __init__(self, size, settings):
        pass

    def step(self, frame):
        return frame["radiance"][..., :3]


FILE = """
import numpy as np
class Helper: pass
class Mine:
    reads = ("radiance",)
    def __init__(self, size, settings): pass
    def step(self, frame): return frame["radiance"][..., :3]
"""


def test_sources_of_methods(tmp_path, monkeypatch):
    file = tmp_path / "some_file.py"
    file.write_text(FILE)
    assert load_method(Plain).factory is Plain
    assert load_method(str(file)).name == "some_file"
    assert load_method(file).factory.__name__ == "Mine"
    assert load_method(f"{file}:Mine").name == "Mine"
    folder = write_method(tmp_path / "folder", PLAIN_TOML, a=PLAIN_GLSL)
    assert load_method(folder).name == load_method(str(folder / "method.toml")).name == "folder"
    monkeypatch.chdir(tmp_path)
    assert load_method("folder").name == "folder"
    monkeypatch.syspath_prepend(str(tmp_path))
    assert load_method("some_file:Mine").factory.__name__ == "Mine"
    method = load_method("none")
    assert load_method(method) is method


def test_entry_points(tmp_path, monkeypatch):
    (tmp_path / "my_pack.py").write_text(FILE + f"folder = {str(tmp_path / 'f')!r}\nnumber = 3\n")
    write_method(tmp_path / "f", PLAIN_TOML, a=PLAIN_GLSL)
    monkeypatch.syspath_prepend(str(tmp_path))
    info = tmp_path / "my_pack-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-pack\nVersion: 1.0\n")
    lines = ["a = my_pack:Mine", "b = my_pack:folder", "c = my_pack:number", "d = my_pack:gone"]
    (info / "entry_points.txt").write_text("[taubench_gl.methods]\n" + "\n".join(lines) + "\n")
    importlib.invalidate_caches()
    assert load_method("a").name == "a" and load_method("a").factory.__name__ == "Mine"
    assert load_method("b").passes and load_method("b").name == "b"
    for name, target in (("c", "my_pack:number"), ("d", "my_pack:gone")):
        with pytest.raises(MethodError) as caught:
            load_method(name)
        assert caught.value.where == f"entry point {name} = {target}"


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("import nothing_of_that_name\n", "ModuleNotFoundError"),
        ("def f(:\n", r"SyntaxError: .*line 1"),
        ("raise SystemExit(3)\n", "SystemExit: 3"),
        ("class Odd(BaseException): pass\nraise Odd('why')\n", "Odd: why"),
        ("#" * (1 << 20) + "\n" + FILE, "larger than"),
        ("x = 3\n", "step"),
        (FILE + "class Other(Mine): pass\n", r"Mine, Other"),
        ("class M:\n    reads = ('radiance',)\n    step = 3\n", "step"),
        ("class M:\n    def step(self, frame): pass\n", "reads: "),
        ("class M:\n    reads = ('hue',)\n    settings = {'a': 'x', 'int': 1}\n    def step(self, frame): pass\n",
         "'hue'.*settings.a.default.*settings: 'int'"),
    ],
)  # fmt: skip
def test_errors_of_classes(tmp_path, text, part):
    file = tmp_path / "m.py"
    file.write_text(text)
    with pytest.raises(MethodError, match=part) as caught:
        load_method(file)
    assert "\n" not in str(caught.value) and "m.py" in str(caught.value)


@pytest.mark.parametrize(
    ("source", "part"),
    [
        ("taa_clmp", "'taa_clmp'.*'taa_clamp'"),
        ("no_such_module:X", "no_such_module"),
        ("json:NoClass", "'NoClass'"),
        ("gone.py", "gone.py"),
        ("", "''"),
    ],
)
def test_unknown_methods(source, part, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MethodError, match=part):
        load_method(source)


def test_empty_folder_is_no_method(tmp_path):
    with pytest.raises(MethodError) as caught:
        load_method(tmp_path)
    assert caught.value.where == str(tmp_path / "method.toml")


def test_validation_opens_no_context(monkeypatch):
    monkeypatch.setattr("moderngl.create_context", None)
    assert [load_method(name).name for name in builtin_methods()] == list(builtin_methods())


def test_every_input_has_a_type_in_glsl():
    kinds = {(f.components, f.dtype) for f in FORMATS.values()}
    assert all((info.components, info.dtype) in kinds for info in INPUTS.values())
    assert all(np.dtype(f.dtype).itemsize * f.components == f.bytes for f in FORMATS.values())
