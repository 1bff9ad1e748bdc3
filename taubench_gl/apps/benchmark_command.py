"""``taubench-gl benchmark``: a suite of cases, a scorecard per method, and two results compared."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.aliases import Group
from taubench_gl.apps.options import OutPath

EXIT_FAILED, EXIT_INTERRUPTED = 2, 130


class _RunByDefault(Group):
    """``benchmark svgf --out DIR`` is ``benchmark run svgf --out DIR``."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            args = ["run", *args]
        return super().parse_args(ctx, args)


@click.group(
    cls=_RunByDefault,
    epilog="""\b
Examples:
  taubench-gl benchmark --out results
  taubench-gl benchmark svgf ./my_method --out results
  taubench-gl benchmark --suite full --engine dask://node1:8786 --out results
  taubench-gl benchmark plan --suite full
  taubench-gl benchmark compare mine/benchmark.json theirs/benchmark.json""",
)
def benchmark() -> None:
    """Evaluate reuse methods on a fixed suite: 'benchmark METHOD... --out DIR' runs it.

    The result is one JSON file and one page: a scorecard per method, rankings, and the speed up to which a method is
    better than no reuse.  Results do not depend on engine and workers, bit for bit, except for times.
    """


suite_option = click.option(
    "--suite", default="quick", show_default=True, metavar="quick|full|FILE", help="Built-in suite, or a TOML file."
)


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
@suite_option
@click.option("--out", type=OutPath(), required=True, metavar="DIR", help="Folder of the results.")
@click.option("--workers", type=int, metavar="N", help="Worker processes.  [default: one per core]")
@click.option("--engine", metavar="NAME", help="dask://HOST:PORT or dask-local.  [default: worker processes]")
def run(methods: tuple[str, ...], suite: str, out: Path, workers: int | None, engine: str | None) -> int:
    """Run METHODs on a suite and write scorecards to DIR; without METHOD, all built-in ones.

    METHOD is a built-in name, a folder, file.py, module:Class or exr:DIR, with settings as NAME@alpha=0.1.  'none' is
    always included.  A method that fails is ranked last with its reason; the exit code is then 2.
    """
    from taubench_gl.apps.screen import show_tables
    from taubench_gl.benchmark.run import run_benchmark
    from taubench_gl.benchmark.suite import read_suite
    from taubench_gl.report.benchmark import benchmark_tables

    try:
        done = run_benchmark(read_suite(suite), methods, out, engine=engine, workers=workers, say=_say)
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
  taubench-gl benchmark plan --suite full"""
)
@suite_option
def plan(suite: str) -> None:
    """Print the cases of a suite, and the hashes and files of their scenes.  Makes the scenes; renders nothing."""
    from taubench_gl.benchmark.run import plan as units_of
    from taubench_gl.benchmark.scenes import scene_file
    from taubench_gl.benchmark.suite import read_suite

    found = read_suite(suite)
    units = units_of(found, (), _say)
    click.echo(f"{found.name}: {len(found.cases)} cases, {len(units)} different")
    for unit in units:
        case = unit.case
        what = f"{case.track}, {case.frames} frames, {case.seeds} seeds, reference {case.reference}"
        click.echo(f"  {unit.identity[:8]}  {case.id}: {what}; scene {unit.sha256[:8]} {scene_file(case.scene)}")


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
