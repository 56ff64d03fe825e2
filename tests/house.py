"""What the package is made of, counted: its tuned numbers.

``python -m tests.house`` writes docs/tuned-numbers.md anew.
"""

import ast
import io
import re
import tokenize
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
TABLE = ROOT / "docs/tuned-numbers.md"
_HEAD = """# Tuned numbers of identification

Every number that a module of `butterfly/identification` assigns at its top, and what it means. A
rule that needs one more needs a reason; where no source is named, the number was chosen by trying.
`python -m tests.house` writes this page, and a test keeps it up to date.
"""


class Number(NamedTuple):
    """A number, or a few, that a module assigns at its top."""

    file: str
    name: str
    value: str
    meaning: str


@cache
def tuned_numbers(package: str = "butterfly/identification") -> list[Number]:
    """Return the numbers that modules of a package assign at their top, by file."""
    found: list[Number] = []
    for path in sorted((ROOT / package).rglob("*.py")):
        found += _of_module(path)
    return found


def table(numbers: list[Number]) -> str:
    """Return the page that lists numbers by file."""
    parts = [_HEAD]
    for file in dict.fromkeys(each.file for each in numbers):
        rows = [each for each in numbers if each.file == file]
        lines = (f"| `{each.name}` | {each.value} | {each.meaning} |" for each in rows)
        parts.append(
            "\n".join([f"## {file}\n", "| name | value | meaning |", "|---|---|---|", *lines])
            + "\n"
        )
    return "\n".join(parts)


def _of_module(path: Path) -> list[Number]:
    text = path.read_text(encoding="utf-8")
    body, (behind, alone) = ast.parse(text).body, _comments(text)
    found = []
    for node, after in zip(body, [*body[1:], None], strict=True):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or not _is_number(node.value):
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        meaning = behind.get(node.end_lineno or 0, "")
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            meaning = " ".join(str(after.value.value).split())
        meaning = meaning or _above(alone, node.lineno)
        names = re.sub(r"[()]", "", ", ".join(ast.unparse(each) for each in targets))
        assert node.value is not None
        value = ast.unparse(node.value)
        file = str(path.relative_to(ROOT / "butterfly"))
        found.append(Number(file, names, value, meaning.replace("|", "\\|")))
    return found


def _is_number(value: ast.expr | None) -> bool:
    """Whether an expression is made of numbers alone, and of arithmetic on them."""
    if value is None:
        return False
    allowed = (ast.Constant, ast.UnaryOp, ast.BinOp, ast.Tuple, ast.operator, ast.unaryop, ast.Load)
    nodes = list(ast.walk(value))
    constants = [each.value for each in nodes if isinstance(each, ast.Constant)]
    return (
        bool(constants)
        and all(isinstance(each, allowed) for each in nodes)
        and all(isinstance(each, int | float) and not isinstance(each, bool) for each in constants)
    )


def _comments(text: str) -> tuple[dict[int, str], dict[int, str]]:
    """Return the comments of a module by line: those behind code, and those alone on theirs."""
    behind: dict[int, str] = {}
    alone: dict[int, str] = {}
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            found = behind if token.start[1] else alone
            found[token.start[0]] = token.string.lstrip("# ")
    return behind, alone


def _above(comments: dict[int, str], line: int) -> str:
    lines: list[str] = []
    while (line := line - 1) in comments:
        lines.insert(0, comments[line])
    return " ".join(lines)


if __name__ == "__main__":
    TABLE.write_text(table(tuned_numbers()), encoding="utf-8")
