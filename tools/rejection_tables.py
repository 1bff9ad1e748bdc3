"""Records of docs/reject.md: scores of rejection tests, and of such tests as gates of reservoirs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from record_files import DATA, DOCS, ROOT, keep_image, number, table, taubench, write_marked

SIZE, SMALL, TINY = "640x360", "128x72", "64x36"
TESTS = (
    "position", "normal", "normal_dot", "relative_depth", "svgf", "plane_distance", "object_id", "velocity",
    "footprint_position", "footprint_plane", "footprint_depth", "relative_depth+normal_dot=0.5",
    "footprint_plane+normal_dot=0.5",
)  # fmt: skip
WALK = ("--translation", "0.1,0.002", "--yaw", "1,0.5", "--pitch", "0.3,0.05")
METHODS = ("velocity", "color_clamp", "normal", "plane_distance", "position", "svgf", "relative_depth",
           "footprint_plane")  # fmt: skip

GATES = ("velocity", "normal", "normal_dot", "svgf", "plane_distance", "object_id", "footprint_plane", "relative_depth",
         "position", "position+normal")  # fmt: skip
GATE_SCENES = ("demo", "fps", "vr")
NO_HISTORY = "restir-di@temporal=false@combination=unbiased@visibility_reuse=true"

SCENES: dict[str, tuple[str, tuple[str, ...]]] = {
    "demo": ("demo", ("--frames", "20:24")),
    "fps": ("valley FPS", ("--fps", "60", "--frames", "20:24")),
    "vr": ("valley VR", ("--fps", "60", "--frames", "20:24")),
    "room": ("room", ("--fps", "60", "--frames", "20:24")),
    "sponza": ("Sponza", ("--camera", "orbit", "--frames", "4:8")),
    "house": ("house", ("--camera", "orbit", "--frames", "4:8")),
}
"""Name -> title and frames.  Exact columns are of 3 pairs; of as many frames the first pair is not scored."""

IMAGES = {
    "house": ("--camera", "orbit", "--frames", "2:9"),
    "fps": ("--fps", "60", "--frames", "18:25"),
    "room": ("--fps", "60", "--frames", "18:25"),
}
"""Scenes whose images are compared, and their frames."""


class Results:
    """Results in a folder; those that are missing are measured."""

    def __init__(self, out: Path):
        self._out = out

    def scene(self, name: str) -> Path:
        """The file of a scene, made if it is derived from another."""
        made = self._out / f"{name}.glb"
        given = {
            "demo": ROOT / "assets" / "demo.glb",
            "sponza": DATA / "sponza" / "Sponza.gltf",
            "house": DATA / "playcanvas" / "house" / "house.glb",
        }
        if name in given:
            return given[name]
        if not made.exists():
            if name == "room":
                taubench("stress", DATA / "godot" / "room" / "room.glb", *WALK, "--out", made)
            else:
                taubench("scenes", "make", f"eternal-valley-{name}", made)
        return made

    def exact(self, name: str) -> dict[str, Any]:
        frames = SCENES[name][1]
        return self._result(name, "exact", "summary.json", "evaluate", *frames, "--size", SIZE, "--exact")

    def scores(self, name: str) -> dict[str, Any]:
        frames = SCENES[name][1]
        tests = ("--tests", ",".join(TESTS))
        return self._result(name, "scores", "reject.json", "reject evaluate", *frames, "--size", SIZE, *tests)

    def images(self, name: str) -> dict[str, Any]:
        folder = self._out / "methods"
        if not folder.exists():
            taubench("reject", "method", "--tests", ",".join(METHODS), "--out", folder)
        methods = ",".join(["accumulate", *(str(folder / f"reject_{test}") for test in METHODS)])
        options = ("--size", SMALL, "--input", "noisy", "--reference", "max", "--reference-samples", "4")
        more = ("--video", "none", "--methods", methods)
        return self._result(name, "images", "reuse.json", "reuse evaluate", *IMAGES[name], *options, *more)

    def gates(self, name: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """Scores of the tests of GATES, and of restir-di with each as the gate of its reservoirs."""
        folder, tests = self._out / "gates", ",".join(GATES)
        frames = SCENES[name][1][:-2]
        scores = self._result(name, "gate-scores", "reject.json", "reject evaluate", *frames, "--frames", "19:26",
                              "--size", TINY, "--tests", tests)  # fmt: skip
        if not folder.exists():
            taubench("reject", "method", "--tests", tests, "--history", "reservoirs", "--out", folder)
        combinations = "@visibility_reuse=true@combination=biased/unbiased"
        methods = [NO_HISTORY, *(f"{folder / gate_of(test)}{combinations}" for test in GATES)]
        options = ("--size", TINY, "--frames", "20:26", "--input", "path-traced@1", "--bounces", "1", "--seeds", "8")
        more = (
            "--reference",
            "path-traced@256",
            "--metrics",
            "psnr",
            "--video",
            "none",
            "--methods",
            ",".join(methods),
        )
        return scores, self._result(name, "gate-images", "reuse.json", "reuse evaluate", *frames, *options, *more)

    def _result(self, name: str, step: str, file: str, command: str, *options: str) -> dict[str, Any]:
        folder = self._out / f"{name}-{step}"
        if not (folder / file).exists():
            taubench(*command.split(), self.scene(name), *options, "--out", folder)
        return json.loads((folder / file).read_text())


def gate_of(test: str) -> str:
    """Name of the method that ``reject method --history reservoirs`` writes for a test."""
    return f"gate_{test.partition('=')[0].replace('+', '_and_')}"


def exact_table(results: Results) -> str:
    found = {name: results.exact(name) for name in SCENES}

    def row(title: str, of: Callable[[dict[str, Any]], float | None], digits: int = 2) -> list[str]:
        return [title, *(number(of(one), digits) for one in found.values())]

    rows = [row("occluded, % of all pixels", lambda s: s["exact"]["occluded"]["mean_percent"])]
    for column in ("position", "normal", "color", "direct", "indirect"):
        rows.append(row(f"{column} discards, %", lambda s, c=column: s["discard"][c]["mean_percent"]))
        share = "of these misregistered, %"
        rows.append(row(share, lambda s, c=column: s["exact"]["misregistered"][c]["share_percent"], 0))
    rows.append(row("occluded and missed by position and normal, %", lambda s: s["exact"]["missed"]["mean_percent"]))
    for change in ("brightened", "darkened", "view_dependent"):
        title = f"{change.replace('_', '-')} points, %"
        rows.append(row(title, lambda s, c=change: s["exact"][c]["mean_percent"]))
    return table([title for title, _ in SCENES.values()], rows)


def scores_table(results: Results) -> str:
    found = [results.scores(name) for name in SCENES]
    counts = [(s["positive"]["visibility"], s["pixels"]["surface"]) for s in found]
    rows = [["positive pixels (share of the scored)", *(f"{p} ({100 * p / of:.2f} %)" for p, of in counts)]]
    for test in TESTS:
        cells = []
        for summary in found:
            scores = summary["tests"][test.partition("=")[0]]["scores"]["visibility"]
            values = (scores["precision"], scores["recall"])
            wrong = number(100.0 * scores["false_positive_rate"], 1)
            cells.append(" / ".join([*(number(value, 2) for value in values), wrong]))
        rows.append([f"`{test}`", *cells])
    return table([title for title, _ in SCENES.values()], rows)


def images_table(results: Results) -> str:
    found = {name: results.images(name)["methods"] for name in IMAGES}

    def of(methods: dict[str, Any], test: str) -> dict[str, Any]:
        return next(one for label, one in methods.items() if Path(label).name in (test, f"reject_{test}"))

    rows = []
    for test in ("accumulate", *METHODS):
        each = [of(methods, test) for methods in found.values()]
        cells = [(m["mean"]["flip"], m["classes"]["disoccluded"]["flip"], m["mean"]["flicker"]) for m in each]
        title = "nothing (`accumulate`)" if test == "accumulate" else f"`{test}`"
        rows.append([title, *(f"{number(a, 3)} / {number(b, 3)} / {number(c, 4)}" for a, b, c in cells)])
    hidden = [of(methods, "accumulate")["classes"]["disoccluded"]["percent"] for methods in found.values()]
    rows.append(["disoccluded pixels, %", *(number(value, 2) for value in hidden)])
    reused = [[of(m, t)["reuse"]["reused_percent"] for t in ("position", "footprint_plane")] for m in found.values()]
    rows.append(["reused by `position` / `footprint_plane`, %", *(f"{a:.1f} / {b:.1f}" for a, b in reused)])
    return table([SCENES[name][0] for name in IMAGES], rows)


def gate_points(results: Results, name: str) -> dict[str, dict[str, Any]]:
    """Of each test of GATES: its recall, and the samples of both combinations by name; and those without history."""
    scores, images = results.gates(name)
    methods = images["methods"].items()
    samples = {label: m["samples"] | {"variance": m["error_parts"]["variance"]["mean"]} for label, m in methods}
    points = {"no history": {"recall": None, "unbiased": samples[NO_HISTORY]}}
    for test in GATES:
        recall = scores["tests"][test.partition("=")[0]]["scores"]["visibility"]["recall"]
        both = {c: samples[f"{gate_of(test)}@visibility_reuse=true@combination={c}"] for c in ("biased", "unbiased")}
        points[test] = {"recall": recall, **both}
    return points


def gates_table(results: Results) -> str:
    rows: dict[str, list[str]] = {}
    for name in GATE_SCENES:
        for test, point in gate_points(results, name).items():
            history = (point["unbiased"]["history"] or {"all": {}})["all"]
            cells = [number(point["recall"], 2), number(history.get("wrong_kept_percent"), 1)]
            cells += [number(point["unbiased"]["variance"], 4)]
            cells += [number(point[c]["bias"]["percent"], 1) if c in point else "-" for c in ("unbiased", "biased")]
            rows.setdefault(test, []).append(" / ".join(cells))
    return table(
        [SCENES[name][0] for name in GATE_SCENES], [[f"`{t}`" if t in GATES else t, *c] for t, c in rows.items()]
    )


def gates_figure(results: Results, path: Path) -> None:
    """Variance and bias of restir-di by the recall of the test that gates its history, a column for each scene."""
    from taubench_gl.report.method_styles import COLORS
    from taubench_gl.report.plot import Plot

    plot = Plot("", 11.0, 6.4, rows=2, columns=len(GATE_SCENES), sharex=True)
    above, below = plot.panels[: len(GATE_SCENES)], plot.panels[len(GATE_SCENES) :]
    for name, top, bottom in zip(GATE_SCENES, above, below, strict=True):
        points = gate_points(results, name)
        plot.title(top, SCENES[name][0])
        alone = points.pop("no history")["unbiased"]["variance"]
        top.axhline(alone, color="black", linewidth=0.9, linestyle=":", label="no history")
        bottom.axhline(0.0, color="black", linewidth=0.9)
        for i, (test, point) in enumerate(points.items()):
            style = {"color": COLORS[i % len(COLORS)], "linestyle": "", "markersize": 7}
            marker = "os^DvPX*<>"[i % 10]
            top.plot(point["recall"], point["unbiased"]["variance"], marker, label=test, **style)
            for combination, face in (("unbiased", "none"), ("biased", None)):
                bias = point[combination]["bias"]
                light = bias["mean"] / bias["percent"]
                ends = [[abs(bias["mean"] - end) / light] for end in (bias["low"], bias["high"])]
                bottom.errorbar(point["recall"], bias["percent"], yerr=ends, marker=marker, elinewidth=0.8,
                                markerfacecolor=face or style["color"], **style)  # fmt: skip
        top.set(ylim=(0, None))
        bottom.set_xlabel("recall of the test")
    above[0].set_ylabel("variance of linear radiance")
    below[0].set_ylabel("bias, % of the light\n(open: unbiased, filled: biased)")
    plot.legend(above[-1])
    plot.save(path)


def rejection(work: Path) -> None:
    """Write three tables of docs/reject.md."""
    results = Results(work)
    for name, make in {"exact": exact_table, "scores": scores_table, "images": images_table}.items():
        write_marked(DOCS / "reject.md", name, make(results))


def gates(work: Path) -> None:
    """Write table and figure of gates in docs/reject.md, in twenty minutes."""
    results = Results(work)
    write_marked(DOCS / "reject.md", "gates", gates_table(results))
    gates_figure(results, work / "gates.png")
    keep_image(work / "gates.png", "gates.png")
