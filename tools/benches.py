"""The framework of the benchmarks: a registry of functions, rows with ratios, claims, and tables.

Samples of the alternatives are interleaved (A, B, A, B, ...) after one discarded round.  The clock is the one that
gpu.timing has verified, and is reported with the numbers.  A time alone depends on the machine, so each row also has
its ratio to the first row of its table.  A row that cannot be measured has the reason instead.
"""

from __future__ import annotations

import argparse
import json
import operator
import os
import platform
import resource
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from taubench_gl.channels import CHANNELS
from taubench_gl.errors import TaubenchError
from taubench_gl.gpu.context import Gpu, open_gpu
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.outputs import write_atomically
from taubench_gl.provenance import provenance

ROOT = Path(__file__).resolve().parents[1]
FPS = 24.0
FULL_SIZE, QUICK_SIZE = (1920, 1080), (640, 360)
EIGHT = tuple(name for name in ("position", "normal", "prev_position", "geometric_normal", "base_color", "material",
                                "emission", "ids") if name in CHANNELS)  # fmt: skip


TESTS = {">=": operator.ge, "<=": operator.le}
CLAIM_HEADS = ("claim", "target", "measured", "spread", "holds")


@dataclass(frozen=True)
class Claim:
    """A statement on speed.  ``measured`` None: not measured, for the reason in ``note``.

    ``low`` and ``high``: 10th and 90th percentile of the samples or rounds.
    """

    what: str
    test: str  # of TESTS
    target: float
    measured: float | None
    low: float | None = None
    high: float | None = None
    unit: str = "x"
    note: str = ""

    @property
    def holds(self) -> bool | None:
        return None if self.measured is None else bool(TESTS[self.test](self.measured, self.target))


def unmeasured(what: str, test: str, target: float, why: str, unit: str = "x") -> Claim:
    """A claim that this run does not measure."""
    return Claim(what, test, target, None, unit=unit, note=why)


def claim_cells(claim: Claim) -> list[str]:
    """The cells of a claim, in the order of CLAIM_HEADS."""
    what = f"{claim.what} ({claim.note})" if claim.note else claim.what
    target = f"{claim.test} {claim.target:g} {claim.unit}"
    if claim.measured is None:
        return [what, target, "–", "–", "not measured"]
    spread = "–" if claim.low is None else f"{claim.low:.3g} to {claim.high:.3g}"
    return [what, target, f"{claim.measured:.3g} {claim.unit}", spread, "yes" if claim.holds else "NO"]


def claim_lines(claims: list[Claim]) -> list[str]:
    """The table as Markdown lines."""
    rows = [CLAIM_HEADS, ["---", "---:", "---:", "---:", "---"], *map(claim_cells, claims)]
    return [f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |" for cells in rows]


@dataclass(frozen=True)
class Row:
    """Milliseconds of one alternative, and its ratio to the table's base row; None if it was not measured."""

    what: str
    median_ms: float | None
    low_ms: float | None  # 10th percentile
    high_ms: float | None  # 90th
    samples: int
    note: str = ""  # if not measured: the reason
    ratio: float | None = None


@dataclass(frozen=True)
class Result:
    """One table.  ``base``: the row with ratio 1; -1: the rows have other ratios, named by ``unit``.

    ``claims``: the statements that this benchmark tests.
    """

    title: str
    rows: list[Row]
    notes: list[str]
    base: int = 0
    unit: str = "ratio"
    claims: tuple[Claim, ...] = ()


@dataclass(frozen=True)
class Options:
    size: tuple[int, int]
    repeats: int
    quick: bool = False
    alone: bool = False  # the only benchmark of this run
    out: Path = field(default_factory=lambda: ROOT / "out" / "bench")

    @property
    def size_text(self) -> str:
        return f"{self.size[0]}x{self.size[1]}"


BENCHES: dict[str, Callable[[Gpu, Options], Result]] = {}
QUICK: list[str] = []


def bench(function: Callable[[Gpu, Options], Result]) -> Callable[[Gpu, Options], Result]:
    """Register a benchmark under the name of its function."""
    BENCHES[function.__name__] = function
    return function


def quick(function: Callable[[Gpu, Options], Result]) -> Callable[[Gpu, Options], Result]:
    """Make a benchmark part of ``tools/bench quick``."""
    QUICK.append(function.__name__)
    return function


def real_scene(*names: str) -> Path:
    """The first of ``names`` that exists in the folder of real scenes; otherwise assets/demo.glb."""
    data = Path(os.environ.get("TAUBENCH_DATA") or ROOT.parent / "shared" / "data")
    for name in names:
        if (data / name).is_file():
            return data / name
    return ROOT / "assets" / "demo.glb"


def row(what: str, samples: list[float], note: str = "") -> Row:
    low, median, high = np.percentile(samples, [10, 50, 90])
    return Row(what, float(median), float(low), float(high), len(samples), note)


def missing(what: str, reason: str) -> Row:
    """A row that this machine cannot measure."""
    return Row(what, None, None, None, 0, reason)


def with_ratios(result: Result) -> Result:
    """``result`` with the ratio of each row to the base, where both are measured and no ratio is given."""
    if result.base < 0 or not result.rows:
        return result
    base = result.rows[result.base].median_ms
    rows = [
        r if r.ratio is not None or not r.median_ms or not base else replace(r, ratio=r.median_ms / base)
        for r in result.rows
    ]
    return replace(result, rows=rows)


def ratios(over: list[float], under: list[float]) -> tuple[float, float, float]:
    """Median of ``over`` / median of ``under``, and the 10th and 90th percentile of the ratios of sample pairs.

    Interleaved samples share the load of the machine, so the ratio of each pair is meaningful.
    """
    each = np.array(over) / np.array(under)
    low, high = np.percentile(each, [10, 90])
    return float(np.median(over) / np.median(under)), float(low), float(high)


def cpu_seconds() -> float:
    """CPU time, seconds, of this process and of the child processes that have ended."""
    return sum(os.times()[:4])


def peak_rss_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


class Stopwatch:
    """Wall-clock milliseconds by name; each sample ends with finish()."""

    def __init__(self, gpu: Gpu):
        self._gpu, self.samples = gpu, defaultdict(list)

    def time(self, name: str, work: Callable[[], object]) -> object:
        self._gpu.finish()
        start = time.perf_counter()
        value = work()
        self._gpu.finish()
        self.samples[name].append((time.perf_counter() - start) * 1e3)
        return value

    def median(self, name: str) -> float:
        return float(np.median(self.samples[name]))


def size_of(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    return int(width), int(height)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="tools/bench", description="Times the passes and prints tables with ratios.")
    choices = [*BENCHES, "quick", "all", "agreement"]
    parser.add_argument("which", nargs="?", default="all", choices=choices, metavar="WHICH", help=", ".join(choices))
    parser.add_argument(
        "--size", type=size_of, metavar="WxH", help="default 1920x1080; quick 640x360, agreement 192x108"
    )
    parser.add_argument("--repeats", type=int, help="rounds after the warm-up (default 3; quick 1)")
    parser.add_argument("--backend", default="auto")
    parser.add_argument("--no-install", action="store_true", help="do not install missing peers into .venv")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the numbers to FILE")
    parser.add_argument("--out", type=Path, help="folder of bench.json and bench.md (default out/bench)")
    group = parser.add_argument_group("agreement (needs Blender as a Python module; not part of all)")
    group.add_argument("--scene", default="room", help="of tools/light_scenes.py (default room)")
    group.add_argument("--converged", type=int, default=256, help="samples of the reference (default 256)")
    options = parser.parse_args(arguments)
    console = Console(soft_wrap=True)
    console.width = max(console.width, 120)  # tables in a pipe or a log are wide
    if options.which == "agreement":
        return agreement(console, options)
    is_quick = options.which == "quick"
    out = options.out or ROOT / "out" / "bench"
    repeats = options.repeats if options.repeats is not None else 1 if is_quick else 3
    size, alone = options.size or (QUICK_SIZE if is_quick else FULL_SIZE), options.which in BENCHES
    names = {"quick": QUICK, "all": list(BENCHES)}.get(options.which, [options.which])
    out.mkdir(parents=True, exist_ok=True)

    def save(report: dict) -> None:
        text = json.dumps(report, indent=2) + "\n"
        for path in (out / "bench.json", options.json):
            if path is not None:
                write_atomically(path, text)
        write_atomically(out / "bench.md", markdown(report))

    run(console, names, Options(size, max(repeats, 1), is_quick, alone, out), options.backend, save)
    console.print(f"written to {out / 'bench.json'} and bench.md", markup=False, highlight=False)
    return 0


def run(console: Console, names: list[str], options: Options, backend: str, save: Callable[[dict], None]) -> None:
    """Run benchmarks one after another and print each; ``save`` gets the report so far after each of them."""
    gpu = open_gpu(backend)
    with gpu:
        origin = provenance(gpu, PassTimer.clock)
        load = os.getloadavg()[0]
        machine = (f"{gpu.renderer}, {gpu.backend}; clock: {origin['clock']}; {os.cpu_count()} cores, load {load:.1f}; "
                   f"Python {platform.python_version()}, NumPy {np.__version__}")  # fmt: skip
        console.print(machine, markup=False)
        results: dict[str, dict] = {}
        claims: list[Claim] = []
        report = {
            "machine": machine, "provenance": origin, "cores": os.cpu_count(), "load": load, "size": list(options.size),
            "repeats": options.repeats, "claims": [], "benches": results,
        }  # fmt: skip
        for name in names:
            started, spent = time.perf_counter(), cpu_seconds()
            try:
                result = with_ratios(BENCHES[name](gpu, options))
            except TaubenchError as error:  # the other benchmarks still run
                result = Result(name, [missing(name, str(error))], [])
            results[name] = asdict(result) | {
                "seconds": time.perf_counter() - started, "cpu_seconds": cpu_seconds() - spent,
                "load": os.getloadavg()[0], "peak_rss_mib": peak_rss_mb(),
            }  # fmt: skip
            claims += result.claims
            report["claims"] = [asdict(claim) | {"holds": claim.holds} for claim in claims]
            show(console, result)
            save(report)
        gpu.check("the benches")
    show_claims(console, claims)


def agreement(console: Console, options: argparse.Namespace) -> int:
    """Run the agreement benchmark, which opens a context per evaluation and also has columns of accuracy."""
    from agreement_bench import SIZE, measure
    from agreement_bench import show as show_costs

    out = options.out or ROOT / "out" / "agreement"
    costs = measure(out, options.scene, options.size or SIZE, options.converged, options.backend)
    show_costs(console, costs)
    if options.json is not None:
        report = {"cores": os.cpu_count(), "benches": {"agreement": asdict(costs)}}
        options.json.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return 0


HEADS = ("median ms", "10 %", "90 %", "samples")


def cells(r: Row | dict) -> list[str]:
    """The cells of a row: name, ratio, milliseconds, samples; dashes and the reason if it was not measured."""
    r = asdict(r) if isinstance(r, Row) else r
    if r["median_ms"] is None:
        return [f"{r['what']}: {r['note']}", "–", "–", "–", "–", "0"]
    ratio = "–" if r["ratio"] is None else f"{r['ratio']:.3g}"
    name = f"{r['what']} ({r['note']})" if r["note"] else r["what"]
    return [name, ratio, *(f"{r[key]:.2f}" for key in ("median_ms", "low_ms", "high_ms")), str(r["samples"])]


def show(console: Console, result: Result) -> None:
    table = Table(title=result.title, title_justify="left")
    table.add_column("")
    for head in (result.unit, *HEADS):
        table.add_column(head, justify="right")
    for r in result.rows:
        table.add_row(*map(escape, cells(r)))
    console.print(table)
    for note in (*result.notes, f"peak resident memory of this process so far: {peak_rss_mb():.0f} MiB"):
        console.print(f"  {note}", markup=False, highlight=False)


def show_claims(console: Console, claims: list[Claim]) -> None:
    if not claims:
        return
    table = Table(title="Claims", title_justify="left")
    for head in CLAIM_HEADS:
        table.add_column(head, justify="left" if head in ("claim", "holds") else "right")
    for claim in claims:
        table.add_row(*map(escape, claim_cells(claim)))
    console.print(table)


def markdown(report: dict) -> str:
    """The tables as Markdown, the claims first."""
    benches = report["benches"].values()
    size, minutes = "x".join(map(str, report["size"])), sum(result["seconds"] for result in benches) / 60
    lines = ["# Speed", "", report["machine"], "", f"{size}, {report['repeats']} rounds, {minutes:.1f} minutes", ""]
    if report["claims"]:
        fields = Claim.__dataclass_fields__
        claims = [Claim(**{name: values[name] for name in fields}) for values in report["claims"]]
        lines += ["## Claims", "", *claim_lines(claims), ""]
    for result in benches:
        lines += [f"## {result['title']}", "", f"| | {result['unit']} | {' | '.join(HEADS)} |", "|---|" + "---:|" * 5]
        lines += [f"| {' | '.join(c.replace('|', '/') for c in cells(r))} |" for r in result["rows"]]
        lines += ["", *(f"- {note}" for note in result["notes"])]
        spent = f"{result['seconds']:.0f} s, {result['cpu_seconds']:.0f} s of CPU time"
        lines += [f"- duration {spent}; load of the machine at the end {result['load']:.1f}", ""]
    return "\n".join(lines)
