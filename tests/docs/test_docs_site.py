"""The documentation site: its pages are complete, its links exist, and it works from files, without a network."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import taubench_gl

pytestmark = [pytest.mark.usefixtures("fixed_light"), pytest.mark.long]

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools"))

from docs_pages import LIVE, home_page  # noqa: E402
from live_pages import CARD, LESSONS, METHODS_PAGES, RUN  # noqa: E402

PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
OPTIONS = re.search(r"-m mkdocs (.*)", (ROOT / "tools" / "docs").read_text())[1].replace('"$@"', "").split()
"""Options of MkDocs in tools/docs."""
pytest.importorskip("material", reason="mkdocs-material is not installed")


def build(*arguments: str | Path, cwd: Path = ROOT, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mkdocs", *OPTIONS, *map(str, arguments)]
    variables = os.environ | {"NO_MKDOCS_2_WARNING": "1", "PYTHONPATH": str(ROOT)} | environment
    return subprocess.run(command, cwd=cwd, env=variables, capture_output=True, text=True, timeout=120)


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What tools/live_pages.py writes: the report of a small run, and a page in place of each lesson and comparison."""
    folder = tmp_path_factory.mktemp("live")
    taubench_gl.evaluate(ROOT / "assets" / "demo.glb", size=(64, 36), frames=(0, 4), out=folder / RUN, report=True)
    write_page(folder / LESSONS / "07-occlusion.html", folder / LESSONS / "07-occlusion.webp")
    page = METHODS_PAGES[1]
    write_page(folder / page.name / "report.html", folder / page.name / CARD)
    methods = {n: {"mean": {"flip": e}, "classes": {}, "failed": None} for n, e in (("none", 0.4), ("svgf", 0.1))}
    measures = {"flip": {"better": "lower"}}
    (folder / page.name / "reuse.json").write_text(json.dumps({"methods": methods, "measures": measures}))
    return folder


def write_page(page: Path, image: Path) -> None:
    page.parent.mkdir(exist_ok=True)
    page.write_text("<title>A page</title>")
    shutil.copy(ROOT / "docs" / "images" / "reject.png", image)


@pytest.fixture(scope="module")
def site(live: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built as by tools/docs."""
    folder = tmp_path_factory.mktemp("site")
    done = build("--site-dir", folder, **{LIVE: str(live)})
    assert done.returncode == 0, done.stderr
    return folder


def test_every_page_is_built(site: Path):
    built = {str(path.relative_to(site).with_suffix("")) for path in site.glob("**/*.html")}
    named = {str(page.relative_to(ROOT / "docs").with_suffix("")) for page in PAGES if ROOT / "docs" in page.parents}
    assert {"commands/index" if name == "commands/README" else name for name in named} <= built
    assert {"index", "start", "changelog", "contributing", "demos/07-occlusion", "run/report"} <= built


def test_the_home_page_shows_the_live_parts(site: Path):
    text = (site / "index.html").read_text(encoding="utf-8")
    cards = re.findall(r'<a href="([^"]*)"><img src="([^"]*)"', text)
    assert [page for page, _ in cards] == ["demos/07-occlusion.html", f"{METHODS_PAGES[1].name}/report.html"]
    assert all((site / file).is_file() for card in cards for file in card)
    assert "0.100" in text  # the verdict
    assert text.count("(paper)") >= 8  # rows of Tables 1 to 4


def test_without_live_parts_the_home_page_is_the_introduction(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv(LIVE, raising=False)
    text = home_page()
    assert "<iframe" not in text and "](start.md)" in text and "walk.webp" in text
