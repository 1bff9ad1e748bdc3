"""How the records of tools/records.py are made; each function writes its files of the checkout.

Results of commands go to a folder that belongs to the present dependencies, so what is there is not measured again.
"""

from __future__ import annotations

import copy
import csv
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from record_files import DEMO, DOCS, ROOT, keep_image, number, table, taubench, write_marked

SCREEN = ("xvfb-run", "-a", "-s", "-screen 0 1440x900x24")
VIEWER_STEPS = "frame 22\nset probe 545,190\nset probe_pinned on\n"
"""What the viewer's image in the gallery shows."""

README_PARTS = (
    (r"\A.*?\n\n", "the headline"),
    (r"^Table 4: .*?^ +Eternal Valley VR .*?\n", "Table 4 up to the second row of the paper"),
    (r"^at half and twice the exposure: .*?\.\n", "the sensitivity to the exposure"),
)
"""Patterns of what the README shows of the output of tools/demo."""


def program(name: str, *options: object) -> Callable[[Path], None]:
    """A recorder that runs a program of tools/, which writes the files itself."""

    def run(work: Path) -> None:
        path = ROOT / "tools" / name
        script = path.read_text(encoding="utf-8").startswith("#!/usr/bin/env bash")
        if subprocess.run([*(() if script else (sys.executable,)), path, *map(str, options)], cwd=ROOT).returncode:
            sys.exit(f"tools/record: tools/{name} failed")

    return run


def command_pages() -> dict[Path, str]:
    import reference_pages

    return reference_pages.pages()


def selftest_pictures(work: Path) -> None:
    from taubench_gl.gpu.context import open_gpu
    from taubench_gl.selftest import pictures
    from taubench_gl.selftest.bench import Bench
    from taubench_gl.selftest.runner import DEFAULT_SIZE

    with open_gpu() as gpu:
        text = json.dumps(pictures.measured(Bench(gpu, DEFAULT_SIZE)), separators=(",", ":"))
    Path(pictures.__file__).with_name(pictures.RECORDED).write_text(text + "\n", encoding="utf-8")


def hard_cases() -> dict[Path, str]:
    from make_hard_cases import PATH, page

    return {PATH: page()}


def assets(work: Path) -> None:
    from conformance_scenes import SCENES as CASES
    from make_assets import demo
    from make_stand_ins import RECIPES, build
    from suite_scenes import SCENES, make_light_scene

    demo().save(DEMO)
    for name, scene in SCENES.items():
        make_light_scene(scene, DEMO.parent / "light" / f"{name}.glb")
    for name, recipe in RECIPES.items():
        build(recipe).save(DEMO.parent / "stand-ins" / f"{name}.glb")
    for name, document in CASES.items():
        document().save(DEMO.parent / "conformance" / f"{name}.glb")


def readme(work: Path) -> None:
    """As tools/demo."""
    printed = taubench(*gallery_command("mask.png", out=work / "demo"), "--verbose")
    write_marked(ROOT / "README.md", "demo", f"```text\n{readme_sample(printed)}```")
    keep_image(work / "demo" / "mask.png", "mask.png")


def readme_sample(printed: str) -> str:
    """The parts of the output of tools/demo that the README shows."""
    parts = []
    for pattern, what in README_PARTS:
        found = re.search(pattern, printed, re.DOTALL | re.MULTILINE)
        if not found:
            sys.exit(f"tools/record: the output of tools/demo lacks {what}")
        parts.append(found.group().strip("\n"))
    return "\n\n".join(parts) + "\n"


def animation(work: Path) -> None:
    """Each frame of the demo beside its masks, at half speed."""
    import numpy as np
    from PIL import Image

    import taubench_gl as tb
    from taubench_gl.report.mask_images import as_bytes, mask_overlay

    pairs = tb.pairs(DEMO, size="320x180", light="preview")
    parts = [
        np.concatenate([as_bytes(p.color[..., :3]), mask_overlay(p.mask, p.color[..., :3])], axis=1) for p in pairs
    ]
    first, *others = map(Image.fromarray, parts)
    first.save(
        DOCS / "images" / "walk.webp", save_all=True, append_images=others, duration=83, loop=0, quality=55, method=6
    )


def gallery_command(image: str, **changed: object) -> list[str]:
    """The arguments of the command that docs/gallery.md prints below an image, with other values of some options."""
    text = (DOCS / "gallery.md").read_text(encoding="utf-8").partition(f"(images/{image})")[2]
    line = text.partition("```sh\ntaubench-gl ")[2].partition("\n```")[0].replace("\\\n", " ")
    words = line.replace(" assets/demo.glb", f" {DEMO}").split()
    for name, value in changed.items():
        option = f"--{name.replace('_', '-')}"
        at = words.index(option) if option in words else len(words)
        words[at : at + 2] = [option, str(value)]
    return words


def gallery(work: Path) -> None:
    for name, text in gallery_numbers(work).items():
        write_marked(DOCS / "gallery.md", name, text)


def gallery_numbers(work: Path) -> dict[str, str]:
    """What docs/gallery.md says below its images: by the printed commands without light, frames and samples that the
    numbers do not depend on.
    """
    geometry = {"columns": "frustum,position,normal", "light": "preview"}
    taubench(*gallery_command("mask.png", **geometry, frames="33:35", out=work / "masks"))
    (row,) = csv.DictReader((work / "masks" / "frames.csv").read_text(encoding="utf-8").splitlines())
    legend = {"off-screen": "outside", "disoccluded": "disoccluded", "newly occluding": "occluding", "normal": "normal"}
    parts = (f"{label} {100 * int(row[name]) / int(row['pixels']):.2f} %" for label, name in legend.items())
    numbers = {"gallery-mask": f"Frame {row['frame']}, the worst: {', '.join(parts)} of the pixels."}
    taubench(*gallery_command("report.png", **geometry, out=work / "report"))
    rate = json.loads((work / "report" / "summary.json").read_text(encoding="utf-8"))["reusable"]["surface"]
    low, high = rate["min_percent"], rate["max_percent"]
    text = f"By geometry, {rate['mean_percent']:.2f} % of the surface pixels can be reused"
    numbers["gallery-report"] = f"{text}, {low:.2f} to {high:.2f} % in a pair."
    steps = work / "steps.txt"
    names = ("probe.position", "threshold.position", "overlay.position")
    steps.write_text(VIEWER_STEPS + "".join(f"print {name}\n" for name in names) + "quit\n")
    printed = taubench(*gallery_command("viewer.png", script=steps), before=SCREEN)
    values = dict(line.split() for line in printed.splitlines() if line.startswith(names))
    distance, threshold, covered = (float(values[name]) for name in names)
    text = f"Frame 22, pixel (545, 190): its position is {distance:.2f} m from its history, more than {threshold:.4f} m"
    numbers["gallery-viewer"] = f"{text}. The mask of position covers {covered:.2f} % of the image."
    taubench(*gallery_command("reuse.jpg", reference="path-traced@1", frames="0:4", out=work / "reuse"))
    methods = json.loads((work / "reuse" / "reuse.json").read_text(encoding="utf-8"))["methods"]
    reused = (f"{name} {m['reuse']['reused_percent']:.1f} %" for name, m in methods.items())
    numbers["gallery-reuse"] = f"Pixels with history in frames 1 to 3: {', '.join(reused)}."
    return numbers


def report_image(work: Path) -> None:
    from playwright.sync_api import sync_playwright

    taubench(*gallery_command("report.png", out=work / "run"))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1180, "height": 1010})
        page.goto((work / "run" / "report.html").as_uri())
        page.wait_for_function("document.images.length === 0 || [...document.images].every((i) => i.complete)")
        page.wait_for_load_state("networkidle")
        page.screenshot(path=work / "report.png")
        browser.close()
    keep_image(work / "report.png", "report.png")


def viewer_image(work: Path) -> None:
    steps, image_file = work / "steps.txt", work / "viewer.png"
    steps.write_text(f"{VIEWER_STEPS}screenshot {image_file} window\nquit\n")
    taubench(*gallery_command("viewer.png", window="1280x720", script=steps), before=SCREEN)
    keep_image(image_file, "viewer.png")


def eyes_image(work: Path) -> None:
    steps, image_file = work / "steps.txt", work / "eyes.png"
    shown = ("against history", "comparison difference", "beside on", "section.effects off", "show.direct on")
    lines = ["frame 24", *(f"set {name}" for name in shown), f"screenshot {image_file} window", "quit"]
    steps.write_text("\n".join(lines) + "\n")
    how = ("--size", "480x270", "--history", "eye", "--eyes", "0.12", "--lighting", "--window", "1400x800")
    taubench("view", DEMO, *how, "--script", steps, before=SCREEN)
    keep_image(image_file, "eyes.png")


_VALLEY = ("--pairs", "every:24", "--light-within", "3")
EYE_SCENES = {"demo": ("--pairs", "every:6"), "eternal-valley-fps": _VALLEY, "eternal-valley-vr": _VALLEY}
"""Scenes of docs/other-eye.md, and which pairs and how many samples are taken."""


def other_eye(work: Path) -> None:
    """An hour of two CPU cores."""
    for name, how in EYE_SCENES.items():
        scene = DEMO if name == "demo" else work / f"{name}.glb"
        if not scene.exists():
            taubench("scenes", "make", name, scene)
        for history in ("frame", "eye", "both"):
            out = work / f"{name}-{history}"
            if not (out / "summary.json").exists():
                taubench("evaluate", scene, "--out", out, "--history", history, "--size", "320x180", *how)
    write_marked(DOCS / "other-eye.md", "other-eye", other_eye_tables(work))


def other_eye_tables(work: Path) -> str:
    """Table 4 with the headline, reasons, and where they come from, of finished runs."""
    columns = ("frustum", "color", "position", "normal", "direct", "indirect")
    reasons = {"outside": "off-screen", "disoccluded": "disoccluded", "occluding": "newly occluding",
               "position": "position", "normal": "normal", "lit": "brightened", "shadowed": "darkened"}  # fmt: skip
    histories = {"frame": "last frame", "eye": "other eye", "both": "both"}
    rates, why, facts = [], [], []
    for name, how in EYE_SCENES.items():
        for history, label in histories.items():
            text = (work / f"{name}-{history}" / "summary.json").read_text(encoding="utf-8")
            summary = json.loads(text)
            reusable, sampling = summary["reusable"], summary["sampling"]
            surface = reusable["surface"]["mean_percent"], sampling["reusable"]["surface"]["half_width_points"]
            cells = [f"{surface[0]:.1f} ± {surface[1]:.1f}", _estimate(reusable["shading"])]
            for column in columns:
                of_pairs = sampling["columns"].get(column)
                cells.append(_estimate(of_pairs or summary["discard"][column]))
            rates.append(f"| {name} | {label} | {' | '.join(cells)} |")
            shares = {key: reusable["reasons"][key]["mean_percent"] for key in reusable["reasons"]}
            rest = sum(share for key, share in shares.items() if key not in reasons)
            cells = [f"{share:.2f}" for share in (*(shares[key] for key in reasons), rest)]
            why.append(f"| {name} | {label} | {reusable['shading']['mean_percent']:.2f} | {' | '.join(cells)} |")
        made, camera, scene = summary["provenance"], summary["camera"], summary["scene"]
        facts.append(
            f"- {name}: `--size 320x180 {' '.join(how)}`, {summary['pairs']} pairs; per frame the camera moves "
            f"{camera['position']['mean']:.3f} m and turns {camera['angle']['mean']:.2f}°; SHA-256 of the scene "
            f"`{scene['sha256'][:16]}`; taubench-gl {made['version']}, {made['renderer'].partition(' (')[0]}, "
            f"OpenGL {made['driver']}."
        )
    heads = ["scene", "history", "reusable surface", "reusable shading", *columns]
    first = [f"| {' | '.join(heads)} |", "| --- " * len(heads) + "|", *rates]
    heads = ["scene", "history", "reusable", *reasons.values(), "other"]
    second = [f"| {' | '.join(heads)} |", "| --- " * len(heads) + "|", *why]
    text = "Why surface pixels are not reusable, % of surface pixels; a pixel counts once, under its first reason:"
    return "\n".join([*first, "", text, "", *second, "", "Made by `tools/record other-eye`:", "", *facts])


def _estimate(entry: dict[str, Any]) -> str:
    """A share with half the width of its interval."""
    low, high = entry["interval95_percent"]
    return f"{entry['mean_percent']:.1f} ± {0.5 * (high - low):.1f}"


def reuse_image(work: Path) -> None:
    taubench(*gallery_command("reuse.jpg", out=work / "reuse"))
    keep_image(work / "reuse" / "side_by_side.png", "reuse.jpg")


def reject_image(work: Path) -> None:
    taubench("demo", "ground", "--out", work)
    keep_image(next(work.glob("*-ground.png")), "reject.png")


SAMPLED = {
    "demo": ("demo", ("--frames", "20:26")),
    "many_lights": ("many_lights", ("--light-unit", "watt", "--environment", "none", "--frames", "0:6")),
    "emitters": ("emitters", ("--light-unit", "watt", "--environment", "none", "--frames", "0:6")),
    "eternal-valley-fps": ("valley FPS", ("--fps", "60", "--frames", "20:26")),
}
"""Scenes of the record ``light-samples`` and their options."""


def light_samples(work: Path) -> None:
    """Half an hour."""
    import numpy as np

    from taubench_gl.benchmark.scenes import SceneRecipe, scene_file
    from taubench_gl.metrics.bootstrap import student_interval

    methods = ["ris", "restir-di", "restir-di@combination=unbiased"]
    methods += [f"restir-di@combination={name}@visibility_reuse=true" for name in ("unbiased", "biased")]
    options = ("--size", "64x36", "--input", "path-traced@1", "--bounces", "1", "--seeds", "8", "--metrics", "psnr",
               "--reference", "path-traced@256", "--video", "none", "--methods", ",".join(methods))  # fmt: skip
    rows = []
    for name, (title, more) in SAMPLED.items():
        out = work / name
        if not (out / "reuse.json").exists():
            taubench("reuse", "evaluate", scene_file(SceneRecipe(name)), *more, *options, "--out", out)
        of = json.loads((out / "reuse.json").read_text())["methods"]
        with (out / "frames.csv").open(encoding="utf-8") as file:
            frames = list(csv.DictReader(file))
        seeds, cells = int(frames[-1]["seed"]) + 1, []
        errors = {label: np.zeros(seeds) for label in methods}
        for row in frames:
            if row["frame"] != frames[0]["frame"]:  # which has no history
                errors[row["method"]][int(row["seed"])] += float(row["linear_mse"])
        for label in methods[1:]:
            rays, base = (of[m]["samples"]["per_pixel"]["shadow_rays"] for m in (label, methods[0]))
            gain = student_interval(np.log(errors[methods[0]] / errors[label] * base / rays))
            low, mean, high = (number(float(np.exp(v)), 2) for v in (gain.low, gain.estimate, gain.high))
            bias = number(of[label]["samples"]["bias"]["percent"], 1)
            cells.append(f"{number(rays / base, 1)}: {mean} ({low} to {high}), {bias} %")
        rows.append([title, *cells])
    head = ["pairwise (default)", "1/Z", "1/Z, visibility reuse", "biased, visibility reuse"]
    write_marked(DOCS / "reuse-evaluation.md", "light-samples", table(head, rows))


def cost(work: Path) -> None:
    """Ten minutes: the study itself continues what an earlier call began."""
    size = ("--size", "32x18", "--frames", "20:23", "--clock", "cpu", "--truth-within", "0.5", "--time", "none")
    taubench("cost", "assets/demo.glb", "--out", work / "demo", *size)
    keep_image(work / "demo" / "cost.png", "cost-demo.png")
    study = json.loads((work / "demo" / "cost.json").read_text(encoding="utf-8"))
    write_marked(DOCS / "cost.md", "cost", "\n".join(["```", *study["lines"], "```"]))


def sampled_light(work: Path) -> None:
    """Half an hour, the images too."""
    stored, demo = work / "sampled-light.npz", ROOT / "assets" / "demo.glb"
    work.mkdir(parents=True, exist_ok=True)
    if not stored.is_file():
        program("sampled_light_study", "decide", stored, demo)(work)
    picture = DOCS / "images" / "sampled-light.png"
    program("sampled_light_study", "figure", picture, stored, demo, "bidirectional=true")(work)


BATCH = 'scenes = ["scene.glb"]\nsize = "320x180"\nframes = "0:9"\nreprojection = ["camera", "motion"]\n'
FIRST = {
    "compare": "evaluate scene.glb --reprojection motion --light preview --out other-results",
    "evaluate exr:renders": "export scene.glb --out renders --frames 0:25 --channels gbuffer,radiance,flow,masks",
}
"""Start of a command of the README -> what writes its input; its time is no row."""
ENDED = (-9, 137)  # exit codes of timeout where it has killed the command


def command_times(work: Path, limit: float = 600.0) -> None:
    """Half an hour: the README's commands in its order, but for windows and tools; those that take longer are ended.

    Later commands read what earlier ones wrote.  A call with a larger ``limit`` measures again what was ended.
    """
    blocks = re.findall(r"```sh\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    lines = [line.split("#")[0].strip().removeprefix("taubench-gl ") for line in "".join(blocks).splitlines()]
    shutil.copy(DEMO, work / "scene.glb")
    (work / "batch.toml").write_text(BATCH)
    kept, rows = work / "seconds.json", ["| command | first line | end |", "| --- | ---: | ---: |"]
    times = json.loads(kept.read_text()) if kept.is_file() else {}
    for line in lines:
        if not line or re.search(r"^view|--view|^tools/", line):
            continue
        first, end, done = times.get(line, (0.0, 0.0, False))
        if not done and end < limit:
            for before in (before for start, before in FIRST.items() if line.startswith(start)):
                seconds(before, work, 3600.0)
            first, end, done = times[line] = seconds(line, work, limit)
            kept.write_text(json.dumps(times))
        rows.append(f"| `{line}` | {first:.1f} | {'' if done else '> '}{end:.0f} |")
    write_marked(DOCS / "speed.md", "command-times", "\n".join(rows))


def seconds(line: str, work: Path, limit: float) -> tuple[float, float, bool]:
    """To the first line on standard output or standard error, and to the end; whether the command ended by itself."""
    start, first = time.monotonic(), None
    run = ["timeout", "-s", "KILL", f"{limit}", sys.executable, "-u", "-m", "taubench_gl", *line.split()]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(run, cwd=work, env=os.environ | {"PYTHONPATH": str(ROOT)}, **pipes) as process:
        for _ in process.stdout:
            first = first or time.monotonic() - start
    if process.returncode not in (0, 1, *ENDED):
        sys.exit(f"tools/record: exit code {process.returncode}: {line}")
    end = time.monotonic() - start
    return first or end, end, process.returncode not in ENDED


DIGITS = 6
LEFT_OUT = ("bound", "classes", "reuse", "reasons")
"""Blocks of single cases that the record of the benchmark does not hold."""
BENCHMARK = """# Benchmark: the quick suite with all built-in methods

`taubench-gl benchmark --out DIR`, recorded by `tools/record benchmark`; [benchmark.md](benchmark.md) defines every
number. The file `benchmark-quick.json` beside this page is the result, with six digits and without the differences of
all pairs and the blocks `bound`, `classes`, `reuse` of single cases; `taubench-gl benchmark compare` takes it.

{about} The units took {seconds:.0f} s of worker time together, on two workers.

"""


def benchmark(work: Path) -> None:
    from taubench_gl.benchmark.output import load_benchmark
    from taubench_gl.report.benchmark import benchmark_tables
    from taubench_gl.report.table import to_markdown

    taubench("benchmark", "--out", work, fine=(0, 2))  # 2: a method failed, which is part of the result
    summary = load_benchmark(work)
    made = summary["provenance"]
    about = f"taubench-gl {made['version']} on {made['renderer']}, {made['driver']}."
    # A case of equal hash is measured once.
    seconds = {case["sha256"]: summary["times"]["seconds"][name] for name, case in summary["cases"].items()}
    text = BENCHMARK.format(about=about, seconds=sum(seconds.values())) + to_markdown(benchmark_tables(summary))
    (DOCS / "benchmark-quick.md").write_text(text, encoding="utf-8")
    record = json.dumps(rounded(shortened(summary)), separators=(",", ":"))
    (DOCS / "benchmark-quick.json").write_text(record + "\n", encoding="utf-8")


def rounded(value: Any) -> Any:
    """Numbers with ``DIGITS`` significant digits."""
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, dict):
        return {key: rounded(one) for key, one in value.items()}
    return [rounded(one) for one in value] if isinstance(value, list) else value


def shortened(summary: dict[str, Any]) -> dict[str, Any]:
    """The result without what neither the page nor ``benchmark compare`` reads: less than half of it."""
    out = copy.deepcopy(summary)
    for of_track in out["rankings"].values():
        for ranking in of_track.values():
            ranking.pop("differences", None)
    for method in out["methods"].values():
        for cell in method["cases"].values():
            for name in LEFT_OUT:
                cell.pop(name, None)
    return out
