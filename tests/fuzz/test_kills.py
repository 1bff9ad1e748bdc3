"""Kills (SIGKILL) at random moments of every command that writes a folder: evaluate, export, batch, cost, reuse,
benchmark and reference rendering.

After each kill: no child is left, and a run with a summary.json is whole.  After all kills of a command, the same one
gives the results of an undisturbed run.  Prints the number of kills and of runs that ended before their kill.
"""

from __future__ import annotations

import csv
import json
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from taubench_gl.folder_lock import LOCK_FILE, FolderLock
from taubench_gl.paths import PACKAGE
from taubench_gl.run import SUMMARY_FILE, load_run

ROOT = PACKAGE.parent
DEMO = ROOT / "assets" / "demo.glb"
KILLS = int(os.environ.get("TAUBENCH_KILLS", "5"))
"""Kills of each command."""
COMMON = ("--size", "64x36", "--light-unit", "candela", "--exposure", "1", "--environment", "none")
GEOMETRY = (*COMMON, "--columns", "frustum,position,normal")
VOLATILE = ("timing", "memory", "provenance")

REFERENCE = """
import sys
from taubench_gl.animation import choose_camera
from taubench_gl.pathtraced.blender.job import Quality
from taubench_gl.pathtraced.blender.render import render_reference
from taubench_gl.scene import load_scene
scene = load_scene(sys.argv[1])
render_reference(scene, choose_camera(scene), range(12), sys.argv[2], fps=24.0, size=(32, 18),
                 quality=Quality(samples=1), python=sys.argv[3])
"""


def summary_of(path: Path, volatile: tuple[str, ...] = VOLATILE) -> dict[str, Any]:
    """The values of a result without the ``volatile`` ones and without their checksum; that of the rows stays."""
    summary = json.loads(path.read_text())
    del summary["stored"]["sha256"]
    return {key: value for key, value in summary.items() if key not in volatile}


def arrays_in(folder: Path) -> dict[str, bytes]:
    out = {}
    for path in sorted(folder.rglob("*.npz")):
        with np.load(path) as arrays:
            out |= {f"{path.name}/{name}": arrays[name].tobytes() for name in arrays}
    return out


def of_evaluate(out: Path) -> Any:
    return summary_of(out / SUMMARY_FILE), (out / "frames.csv").read_bytes(), arrays_in(out)


def of_export(out: Path) -> Any:
    return arrays_in(out), (out / "camera.json").read_bytes(), json.loads((out / "export.json").read_text())


def of_batch(out: Path) -> Any:
    files = [out / "summary.json", *sorted(out.glob("jobs/*/summary.json")), *sorted(out.glob("jobs/*/frames.csv"))]
    return {str(path.relative_to(out)): path.read_bytes() for path in files}


def of_cost(out: Path) -> Any:
    """Columns and errors, which do not depend on time."""
    study = json.loads((out / "cost.json").read_text())
    return study["truth"]["columns"], {point["name"]: (point["columns"], point["error"]) for point in study["points"]}


def of_reference(out: Path) -> Any:
    frames = {path.name: path.read_bytes() for path in sorted(out.glob("frame_*.exr"))}
    return frames, (out / "camera.json").read_bytes()


def of_reuse(out: Path) -> Any:
    """Images, the rows of frames but for their times, and scores of samples."""
    images = {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.glob("results/**/*.exr"))}
    with open(out / "frames.csv", newline="") as file:
        rows = [{key: cell for key, cell in row.items() if key != "time_ms"} for row in csv.DictReader(file)]
    assert len(images) == 18 and len(rows) == 6
    return (
        images,
        rows,
        {n: m.get("samples") for n, m in json.loads((out / "reuse.json").read_text())["methods"].items()},
    )


def of_benchmark(out: Path) -> Any:
    return json.dumps(summary_of(out / "benchmark.json", ("times", "provenance")))


def commands(folder: Path) -> dict[str, tuple[list[str], Callable[[Path], Any]]]:
    """name -> command, whose ``OUT`` is the output folder, and the function that reads its results."""
    spec = folder / "spec.toml"
    spec.write_text(
        f'scenes = ["{DEMO}"]\nframes = "0:9"\nsize = "48x27"\ncolumns = ["frustum", "position"]\n'
        'light_unit = "candela"\nexposure = 1\nenvironment = "none"\nreprojection = ["camera", "motion"]\n'
    )
    suite = folder / "suite.toml"
    suite.write_text(
        'schema = "suite/1"\nname = "tiny"\nsize = "48x27"\nframes = 3\nmetrics = ["psnr"]\n'
        '[[cases]]\nscene = "demo"\ntrack = "noisy"\ninput = "noisy"\nseeds = 3\nreference_samples = 1\n'
    )
    sys.path.insert(0, str(ROOT / "tests" / "pathtraced"))
    from cycles_scenes import LAMP, fake_blender, plane

    scene = plane(folder / "plane.glb", [LAMP], keys={"translation": [[0, 0, 0], [1, 0, 0]]})
    program = [sys.executable, "-m", "taubench_gl"]
    return {
        "evaluate": ([*program, "evaluate", str(DEMO), "--frames", "0:9", "--save", "masks", "--out", "OUT", *GEOMETRY],
                     of_evaluate),
        "export": ([*program, "export", str(DEMO), "--frames", "0:9", "--format", "npz", "--out", "OUT",
                    "--size", "64x36", "--channels", "gbuffer,flow"], of_export),
        "batch": ([*program, "batch", "run", str(spec), "--out", "OUT", "--workers", "1", "--chunk", "2"], of_batch),
        "cost": ([*program, "cost", str(DEMO), "--frames", "0:2", "--out", "OUT", "--columns", "direct",
                  "--repeats", "1", "--truth-within", "9", "--time", "1", "--clock", "cpu", *COMMON,
                  "--size", "8x5"], of_cost),
        "reuse": ([*program, "reuse", "evaluate", str(DEMO), "--methods", "accumulate", "--metrics", "psnr", "--video",
                   "none", "--save", "results", "--frames", "0:6", "--input", "noisy", "--indirect", "none", *COMMON,
                   "--out", "OUT"], of_reuse),
        "samples": ([*program, "reuse", "evaluate", str(DEMO), "--methods", "restir-di", "--metrics", "psnr", "--video",
                     "none", "--save", "results", "--frames", "0:6", "--input", "path-traced@1", "--reference",
                     "path-traced@4", *COMMON, "--size", "32x18", "--out", "OUT"], of_reuse),
        "benchmark": ([*program, "benchmark", "none", "accumulate", "--suite", str(suite), "--workers", "1", "--out",
                       "OUT"], of_benchmark),
        "reference": ([sys.executable, "-c", REFERENCE, str(scene), "OUT", fake_blender(folder)], of_reference),
    }  # fmt: skip


def start(command: list[str], out: Path) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [str(out) if word == "OUT" else word for word in command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"LP_NUM_THREADS": "1"},
    )


def kill(process: subprocess.Popen[bytes]) -> bool:
    """Kill a process; whether it still ran.  Its children end too."""
    try:
        children = psutil.Process(process.pid).children(recursive=True)
    except psutil.NoSuchProcess:
        children = []
    process.kill()
    killed = process.wait() < 0
    _, alive = psutil.wait_procs(children, timeout=120)
    assert not alive, alive
    return killed


@pytest.mark.long
@pytest.mark.parametrize("name", ["evaluate", "export", "batch", "cost", "reuse", "samples", "benchmark", "reference"])
def test_kills_at_random_moments(tmp_path, name):
    command, results = commands(tmp_path)[name]
    began = time.perf_counter()
    assert start(command, tmp_path / "undisturbed").wait() == 0
    duration = time.perf_counter() - began
    expected = results(tmp_path / "undisturbed")
    out, moments, kills, ended = tmp_path / "out", random.Random(name), 0, 0
    while kills < KILLS:
        process = start(command, out)
        try:
            process.wait(timeout=duration * moments.uniform(0.1, 1.0))
        except subprocess.TimeoutExpired:
            kills += kill(process)
        else:
            ended += 1
            shutil.rmtree(out)  # complete: nothing is left to do, or to kill
        for summary in [*out.glob(SUMMARY_FILE), *out.glob(f"jobs/*/{SUMMARY_FILE}")]:
            if name == "evaluate" or summary.parent != out:
                assert len(load_run(summary.parent).frames) == 8
    assert start(command, out).wait() == 0
    assert results(out) == expected
    print(f"{name}: {kills} kills, {ended} runs ended before, results equal")


@pytest.mark.long
@pytest.mark.parametrize("name", ["evaluate", "export", "batch", "cost", "reuse", "benchmark", "reference"])
def test_a_second_writer_of_a_folder_ends_with_one_line(tmp_path, name):
    command, _ = commands(tmp_path)[name]
    out = tmp_path / "out"
    with FolderLock(out):
        words = [str(out) if word == "OUT" else word for word in command]
        second = subprocess.run(words, capture_output=True, text=True, timeout=600)
        assert os.listdir(out) == [LOCK_FILE]
    lines = second.stderr.strip().splitlines()
    assert second.returncode != 0 and f"process {os.getpid()} " in lines[-1]
    assert name == "reference" or (second.returncode == 2 and sum("error" in line for line in lines) == 1)
