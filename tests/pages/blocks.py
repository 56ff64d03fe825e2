"""Code on pages, found as somebody reads it: from top to bottom."""

import re
import textwrap
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    str(path.relative_to(ROOT))
    for pattern in ("*.md", "docs/*.md", "examples/*.md", "experiments/*.md", "models/*/*.md")
    for path in ROOT.glob(pattern)
    if path.name != "CHANGELOG.md"
)

QUOTATION = "quotation"
_BLOCK = re.compile(
    r"^```(?P<language>\w*)\n(?P<fenced>(?:(?!```).*\n)*)```$"
    r"|(?<=\n\n)(?P<indented>(?:    .*\n|\n(?=    ))+)"
    r"|(?<=\n\n)(?P<quoted>(?:>.*\n)+)",
    re.MULTILINE,
)
_SPANS = re.compile(r"`(butterfly [a-z][^`]*)`")


@dataclass(frozen=True)
class Block:
    """A block of code, or a quotation: its language (none of an indented one) and its text."""

    language: str
    text: str

    @property
    def commands(self) -> list[str]:
        """What a shell would be told to do in it, without comments."""
        return [command for command, _ in self.answered]

    @property
    def answered(self) -> list[tuple[str, list[str]]]:
        """Each command with the lines of its answer, as far as the block shows it."""
        found: list[tuple[str, list[str]]] = []
        if self.language not in {"", "sh", "bash"}:
            return found
        for line in self.text.replace("\\\n", " ").splitlines():
            if line.startswith(("butterfly ", "sed ")):
                found.append((line.split("  #")[0].strip(), []))
            elif found and line.strip():
                found[-1][1].append(line)
        return found


def blocks_of(page: str) -> list[Block]:
    """Return the blocks of a page, in order."""
    return [_block(match) for match in _BLOCK.finditer(_text(page))]


def _block(match: re.Match[str]) -> Block:
    if match["indented"]:
        return Block("", textwrap.dedent(match["indented"]))
    if match["quoted"]:
        return Block(QUOTATION, re.sub(r"^> ?", "", match["quoted"], flags=re.MULTILINE))
    return Block(match["language"], match["fenced"])


def commands_of(page: str) -> list[str]:
    """Return every command on a page, in blocks and in sentences."""
    inline = [each.replace("\\|", "|") for each in _SPANS.findall(" ".join(_text(page).split()))]
    return [*inline, *(each for block in blocks_of(page) for each in block.commands)]


def _text(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")
