"""A hook of MkDocs: what lies beside docs/ and is read with it becomes part of the site.

Links like `../experiments/README.md` work on a code host as they stand. The site holds the files of
these folders under their own names, and leaves out of links what leads out of or into `docs/`. A
notebook, which a code host shows, is a page as well.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

from mkdocs.structure.files import File

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

CHECKOUT = Path(__file__).parents[2]
NOTEBOOK = ".ipynb"
BESIDE = ("CHANGELOG.md", "examples/*.*", "experiments/**/*.*", "models/**/*.*")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add them."""
    for pattern in BESIDE:
        for path in sorted(CHECKOUT.glob(pattern)):
            name = path.relative_to(CHECKOUT).as_posix()
            files.append(File.generated(config, name, abs_src_path=str(path)))
            if path.suffix == NOTEBOOK:
                page = str(Path(name).with_suffix(".md"))
                files.append(File.generated(config, page, content=_as_page(path)))
    return files


def _as_page(notebook: Path) -> str:
    """Return its cells; what they print is seen where it runs."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    fenced = {"code": ("```python\n", "\n```"), "markdown": ("", "")}
    texts = ("".join(cell["source"]).join(fenced[cell["cell_type"]]) for cell in cells)
    return "\n\n".join((*texts, f"[The notebook, to run]({notebook.name})."))


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Write links as they are within the site."""
    if page.file.generated_by is None:
        return markdown.replace("](../", "](").replace(f"{NOTEBOOK})", ".md)")
    return re.sub(r"\]\(((?:\.\./)*)docs/", r"](\1", markdown)
