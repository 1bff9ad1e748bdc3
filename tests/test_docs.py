"""Every command has examples; links of the docs exist."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "tools"))
import reference_pages  # noqa: E402

PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])


def test_pages_of_removed_commands_are_removed():
    assert set((ROOT / "docs" / "commands").glob("*.md")) == {
        p for p in reference_pages.pages() if p.parent.name == "commands"
    }


def test_every_command_has_examples():
    bare = [
        " ".join(path)
        for path, text in reference_pages.commands()
        if "Examples:" not in text and "Commands:" not in text
    ]
    assert not bare, f"give their docstrings examples: {bare}"


def test_every_public_name_is_documented():
    for module, names in reference_pages.MODULES.items():
        for name in names:
            thing = getattr(__import__(module, fromlist=[name]), name)
            assert (thing.__doc__ or "").strip(), f"{module}.{name} has no docstring"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_exist(page: Path):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    missing = [
        target
        for target in re.findall(r"\]\(([^)#\s]+)", text)
        if "://" not in target and not (page.parent / target).exists()
    ]
    assert not missing


def test_every_page_is_in_the_navigation():
    """The navigation of mkdocs.yml has every page but those of commands, which tools/docs_pages.py adds."""
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n")[1]
    named = set(re.findall(r"[\w-]+\.md", nav))
    assert {page.name for page in (ROOT / "docs").glob("*.md")} == named - {
        "index.md", "start.md", "README.md", "contributing.md", "changelog.md",
    }  # fmt: skip


def test_the_tests_that_the_security_page_names_exist():
    """``tests/file.py::name``, or ``::name`` in the file that was named last."""
    page = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    text, checked = "", 0
    for file, name in re.findall(r"`(tests/[\w/]+\.py)?(?:::(\w+))?`", page):
        text = (ROOT / file).read_text(encoding="utf-8") if file else text
        assert not name or f"def {name}(" in text, name
        checked += bool(name)
    assert checked > 20


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts(shell: str, taubench):
    code, out, err = taubench("completion", shell)
    assert code == 0 and "_TAUBENCH_GL_COMPLETE" in out, err
