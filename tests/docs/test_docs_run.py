"""Commands and Python examples of the pages run, on the demo scene and at a small size."""

from __future__ import annotations

import os
import re
import shutil
import sys
import warnings
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from test_docs_examples import PAGES, ROOT, blocks, command_lines, words_of

from taubench_gl.apps.cli import cli, main

pytestmark = pytest.mark.usefixtures("coarse_metering", "fixed_light")

NAMES = {page: str(page.relative_to(ROOT)) for page in PAGES}
sys.path.append(str(ROOT / "tests" / "pathtraced"))

LEFT_OUT = {
    r"^view|--view": "opens a window: tests/viewer",
    r"^convert|^reference render|\.(fbx|zip)\b": "needs Blender, or a file that may not be shipped: tests/pathtraced, "
    "tests/datasets",
    r"bart-museum|^scenes get": "files of the user: tests/datasets",
    r"^evaluate valley.glb": "the stand-in takes minutes: tests/datasets",
    r"exr:(engine|one-sample)|--mapping falcor": "reads renderings of other programs: tests/pathtraced, tests/reuse",
    r"^paper|^scenes make|^benchmark (?!compare)|^cost |study/within-": "takes minutes: tests/paper, tests/datasets, "
    "tests/benchmark, tests/cost",
    r"^demo --(all|lecture)|^selftest( --json)?$|^doctor --report": "takes minutes: tests/demos, selftest, drivers",
    r"^conformance score": "reads frames of an engine: tests/conformance",
    r"--camera-path (head|trajectory|track)": "reads a recorded camera: tests/animation/test_recorded_camera.py",
    r"\b(arena|cubes)\.glb": "a recorded game: tests/capture",
    r"sky\.hdr": "an image of the user: tests/light",
    r"methods gates/|,gates/|tests relative_depth": "fitted tests and a mapping of the user: tests/reject",
    r"^capture": "needs a recording and the game's data: tests/capture",
    r"\bpairs\d|exr:denoised": "a walk through another program: tests/export/test_sequences_elsewhere.py",
    r"methods none,svgf,svgf@taa": "takes minutes: tests/reuse/test_svgf.py",
    r"osmesa": "a driver that may be missing: tools/test --driver",
}
"""Examples that do not run here (regular expressions of command lines), and what tests them."""

SMALL = {
    "--size": "64x36", "--frames": "0:3", "--reference-samples": "4",
    "--repeats": "1", "--shadow-size": "128",
}  # fmt: skip
"""Values of options in place of those of the page and of the defaults."""

LESS = {
    "path-traced@1024": "path-traced@8",
    "path-traced@256": "path-traced@8",
    "yaw=0:12:7": "yaw=0:12:2",
    "64": "4",
    "5": "2",
}
"""Words in place of those of the page."""

FIRST = {
    r"^batch (status|resume|report) results": ["batch run spec.toml --out results"],
    r"^batch report batch": ["batch run batch.toml --out batch"],
    r"^(report|compare|view) .*\bresults\b": ["evaluate scene.glb --out results"],
    r"^share results": ["evaluate scene.glb --report --out results"],
    r"\bother-results\b": ["evaluate scene.glb --reprojection motion --out other-results"],
    r"\bout/": ["evaluate scene.glb --out out/sponza", "evaluate scene.glb --reprojection motion --out out/bistro"],
    r"\breuse-results\b": ["reuse evaluate scene.glb --methods none,accumulate --out reuse-results"],
    r"\breuse-a\b": ["reuse evaluate scene.glb --methods none,accumulate --out reuse-a"],
    r"\breuse-b\b": ["reuse evaluate scene.glb --methods none,taa_clamp --out reuse-b"],
    r"^inspect nss": ["export scene.glb --out nss --format nss --input jittered+upscale@2 --reference max"],
    r"exr:frames": ["export scene.glb --out frames --format exr"],
    r"^reference compare|^report raster": [
        "evaluate scene.glb --out raster --save masks,channels",
        "export scene.glb --out frames --format exr --channels gbuffer,radiance,flow,masks",
        "evaluate exr:frames --out traced --save masks,channels",
    ],
    r"(?<!new )my-method": ["reuse new my-method"],
    r"\./my_method\b": ["reuse new my_method"],
    r"methods/reject_": ["reject method --tests position --out methods"],
}
"""Commands that write what an example (regular expression) reads."""

QUICK = (
    r"^(inspect scene.glb|completion|scenes|benchmark|reference list|demo$|reject list)"
    r"|^reuse (list|show|new)|^stress .*headset"
)
"""Examples of other pages in the normal run."""

FIRST_PAGE = "README.md"
"""The page whose examples are in the normal run, but for those of TWICE."""

TWICE = r"^(stress .*--sweep|batch .*--workers|reuse fit|reuse evaluate .*fsr2-class)"
"""Examples of that page that run only with --long: the tests of these packages run the same on other files."""

PYTHON = {
    "README.md": {
        'out="results")': 'out="results", size="64x36", frames=range(3))',
        'size="640x360", frames=range(0, 24)': 'size="64x36", frames=range(3)',
        "pair.explain(320, 180)": "pair.explain(32, 18)",
    },
    "docs/demos.md": {"size=(640, 360)": "size=(160, 90)"},
    "docs/export.md": {"range(10)": "range(1)"},
    "docs/other-eye.md": {
        'size="320x180"': 'size="64x36", frames=range(3)',
        "pair.explain(160, 90)": "pair.explain(32, 18)",
    },
    "docs/reuse-evaluation.md": {
        "width=640, height=360": "width=64, height=36",
        "frames=(0, 48)": "frames=(0, 4)",
        'input="noisy+jittered"': 'input="noisy+jittered", reference_samples=4',
    },
}
"""Pages whose Python examples run, and what is replaced in them."""

PYTHON_ELSEWHERE = {
    "docs/api.md": "tests/test_api.py",
    "docs/cost.md": "tests/cost/test_study.py",
    "docs/reuse.md": "tests/reuse/test_reuse_guide.py, test_python_routes.py",
    "docs/train-a-denoiser.md": "tests/export/test_sequences_elsewhere.py",
}


def reason_of(line: str) -> str | None:
    """Why a command line does not run here."""
    return next((why for pattern, why in LEFT_OUT.items() if re.search(pattern, line)), None)


def examples() -> dict[str, str]:
    """Each different command line of the pages that runs, and the first page that has it."""
    found: dict[str, str] = {}
    for page in PAGES:
        for line in map(" ".join, map(words_of, command_lines(page))):
            if reason_of(line) is None:
                found.setdefault(line, NAMES[page])
    return found


def reduced(words: list[str], kept: Collection[str]) -> list[str]:
    """The arguments with LESS, and with the values of SMALL for the options that the command has, but for ``kept``."""
    command: click.Command = cli
    for word in words:
        if not isinstance(command, click.Group):
            break
        command = command.commands.get(word) or command.commands.get("run", command)
    known = {name for parameter in command.params for name in parameter.opts}
    if words[0] == "selftest":
        return words  # its cases need their sizes
    small = SMALL | ({"--size": "160x90"} if words[0] == "demo" else {})
    small |= {"--seconds": "0.2"} if "--sweep" in words else {}
    if any(word.startswith("exr:") for word in words) or (words[0] == "stress" and "--sweep" not in words):
        del small["--size"]
    if words[:2] in (["reuse", "evaluate"], ["reuse", "fit"]) and "--input" not in words:
        small["--reference"] = "path-traced@4"  # of path-traced input: as many samples as fit in two minutes
    return [LESS.get(word, word) for word in words] + [
        text for name, value in small.items() if name in known - set(kept) for text in (name, value)
    ]


def run(words: list[str], kept: Collection[str] = ()) -> None:
    with pytest.raises(SystemExit) as ended:
        main(reduced(words, kept))
    answers = (0, None, 1) if words[0] == "check" else (0, None)  # 1: the vectors of ``write_inputs`` are random
    assert ended.value.code in answers, " ".join(words)


def write_inputs(folder: Path) -> None:
    """What examples read and no command of the program writes."""
    from exr_files import blender_frame, view_at
    from exr_files import write as write_exr
    from pygltflib import GLTF2

    from taubench_gl.pathtraced.cameras import camera_file_text

    shutil.copytree(ROOT / "assets", folder / "assets")
    for name in ("scene", "board", "a"):
        shutil.copy(ROOT / "assets" / "demo.glb", folder / f"{name}.glb")
    for name in ("mine", "theirs"):
        (folder / name).mkdir()
        shutil.copy(ROOT / "docs" / "benchmark-quick.json", folder / name / "benchmark.json")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the buffer goes into a file of its own
        for name in ("scene.gltf", "b.gltf"):
            GLTF2().load(str(ROOT / "assets" / "demo.glb")).save(str(folder / name))
    for name in ("spec.toml", "batch.toml", "first.toml", "second.toml"):
        (folder / name).write_text('scenes = ["scene.glb"]\nsize = "64x36"\nframes = "0:3"\n')
    (folder / "mine.toml").write_text('[my-scene]\ntitle = "Mine"\nformat = "gltf"\n')
    (folder / "headset.csv").write_text(
        "time,x,y,z,qx,qy,qz,qw\n" + "".join(f"{i / 60},{0.01 * i},1.6,5,0,0,0,1\n" for i in range(31))
    )
    (folder / "renders").mkdir()
    for i in range(3):
        write_exr(folder / "renders" / f"{i:04d}.exr", blender_frame((0.02 * i, 1.0, 5.0), seed=i)[0])
    cameras = {i: view_at(0.02 * i) for i in range(3)}
    (folder / "renders" / "camera.json").write_text(camera_file_text(cameras, 24.0, (12, 8)))
    accumulate = blocks(ROOT / "docs" / "reuse.md", "python")[0]
    (folder / "my_method.py").write_text(accumulate.replace("class Accumulate", "class Variant"))
    (folder / "my_test").mkdir()
    for language in ("toml", "glsl"):
        (text,) = blocks(ROOT / "docs" / "reject.md", language)
        (folder / "my_test" / f"test.{language}").write_text(text)


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], list[Path]]:
    """prepared(example) -> folders whose contents the example reads; each is written once."""
    made: dict[tuple[str, ...], Path] = {}

    def folders(line: str) -> list[Path]:
        found = [()] + [tuple(commands) for pattern, commands in FIRST.items() if re.search(pattern, line)]
        for commands in found:
            if commands not in made:
                folder = tmp_path_factory.mktemp("prepared")
                if commands:
                    for name in ("scene.glb", "spec.toml", "batch.toml"):
                        os.symlink(made[()] / name, folder / name)
                else:
                    write_inputs(folder)
                with pytest.MonkeyPatch.context() as patch:
                    patch.chdir(folder)
                    for command in commands:
                        run(command.split(), kept=command.split())
                made[commands] = folder
        return [made[commands] for commands in found]

    return folders


@pytest.fixture
def ready(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, prepared) -> Callable[[str], None]:
    """ready(example) fills the current folder with what it reads."""

    def fill(line: str) -> None:
        here = tmp_path / "here"
        for folder in prepared(line):
            shutil.copytree(folder, here, dirs_exist_ok=True)
        monkeypatch.chdir(here)

    return fill


def marked(line: str, page: str) -> Any:
    usual = (page == FIRST_PAGE and not re.search(TWICE, line)) or re.search(QUICK, line)
    return pytest.param(line, id=line, marks=() if usual else pytest.mark.long)


@pytest.mark.parametrize("line", [marked(line, page) for line, page in examples().items()])
def test_examples_run(line: str, ready):
    ready(line)
    words = line.split()
    if "out/*" in words:  # the shell's work
        words = words[: words.index("out/*")] + ["out/sponza", "out/bistro"] + words[words.index("out/*") + 1 :]
    run(words)


@pytest.mark.long
@pytest.mark.parametrize("name", PYTHON)
def test_python_examples_run(name: str, ready):
    texts = blocks(ROOT / name, "python")
    if any("import torch" in text for text in texts):
        pytest.importorskip("torch")
    ready("\n".join(texts))
    names: dict[str, object] = {"__name__": "example"}
    for text in texts:
        for old, new in PYTHON[name].items():
            text = text.replace(old, new)
        exec(compile(text, name, "exec"), names)
    if name == "docs/export.md":
        assert np.isfinite(np.asarray(names["error"])).all()


def test_what_is_left_out_or_replaced_exists():
    texts = [" ".join(words_of(line)) for page in PAGES for line in command_lines(page)]
    texts += [text for page in PAGES for text in blocks(page, "python")]
    for pattern in (*LEFT_OUT, QUICK, TWICE, *LESS, *FIRST):
        assert any(re.search(pattern, text) for text in texts), pattern
    for name, replaced in PYTHON.items():
        text = "\n".join(blocks(ROOT / name, "python"))
        assert text and all(old in text for old in replaced), name
    assert {NAMES[page] for page in PAGES if blocks(page, "python")} == PYTHON.keys() | PYTHON_ELSEWHERE.keys()
