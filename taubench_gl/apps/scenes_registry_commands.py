"""``taubench-gl scenes list|show|get|verify``: scenes by name, and where to get them."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import click

registry_option = click.option(
    "--registry",
    "registries",
    type=click.Path(path_type=Path),
    multiple=True,
    help="A TOML file with scenes of your own; may be repeated.  [default: those of TAUBENCH_SCENES]",
)
cache_option = click.option(
    "--cache",
    type=click.Path(path_type=Path),
    help="Keep scenes here.  [default: TAUBENCH_CACHE, else the user's cache]",
)


def _entries(registries: tuple[Path, ...]) -> dict[str, Any]:
    from taubench_gl.datasets.named import registry_entries

    return registry_entries(registries)


@click.command(
    "list",
    epilog="""\b
Examples:
  taubench-gl scenes list
  taubench-gl scenes list --registry mine.toml --json""",
)
@registry_option
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def list_scenes(registries: tuple[Path, ...], as_json: bool) -> None:
    """The scenes that have a name."""
    import msgspec

    entries = _entries(registries)
    if as_json:
        click.echo(json.dumps({name: msgspec.to_builtins(e) for name, e in entries.items()}, indent=2))
        return
    width = max(map(len, entries))
    for name, entry in entries.items():
        click.echo(f"{name:{width}}  {entry.format:12}  {entry.title}")


@click.command(
    epilog="""\b
Examples:
  taubench-gl scenes show eternal-valley-fps"""
)
@click.argument("name")
@registry_option
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def show(name: str, registries: tuple[Path, ...], as_json: bool) -> None:
    """What is known of scene NAME: licence, homepage, units, rate, camera and its rows in the paper."""
    import msgspec

    from taubench_gl.apps.screen import show_pairs
    from taubench_gl.datasets.registry import find_entry

    name, entry = find_entry(_entries(registries), name)
    facts = msgspec.to_builtins(entry)
    if as_json:
        click.echo(json.dumps({"name": name, **facts}, indent=2))
        return
    show_pairs(f"Scene {name}", {key: value if value not in ("", None) else None for key, value in facts.items()})
    if entry.options():
        click.echo(f"  evaluate with      {entry.options()}")


@click.command(
    epilog="""\b
Examples:
  taubench-gl scenes get bart-museum --from museum.zip
  taubench-gl scenes get zero-day --from zeroday.zip --scene MEASURE_ONE.fbx
  taubench-gl scenes get my-scene --registry mine.toml --accept-licence
  taubench-gl evaluate bart-museum
\b
An interrupted download goes on where it stopped.  The checksum of the first download is remembered; a later one that
differs is refused.  Downloading needs the extra 'datasets'; --from needs nothing.  Afterwards the name stands for the
scene wherever a path can, and brings its frame rate, frames, camera and units along; options override them."""
)
@click.argument("name")
@click.option("--from", "source", type=click.Path(path_type=Path), metavar="FILE", help="Take this file.")
@click.option("--url", help="Download from here instead of the registry's address.")
@click.option("--scene", metavar="FILE", help="Which scene of the archive, where it holds several.")
@click.option("--accept-licence", is_flag=True, help="Do not ask.")
@registry_option
@cache_option
def get(
    name: str,
    source: Path | None,
    url: str | None,
    scene: str | None,
    accept_licence: bool,
    registries: tuple[Path, ...],
    cache: Path | None,
) -> None:
    """Download scene NAME into the cache, or take it from a file you have, and print where it is."""
    from taubench_gl.datasets.registry import find_entry
    from taubench_gl.datasets.registry_store import Store
    from taubench_gl.errors import DatasetError

    name, entry = find_entry(_entries(registries), name)
    click.echo(f"{entry.title}, by {entry.authors or 'unknown'}; licence: {entry.licence or 'not stated'}", err=True)
    if not accept_licence:
        if not sys.stdin.isatty():
            raise DatasetError("the licence has not been accepted", hint="add --accept-licence if you accept it")
        click.confirm("Do you accept the licence?", abort=True, err=True)
    store = Store(name, entry, cache)
    if source is not None:
        path = store.take(source, scene)
    else:
        path = store.get(url, _bar() if sys.stderr.isatty() else None, scene)
    click.echo(path)
    # The name works where the registry and the cache are found again without being told.
    if entry.format in ("fbx", "blend"):
        click.echo("the first evaluation converts it, with Blender as a Python module (see: convert --help)", err=True)
    told = f"  (is: {entry.options()})" if entry.options() else ""
    click.echo(f"Tables 1 to 4: taubench-gl evaluate {name}{told}", err=True)
    if registries or cache is not None:
        click.echo("  with TAUBENCH_SCENES and TAUBENCH_CACHE set to what --registry and --cache were here", err=True)


@click.command(
    epilog="""\b
Examples:
  taubench-gl scenes verify bart-museum"""
)
@click.argument("name")
@registry_option
@cache_option
def verify(name: str, registries: tuple[Path, ...], cache: Path | None) -> None:
    """Check that the cached file of scene NAME is still what was fetched."""
    from taubench_gl.datasets.registry import find_entry
    from taubench_gl.datasets.registry_store import Store

    record, scene = Store(*find_entry(_entries(registries), name), cache).verify()
    click.echo(f"{record.file}: {record.bytes} bytes, sha256 {record.sha256}, as fetched")
    click.echo(scene)


def _bar():
    """A progress line on the terminal, one update per megabyte."""

    def show_bytes(have: int, whole: int | None) -> None:
        share = f"{100 * have / whole:5.1f} %" if whole else ""
        click.echo(f"\r{have >> 20} MiB {share}", err=True, nl=whole is not None and have >= whole)

    return show_bytes
