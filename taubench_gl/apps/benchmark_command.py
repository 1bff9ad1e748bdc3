"""``taubench-gl benchmark``: a suite of cases, a scorecard per method, and two results compared."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.options import OutPath
from taubench_gl.apps.run_by_default import RunByDefault

EXIT_FAILED, EXIT_INTERRUPTED = 2, 130


@click.group(
    cls=RunByDefault,
    epilog="""\b
Examples:
  taubench-gl benchmark --out results
  taubench-gl benchmark svgf ./my_method --out results
  taubench-gl benchmark --suite full --engine dask://node1:8786 --out results
  taubench-gl benchmark plan --suite full --time
  taubench-gl benchmark compare mine/benchmark.json theirs/benchmark.json""",
)
def benchmark() -> None:
    """Evaluate reuse methods on a fixed suite: 'benchmark METHOD... --out DIR' runs it.

    The result is one JSON file and one page: a scorecard per method, rankings, and the speed up to which a method is
    better than no reuse.  Results do not depend on engine and workers, bit for bit, except for times.
    """


def suite_options(command: Any) -> Any:
    """``--suite`` and ``--cases``."""
    for option in reversed(
        (
            click.option("--suite", default="quick", show_default=True, metavar="quick|full|FILE",
                         help="Built-in suite, or a TOML file."),
            click.option("--cases", multiple=True, metavar="PATTERN",
                         help="Only these cases, such as 'demo/rotation=*'; the result is that of another suite."),
        )
    ):  # fmt: skip
        command = option(command)
    return command


@benchmark.command(
    epilog="""\b
Examples:
  taubench-gl benchmark run --out results
  taubench-gl benchmark run taa_clamp@alpha=0.05 my_method.py --suite quick --out results
  taubench-gl benchmark run --suite full --workers 16 --out results

\b
The same command continues an interrupted benchmark; what is stored in DIR does not run again.
docs/benchmark.md defines every number."""
)
@click.argument("methods", nargs=-1, metavar="[METHOD]...")
@suite_options
@click.option("--out", type=OutPath(), required=True, metavar="DIR", help="Folder of the results.")
@click.option("--workers", type=int, metavar="N", help="Worker processes.  [default: one per core]")
@click.option("--engine", metavar="NAME", help="dask://HOST:PORT or dask-local.  [default: worker processes]")
@click.option("--time-limit", type=click.FloatRange(min=0.0, min_open=True), default=1800.0, show_default=True,
              metavar="SECONDS", help="A method that takes longer for a frame has failed.")  # fmt: skip
def run(
    methods: tuple[str, ...],
    suite: str,
    cases: tuple[str, ...],
    out: Path,
    workers: int | None,
    engine: str | None,
    time_limit: float,
) -> int:
    """Run METHODs on a suite and write scorecards to DIR; without METHOD, all built-in ones.

    METHOD is a built-in name, a folder, file.py, module:Class or exr:DIR, with settings as NAME@alpha=0.1.  'none' is
    always included.  A method that fails is ranked last with its reason; the exit code is then 2.
    """
    from taubench_gl.apps.screen import show_tables
    from taubench_gl.apps.study_screen import StudyScreen
    from taubench_gl.benchmark.run import run_benchmark
    from taubench_gl.benchmark.suite import read_suite
    from taubench_gl.report.benchmark import benchmark_tables

    how = {"engine": engine, "workers": workers, "limit": time_limit}
    try:
        with StudyScreen("images") as screen:
            done = run_benchmark(read_suite(suite).part(cases), methods, out, **how, listener=screen)
    except KeyboardInterrupt:
        _error(f"interrupted; finished units are in {out}: the same command continues")
        raise click.exceptions.Exit(EXIT_INTERRUPTED) from None
    show_tables(benchmark_tables(done))
    click.echo(f"written to {out}: benchmark.json, report.html, tables and plots")
    failed = _failures(done)
    for line in failed:
        _error(f"error: {line}")
    return EXIT_FAILED if failed else 0


@benchmark.command(
    epilog="""\b
Examples:
  taubench-gl benchmark plan
  taubench-gl benchmark plan --suite full --time
  taubench-gl benchmark plan none svgf --suite full --cases '*/path-traced@1' --time --workers 16"""
)
@click.argument("methods", nargs=-1, metavar="[METHOD]...")
@suite_options
@click.option("--time", "timed", is_flag=True, help="Estimate the time from a few frames of every input, with METHODs.")
@click.option("--workers", type=click.IntRange(min=1), metavar="N",
              help="Workers of the estimate.  [default: one per core]")  # fmt: skip
def plan(methods: tuple[str, ...], suite: str, cases: tuple[str, ...], timed: bool, workers: int | None) -> None:
    """Print the units of a suite: cases, hashes, scene files.  Makes the scenes; renders nothing without --time.

    Path-traced references are traced in part for the estimate; what is traced is kept.
    """
    from taubench_gl.benchmark.estimate import estimate_units
    from taubench_gl.benchmark.run import BenchmarkStudy, entries_of
    from taubench_gl.benchmark.scenes import scene_file
    from taubench_gl.benchmark.suite import read_suite
    from taubench_gl.study.engines import available_cores
    from taubench_gl.study.estimate import announce

    selected = read_suite(suite).part(cases)
    entries = entries_of(methods)
    units = list(BenchmarkStudy(selected, entries, ".").units.values())
    click.echo(f"{selected.name}: {len(selected.cases)} cases, {len(units)} different; {len(entries)} methods")
    for unit in units:
        case = unit.case
        facts = f"{case.track}, {case.frames} frames, {case.seeds} seeds, reference {case.reference}"
        click.echo(f"  {unit.identity[:8]}  {case.id}: {facts}; scene {unit.sha256[:8]} {scene_file(case.scene)}")
    if timed:
        announce(estimate_units(units, _say), "frames", workers or available_cores(), click.echo)


@benchmark.command(
    epilog="""\b
Examples:
  taubench-gl benchmark compare mine theirs
  taubench-gl benchmark compare mine/benchmark.json theirs/benchmark.json --format markdown"""
)
@click.argument("a", metavar="A.json")
@click.argument("b", metavar="B.json")
@click.option("--format", "form", type=click.Choice(["text", "markdown", "csv", "latex"]), default="text",
              show_default=True, help="Format of the tables.")  # fmt: skip
def compare(a: str, b: str, form: str) -> None:
    """Print two benchmarks of one suite side by side.  Other suites, versions of it or scenes are refused."""
    from taubench_gl.apps.screen import show_tables
    from taubench_gl.benchmark.compare import compared
    from taubench_gl.benchmark.output import load_benchmark
    from taubench_gl.report import FORMATS
    from taubench_gl.report.benchmark import comparison_tables

    one, other = load_benchmark(a), load_benchmark(b)
    tables = comparison_tables(compared(one, other), one["measures"])
    if form == "text":
        show_tables(tables)
    else:
        click.echo(FORMATS[form](tables), nl=False)


def _failures(summary: dict[str, Any]) -> list[str]:
    """One line per method that failed: its first failure."""
    out = []
    for label, method in summary["methods"].items():
        bad = next((state for state in method["tracks"].values() if state["state"] == "failed"), None)
        if bad is not None:
            out.append(f"{label}: {bad['case']}: {bad['reason']}")
    return out


def _say(line: str) -> None:
    click.echo(line, err=True)


def _error(line: str) -> None:
    click.echo(f"taubench-gl: {line}", err=True)
