"""The documentation site: its pages are complete, its links exist, and it works from files, without a network."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
OPTIONS = re.search(r"-m mkdocs (.*)", (ROOT / "tools" / "docs").read_text())[1].replace('"$@"', "").split()
"""Of MkDocs, as in tools/docs."""
BLOCKS = re.compile(r"<(h[1-6]|table|tr|td|th|ul|ol|li|pre|a|img)\b")

pytest.importorskip("material", reason="mkdocs-material is not installed")


def build(*arguments: str | Path, cwd: Path = ROOT, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mkdocs", *OPTIONS, *map(str, arguments)]
    variables = os.environ | {"NO_MKDOCS_2_WARNING": "1", "PYTHONPATH": str(ROOT)} | environment
    return subprocess.run(command, cwd=cwd, env=variables, capture_output=True, text=True, timeout=120)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built as by tools/docs, with the page and the figure of one demo in place of all."""
    demos, folder = tmp_path_factory.mktemp("demos"), tmp_path_factory.mktemp("site")
    (demos / "07-occlusion.html").write_text("<title>Occlusion</title>")
    shutil.copy(ROOT / "docs" / "images" / "reject.png", demos / "07-occlusion.png")
    done = build("--site-dir", folder, TAUBENCH_DOCS_DEMOS=str(demos))
    assert done.returncode == 0, done.stderr
    return folder


def test_every_page_is_built(site: Path):
    built = {str(path.relative_to(site).with_suffix("")) for path in site.glob("**/*.html")}
    named = {str(page.relative_to(ROOT / "docs").with_suffix("")) for page in PAGES if ROOT / "docs" in page.parents}
    assert {"commands/index" if name == "commands/README" else name for name in named} <= built
    assert {"index", "changelog", "contributing", "demos/07-occlusion"} <= built


def test_the_gallery_ends_with_the_demos(site: Path):
    text = (site / "gallery.html").read_text(encoding="utf-8")
    assert re.findall(r'href="(demos/[^"]*)"', text) == ["demos/07-occlusion.html"]
    assert (site / "demos" / "07-occlusion.png").is_file()


def small_site(folder: Path, nav: str, **pages: str) -> subprocess.CompletedProcess[str]:
    """Build ``pages`` with the settings of the site."""
    settings = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n")[0]
    settings = re.sub(r"\nhooks:.*\n", "\n", settings).replace("site_dir: out/docs", "site_dir: site")
    (folder / "docs").mkdir(parents=True)
    (folder / "mkdocs.yml").write_text(f"{settings}\nnav: [{nav}]\n")
    for name, text in pages.items():
        (folder / "docs" / f"{name}.md").write_text(text)
    return build(cwd=folder)


def test_broken_links_and_forgotten_pages_end_the_build(tmp_path: Path):
    links = ("m1.md", "#m2", "other.md#m3", "m4.png")
    good = small_site(tmp_path / "good", "index.md, other.md", index="# A\n\n[b](other.md#b)\n", other="# B\n")
    assert good.returncode == 0, good.stderr
    text = "# A\n\n" + " ".join(f"[a]({link})" for link in links) + "\n"
    bad = small_site(tmp_path / "bad", "index.md, other.md", index=text, other="# B\n")
    assert bad.returncode == 1
    assert [link for link in links if link not in bad.stderr] == []
    forgotten = small_site(tmp_path / "forgotten", "index.md", index="# A\n", other="# B\n")
    assert forgotten.returncode == 1 and "other.md" in forgotten.stderr


def test_pages_have_the_blocks_of_commonmark():
    """The site's renderer needs more empty lines than a repository browser: it must not lose lists or tables."""
    import markdown
    from markdown_it import MarkdownIt

    sys.path.insert(0, str(ROOT / "tools"))
    from docs_pages import separate_lists

    common, site = MarkdownIt("commonmark").enable("table"), ["tables", "sane_lists", "pymdownx.superfences"]
    differences = {}
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        expected = Counter(BLOCKS.findall(common.render(text)))
        found = Counter(BLOCKS.findall(markdown.markdown(separate_lists(text), extensions=site)))
        if expected != found:
            differences[page.name] = (expected - found, found - expected)
    assert not differences


@pytest.mark.parametrize("size", [(1280, 720), (390, 844)])
def test_search_works_from_files_and_nothing_is_requested(site: Path, browser, size):
    page = browser.new_page(viewport={"width": size[0], "height": size[1]})
    requests, messages = [], []
    page.on("request", lambda request: requests.append(request.url))
    page.on("console", lambda message: messages.append(message.text))
    page.on("pageerror", lambda error: messages.append(str(error)))
    for name in ("gallery", "hard-cases", "commands/evaluate"):
        page.goto((site / f"{name}.html").as_uri())
        page.wait_for_load_state("load")
        assert page.evaluate("document.documentElement.scrollWidth") <= size[0], name
        assert page.evaluate("[...document.images].every((i) => i.loading === 'lazy' || i.naturalWidth > 0)"), name
    if size[0] < 960:
        page.click("label.md-header__button[for=__search]")
    page.click("input.md-search__input")
    page.keyboard.type("newly occluding")
    page.wait_for_selector(".md-search-result__item a", state="attached")
    found = [link.get_attribute("href") for link in page.query_selector_all(".md-search-result__link")]
    assert "glossary.html" in found[0]
    assert not messages and requests
    assert [url for url in requests if not url.startswith(("file:", "data:", "blob:", "about:"))] == []
    page.close()


@pytest.mark.long
def test_search_works_in_firefox(site: Path, firefox):
    from marionette_driver import By, Wait

    page = firefox(site / "gallery.html", "input.md-search__input")
    box = page.find_element(By.CSS_SELECTOR, "input.md-search__input")
    box.click()
    box.send_keys("newly occluding")
    links = "return [...document.querySelectorAll('.md-search-result__link')].map((a) => a.getAttribute('href'))"
    Wait(page, timeout=60).until(lambda d: any("glossary.html" in link for link in d.execute_script(links)))
