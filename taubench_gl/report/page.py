"""The report kit: HTML pages that are one file each and need no network, no server and no library.

A page is a template in ``report/templates`` that extends ``page.html`` and fills its blocks::

    {% extends "page.html" %}
    {% from "macros.html" import table %}
    {% block title %}{{ name }}{% endblock %}
    {% block main %}<h1>{{ name }}</h1>{{ table(title, heads, rows, notes) }}{% endblock %}

and one call that returns its text::

    render_page("cost.html", styles=("cost.css",), scripts=("cost.js",), data=values, name=..., heads=..., rows=...)

``page.css`` (themes, narrow screens, print, bar, plots, tables) is part of every page; ``styles`` follow it.  A page
with ``scripts`` also gets ``page.js`` (theme button, unfolding for print) and ``plot.js`` (elements, scales, axes,
lines, marks).  All scripts share one strict function; ``data`` is their constant of that name.  Templates escape every
value.  The content-security policy of the page forbids it to load anything.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from functools import cache
from importlib import resources
from typing import Any

from taubench_gl.report.palette import hex_of

REPORT_FILE = "report.html"
"""Name of the page in the folder of a run or of a reuse evaluation."""


def render_page(
    template: str, *, styles: Sequence[str] = (), scripts: Sequence[str] = (), data: Any = None, **values: Any
) -> str:
    """Text of a whole page.

    ``template`` is a file of ``report/templates``; ``styles`` and ``scripts`` are files of ``report/assets``; ``data``
    is any value that JSON holds (NaN raises ValueError); ``values`` are the names that the template uses.
    """
    from markupsafe import Markup

    names = ("page.js", "plot.js", *scripts) if scripts else ()
    return render(
        template,
        style=Markup("\n".join(map(asset, ("page.css", *styles)))),
        script=Markup("\n".join(map(asset, names))),
        data=data,
        **values,
    )


def render(template: str, **values: Any) -> str:
    """A template with its values filled in.  A name that is missing raises ``jinja2.UndefinedError``."""
    return _environment().get_template(template).render(**values)


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

    found = Environment(
        loader=PackageLoader(__package__, "templates"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    # The filter tojson also escapes <, > and &, so that no name in the data ends the script element.
    found.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    found.filters |= {"hex": hex_of}
    return found
