"""``taubench-gl benchmark``: a suite of cases, a scorecard per method, and two results compared."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.options import Commands, command
from taubench_gl.apps.screen import TABLE_FORMATS, interruptible, note, show_tables, warn
from taubench_gl.fields import REQUIRED, above_zero, at_least, one_of, setting
from taubench_gl.settings import OUTPUT

SUITE = setting("quick", "Built-in suite, or a TOML file", metavar="quick|full|FILE")
CASES = setting(
    (),
    "Only these cases, such as 'demo/rotation=*'; the result is that of another suite",
    metavar="PATTERN",
    repeats=True,
)


@click.group(cls=Commands, default="run")
def benchmark() -> None:
    """Evaluate reuse methods on a fixed suite: 'benchmark METHOD... --out DIR' runs it.

    The result is one JSON file and one page: a scorecard per method, rankings, and the speed up to which a method is
    better than no reuse.  Results do not depend on workers, bit for bit, except for times.

    Examples:
      taubench-gl benchmark --out results
      taubench-gl benchmark svgf ./my_method --out results
      taubench-gl benchmark plan --suite full
      taubench-gl benchmark compare mine/benchmark.json theirs/benchmark.json
    """


@command()
@click.argument("methods", nargs=-1, metavar="[METHOD]...")
def run(
    methods: tuple[str, ...],
    *,
    suite: str = SUITE,
    cases: tuple[str, ...] = CASES,
    out: Path = setting(REQUIRED, "Folder of the results", group=OUTPUT, metavar="DIR"),
    workers: int | None = setting(
        None, "Worker processes; 0: none, all in this process", at_least(0), short=True, shown="one per core"
    ),
    time_limit: float = setting(
        1800.0, "A method that takes longer for a frame has failed", above_zero(), metavar="SECONDS"
    ),
) -> int:
    """Run METHODs on a suite and write scorecards to DIR; without METHOD, all built-in ones.

    METHOD is a built-in name, a folder, file.py, module:Class or exr:DIR, with settings as NAME@alpha=0.1.  'none' is
    always included, and 'present-last' beside methods that generate frames, which have a track of their own.  A method
    that fails is ranked last with its reason; the exit code is then 2.

    Examples:
      taubench-gl benchmark run --out results
      taubench-gl benchmark run taa_clamp@alpha=0.05 my_method.py --suite quick --out results
      taubench-gl benchmark run extrapolate interpolate --cases '*/full' --out results
      taubench-gl benchmark run --suite full --workers 16 --out results

    The same command continues an interrupted benchmark; what is stored in DIR does not run again.
    docs/benchmark.md defines every number.
    """
    from taubench_gl.apps.progress import StudyScreen
    from taubench_gl.benchmark.run import run_benchmark
    from taubench_gl.benchmark.suite import read_suite
    from taubench_gl.report.benchmark import benchmark_tables

    selected, kept = read_suite(suite).part(cases), f"finished units are in {out}: the same command continues"
    with interruptible(lambda: kept), StudyScreen("images") as screen:
        done = run_benchmark(selected, methods, out, workers=workers, limit=time_limit, listener=screen)
    show_tables(benchmark_tables(done))
    click.echo(f"written to {out}: benchmark.json, report.html, tables and plots")
    failed = _failures(done)
    for line in failed:
        warn(f"error: {line}")
    return 2 if failed else 0


@command()
@click.argument("methods", nargs=-1, metavar="[METHOD]...")
def plan(
    methods: tuple[str, ...],
    *,
    suite: str = SUITE,
    cases: tuple[str, ...] = CASES,
) -> None:
    """Print the units of a suite: cases, hashes, scene files.  Makes the scenes; renders nothing.

    Examples:
      taubench-gl benchmark plan
      taubench-gl benchmark plan none svgf --suite full --cases '*/path-traced@1'
    """
    from taubench_gl.benchmark.run import BenchmarkStudy, entries_of, runnable
    from taubench_gl.benchmark.scenes import scene_file
    from taubench_gl.benchmark.suite import read_suite

    selected = runnable(read_suite(suite).part(cases), note)
    entries = entries_of(methods)
    units = list(BenchmarkStudy(selected, entries, ".").units.values())
    click.echo(f"{selected.name}: {len(selected.cases)} cases, {len(units)} different; {len(entries)} methods")
    for unit in units:
        case, request = unit.case, unit.case.request
        facts = f"{case.track}, {case.frames} frames, {request.seeds} seeds, reference {request.reference}"
        click.echo(f"  {unit.identity[:8]}  {case.id}: {facts}; scene {unit.sha256[:8]} {scene_file(case.scene)}")


@command()
@click.argument("a", metavar="A.json")
@click.argument("b", metavar="B.json")
def compare(
    a: str,
    b: str,
    *,
    form: str = setting("text", "Format of the tables", one_of(TABLE_FORMATS[:-1]), flag="--format"),
) -> None:
    """Print two benchmarks of one suite side by side.  Other suites, versions of it or scenes are refused.

    Examples:
      taubench-gl benchmark compare mine theirs
      taubench-gl benchmark compare mine/benchmark.json theirs/benchmark.json --format markdown
    """
    from taubench_gl.benchmark.output import compared, load_benchmark
    from taubench_gl.report.benchmark import comparison_tables

    result_a, result_b = load_benchmark(a), load_benchmark(b)
    show_tables(comparison_tables(compared(result_a, result_b), result_a["measures"]), form)


def _failures(summary: dict[str, Any]) -> list[str]:
    """One line per method that failed: its first failure."""
    out = []
    for label, method in summary["methods"].items():
        bad = next((state for state in method["tracks"].values() if state["state"] == "failed"), None)
        if bad is not None:
            out.append(f"{label}: {bad['case']}: {bad['reason']}")
    return out


for member in (run, plan, compare):
    benchmark.add_command(member)
