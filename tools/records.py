"""Recorded results of the repository: what each depends on, which are stale, and how they are made (tools/record).

A record is *stale* if a file that it depends on has changed since it was made, or, where making it is cheap, if making
it gives another text.  ``tools/records.json`` keeps a hash of each dependency at that time.  A stale record need not
differ: ``--unchanged`` says so, for instance after tools/compare_checkouts.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
HASHES = ROOT / "tools" / "records.json"
if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))

import recorders as by  # noqa: E402
from rejection_tables import gates, rejection  # noqa: E402

SOURCES = (
    "taubench_gl/scene", "taubench_gl/animation", "taubench_gl/settings.py",
    "taubench_gl/setting_values.py", "taubench_gl/conventions.py",
    "taubench_gl/features.py",
)  # fmt: skip
FRAME = (
    *SOURCES, "taubench_gl/gpu", "taubench_gl/effects", "taubench_gl/frame", "taubench_gl/evaluation", "shaders/color",
    "shaders/common", "shaders/deform", "shaders/gbuffer", "shaders/indirect", "shaders/lighting", "shaders/masks",
    "shaders/shadow",
)  # fmt: skip
"""Rasterized frames, masks and counts."""
RAYS = ("shaders/pathtracing", "shaders/raytracing", "shaders/visibility")
REUSE = ("taubench_gl/reuse", "shaders/reuse")
DEMO = "assets/demo.glb"


@dataclass(frozen=True)
class Record:
    """One recorded result."""

    name: str
    files: tuple[str, ...]
    """What is recorded: files or folders, relative to the checkout."""
    depends: tuple[str, ...] = ()
    """Files and folders that it follows from.  Folders count with all files below."""
    make: Callable[[Path], None] | None = None
    """Writes ``files``; its argument is a folder for results of commands, which an interrupted call finds again.  None:
    the page says by what it was measured, and numbers are copied by hand."""
    contents: Callable[[], Mapping[Path, str]] | None = None
    """Of a record that is cheap to make, instead of both: path -> text.  It is current if its files have this text."""


@dataclass(frozen=True)
class Records:
    """All records of a checkout, and the file with the hashes of their dependencies."""

    every: Sequence[Record]
    root: Path = ROOT
    hashes: Path = HASHES

    def kept(self) -> dict[str, dict[str, str]]:
        """Record -> dependency -> hash when it was made.  Read each time: two programs may make different records."""
        return json.loads(self.hashes.read_text(encoding="utf-8"))

    def named(self, names: Sequence[str]) -> list[Record]:
        """In the order of declaration: a record may depend on files of those before it."""
        unknown = sorted(set(names) - {r.name for r in self.every})
        if unknown:
            sys.exit(f"tools/record: no record is named {', '.join(unknown)}; tools/record lists them")
        return [r for r in self.every if r.name in names]

    def changed(self, record: Record) -> list[str]:
        """The dependencies, or for a cheap record the files, that make it stale; empty if it is current."""
        if record.contents:
            others = [p for p, text in record.contents().items() if not p.exists() or p.read_text("utf-8") != text]
            return [str(p.relative_to(self.root)) for p in others]
        kept = self.kept().get(record.name, {})
        return [path for path, digest in self.digests(record).items() if kept.get(path) != digest]

    def digests(self, record: Record) -> dict[str, str]:
        """Dependency -> hash of its present content."""
        return {path: self.digest(path) for path in record.depends}

    def digest(self, path: str) -> str:
        at, out = self.root / path, hashlib.sha256()
        for file in [at] if at.is_file() else sorted(p for p in at.rglob("*") if p.is_file()):
            if "__pycache__" not in file.parts:
                out.update(f"{file.relative_to(self.root)}\0{hashlib.sha256(file.read_bytes()).hexdigest()}\n".encode())
        return out.hexdigest()[:12]

    def keep(self, record: Record, digests: dict[str, str]) -> None:
        """Set the hashes of ``record``."""
        if record.depends:
            kept = self.kept() | {record.name: digests}
            lines = [f"{json.dumps(r.name)}: {json.dumps(kept[r.name])}" for r in self.every if r.name in kept]
            self.hashes.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")

    def make(self, record: Record, work: Path) -> None:
        """Write the files of ``record``, then its hashes, which are those of the start."""
        digests = self.digests(record)
        if record.contents:
            for path, text in record.contents().items():
                path.write_text(text, encoding="utf-8")
        elif record.make:
            folder = work / f"{record.name}-{hashlib.sha256(repr(digests).encode()).hexdigest()[:12]}"
            folder.mkdir(parents=True, exist_ok=True)
            record.make(folder)
        else:
            sys.exit(f"tools/record: {record.name} is copied by hand into {', '.join(record.files)}; then: --unchanged")
        self.keep(record, digests)


EVERY = (
    Record(
        "commands", ("docs/commands", "docs/api.md", "docs/glossary.md", "docs/repairs.md"), contents=by.command_pages
    ),
    Record("hard-cases", ("docs/hard-cases.md",), contents=by.hard_cases),
    Record(
        "assets", (DEMO, "assets/light", "assets/conformance", "assets/stand-ins"),
        (*(f"tools/{name}.py" for name in (
            "make_assets", "make_stand_ins", "valley", "figures", "conformance_scenes", "suite_scenes", "light_kit",
            "shapes",
        )), "taubench_gl/datasets/gltf_writer.py"), by.assets,
    ),
    # What is drawn; how it is drawn is what the goldens test.  Look at them before a commit.
    Record("goldens", ("tests/goldens",), ("tests/frame/golden_cases.py", DEMO), by.program("make_goldens.py")),
    Record(
        "selftest-pictures", ("taubench_gl/selftest/pictures.json",), ("taubench_gl/selftest/pictures.py", DEMO),
        by.selftest_pictures,
    ),
    Record(
        "cycles-references", ("tests/pathtraced/references", "tests/pathtraced/light_transport"),
        ("tools/cycles_references", "tools/light_transport_scenes.py", "tools/suite_scenes.py",
         "tests/pathtraced/reference_scenes.py"),
        by.program("cycles_references"),
    ),
    Record(
        "blender-references", ("tests/pathtraced/blender_lights",), ("tools/blender_scenes.py",),
        by.program("blender_references"),
    ),
    Record(
        "numerics", ("tests/selftest/numerics.json",),
        (*FRAME, *RAYS, "taubench_gl/selftest", "tests/selftest/guards.py"), by.program("make_numerics.py"),
    ),
    Record("readme", ("README.md", "docs/images/mask.png"), (DEMO, *FRAME, "taubench_gl/metrics"), by.readme),
    Record("animation", ("docs/images/walk.webp",), (DEMO, *FRAME, "taubench_gl/report"), by.animation),
    Record("report-image", ("docs/images/report.png",), (DEMO, *FRAME, "taubench_gl/report"), by.report_image),
    Record(
        "gallery", ("docs/gallery.md",),
        (DEMO, *FRAME, *REUSE, "taubench_gl/viewer", "shaders/pathtracing", "shaders/raytracing"), by.gallery,
    ),
    Record(
        "viewer-image", ("docs/images/viewer.png",), (DEMO, *FRAME, "taubench_gl/viewer", "shaders/viewer"),
        by.viewer_image,
    ),
    Record(
        "eyes-image", ("docs/images/eyes.png",), (DEMO, *FRAME, "taubench_gl/viewer", "shaders/viewer"), by.eyes_image
    ),
    Record("other-eye", ("docs/other-eye.md",), (DEMO, *FRAME, *RAYS, "taubench_gl/datasets"), by.other_eye),
    Record("reuse-image", ("docs/images/reuse.jpg",), (DEMO, *FRAME, *RAYS, *REUSE), by.reuse_image),
    Record(
        "reject-image", ("docs/images/reject.png",), (*FRAME, "taubench_gl/demos/lessons/ground.py"), by.reject_image
    ),
    Record(
        "rejection", ("docs/reject.md",),
        (DEMO, *FRAME, *RAYS, *REUSE, "taubench_gl/reject", "shaders/reject", "taubench_gl/datasets"), rejection,
    ),
    Record(
        "gates", ("docs/reject.md", "docs/images/gates.png"),
        (DEMO, *FRAME, *RAYS, *REUSE, "taubench_gl/reject", "shaders/reject", "taubench_gl/datasets"), gates,
    ),
    Record(
        "light-samples", ("docs/reuse-evaluation.md",),
        (DEMO, *FRAME, *RAYS, *REUSE, "taubench_gl/datasets"), by.light_samples,
    ),
    Record(
        "benchmark", ("docs/benchmark-quick.md", "docs/benchmark-quick.json"),
        (DEMO, *FRAME, *RAYS, *REUSE, "taubench_gl/benchmark", "taubench_gl/datasets"), by.benchmark,
    ),
    Record(
        "bmfr-authors", ("docs/reuse-evaluation.md", "docs/images/bmfr.jpg", "docs/images/bmfr-curves.png"),
        ("taubench_gl/reuse/methods/bmfr", "tools/bmfr_authors.py", "tools/bmfr_comparison",
         "tools/peer_programs/bmfr_opencl.py"),
    ),
    Record(
        "cost", ("docs/cost.md", "docs/images/cost-demo.png"),
        (DEMO, *FRAME, *RAYS, "taubench_gl/cost", "taubench_gl/report/cost.py"), by.cost,
    ),
    Record(
        "cycles-time", ("docs/images/cycles-time.png",),
        ("tools/light_transport_scenes.py", *SOURCES, "taubench_gl/gpu", "taubench_gl/frame", *RAYS),
        by.program("cycles_time", "--docs"),
    ),
    Record("sampled-light", ("docs/images/sampled-light.png",), (DEMO, *FRAME, *RAYS), by.sampled_light),
    Record("speed", ("docs/speed.md",), (DEMO, *FRAME, *RAYS)),  # tools/bench all
    Record("command-times", ("docs/speed.md",), (DEMO, *FRAME, *RAYS, *REUSE), by.command_times),
    Record(  # tools/engines, then conformance_table.py
        "conformance", ("docs/conformance.md",),
        ("taubench_gl/conformance", "assets/conformance", *(f"tools/engines/conformance_{name}" for name in (
            "bpy.py", "three.page.mjs", "babylon.page.mjs", "taubench.py"))),
    ),
    Record("light-agreement", ("docs/light.md",), ("tools/light_scenes.py", *FRAME)),  # tools/light_agreement
    Record(  # tools/light_columns
        "light-columns", ("docs/path-traced.md",), ("assets/light", *FRAME, *RAYS),
    ),
)  # fmt: skip


def main() -> int:
    about = "Without arguments: lists the recorded results of the repository and which of them are stale."
    parser = argparse.ArgumentParser(prog="tools/record", description=about)
    parser.add_argument("names", nargs="*", metavar="NAME", help="make these again")
    parser.add_argument("--stale", action="store_true", help="make all stale ones again that are not copied by hand")
    parser.add_argument("--unchanged", action="store_true", help="do not make NAME: its result is known to be the same")
    parser.add_argument("--work", type=Path, default=ROOT / "out" / "record", help="for intermediate results")
    options = parser.parse_args()
    records = Records(EVERY)
    chosen = records.named(options.names)
    if options.stale:
        chosen += [r for r in EVERY if r not in chosen and (r.make or r.contents) and records.changed(r)]
    for record in chosen:
        print(f"== {record.name}", flush=True)
        if options.unchanged:
            records.keep(record, records.digests(record))
        else:
            records.make(record, options.work.resolve())
    if not (chosen or options.stale):
        for record in EVERY:
            changed = records.changed(record)
            state = f"stale, {len(changed)} dependencies changed: {', '.join(changed[:4])}" if changed else "current"
            print(f"{record.name:<20}{'by hand; ' * (not record.make and not record.contents)}{state}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
