"""Pages of the documentation site that are not in docs/: a hook of MkDocs, named in mkdocs.yml.

The home page is README.md, and CONTRIBUTING.md and CHANGELOG.md are pages, so that each text exists once.  The gallery
ends with the demos if ``TAUBENCH_DOCS_DEMOS`` names a folder that ``taubench-gl demo --all`` wrote.
"""

from __future__ import annotations

import html
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

from taubench_gl.demos.lessons import demos

ROOT = Path(__file__).resolve().parents[1]
PAGES = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
"""File of the checkout -> page of the site."""
DEMOS = "TAUBENCH_DOCS_DEMOS"
SEARCH = {"glossary.md": {"boost": 4}, "benchmark-quick.md": {"exclude": True}}
"""Page -> its weight in searches: definitions first, and no tables of numbers."""


def on_config(config: Any) -> Any:
    """The pages of the commands in the navigation, below their index."""
    index = "commands/README.md"
    others = sorted(p.name for p in (ROOT / "docs" / "commands").glob("*.md") if p.name != "README.md")
    pages = [index, *({name.removesuffix(".md"): f"commands/{name}"} for name in others)]
    for entry in config.nav:
        for title, below in entry.items():
            if title == "Reference":
                entry[title] = [{"Commands": pages} if item == {"Commands": [index]} else item for item in below]
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add the pages of the checkout and the pages and figures of the demos."""
    for name, page in PAGES.items():
        head = "---\nhide: [navigation]\n---\n" if page == "index.md" else ""
        text = head + page_text((ROOT / name).read_text(encoding="utf-8"))
        files.append(File.generated(config, page, content=text))
    files.append(File.generated(config, "LICENSE", abs_src_path=str(ROOT / "LICENSE")))
    for path in demo_files():
        files.append(File.generated(config, f"demos/{path.name}", abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """``separate_lists``, the weight in searches, and the cards of the demos at the end of the gallery."""
    page.meta |= {"search": SEARCH[page.file.src_uri]} if page.file.src_uri in SEARCH else {}
    if page.file.src_uri == "gallery.md" and (cards := "\n".join(demo_cards())):
        markdown += f'\n## Demos\n\n<div class="demo-cards">\n{cards}\n</div>\n'
    return separate_lists(markdown)


def separate_lists(text: str) -> str:
    """``text`` with an empty line before each list after a paragraph: Python-Markdown needs it, CommonMark does not."""
    lines, fenced = [""], False
    for line in text.splitlines():
        fenced ^= line.startswith("```")
        if not fenced and re.match(r"(-|\d+\.) ", line) and re.match(r"(?!(-|\d+\.) )\S", lines[-1]):
            lines.append("")
        lines.append(line)
    return "\n".join(lines[1:]) + "\n"


def page_text(text: str) -> str:
    """``text`` of a file beside docs/ with the links of a page in docs/."""
    text = re.sub(r"\]\(docs/", "](", text)
    for name, page in PAGES.items():
        text = text.replace(f"]({name}", f"]({page}")
    return text


def demo_files() -> Iterator[Path]:
    """Pages and figures of the demos, if there are any."""
    folder = os.environ.get(DEMOS)
    if folder:
        yield from sorted(p for p in Path(folder).iterdir() if p.suffix in (".html", ".png"))


def demo_cards() -> Iterator[str]:
    """One link per demo of the folder: figure and title."""
    names = {path.name for path in demo_files()}
    for demo in demos():
        figures = sorted(name for name in names if name.startswith(demo.stem) and name.endswith(".png"))
        if f"{demo.stem}.html" in names and figures:
            title = html.escape(f"{demo.number}. {demo.title}")
            image = f'<img src="demos/{figures[0]}" alt="" loading="lazy">'
            yield f'<a href="demos/{demo.stem}.html">{image}{title}</a>'
