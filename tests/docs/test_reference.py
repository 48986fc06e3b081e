"""The API reference has every public name, and the table of contents every page."""

import re
from pkgutil import resolve_name

import pytest

import surefoot
from tests.docs.pages import ROOT

FOLDER = ROOT / "docs"
TOCTREE = re.compile(r"```\{toctree\}\n(.*?)```", flags=re.DOTALL)
DOTTED = sorted(
    name
    for page in (FOLDER / "api").glob("*.md")
    for name in re.findall(r"auto\w+:: (surefoot\.\S+)$", page.read_text(), flags=re.MULTILINE)
)


@pytest.mark.parametrize("name", DOTTED)
def test_every_name_of_the_reference_exists(name):
    assert resolve_name(name) is not None


def test_every_public_name_is_documented_once():
    pages = "".join(page.read_text() for page in (FOLDER / "api").glob("*.md"))
    names = re.findall(r"auto\w+:: surefoot\.(\w+)$", pages, flags=re.MULTILINE)
    assert sorted(names) == surefoot.__all__


def test_every_page_is_in_the_table_of_contents():
    listed = set()
    for page in FOLDER.rglob("*.md"):
        for entries in TOCTREE.findall(page.read_text()):
            names = [line for line in entries.splitlines() if line and not line.startswith(":")]
            listed |= {(page.parent / f"{name}.md").resolve() for name in names}
    pages = {page for page in FOLDER.rglob("*.md") if "_build" not in page.parts}
    assert pages - listed == {FOLDER / "index.md"}
    assert [page for page in listed if not page.is_file()] == []
