"""Gather the pages of the site in build/docs, and finish the built site: `make docs` runs both.

Links like `../experiments/README.md` work on a code host. The site holds the files of these folders
under their own names, so links lose what leads out of or into `docs/`. A notebook is run and
becomes a page. For programs there is every page as Markdown, and llms.txt, a list of them.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml
from notebooks import NOTEBOOKS, as_page, as_written, executed, style

CHECKOUT = Path(__file__).parents[2]
DOCS, PAGES, SITE = (CHECKOUT / name for name in ("docs", "build/docs", "build/site"))
OF_PROJECT = ("CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md")
BESIDE = (
    *OF_PROJECT,
    "examples/*.*",
    "examples/notebooks/*.ipynb",
    "experiments/**/*.*",
    "models/**/*.*",
)
AGENTS = "How to call it, read its answers, and not conclude too much: [agents.md](agents.md)."
SHIM = "iframe-worker.js"
NETWORK = "https://unpkg.com/iframe-worker/shim"
"""What Zensical loads from the network where pages are opened as files."""


def gather(notebooks: dict[str, Any]) -> None:
    """Write build/docs anew, with a page for each notebook."""
    shutil.rmtree(PAGES, ignore_errors=True)
    shutil.copytree(DOCS, PAGES, ignore=shutil.ignore_patterns("*.py", "*.json"))
    for page in PAGES.glob("*.md"):
        text = page.read_text(encoding="utf-8")
        page.write_text(text.replace("](../", "](").replace(".ipynb)", ".md)"), encoding="utf-8")
    for path in (found for pattern in BESIDE for found in CHECKOUT.glob(pattern)):
        name = PAGES / path.relative_to(CHECKOUT)
        name.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".md":
            text = _history(path) if path.name == "CHANGELOG.md" else path.read_text("utf-8")
            name.write_text(_within_site(text), encoding="utf-8")
        else:
            shutil.copy(path, name)
    (PAGES / "site/answer.css").write_text(style(), encoding="utf-8")
    folder = PAGES / NOTEBOOKS.relative_to(CHECKOUT)
    for stem, notebook in notebooks.items():
        page = folder / f"{stem}.md"
        page.write_text(_within_site(as_page(notebook, stem, folder)), encoding="utf-8")


def _within_site(text: str) -> str:
    """Return a page of another folder, with links into docs/ and to notebooks as the site's."""
    return re.sub(r"\]\(((?:\.\./)*)docs/", r"](\1", text).replace(".ipynb)", ".md)")


def _history(changelog: Path) -> str:
    """Return it with links to pages of its time, which are gone since, as text."""

    def kept(link: re.Match[str]) -> str:
        return link[0] if (CHECKOUT / link[2]).exists() and not link[3] else link[1]

    text = changelog.read_text(encoding="utf-8")
    return re.sub(r"\[([^\]]*)\]\((docs/[\w-]+\.md)(#[\w-]*)?\)", kept, text)


class _Reader(yaml.SafeLoader):
    """Reads mkdocs.yml, which names a Python function."""


_Reader.add_multi_constructor("tag:yaml.org,2002:python/", lambda *_: None)


def navigation() -> dict[str, list[str]]:
    """Return the pages of the site by the headings of its navigation, in its order."""
    site = yaml.load((CHECKOUT / "mkdocs.yml").read_text("utf-8"), _Reader)  # noqa: S506 - safe
    return {heading: [*_pages(below)] for part in site["nav"] for heading, below in part.items()}


def _pages(entry: Any) -> Iterator[str]:  # noqa: ANN401 - a name, a list, or a part of navigation
    """Return the pages of a part of the navigation."""
    if isinstance(entry, str):
        yield entry
    else:
        for below in entry.values() if isinstance(entry, dict) else entry:
            yield from _pages(below)


def list_of_pages() -> str:
    """Return llms.txt: what the project is, and every page with its first sentence."""
    lines = ["# butterfly", "", f"> {_first_sentence(_text('index.md'))}", "", AGENTS]
    for heading, pages in navigation().items():
        lines += ["", f"## {heading}", ""]
        for page in pages:
            title = _text(page).removeprefix("# ").partition("\n")[0]
            lines.append(f"- [{title}]({page}): {_first_sentence(_text(page))}")
    return "\n".join(lines) + "\n"


def _text(page: str) -> str:
    """Return the source of a page of the site: of a notebook its first cell."""
    if (notebook := (CHECKOUT / page).with_suffix(".ipynb")).exists():
        return "".join(json.loads(notebook.read_text("utf-8"))["cells"][0]["source"])
    source = DOCS / page
    return (source if source.exists() else CHECKOUT / page).read_text(encoding="utf-8")


def _first_sentence(page: str) -> str:
    """Return the first sentence of a page, without links and marks; a command may begin it."""
    begun = ""
    for part in page.split("\n\n")[1:]:
        if part.startswith("    "):
            begun = f"`{part.strip().splitlines()[-1]}` "
        elif re.match(r"[*`A-Za-z]", part):
            text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", " ".join(part.split()))
            return begun * text[0].islower() + re.split(r"(?<=[.?!]) |:$", text.replace("*", ""))[0]
    return ""


def finish() -> None:
    """Make the built site independent of the network, and readable for programs.

    A page that is missing, or that the search does not know, ends it.
    """
    search = json.loads((SITE / "search.json").read_text(encoding="utf-8"))
    searched = {item["location"].partition("#")[0] for item in search["items"]}
    for name in (page for pages in navigation().values() for page in pages):
        built = str(Path(name.replace("README.md", "index.md")).with_suffix(".html"))
        if built not in searched or not (SITE / built).is_file():
            sys.exit(f"{name} is not in the built site, or not in its search")
        shutil.copy(PAGES / name, SITE / name)
    (SITE / "llms.txt").write_text(list_of_pages(), encoding="utf-8")
    shutil.copy(Path(__file__).with_name(SHIM), SITE / "assets/javascripts" / SHIM)
    for page in SITE.rglob("*.html"):
        up = "../" * (len(page.relative_to(SITE).parts) - 1)
        text = page.read_text(encoding="utf-8")
        page.write_text(text.replace(NETWORK, f"{up}assets/javascripts/{SHIM}"), encoding="utf-8")


if __name__ == "__main__":
    match sys.argv[1]:
        case "finish":
            finish()
        case "source":
            gather(as_written())
        case _:
            gather(executed())
