"""HTML pages that are one file each and need no network, no server and no library.

A page is its sections, each a list of parts::

    page = Page("Results", scripts=("run.js",), data=values)
    page.add("tables", "Tables", to_html(tables, scroll=True), text_lines(about))
    page.html()

A part is HTML: a table (``table.to_html``), an element (``tag``, ``text_lines``, ``picture``), or a macro of
``report/templates`` (``macro``), which hold what is more than a few elements.  Text is escaped everywhere.

``page.css`` (themes, narrow screens, print, bar, plots, tables) is part of every page; ``styles`` follow it.  A page
with ``scripts`` also gets ``page.js`` (theme button, unfolding for print) and ``plot.js`` (elements, scales, axes,
lines, marks), and a bar with links to its sections.  All scripts share one strict function; ``data`` is their constant
of that name.  The content-security policy of the page forbids it to load anything.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Any

from markupsafe import Markup

from taubench_gl.report.palette import FEATURE_COLORS, hex_of

_COLORS = ":root {" + "".join(f" --c-{name}: {hex_of(name)};" for name in FEATURE_COLORS) + " }"
"""Colors of the columns of Table 4, for plots."""
REPORT_FILE = "report.html"
"""Name of the page in the folder of a run or of a reuse evaluation."""


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a page.

    ``link``: its name in the bar, none if empty; ``label``: its name for screen readers where it has no title;
    ``step``: whether it is one screen of a lecture.
    """

    id: str
    title: str
    parts: tuple[Markup, ...]
    link: str
    label: str
    step: bool


@dataclass(slots=True)
class Page:
    """One page.

    ``title`` is that of the window, ``heading`` that of the page, without one the same, with "" none; ``kind``: what
    the page is, in the bar; ``intro``: parts before the sections, ``footer``: after them; ``tools``: parts of the bar;
    ``styles`` and ``scripts``: files of ``report/assets``; ``data``: any value that JSON holds.
    """

    title: str
    kind: str = ""
    heading: str | None = None
    intro: tuple[Markup, ...] = ()
    footer: tuple[Markup, ...] = ()
    tools: Markup | str = ""
    styles: tuple[str, ...] = ()
    scripts: tuple[str, ...] = ()
    data: Any = None
    sections: list[Section] = field(default_factory=list)

    def add(
        self, id: str, title: str, *parts: Markup, link: str | None = None, label: str = "", step: bool = False
    ) -> None:
        """Append a section.  ``link``: the title without one; ``step``: one screen of a lecture (demo.js)."""
        self.sections.append(Section(id, title, parts, title if link is None else link, label, step))

    def html(self) -> str:
        """Text of the whole page.  Raises ValueError for NaN in ``data``."""
        scripts = ("page.js", "plot.js", *self.scripts) if self.scripts else ()
        return _environment().get_template("page.html").render(
            page=self,
            style=Markup("\n".join((_COLORS, *map(asset, ("page.css", *self.styles))))),
            script=Markup("\n".join(map(asset, scripts))),
        )  # fmt: skip


def tag(name: str, *children: Any, **attributes: str) -> Markup:
    """An element with its children, escaped unless they are Markup; ``class_`` is the attribute class."""
    names = {key: key.rstrip("_").replace("_", "-") for key in attributes}
    pairs = Markup("").join(Markup(' {}="{}"').format(names[key], value) for key, value in attributes.items())
    end = Markup("" if name == "img" else "</{}>").format(name)
    return Markup("<{}{}>").format(name, pairs) + Markup("").join(children) + end


def text_lines(texts: Iterable[str], class_: str = "about") -> Markup:
    """A paragraph with a line for each text."""
    return tag("p", Markup("<br>").join(texts), class_=class_)


def bullets(entries: Iterable[tuple[str, str]]) -> Markup:
    """A list of names in bold and texts, which contain what separates both."""
    return tag("ul", *(tag("li", tag("strong", name), text) for name, text in entries))


def picture(uri: str, alt: str, class_: str = "") -> Markup:
    """An image in a figure."""
    return tag("figure", tag("img", src=uri, alt=alt), **{"class": class_} if class_ else {})


def macro(name: str, template: str = "macros.html") -> Callable[..., Markup]:
    """A macro of ``report/templates``.  Called with a value that lacks a name it raises ``jinja2.UndefinedError``."""
    return getattr(_environment().get_template(template).module, name)


def data_uri(data: bytes, kind: str = "png") -> str:
    """An image file as a data URI; ``kind``: png or webp."""
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


@cache
def asset(name: str) -> str:
    """A file of ``report/assets`` as text."""
    return resources.files(__package__).joinpath("assets", name).read_text(encoding="utf-8")


@cache
def _environment() -> Any:
    # Imported late: commands that write no page start faster without it.
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader(__package__, "templates"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    # The filter tojson also escapes <, > and &, so that no name in the data ends the script element.
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    environment.filters |= {"hex": hex_of}
    return environment
