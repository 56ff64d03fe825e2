"""The site has every page, and everything that its pages show."""

import re

import pytest

import butterfly as bf
from butterfly.identification.trust import Trust
from butterfly.verdict import VERDICTS
from tests.pages.blocks import PAGES, ROOT
from tests.pages.scripts import script

gather = script("gather")

LARGEST = 150_000  # bytes of a picture
SHOWN = re.compile(r"!\[[^\]]*\]\((?!https:)([^)]+)\)")
"""A picture of ours on a page; badges are others'."""


def _listed():
    return [page for pages in gather.navigation().values() for page in pages]


def test_every_page_stands_in_the_site_s_navigation_once():
    pages = {page.removeprefix("docs/") for page in PAGES} - {"README.md"}
    notebooks = {
        str(path.relative_to(ROOT).with_suffix(".md"))
        for path in (ROOT / "examples").rglob("*.ipynb")
    }
    assert {*_listed()} == pages | notebooks | {"CHANGELOG.md"}
    assert len(_listed()) == len({*_listed()})


def test_the_navigation_is_in_the_order_of_a_reader():
    headings = ["Home", "Tutorials", "How-to", "Reference", "Explanation", "Project"]
    assert [*gather.navigation()] == headings


def _links(page):
    """Return the files that a page links to, by their names in the repository."""
    for link in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", (ROOT / page).read_text("utf-8")):
        if "://" not in link:
            yield str((ROOT / page).parent.joinpath(link).resolve().relative_to(ROOT))


def test_every_page_and_notebook_is_at_most_two_links_from_the_front_page():
    assert "docs/index.md" in _links("README.md")
    first = {*_links("docs/index.md")}
    pages = {page for page in first if page.endswith(".md")}
    second = {link for page in pages for link in _links(page)}
    notebooks = {str(path.relative_to(ROOT)) for path in (ROOT / "examples").rglob("*.ipynb")}
    wanted = {*PAGES, *notebooks} - {"README.md", "docs/index.md"}
    assert wanted - first - second == set()


@pytest.mark.parametrize("page", PAGES)
def test_a_page_links_to_what_is_there(page):
    assert [link for link in _links(page) if not (ROOT / link).exists()] == []


def test_every_public_name_stands_in_the_reference():
    page = (ROOT / "docs/api.md").read_text(encoding="utf-8")
    for name in bf.__all__:
        assert re.search(rf"[. \[]{name}[\n,\]]", page), name


def test_every_picture_is_shown_somewhere_and_small_and_every_one_that_is_shown_is_there():
    shown = {
        (ROOT / page).parent.joinpath(path).resolve()
        for page in PAGES
        for path in re.findall(
            r"!\[[^\]]*\]\((?!https:)([^)]+)\)", (ROOT / page).read_text(encoding="utf-8")
        )
    }
    pictures = {*(ROOT / "docs/pictures").glob("*.png")}
    assert pictures
    assert all(picture.stat().st_size < LARGEST for picture in pictures)
    assert pictures <= shown
    assert [path for path in shown if not path.is_file()] == []


def test_llms_txt_lists_every_page_of_the_site_with_what_it_says():
    lines = gather.list_of_pages().splitlines()
    assert lines[0].startswith("# ")
    assert lines[2].startswith("> ")
    for page in _listed():
        (line,) = (line for line in lines if line.startswith("- [") and f"]({page}): " in line)
        assert len(line.partition(f"]({page}): ")[2]) > 15


def test_the_page_for_agents_has_every_verdict_and_claim_and_verbs_and_exit_codes_that_exist():
    page = (ROOT / "docs/agents.md").read_text(encoding="utf-8")
    assert all(level.verdict in page for level in VERDICTS)
    assert all(f"`{trust.claim}`" in page for trust in Trust if trust.claim)
    commands = (ROOT / "docs/commands.md").read_text(encoding="utf-8")
    codes = re.findall(r"^\| `(\d+)` \|", commands, re.MULTILINE)
    named = re.findall(r"^\| (?:`(\d+)`, )?`(\d+)` \|", page, re.MULTILINE)
    assert {"0", "2", "3"} <= {code for row in named for code in row if code} <= {*codes}
    verbs = re.findall(r"`bf\.(\w+)`", page)
    assert verbs
    assert {*verbs} <= {*bf.__all__}
