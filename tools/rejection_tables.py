"""The tables of docs/reject.md, measured by commands of the package: ``TABLES``, for tools/record."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from recorders import DATA, ROOT, taubench

SIZE, SMALL = "640x360", "128x72"
TESTS = (
    "position", "normal", "normal_dot", "relative_depth", "svgf", "plane_distance", "object_id", "velocity",
    "footprint_position", "footprint_plane", "footprint_depth", "relative_depth+normal_dot=0.5",
    "footprint_plane+normal_dot=0.5",
)  # fmt: skip
WALK = ("--translation", "0.1,0.002", "--yaw", "1,0.5", "--pitch", "0.3,0.05")
METHODS = ("velocity", "color_clamp", "normal", "plane_distance", "position", "svgf", "relative_depth",
           "footprint_plane")  # fmt: skip

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

    def _result(self, name: str, step: str, file: str, command: str, *options: str) -> dict[str, Any]:
        folder = self._out / f"{name}-{step}"
        if not (folder / file).exists():
            taubench(*command.split(), self.scene(name), *options, "--out", folder)
        return json.loads((folder / file).read_text())


def table(head: list[str], rows: list[list[str]]) -> str:
    return "\n".join(f"| {' | '.join(row)} |" for row in (["", *head], ["---"] * (len(head) + 1), *rows)) + "\n"


def number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


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


TABLES: dict[str, Callable[[Results], str]] = {"exact": exact_table, "scores": scores_table, "images": images_table}
