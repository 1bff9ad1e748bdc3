"""The contract: what a method folder or class may say, and that each fault is one line that names it."""

from __future__ import annotations

import importlib
import subprocess
import sys

import numpy as np
import pytest
from reuse_tools import PLAIN_GLSL, PLAIN_TOML, write_method

from taubench_gl.errors import MethodError
from taubench_gl.reuse.contract import FORMATS
from taubench_gl.reuse.frame import INPUTS
from taubench_gl.reuse.loading import load_method

PASS = '[[pass]]\nshader = "a.glsl"\nwrites = ["result"]\n'
READS = 'reads = ["radiance", "motion"]\n'


def fault_of(tmp_path, toml: str, glsl: str = PLAIN_GLSL) -> str:
    with pytest.raises(MethodError) as caught:
        load_method(write_method(tmp_path / "m", toml, a=glsl))
    text = str(caught.value)
    assert "\n" not in text and "method.toml" in text
    return text


@pytest.mark.parametrize(
    ("toml", "complaints"),
    [
        ("", ["reads: a list of inputs is needed", "pass: at least one"]),
        ('reads = ["radience"]\n' + PASS, ["no input is named 'radience' (did you mean 'radiance'?"]),
        ("reads = 3\n" + PASS, ["reads: a list of inputs"]),
        ('name = 3\ncite = [1]\ntitle = ""\n' + READS + PASS, ["name: 3 is not", "cite: is not text", "title: ''"]),
        ("histori = 1\n" + READS + PASS, ["histori: unknown key (did you mean 'history'?"]),
        (READS + PASS + '[history]\na = "rgb32f"\n', ["history.a: 'rgb32f' is no format (there are rgba32f"]),
        (READS + PASS + '[history]\nposition = "r32f"\n', ["'position' cannot name a history: an input has that name"]),
        (READS + PASS + '[history]\nprev_x = "r32f"\n', ["'prev_x' cannot name a history: prev_ is"]),
        (READS + PASS + '[buffers]\nresult = "r32f"\n', ["'result' cannot name a buffer: the word is taken"]),
        (READS + PASS + '[buffers]\nBig = "r32f"\n', ["'Big' cannot name a buffer: small letters"]),
        (READS + PASS + '[history]\na = "r32f"\n[buffers]\na = "r32f"\n', ["buffers: 'a' is given twice"]),
        (READS + PASS + '[history]\na = "r32f"\n', ["no pass writes 'a' (history)"]),
        (READS + '[[pass]]\nshader = "a.glsl"\nwrites = []\n', ["no pass writes 'result' (the picture)"]),
        (READS + '[[pass]]\nshader = "a.glsl"\nwrites = ["resulted"]\n', ["pass[0].writes: nothing here is named"]),
        (READS + '[[pass]]\nwrites = ["result"]\n', ["pass[0].shader: the name of a GLSL file"]),
        (READS + '[[pass]]\nshader = "b.glsl"\nwrites = ["result"]\n', ["b.glsl: cannot be read: No such file"]),
        (READS + '[[pass]]\nshader = "a.glsl"\nwrites = ["result"]\nreads = ["normal"]\n',
         ["pass[0].reads: nothing here is named 'normal': add it to the method's reads"]),
        (READS + '[buffers]\nb = "r32f"\n[[pass]]\nshader = "a.glsl"\nwrites = ["result"]\nreads = ["b", "radiance"]\n',
         ["pass[0].reads: 'b' is read before any pass has written it", "no pass writes 'b' (buffer)"]),
        (READS + PASS + "repeat = 0\n", ["pass[0].repeat: 0 is not a whole number from 1 to 64"]),
        (READS + '[settings]\nn = 3\n' + PASS + 'repeat = "n"\n', ["setting 'n' must be a whole number with min >= 1"]),
        (READS + 'keyframe = "every"\n' + PASS, ["keyframe: 'every' is not a whole number", "there are none"]),
        (READS + "[settings]\nalpha = { min = 1 }\n" + PASS, ["settings.alpha.default: is missing"]),
        (READS + "[settings]\nalpha = { default = 2.0, max = 1.0 }\n" + PASS,
         ["settings.alpha.default: 2.0 is not a number of at most 1"]),
        (READS + '[settings]\nmode = { default = "c", choices = ["a", "b"] }\n' + PASS, ["'c' is not one of a, b"]),
        (READS + '[settings]\nalpha = { default = 0.1, scale = "log" }\n' + PASS, ["log needs a min above 0"]),
        (READS + '[settings]\nalpha = { default = 0.1, mim = 0.0 }\n' + PASS, ["settings.alpha.mim: unknown key"]),
        (READS + "[settings]\nfloat = 0.1\n" + PASS, ["'float' cannot name a setting: the word is taken in GLSL"]),
        ("reads = [\n", ["is not TOML"]),
        ('reads = ["x", "y"]\nbad = 1\n', ["'x'", "'y'", "bad: unknown key", "pass: at least one"]),
    ],
)  # fmt: skip
def test_each_fault_of_a_description_is_named(tmp_path, toml, complaints):
    text = fault_of(tmp_path, toml)
    for complaint in complaints:
        assert complaint in text, text


@pytest.mark.parametrize(
    ("glsl", "complaint"),
    [
        ("void main() {}\n", "a.glsl has no function 'void reuse(ivec2 p)'"),
        ("// void reuse(ivec2 p) {}\n", "a.glsl has no function"),
        ("void reuse(ivec2 p) {\n  write_result(p, fetch_normal(p).xyz);\n}\n",
         "a.glsl:2: fetch_normal: 'normal' is not in the reads of the method"),
        ("void reuse(ivec2 p) {\n\n  write_motion(p, vec2(0));\n}\n", "a.glsl:3: write_motion: 'motion' is an input"),
        ('#include "gone.glsl"\n' + PLAIN_GLSL, "cannot be read: No such file"),
    ],
)  # fmt: skip
def test_each_fault_of_a_shader_is_found_without_opengl(tmp_path, glsl, complaint):
    assert complaint in fault_of(tmp_path, PLAIN_TOML, glsl)


def test_a_users_own_functions_are_his_own(tmp_path):
    """Names that only look like ours, and mentions in comments, are no faults."""
    glsl = "float sample_disk(float x) { return x; }\n// fetch_normal(p)\n" + PLAIN_GLSL
    assert load_method(write_method(tmp_path / "m", PLAIN_TOML, a=glsl)).reads == ("radiance",)


def test_what_a_valid_description_becomes(tmp_path):
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
    # result 16, history rg16f twice, buffer r32f twice (it is read and written in one turn)
    assert method.bytes((10, 10)) == 100 * (16 + 2 * 4 + 2 * 4)
    assert method.values({"alpha": 1, "mode": "a"}) == {"alpha": 1.0, "levels": 2, "on": True, "mode": "a"}
    assert method.settings["mode"].number("b") == 1
    assert method.settings["levels"].parse("3") == 3 and method.settings["on"].parse("false") is False


def test_wrong_settings_are_told_together():
    with pytest.raises(MethodError) as caught:
        load_method("taa_clamp").values({"alpha": 3.0, "alhpa": 1.0, "filtering": "cubic", "rounded": 1})
    text = str(caught.value)
    for part in ("setting alpha: 3.0 is not a number from 0.01 to 1", "'alhpa' (did you mean 'alpha'?",
                 "one of nearest", "setting rounded: 1 is not true or false", "method 'taa_clamp'"):  # fmt: skip
        assert part in text
    for value in (float("nan"), "0.1", None, True):
        with pytest.raises(MethodError):
            load_method("taa_clamp").values({"alpha": value})
    with pytest.raises(MethodError, match=r"2\.5 is not a whole number from 1 to 8"):
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


def test_a_method_is_found_in_every_way(tmp_path, monkeypatch):
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


def test_entry_points_are_found_by_name(tmp_path, monkeypatch):
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
    with pytest.raises(MethodError, match=r"entry point c = my_pack:number: is neither a class"):
        load_method("c")
    with pytest.raises(MethodError, match=r"entry point d = my_pack:gone: cannot be loaded: AttributeError"):
        load_method("d")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("import nothing_of_that_name\n", "cannot be run: ModuleNotFoundError"),
        ("def f(:\n", r"cannot be run: SyntaxError: .*line 1"),
        ("raise SystemExit(3)\n", "cannot be run: SystemExit: 3"),
        ("x = 3\n", "has no class with a step"),
        (FILE + "class Other(Mine): pass\n", r"has several methods \(Mine, Other\)"),
        ("class M:\n    reads = ('radiance',)\n    step = 3\n", "has no class with a step"),
        ("class M:\n    def step(self, frame): pass\n", "reads: a tuple of inputs is needed"),
        ("class M:\n    reads = ('colour',)\n    settings = {'a': 'x', 'int': 1}\n    def step(self, frame): pass\n",
         "no input is named 'colour'.*settings.a.default.*'int' cannot name a setting"),
    ],
)  # fmt: skip
def test_each_fault_of_a_class_is_named(tmp_path, text, complaint):
    file = tmp_path / "m.py"
    file.write_text(text)
    with pytest.raises(MethodError, match=complaint) as caught:
        load_method(file)
    assert "\n" not in str(caught.value) and "m.py" in str(caught.value)


@pytest.mark.parametrize(
    ("wanted", "complaint"),
    [
        ("taa_clmp", r"no method, folder or file 'taa_clmp' \(did you mean 'taa_clamp'\?"),
        ("no_such_module:X", "module no_such_module cannot be imported"),
        ("json:NoClass", "has no class 'NoClass'"),
        ("gone.py", "there is no such file"),
        ("", "no method, folder or file ''"),
    ],
)
def test_what_is_not_there_is_named(wanted, complaint, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MethodError, match=complaint):
        load_method(wanted)


def test_an_empty_folder_is_no_method(tmp_path):
    with pytest.raises(MethodError, match=r"method\.toml: cannot be read: No such file"):
        load_method(tmp_path)


def test_validation_opens_no_context():
    code = (
        "import sys; import moderngl; moderngl.create_context = None; from taubench_gl.reuse.loading import *\n"
        "for name in builtin_methods(): load_method(name)\n"
        "assert 'glcontext' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def test_every_input_has_a_type_in_glsl():
    kinds = {(f.components, f.dtype) for f in FORMATS.values()}
    assert all((info.components, info.dtype) in kinds for info in INPUTS.values())
    assert all(np.dtype(f.dtype).itemsize * f.components == f.bytes for f in FORMATS.values())
