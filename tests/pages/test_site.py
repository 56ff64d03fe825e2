"""The site has every page, and everything that its pages show."""

import re

import yaml

import butterfly as bf
from tests.pages.blocks import PAGES, ROOT

LARGEST = 150_000  # bytes of a picture


class _Reader(yaml.SafeLoader):
    """Reads mkdocs.yml, which names a Python function."""


_Reader.add_multi_constructor("tag:yaml.org,2002:python/", lambda *_: None)


def _listed(entries):
    for entry in entries:
        if isinstance(entry, str):
            yield entry
        else:
            for below in entry.values():
                yield from _listed(below if isinstance(below, list) else [below])


def test_every_page_stands_in_the_site_s_navigation():
    site = yaml.load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"), _Reader)  # noqa: S506
    pages = {page.removeprefix("docs/") for page in PAGES} - {"README.md"}
    notebooks = {f"examples/{path.stem}.md" for path in (ROOT / "examples").glob("*.ipynb")}
    assert set(_listed(site["nav"])) == pages | notebooks | {"CHANGELOG.md"}


def test_the_readme_leads_to_the_site_s_start_and_every_page_is_linked_from_another():
    texts = {page: (ROOT / page).read_text(encoding="utf-8") for page in PAGES}
    assert "(docs/index.md)" in texts["README.md"]
    for page in PAGES:
        name = page.removeprefix("docs/")
        others = (text for other, text in texts.items() if other != page)
        assert page == "README.md" or any(re.search(rf"\([./\w]*{name}[)#]", t) for t in others), (
            page
        )


def test_every_public_name_stands_in_the_reference():
    page = (ROOT / "docs/api.md").read_text(encoding="utf-8")
    for name in bf.__all__:
        assert re.search(rf"[. \[]{name}[\n,\]]", page), name


def test_every_picture_is_shown_somewhere_and_small_and_every_one_that_is_shown_is_there():
    shown = {
        (ROOT / page).parent.joinpath(path).resolve()
        for page in PAGES
        for path in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", (ROOT / page).read_text(encoding="utf-8"))
    }
    pictures = {*(ROOT / "docs/pictures").glob("*.png")}
    assert pictures
    assert all(picture.stat().st_size < LARGEST for picture in pictures)
    assert pictures <= shown
    assert [path for path in shown if not path.is_file()] == []
