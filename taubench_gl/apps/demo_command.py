"""``taubench-gl demo``: the teaching demos."""

from __future__ import annotations

import os
import tempfile
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from taubench_gl.apps.options import GPU, command, option_group
from taubench_gl.apps.screen import only_one
from taubench_gl.errors import SettingsError
from taubench_gl.fields import setting
from taubench_gl.settings import OUTPUT, SIZE, DeviceSettings, Settings, parse_size

if TYPE_CHECKING:
    from taubench_gl.demos.demo import Demo, Finding
    from taubench_gl.demos.gallery import Shown
    from taubench_gl.demos.texts import LecturePart

EXIT_NOT_AS_EXPECTED = 1
Size = tuple[int, int] | None


class DemoType(click.ParamType):
    """A demo by its name, its number or the beginning of its name."""

    name = "demo"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Demo:
        from taubench_gl.demos.lessons import find_demo

        return find_demo(value) if isinstance(value, str) else value

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """The names that begin with ``incomplete``, with the titles of their demos."""
        from taubench_gl.demos.lessons import DEMOS

        return [CompletionItem(n, help=d.text.title) for n, d in DEMOS.items() if n.startswith(incomplete)]


@command(settings=option_group(only=GPU))
@click.argument("named", nargs=-1, metavar="[NAME|NUMBER]...", type=DemoType())
def demo(
    named: tuple[Any, ...],  # demos
    settings: Settings,
    *,
    every: bool = setting(False, "Run all demos and write an index page", flag="--all"),
    lecture: bool = setting(False, "Run seven demos in order, twenty minutes, with notes for the speaker (key N)"),
    out: Path = setting(Path("demos"), "Folder of the figures and pages", group=OUTPUT, metavar="DIR"),
    listing: bool = setting(False, "List the demos, as without a name", flag="--list"),
    scene_file: Path | None = setting(
        None, "Only write the demo's scene, as a file for other commands", flag="--scene", metavar="OUT.glb"
    ),
    viewing: bool = setting(False, "Only open the demo's scene in the viewer", flag="--view"),
    size: Size = setting(
        None,
        "Size of a panel in pixels",
        SIZE.check,
        read=parse_size,
        metavar="WxH",
        shown="480x270",
    ),
) -> int:
    """Run demos that each explain one idea of temporal reuse with figures and a measured number.

    Each number is compared with its theoretical value; the exit code is 1 if one differs.  Without a name, lists the
    demos.

    Examples:
      taubench-gl demo
      taubench-gl demo rotations
      taubench-gl demo 3 7 --out lecture --size 640x360
      taubench-gl demo --lecture --out lecture
      taubench-gl demo --all --out demos
      taubench-gl demo occlusion --view
      taubench-gl demo occlusion --scene board.glb

    DIR receives the figures (PNG), a self-contained HTML page per demo, and index.html with --all or --lecture.
    docs/demos.md lists the demos.
    """
    from taubench_gl.demos.lessons import DEMOS, find_demo
    from taubench_gl.demos.texts import TEXTS

    only_one("--all, --lecture and names exclude each other", "give one of them", every, lecture, named)
    only_one("--scene and --view exclude each other", "give one of them", scene_file, viewing)
    if (scene_file is not None or viewing) and not (named or every or lecture or listing):
        raise SettingsError("no demo was named", hint="--scene and --view need one, see 'taubench-gl demo'")
    if scene_file is not None and scene_file.suffix.lower() != ".glb":
        raise SettingsError(f"{scene_file.name} does not end in .glb", hint="scenes are written as one binary file")
    parts = TEXTS.lecture if lecture else ()
    selected = list(DEMOS.values()) if every else [find_demo(part.demo) for part in parts] or list(dict.fromkeys(named))
    if listing or not selected:
        _list(selected or list(DEMOS.values()))
        return 0
    if scene_file is not None or viewing:
        _scene(selected, scene_file, size)
        return 0
    return _run(selected, out, every or lecture, parts, size, settings.device)


def _list(selected: list[Demo]) -> None:
    for lesson in selected:
        click.echo(f"{lesson.number:>2}  {lesson.name:<12} {lesson.text.title}")


def _scene(selected: list[Demo], path: Path | None, size: Size) -> None:
    """Write the scene of a demo as glTF, or open it in the viewer."""
    from taubench_gl.datasets.gltf_from_scene import write_scene

    if len(selected) > 1:
        raise SettingsError(f"{len(selected)} demos were named", hint="--scene and --view take one")
    (lesson,) = selected
    if path is not None:
        write_scene(lesson.scene(), path)
        click.echo(f"written to {path}; open it with: taubench-gl view {path}")
        return
    from taubench_gl.apps.view_command import view
    from taubench_gl.demos.gallery import open_stage
    from taubench_gl.demos.stage import SIZE

    with open_stage(size or SIZE) as stage:
        findings = lesson.run(stage).findings
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{lesson.stem}.glb"
        write_scene(lesson.scene(), file)
        view.main(args=[str(write_session(lesson, file, size, findings))], standalone_mode=False)


def write_session(lesson: Demo, scene: Path, size: Size, findings: Sequence[Finding] = ()) -> Path:
    """A session file beside ``scene`` that opens the lesson: its pair, its masks, its text and its numbers."""
    from taubench_gl.demos.stage import SIZE
    from taubench_gl.glossary import key_of
    from taubench_gl.settings import FIXED_LIGHTING, Settings
    from taubench_gl.viewer.session_file import SUFFIX, save_lesson
    from taubench_gl.viewer.state import OVERLAYS, SECTIONS

    width, height = size or SIZE
    defaults = {"width": width, "height": height, "indirect": "none", **FIXED_LIGHTING}
    settings = Settings(**(defaults | lesson.opening_settings()))
    masks = {key_of(mask) for mask in lesson.text.opening.reasons}
    opened = {"lesson", "compare", "masks", "thresholds", "playback"}
    values = {"frame": lesson.text.opening.frame, "channel": "color", "against": "history", "overlays": 1, "panels": 1,
              "samples": 0}  # fmt: skip
    values |= {f"show.{name}": int(name in masks) for name in OVERLAYS}
    values |= {f"section.{name}": int(name in opened) for name in SECTIONS}
    look_for = (f"- {item}" for item in lesson.text.look_for)
    description = [
        f"{lesson.number}. {lesson.text.title}",
        lesson.text.question,
        lesson.text.idea,
        "The page of this demo shows:",
        *look_for,
        *(["Numbers of its figure, with theory:"] if findings else []),
        *(f"- {f.text} {f.about.meaning}: expected {f.expected_text}, {f.about.source}" for f in findings),
        "Press Y twice: the previous frame in turn with this one.",
    ]
    path = scene.with_name(f"{lesson.stem}{SUFFIX}")
    save_lesson(path, str(scene), settings, values, "\n".join(description))
    return path


def _run(
    selected: list[Demo], out: Path, index: bool, parts: Sequence[LecturePart], size: Size, machine: DeviceSettings
) -> int:
    from taubench_gl.demos.gallery import open_stage, run_demos
    from taubench_gl.demos.stage import SIZE

    with open_stage(size or SIZE, machine.backend, machine.device) as stage:
        shown = run_demos(stage, selected, out, index=index, lecture=parts, on_demo=_show)
    pages = f"{out / 'index.html'}" if index else ", ".join(str(s.page) for s in shown)
    click.echo(f"written to {out}{os.sep}; open {pages}")
    failed = [s.demo for s in shown if not s.result.as_expected]
    if failed:
        click.secho(f"differs from theory: {', '.join(d.name for d in failed)}", fg="red", bold=True)
    return EXIT_NOT_AS_EXPECTED if failed else 0


def _show(shown: Shown) -> None:
    """Print idea, things to look for and numbers of a demo."""
    lesson, result = shown.demo, shown.result
    click.secho(f"\n{lesson.number}. {lesson.text.title}", bold=True)
    click.echo(textwrap.fill(lesson.text.idea, 110))
    for item in lesson.text.look_for:
        click.echo(textwrap.fill(item, 110, initial_indent="  - ", subsequent_indent="    "))
    for f in result.findings:
        click.secho(f"  {'PASS' if f.as_expected else 'FAIL'} ", fg="green" if f.as_expected else "red", nl=False)
        click.echo(f"{f.text} {f.about.meaning}; expected {f.expected_text} ({f.about.source})")
