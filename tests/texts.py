"""Every text that a user can see, listed from the code: `python -m tests.texts [PATH ...]`.

Messages, help and labels, and public docstrings, one a line with its place, for a person to read.
"""

from __future__ import annotations

import argparse
import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "butterfly"
TEMPLATES = (".j2", ".js")
_FEWEST_WORDS = 3


@dataclass(frozen=True)
class Text:
    """A text, its kind (``message``, ``docstring`` or ``template``) and where it stands."""

    path: Path
    line: int
    kind: str
    words: str


def texts_of(path: Path) -> Iterator[Text]:
    """Yield the texts of a Python file or a template."""
    source = path.read_text(encoding="utf-8")
    if path.suffix in TEMPLATES:
        for number, line in enumerate(source.splitlines(), 1):
            for words in re.findall(r">([^<>{}]+)<|[\"'`]([^\"'`]+ [^\"'`]+)[\"'`]", line):
                if "".join(words).strip():
                    yield Text(path, number, "template", "".join(words).strip())
        return
    tree = ast.parse(source)
    docstrings = dict(_docstrings(tree))
    for node, public in docstrings.items():
        if public:
            yield Text(path, node.lineno, "docstring", _plain(node))
    for node in _outermost(tree):
        if node not in docstrings and len(_plain(node).split()) >= _FEWEST_WORDS:
            yield Text(path, node.lineno, "message", _plain(node))


def _docstrings(tree: ast.Module) -> Iterator[tuple[ast.Constant, bool]]:
    """Yield each string that stands as a statement, and whether what it describes is public."""
    for node in ast.walk(tree):
        private = (getattr(node, "name", "") or "").startswith("_")
        body = getattr(node, "body", None)
        for statement in body if isinstance(body, list) else []:
            value = statement.value if isinstance(statement, ast.Expr) else None
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                yield value, not private


def _outermost(tree: ast.AST) -> Iterator[ast.Constant | ast.JoinedStr]:
    """Yield strings, of formatted ones the whole alone."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.JoinedStr) or (
            isinstance(node, ast.Constant) and isinstance(node.value, str)
        ):
            yield node
        else:
            yield from _outermost(node)


def _plain(node: ast.Constant | ast.JoinedStr) -> str:
    """Return a string as read, what is filled in as its expression in braces."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    parts = (
        part.value if isinstance(part, ast.Constant) else "{" + ast.unparse(part.value) + "}"
        for part in node.values
    )
    return "".join(map(str, parts))


def main() -> None:
    """Print the texts of the package, or of some of its files or folders."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("paths", nargs="*", type=Path, default=[PACKAGE])
    parser.add_argument("--kind", choices=["message", "docstring", "template"])
    options = parser.parse_args()
    for given in options.paths:
        files = [given] if given.is_file() else sorted(given.rglob("*"))
        for path in files:
            if path.suffix in (".py", *TEMPLATES):
                for text in sorted(texts_of(path), key=lambda each: each.line):
                    if options.kind in (None, text.kind):
                        words = " ".join(text.words.split())
                        print(f"{path}:{text.line}: {text.kind}: {words}")


if __name__ == "__main__":
    main()
