"""Runs demos and writes their figures and HTML pages to a folder."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import asdict

from taubench_gl import __version__
from taubench_gl.data_files import read_bytes
from taubench_gl.demos.demo import Array, Demo, Finding, Parameter, Result, value_texts
from taubench_gl.demos.lessons import find_demo
from taubench_gl.demos.sheet import WIDTH, as_bytes, overlay
from taubench_gl.demos.stage import SIZE, LitPair, Stage
from taubench_gl.demos.texts import ColorBar, LecturePart, minutes_text
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.glossary import label_of
from taubench_gl.gpu.context import open_gpu
from taubench_gl.outputs import image_bytes, output_folder, write_atomically
from taubench_gl.report.page import Page, data_uri, macro, tag
from taubench_gl.report.palette import color_of, hex_of

INDEX_FILE = "index.html"
FEW_COLORS = 64
DEMO = "demo.html"
"""Template of the parts of the pages."""
Around = tuple[Demo | None, Demo | None] | None
"""The demos before and after one; None: it is alone."""


@dataclass(frozen=True, slots=True)
class Shown:
    """A demo with its result, its page, and the current frame as a data URI."""

    demo: Demo
    result: Result
    page: Path
    frame: str


@contextmanager
def open_stage(size: tuple[int, int] = SIZE, backend: str = "auto", device: int | None = None) -> Iterator[Stage]:
    """A stage on the GPU or CPU driver of this machine, released on exit.  Raises GraphicsError, SettingsError."""
    with open_gpu(backend, device) as gpu, GpuOwner(gpu) as owner:
        yield owner.own(Stage(gpu, size, device))


def run_demo(name: str, out: str | Path, size: tuple[int, int] = SIZE) -> Result:
    """Run one demo, given by name or number, and write its figures and page to ``out``.  Raises TaubenchError.

    ``size``: width and height of a panel in pixels.
    """
    demo = find_demo(name)
    with open_stage(size) as stage:
        return run_demos(stage, [demo], out)[0].result


def run_demos(
    stage: Stage,
    demos: Sequence[Demo],
    out: str | Path,
    *,
    index: bool = False,
    lecture: Sequence[LecturePart] = (),
    on_demo: Callable[[Shown], None] | None = None,
) -> list[Shown]:
    """Run demos in order and write the figures and the page of each to the folder ``out``.

    ``index``: write an index of all as well.  ``lecture``: minutes and notes of the demos, in the same order.
    ``on_demo``: called after each demo.  Raises TaubenchError.
    """
    folder = output_folder(out)
    shown: list[Shown] = []
    for i, demo in enumerate(demos):
        pair = demo.open_pair(stage)
        result = demo.run(stage, pair).saved(folder / f"{demo.stem}.png")
        around = (demos[i - 1] if i else None, demos[i + 1] if i + 1 < len(demos) else None)
        page = folder / f"{demo.stem}.html"
        write_atomically(page, demo_page(demo, result, pair, around if index else None, lecture))
        shown.append(Shown(demo, result, page, _screens(demo, result, pair)[1][1]))
        if on_demo is not None:
            on_demo(shown[-1])
    if index:
        write_atomically(folder / INDEX_FILE, index_page(shown, lecture))
    return shown


def demo_page(
    demo: Demo, result: Result, pair: LitPair, around: Around = None, lecture: Sequence[LecturePart] = ()
) -> str:
    """The HTML page of one demo.

    ``pair``: the frames of ``Demo.open_pair``; ``around``: the previous and the next demo, whose pages are in the same
    folder; ``lecture``: minutes and notes of its demos, one of which is this one.
    """
    before, after = around or (None, None)
    parameter, findings, screens = result.parameter, result.findings, _screens(demo, result, pair)
    bar = parameter.about.bar and _gradient(parameter.about.bar)
    number = _place(demo, lecture)
    page = Page(
        f"{number}. {demo.text.title}", f"demo {demo.number}, {demo.name}", heading="",
        tools=tag("button", "Lecture", id="lecture", type="button",
                  title="One step per screen; arrow keys change it, Escape ends it"),
        intro=(macro("head", DEMO)(demo, number),), styles=("demo.css",), scripts=("demo.js",),
        data={
            "question": _question(demo, findings[0]),
            "parameter": _parameter(parameter),
            "previous": before and f"{before.stem}.html",
            "next": after and f"{after.stem}.html",
            "lecture": bool(lecture),
        },
        footer=(macro("footer", DEMO)(around, lambda d: _place(d, lecture), __version__),),
    )  # fmt: skip

    def step(name: str, title: str, *values: Any, link: str | None = None) -> None:
        spoken = [(getattr(part, name), i + 1) for i, part in enumerate(lecture) if part.demo == demo.name]
        notes = [macro("notes", DEMO)(text, i, len(lecture), minutes_text(lecture[:i])) for text, i in spoken]
        page.add(name, title, macro(name, DEMO)(*values), *notes, link=link, step=True)

    step("idea", "", demo, screens)
    screen = result.screens
    key = [] if screen else [(label_of(m), hex_of(color_of(m))) for m in demo.text.opening.reasons]
    about = ("", demo.text.screen) if screen else (demo.pair_text(), "")
    step("question", "Guess first", demo, screens, key, *about, link="Question")
    uri, ratio = data_uri(read_bytes(result.path)), WIDTH / result.sheet.height
    step("figure", "Figure", uri, ratio, demo.text.caption, demo.text.look_for)
    size = parameter.picture(0).shape[1::-1]
    step("parameter", "Drag a parameter", parameter, size, bar, link="Parameter")
    strips = [_strip(finding) for finding in findings]
    step("numbers", "Measured numbers and theory", demo, findings, strips, link="Numbers")
    return page.html()


def _screens(demo: Demo, result: Result, pair: LitPair) -> list[tuple[str, str, float]]:
    """Name, image and width / height of the previous frame, the current frame, and the answer."""
    special = result.screens
    frames = (special and special.frames) or tuple(frame["color"][..., :3] for frame in (pair.before, pair.now))
    answer = special.answer if special else overlay(pair.mask, pair.now["color"], *demo.text.opening.reasons)
    images = zip(("previous", "current", "answer"), (*frames, answer))
    return [(name, data_uri(_webp(as_bytes(image)), "webp"), image.shape[1] / image.shape[0]) for name, image in images]


def _gradient(bar: ColorBar) -> str:
    """The color map of a color bar as a CSS gradient, from left to right."""
    import matplotlib

    stops = matplotlib.colormaps[bar.colors](np.linspace(0.0, 1.0, 17))
    colors = ",".join(matplotlib.colors.to_hex(stop) for stop in stops)
    return f"linear-gradient(to right,{colors})"


def _question(demo: Demo, finding: Finding) -> dict[str, Any]:
    """What the page's script needs for the guess; infinite ends of the expected range become the ends of the guess."""
    (low, high), expected = demo.text.guess, finding.expected
    digits = max(0, 2 - math.floor(math.log10(high - low)))
    return {
        "low": low, "high": high, "guess_digits": min(digits, 3), "unit": finding.about.unit,
        "measured": finding.number, "text": finding.text, "meaning": finding.about.meaning,
        "expected": [max(expected.low, low), min(expected.high, high)],
        "theory": f"{finding.expected_text} ({finding.about.source})",
    }  # fmt: skip


def _parameter(parameter: Parameter) -> dict[str, Any]:
    """What the page's script needs to redraw image and number at each value of the parameter."""
    values = asdict(parameter.about) | {field.name: getattr(parameter, field.name) for field in fields(parameter)}
    names = ("name", "unit", "values", "meaning", "number_unit", "measured", "expected", "tolerance", "mark", "digits")
    out = {name: values[name] for name in names} | {"texts": value_texts(parameter)}
    if parameter.plane is not None and parameter.base is not None:
        # Lossless: the page counts the pixels of the plane.
        plane, base = image_bytes(parameter.plane, optimize=True), _webp(parameter.base)
        return out | {"plane": data_uri(plane), "base": data_uri(base, "webp")}
    return out | {"images": [data_uri(_webp(image), "webp") for image in parameter.images]}


def _webp(image: Array) -> bytes:
    """The bytes of a WebP file with an image (h, w, 3) uint8; lossless, and then smaller, where it has few colors."""
    from PIL import Image

    few = Image.fromarray(image).getcolors(FEW_COLORS) is not None  # None: it has more
    return image_bytes(image, "webp", quality=82, method=4, lossless=few)


def index_page(shown: Sequence[Shown], lecture: Sequence[LecturePart] = ()) -> str:
    """The HTML index: one card per demo with a link to its page in the same folder and its minutes in ``lecture``."""
    times = [minutes_text(lecture[: i + 1]) for i in range(len(lecture))] or [""] * len(shown)
    return Page(
        "Demos of temporal reuse", heading=f"Temporal reuse in {len(shown)} demos", styles=("demo.css",),
        intro=(macro("cards", DEMO)(shown, times),),
        footer=(tag("p", f"taubench-gl {__version__}", class_="muted"),),
    ).html()  # fmt: skip


def _strip(finding: Finding) -> dict[str, float] | None:
    """Places of the expected range and of the measured value on a line of 120 pixels; None if one is infinite."""
    low, high, value = finding.expected.low, finding.expected.high, finding.number
    if not all(map(math.isfinite, (low, high, value))):
        return None
    middle = 0.5 * (low + high)
    # The range fills most of the line, unless the value is so far outside that it needs the space.
    reach = max(high - low, 2.2 * abs(value - middle)) or 1.0

    def x(number: float) -> float:
        return 60.0 + 52.0 * (number - middle) / reach * 1.6

    start, end = max(x(low) - 1.0, 2.0), min(x(high) + 1.0, 118.0)
    return {"start": start, "width": max(end - start, 2.0), "value": min(max(x(value), 5.0), 115.0)}


def _place(demo: Demo, lecture: Sequence[LecturePart]) -> int:
    """The number of a page: its place in the lecture, outside of one that of its demo."""
    return next((i for i, part in enumerate(lecture, start=1) if part.demo == demo.name), demo.number)
