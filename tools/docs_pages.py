"""Pages of the documentation site that are not in docs/: a hook of MkDocs, named in mkdocs.yml.

README.md, CONTRIBUTING.md and CHANGELOG.md are pages, so that each text exists once.  The home page begins as README.md
does; where ``TAUBENCH_DOCS_LIVE`` names a folder of ``live_pages.py``, it shows the demo's report, the lessons, methods
on three scenes and the tables of the demo beside the paper's.
"""

from __future__ import annotations

import html
import json
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

sys.path.insert(0, str(Path(__file__).parent))

from live_pages import CARD, LESSONS, METHODS_PAGES, RUN

from taubench_gl.demos.lessons import DEMOS
from taubench_gl.report.page import REPORT_FILE
from taubench_gl.report.reuse import verdict

ROOT = Path(__file__).resolve().parents[1]
PAGES = {"README.md": "start.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
"""File of the checkout -> page of the site."""
LIVE = "TAUBENCH_DOCS_LIVE"
SEARCH = {"glossary.md": {"boost": 4}, "benchmark-quick.md": {"exclude": True}}
"""Page -> its weight in searches: definitions first, and no tables of numbers."""
HOME = """---
hide: [navigation, toc]
---
{introduction}

[Start](start.md){{ .md-button .md-button--primary }} [Tour](tour.md){{ .md-button }}
"""
REPORT = """
## Which pixels of the demo can be reused

Play, drag a threshold, point at a pixel. [The report alone]({RUN}/{REPORT_FILE}) · [what it shows](report.md)

<iframe class="report" src="{RUN}/{REPORT_FILE}" title="Report of the demo"></iframe>
"""


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
    """Add the home page, the pages of the checkout and what live_pages.py wrote."""
    files.append(File.generated(config, "index.md", content=home_page()))
    for name, page in PAGES.items():
        text = page_text((ROOT / name).read_text(encoding="utf-8"))
        files.append(File.generated(config, page, content=text))
    files.append(File.generated(config, "LICENSE", abs_src_path=str(ROOT / "LICENSE")))
    for path in live_files():
        files.append(File.generated(config, f"{path.parent.name}/{path.name}", abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """``separate_lists`` and the weight in searches."""
    page.meta |= {"search": SEARCH[page.file.src_uri]} if page.file.src_uri in SEARCH else {}
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


def live_folder() -> Path | None:
    """What live_pages.py wrote, if it ran."""
    return Path(os.environ[LIVE]) if os.environ.get(LIVE) else None


def live_files() -> Iterator[Path]:
    """Pages of the live parts and the images that the site shows."""
    if folder := live_folder():
        pages = [page.name for page in METHODS_PAGES]
        yield from sorted(p for p in (folder / LESSONS).glob("*.*") if p.suffix in (".html", ".webp"))
        yield from (path for path in (folder / RUN / REPORT_FILE,) if path.is_file())
        yield from (p for name in pages for p in (folder / name / REPORT_FILE, folder / name / CARD) if p.is_file())


def home_page() -> str:
    """The introduction of README.md, and each live part that there is."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    parts = [HOME.format(introduction=page_text(readme.split("\n## ")[0]).strip())]
    if folder := live_folder():
        parts += [REPORT.format(RUN=RUN, REPORT_FILE=REPORT_FILE)] if (folder / RUN / REPORT_FILE).is_file() else []
        parts += card_section(
            "Lessons", "Each shows one effect with one closed form: guess, then look.", lesson_cards()
        )
        text = "Five methods on three scenes of the [benchmark](benchmark.md), with images and error maps."
        parts += card_section("Reuse methods", text, methods_cards(folder))
        tables = folder / RUN / "tables.md"
        parts += [tables_section(tables.read_text(encoding="utf-8"))] if tables.is_file() else []
    return "\n".join(parts)


def card_section(title: str, text: str, cards: Iterator[str]) -> list[str]:
    """A section of links with images, none without a link."""
    links = "\n".join(cards)
    return [f'\n## {title}\n\n{text}\n\n<div class="cards">\n{links}\n</div>\n'] if links else []


def card(page: str, image: str, title: str, text: str = "") -> str:
    """One link: image, title and a sentence."""
    sentence = f"<span>{html.escape(text)}</span>" if text else ""
    return f'<a href="{page}"><img src="{image}" alt="" loading="lazy"><b>{html.escape(title)}</b>{sentence}</a>'


def lesson_cards() -> Iterator[str]:
    """One link per lesson of the folder."""
    names = {path.name for path in live_files() if path.parent.name == LESSONS}
    for demo in DEMOS.values():
        if {f"{demo.stem}.html", f"{demo.stem}.webp"} <= names:
            page, image = f"{LESSONS}/{demo.stem}.html", f"{LESSONS}/{demo.stem}.webp"
            yield card(page, image, f"{demo.number}. {demo.text.title}", demo.text.question)


def methods_cards(folder: Path) -> Iterator[str]:
    """One link per scene: the worst frame and what the page says first."""
    for page in METHODS_PAGES:
        if (folder / page.name / REPORT_FILE).is_file():
            summary = json.loads((folder / page.name / "reuse.json").read_text(encoding="utf-8"))
            link, image = f"{page.name}/{REPORT_FILE}", f"{page.name}/{CARD}"
            yield card(link, image, page.title, verdict(summary) or "")


def tables_section(tables: str) -> str:
    """Tables 1 to 4 of the demo, each with the paper's rows."""
    text = "Measured in the demo, with the rows of the paper. [What each column is](conventions.md)"
    return f"\n## The paper's tables\n\n{text}\n\n{tables[tables.index('**Table 1') :]}"
