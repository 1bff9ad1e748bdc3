"""The shader resolver: includes, cycles, missing files, and error messages that name the line a person wrote."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from taubench_gl.errors import GraphicsError
from taubench_gl.features import LIGHT_FEATURES
from taubench_gl.frame.passes.masks import MaskOptions, mask_pass
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu import shader
from taubench_gl.gpu.shader import ShaderCache, resolve
from taubench_gl.paths import SHADERS

pytestmark = pytest.mark.usefixtures("own_programs")


def write(root: Path, **files: str) -> Path:
    root.mkdir(exist_ok=True)
    for name, text in files.items():
        (root / f"{name}.glsl").write_text(text)
    return root


def test_an_include_comes_in_once(tmp_path) -> None:
    root = write(
        tmp_path,
        main='#include "a.glsl"\n#include "b.glsl"\nvoid main() { one(); }',
        a='#include "common.glsl"\nvoid a() {}',
        b='#include "common.glsl"\nvoid b() {}',
        common="void one() {}",
    )
    source = resolve("main.glsl", roots=(root,))
    assert source.text.count("void one()") == 1
    assert source.text.index("void one()") < source.text.index("void a()") < source.text.index("void b()")
    assert "#include" not in source.text and source.text.startswith("#version 450\n")
    lines = source.text.splitlines()
    assert len(lines) == len(source.origin)
    assert source.origin[lines.index("void b() {}")] == "b.glsl:2"
    assert source.origin[lines.index("void main() { one(); }")] == "main.glsl:3"


@pytest.mark.parametrize(("entry", "chain"), [("a", "a b c a"), ("me", "me me")])
def test_a_cycle_is_reported_as_a_chain(tmp_path, entry, chain) -> None:
    includes = {"a": "b", "b": "c", "c": "a", "me": "me"}
    root = write(tmp_path, **{name: f'#include "{other}.glsl"' for name, other in includes.items()})
    with pytest.raises(GraphicsError) as caught:
        resolve(f"{entry}.glsl", roots=(root,))
    assert " > ".join(f"{name}.glsl" for name in chain.split()) in caught.value.what


def test_a_file_comes_from_the_first_folder_that_has_it(tmp_path) -> None:
    own = write(tmp_path / "own", part="float own;")
    base = write(tmp_path / "base", main='#include "part.glsl"', part="float base;")
    text = resolve("main.glsl", roots=(own, base)).text
    assert "float own;" in text and "float base;" not in text


def test_a_missing_file_names_who_wanted_it(tmp_path) -> None:
    root = write(tmp_path, main='#include "gone.glsl"')
    with pytest.raises(GraphicsError, match=r"gone\.glsl cannot be read \(included by main\.glsl\)"):
        resolve("main.glsl", roots=(root,))
    with pytest.raises(GraphicsError, match=r"nothing\.glsl cannot be read: "):
        resolve("nothing.glsl", roots=(root,))


def test_defines_and_preamble_come_first(tmp_path) -> None:
    root = write(tmp_path, main="void main() {}")
    source = resolve("main.glsl", {"B": 3, "A": True, "C": False}, "const int X = 1;", (root,))
    assert source.text.splitlines()[1:5] == ["#define A 1", "#define B 3", "#define C 0", "const int X = 1;"]
    assert source.origin[4] == "preamble:1"


def test_errors_name_file_and_line(gpu, tmp_path, monkeypatch) -> None:
    """The fault is in an included file, below defines and a preamble; the driver only counts expanded lines."""
    root = write(
        tmp_path,
        main='// a comment\n#include "part.glsl"\nlayout(local_size_x = 1) in;\nvoid main() { broken(); }\n',
        part="\n\nvoid broken() {\n    float x = undeclared_thing;\n}\n",
    )
    monkeypatch.setattr(shader, "resolve", lambda e, d=None, p="": resolve(e, d, p, (root,)))
    with pytest.raises(GraphicsError, match=r"part\.glsl:4\b.*undeclared_thing") as caught:
        ShaderCache(gpu.ctx).compute("main.glsl", {"A": 1, "B": 2}, "const int C = 3;\nconst int D = 4;")
    assert "\n" not in str(caught.value) and "0:" not in str(caught.value).split("compile: ")[1][:3]


def test_errors_name_the_stage_that_failed(gpu, tmp_path, monkeypatch) -> None:
    good = "void main() { gl_Position = vec4(0.0); }\n"
    root = write(tmp_path, vert=good, frag="out vec4 c;\nvoid main() {\n  c = vec3(1.0);\n}\n", bad="\nvoid main( {\n")
    monkeypatch.setattr(shader, "resolve", lambda e, d=None, p="": resolve(e, d, p, (root,)))
    with pytest.raises(GraphicsError, match=r"frag\.glsl:3\b"):
        ShaderCache(gpu.ctx).render("vert.glsl", "frag.glsl")
    with pytest.raises(GraphicsError, match=r"bad\.glsl:2\b"):
        ShaderCache(gpu.ctx).render("bad.glsl", "frag.glsl")


def test_drivers_write_line_numbers_in_several_ways() -> None:
    source = shader.Source("\n" * 12, tuple(f"f.glsl:{i}" for i in range(1, 13)))
    for message in ("0:12(5): error: x", "0(12) : error C0: x", "ERROR: 0:12: x"):
        assert "f.glsl:12" in source.translate(message)
    assert source.translate("0:99(1): error") == "0:99(1): error"


def test_a_program_is_compiled_once(gpu) -> None:
    cache = ShaderCache(gpu.ctx)
    still, motion = (mask_pass(MaskOptions(reprojection=mode), (8, 8), Tuning()) for mode in ("camera", "motion"))
    first = cache.compute("masks/masks.comp.glsl", still.defines, still.interface())
    again = dict(reversed(still.defines.items()))
    assert cache.compute("masks/masks.comp.glsl", again, still.interface()) is first
    assert cache.compute("masks/masks.comp.glsl", motion.defines, motion.interface()) is not first
    assert len(cache) == 2
    cache.release()
    assert len(cache) == 0


def test_every_mask_variant_compiles(gpu) -> None:
    cache = ShaderCache(gpu.ctx)
    for motion, bilinear, *light in itertools.product((False, True), repeat=5):
        options = MaskOptions(
            reprojection="motion" if motion else "camera",
            sampling="bilinear" if bilinear else "nearest",
            radiance=tuple(itertools.compress(LIGHT_FEATURES, light)),
            write_mask=motion,
            write_motion=bilinear,
        )
        declared = mask_pass(options, (8, 8), Tuning(software=light[0]), images=bilinear)
        cache.compute("masks/masks.comp.glsl", declared.defines, declared.interface())
    assert len(cache) == 32
    cache.release()


def test_every_shader_resolves() -> None:
    for path in SHADERS.rglob("*.glsl"):
        entry = path.relative_to(SHADERS).as_posix()
        assert resolve(entry).origin[-1].startswith(entry)
