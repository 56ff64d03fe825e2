"""Gather the pages of the site in build/docs, and finish the built site: `make docs` runs both.

Links like `../experiments/README.md` work on a code host. The site holds the files of these folders
under their own names, so links lose what leads out of or into `docs/`. A notebook becomes a page.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

CHECKOUT = Path(__file__).parents[2]
DOCS, PAGES, SITE = (CHECKOUT / name for name in ("docs", "build/docs", "build/site"))
OF_PROJECT = ("CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md")
BESIDE = (*OF_PROJECT, "examples/*.*", "experiments/**/*.*", "models/**/*.*")
SHIM = "iframe-worker.js"
NETWORK = "https://unpkg.com/iframe-worker/shim"
"""What Zensical loads from the network where pages are opened as files."""


def gather() -> None:
    """Write build/docs anew."""
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
            name.write_text(re.sub(r"\]\(((?:\.\./)*)docs/", r"](\1", text), encoding="utf-8")
        else:
            shutil.copy(path, name)
        if path.suffix == ".ipynb":
            name.with_suffix(".md").write_text(_as_page(path), encoding="utf-8")


def _history(changelog: Path) -> str:
    """Return it with links to pages of its time, which are gone since, as text."""

    def kept(link: re.Match[str]) -> str:
        return link[0] if (CHECKOUT / link[2]).exists() and not link[3] else link[1]

    text = changelog.read_text(encoding="utf-8")
    return re.sub(r"\[([^\]]*)\]\((docs/[\w-]+\.md)(#[\w-]*)?\)", kept, text)


def _as_page(notebook: Path) -> str:
    """Return its cells without their output."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    fenced = {"code": ("```python\n", "\n```"), "markdown": ("", "")}
    texts = ("".join(cell["source"]).join(fenced[cell["cell_type"]]) for cell in cells)
    return "\n\n".join((*texts, f"[The notebook, to run]({notebook.name})."))


def finish() -> None:
    """Make the built site independent of the network."""
    shutil.copy(Path(__file__).with_name(SHIM), SITE / "assets/javascripts" / SHIM)
    for page in SITE.rglob("*.html"):
        up = "../" * (len(page.relative_to(SITE).parts) - 1)
        text = page.read_text(encoding="utf-8")
        page.write_text(text.replace(NETWORK, f"{up}assets/javascripts/{SHIM}"), encoding="utf-8")


if __name__ == "__main__":
    finish() if sys.argv[1:] == ["finish"] else gather()
