"""What commands print, and what they may write, checked before anything is done."""

from __future__ import annotations

import os
import re
import sys
import textwrap
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass, fields, is_dataclass
from enum import IntEnum
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    TextIO,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

from cyclopts import Parameter

from butterfly import outputs, progress
from butterfly.errors import InputError, visible

if TYPE_CHECKING:
    from rich.console import Console

    from butterfly.result import Answer
    from butterfly.verdict import Verdict

_PIPED = 80  # columns, where nobody says how many there are
_READABLE = 100  # characters in a line of a sentence, however wide a terminal is
_INDENT, _GAP = 2, 2  # spaces before a line of a table, and between columns
_PROSE = 16  # characters beyond which a cell of words may be folded at its spaces
_FEW_WORDS = 2  # of a cell that is never folded: an interval, say
_NUMBER = re.compile(r"[^\w]*[\d.]+(e[-+]?\d+)?([^\w]|$)")
_KEPT = re.compile(
    r"(?<=\d) (?=\S)|(?<=±) (?=\d)|(?<=\bN) (?=m\b)|(?<=\bm) (?=s²?/rad)|(?<=\bkg) (?=m²)"
)
_COMMAND = re.compile(r"`[^`]+`")  # to be pasted: never folded
_GLUE = "\N{NO-BREAK SPACE}"
_VERDICT = 2  # lines: values, model
_FEW = 3  # sentences below a verdict
_EVERY = 60.0  # s, after which a line says how far long work has come
_STDOUT = Path("-")


class ExitCode(IntEnum):
    """How a command ends, as a number for whoever called it."""

    DONE = 0
    NO_RESULT = 1  # of some runs of a sweep
    BAD_INPUT = 2
    NOT_TO_BE_USED = 3  # the answer: it did not converge, or warns of itself
    STOPPED = 130  # by Ctrl-C or a signal to end; what is done is kept
    UNREAD = 141  # whoever read standard output closed it, as `head` does

    @classmethod
    def of(cls, verdict: Verdict | None) -> ExitCode:
        """Return the exit code for an estimate's verdict; DONE if there is no estimate."""
        return cls.DONE if verdict is None or verdict.level.usable else cls.NOT_TO_BE_USED


@dataclass
class OutputOptions:
    """The general options of the command that runs: ``--quiet``, ``--verbose``, ``--json``."""

    quiet: bool = False
    verbose: bool = False
    json: Path | None = None
    words: Sequence[str] = ()  # the command and its arguments, without these

    @property
    def document_alone(self) -> bool:
        """Whether the document goes to standard output, and nothing else does."""
        return self.json == _STDOUT

    @property
    def silent(self) -> bool:
        """Whether sentences and tables are left out."""
        return self.quiet or self.document_alone


asked = OutputOptions()


def console() -> Console:
    """Return the rich console, as wide as the terminal, or COLUMNS; brackets are no markup."""
    from rich.console import Console  # noqa: PLC0415 - slow to import

    made = Console(markup=False, emoji=False, highlight=False)
    if not made.is_terminal:
        columns = os.environ.get("COLUMNS", "")
        made.width = int(columns) if columns.isdigit() and int(columns) > 0 else _PIPED
    return made


def put(line: str = "", *, file: TextIO | None = None) -> None:
    """Print a line, on standard output if no ``file`` is given: names in it steer no terminal."""
    print(visible(line), file=file, flush=file is not None)


def say(sentence: str) -> None:
    """Print a sentence: folded between words on a terminal, in one line elsewhere."""
    if not asked.silent:
        put(_folded(sentence))


def warn(sentence: str) -> None:
    """Print a warning on standard error."""
    put(f"warning: {sentence}", file=sys.stderr)


def say_verdict(verdict: Verdict) -> None:
    """Print the two lines of a verdict, which --quiet keeps."""
    _say_answer(verdict.lines[:_VERDICT])


def _say_answer(lines: Iterable[str]) -> None:
    """Print lines that --quiet keeps."""
    for line in () if asked.document_alone else lines:
        put(_folded(line))


def write_json(document: Mapping[str, Any]) -> None:
    """Write an answer as JSON to where ``--json`` said, if it did."""
    if asked.json is None:
        return
    from butterfly.files import json_text, write_document  # noqa: PLC0415 - slow to import

    if asked.document_alone:
        encoding, text = (getattr(sys.stdout, "encoding", None) or "").lower(), json_text(document)
        plain = not encoding.startswith("utf") or visible(text) != text
        print(json_text(document, ascii_only=True) if plain else text, end="")
    else:
        write_document(document, asked.json)
        say(f"Numbers: {asked.json}")


def show(
    result: Answer,
    *,
    report: Path | None = None,
    figures: bool = False,
    save: Path | None = None,
    rows: int | None = None,
    after: str = "",
) -> ExitCode:
    """Print a result, the command ``after`` it, at most so many ``rows``; write what is wanted.

    It is written even if whoever reads closes standard output, as `head` does.
    """
    try:
        _print(result, rows, after)
    finally:
        if report is not None:
            answers = [file for file in (save, asked.json) if file is not None]
            companion = _companion(report, REPORT, answers)
            result.report(report, figures=figures, numbers=companion is not None)
        if save is not None:
            result.save(save)
        if asked.json is not None:
            write_json(result.to_dict())
    for word, file in (("Report", report), ("Saved", save)):
        if file is not None:
            say(f"{word}: {file}")
    return ExitCode.of(result.judged)


def _print(result: Answer, rows: int | None, after: str) -> None:
    """Print verdict, sentences, the command after it, and tables of at most so many rows."""
    verdict = result.judged.lines[:_VERDICT] if result.judged else ()
    answer = (*result.headline, *verdict)
    _say_answer(verdict if asked.quiet and not result.sets_goal else answer)
    sentences = [sentence for sentence in result.paragraphs() if sentence not in answer]
    shown = len(sentences) if asked.verbose else _FEW + (not verdict)
    for sentence in sentences[:shown]:
        say(sentence)
    if more := len(sentences[shown:]):
        say(f"--verbose adds {more} more sentence{'s' * (more > 1)}.")
    if after and not asked.silent:  # whole, however long: to be pasted
        put(f"Next: {after}")
    tables = [table for table in result.tables() if asked.verbose or not table.detail]
    for table in () if asked.silent else tables:
        show_table(table.title, [*map(str, table.headers)], table.rows[:rows])


def show_table(
    title: str, headers: Sequence[str], rows: Sequence[Sequence[object]], *, lead: int = 1
) -> None:
    """Print a table, in blocks if need be, which repeat the ``lead`` columns that name a row."""
    if asked.silent:
        return
    from rich.table import Table  # noqa: PLC0415 - slow to import

    out = console()
    columns = [
        _Column(visible(header), [visible(str(row[k])) for row in rows], words=k < lead)
        for k, header in enumerate(headers or [""] * len(rows[0]))
    ]
    put()
    if title:
        with out.capture() as captured:
            out.print(visible(title), style="bold", soft_wrap=True)
        print(captured.get(), end="")
    for block in _blocks(columns, lead, out.width):
        if title:
            put()
        table = Table(box=None, show_header=bool(headers), padding=(0, _GAP, 0, 0), pad_edge=False)
        for column in block:
            side: Literal["left", "right"] = "left" if column.words else "right"
            table.add_column(_glued(column.header), width=column.width, justify=side)
        for cells in zip(*(column.cells for column in block), strict=True):
            table.add_row(*map(_glued, cells))
        with out.capture() as captured:
            out.print(table)
        for line in captured.get().replace(_GLUE, " ").splitlines():
            print(f"{' ' * _INDENT}{line}".rstrip())
    put()


@dataclass
class _Column:
    """A column of a table, and how wide it is: as wide as it can be, or as narrow as it may be."""

    header: str
    cells: list[str]
    words: bool = False
    width: int = 0
    least: int = 0

    def __post_init__(self) -> None:
        from rich.cells import cell_len  # noqa: PLC0415 - slow to import

        longest = max(map(cell_len, self.cells), default=0)
        prose = longest > _PROSE and any(len(cell.split()) > _FEW_WORDS for cell in self.cells)
        numbers = sum(_NUMBER.match(cell) is not None for cell in self.cells)
        self.words = self.words or prose or 2 * numbers <= len([c for c in self.cells if c])
        folded = max(_PROSE, _longest_word(self.cells)) if prose else longest
        self.least = max(folded, _longest_word([self.header]))
        self.width = max(longest, cell_len(self.header), self.least)

    @property
    def says(self) -> bool:
        """Whether there is any text in it."""
        return not {*self.cells} <= {"", "–"} or not self.cells


def _longest_word(texts: Sequence[str]) -> int:
    from rich.cells import cell_len  # noqa: PLC0415 - slow to import

    return max((cell_len(word) for text in texts for word in _glued(text).split(" ")), default=0)


def _blocks(columns: Sequence[_Column], lead: int, width: int) -> list[list[_Column]]:
    """Return blocks of columns that fit side by side, with their widths set."""
    first, rest = [*columns[:lead]], [column for column in columns[lead:] if column.says]
    blocks = [[*first]]
    for column in rest:
        if len(blocks[-1]) > lead and _total([*blocks[-1], column], "least") > width:
            blocks.append([*first])
        blocks[-1].append(column)
    for block in blocks:
        while _total(block, "width") > width:
            wide = max(block, key=lambda column: column.width - column.least)
            if wide.width == wide.least:
                break
            wide.width -= 1
    return blocks


def _total(columns: Sequence[_Column], what: str) -> int:
    widths: list[int] = [getattr(column, what) for column in columns]
    return _INDENT + sum(widths) + _GAP * (len(columns) - 1)


def _glued(text: str) -> str:
    """Return a text that is not folded between a number and its unit, nor within that."""
    return _KEPT.sub(_GLUE, text)


def _folded(sentence: str) -> str:
    out = console()
    if not out.is_terminal:
        return sentence
    width = min(out.width, _READABLE)
    whole = _COMMAND.sub(lambda command: command[0].replace(" ", _GLUE), sentence)
    lines = textwrap.wrap(_glued(whole), width, break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines).replace(_GLUE, " ")


_T = TypeVar("_T")


def note(sentence: str) -> None:
    """Print on standard error what the program is doing."""
    if not asked.quiet:
        put(sentence, file=sys.stderr)


def show_progress(items: Iterable[_T], description: str) -> Iterable[_T]:
    """Show a progress bar with count and elapsed time; a line, elsewhere than on a terminal."""
    if asked.quiet:
        return items
    return (_bar if sys.stderr.isatty() else _line)(items, description)


def _line(items: Iterable[_T], description: str) -> Iterator[_T]:
    """Say what is being done, and now and then how far it has come."""
    count, shown = len(items) if isinstance(items, Sized) else 0, time.monotonic()
    with progress.phase(description):
        for number, item in enumerate(items):
            if number and count and time.monotonic() - shown > _EVERY:
                shown = time.monotonic()
                note(f"{description}: {number} of {count} …")
            yield item


def _bar(items: Iterable[_T], description: str) -> Iterator[_T]:
    from rich import progress as bars  # noqa: PLC0415 - slow to import
    from rich.console import Console  # noqa: PLC0415

    console = Console(stderr=True, markup=False, emoji=False)
    columns = (
        bars.TextColumn("{task.description}", markup=False),
        *(bars.BarColumn(), bars.MofNCompleteColumn(), bars.TimeElapsedColumn()),
    )
    with bars.Progress(*columns, console=console, transient=True) as bar:
        yield from bar.track(items, description=visible(description))


_TO_STDOUT = Path("-")


@dataclass(frozen=True)
class OutputFile:
    """What an option writes: a file with one of these endings; without any, a folder."""

    endings: tuple[str, ...] = ()
    companion: str = ""  # ending of another file that is written with it
    documents: tuple[str, ...] = ()  # marks of JSON, if it holds any
    copies: str = ""  # argument whose file, if given, is copied: the copy holds no mark


SAVED = OutputFile((".json",), documents=(outputs.mark_of_document("identification", "saved"),))
REPORT = OutputFile((".html",), companion=".json", documents=('"schema": "butterfly.',))
FOLDER = OutputFile()


def options_of(command: object) -> dict[tuple[str, ...], tuple[str, OutputFile]]:
    """Return name and files of each option that writes, by the path of its argument."""
    options: dict[tuple[str, ...], tuple[str, OutputFile]] = {}
    for name, hint in get_type_hints(command, include_extras=True).items():
        kind, *metadata = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        if is_dataclass(kind):
            options.update({(name, *way): entry for way, entry in options_of(kind).items()})
        names = [
            parameter.name
            for parameter in metadata
            if isinstance(parameter, Parameter) and parameter.name
        ]
        option = next(iter(names[0])) if names else f"--{name}"
        for annotation in metadata:
            if isinstance(annotation, OutputFile):
                options[name,] = option, annotation
    return options


def check(
    command: object, arguments: Mapping[str, Any], json: Path | None, kinds: Sequence[str]
) -> None:
    """Note a command's inputs and refuse forbidden outputs; ``kinds``: documents of ``json``."""
    writing = options_of(command)
    files = {}
    if json is not None and json != _TO_STDOUT:
        marks = tuple(map(outputs.mark_of_document, kinds))
        files["--json"] = json, OutputFile((".json",), documents=marks)
    for way, value in _values(arguments):
        if way in writing:
            option, written = writing[way]
            files[option] = Path(value), written
        else:
            outputs.note_input(Path(value))
    named = {option: path for option, (path, written) in files.items() if written.endings}
    answers = [path for path, written in files.values() if ".json" in written.endings]
    for option, (path, written) in files.items():
        _require_kind(path, written, option)
        if (numbers := _companion(path, written, answers)) is not None:
            named[f"the numbers beside {option}"] = numbers
    taken: dict[Path, str] = {}
    for option, path in named.items():
        if taken.setdefault(path.resolve(), option) != option:
            other = taken[path.resolve()]
            raise InputError(path, option, f"the file of {other}", "another name for one of them")
        written = files[option.rpartition(" ")[2]][1]
        if path.suffix:
            is_json = path.suffix.lower() == ".json"
            marks = written.documents if is_json else (outputs.mark_of(path),)
            marks = () if arguments.get(written.copies) is not None else marks
            outputs.require_free(path, *marks, option=option)


def _companion(path: Path, written: OutputFile, answers: Iterable[Path]) -> Path | None:
    """Return the file of numbers beside an output; None where an answer, which has them, is it."""
    if not written.companion:
        return None
    numbers = path.with_suffix(written.companion)
    return None if numbers.resolve() in {answer.resolve() for answer in answers} else numbers


def _require_kind(path: Path, written: OutputFile, option: str) -> None:
    """Raise InputError for another ending, a file instead of a folder, or a folder instead."""
    folder = not written.endings or ("" in written.endings and not path.suffix)
    if path.exists() and path.is_dir() != folder:
        raise InputError(path, option, *(("a file", "a folder")[:: 1 if folder else -1]))
    if written.endings:
        outputs.require_endings(path, written.endings, option)


def _values(values: object, way: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield each path or text among the values of arguments, after its path of names."""
    if isinstance(values, Path | str):
        yield way, values
    elif isinstance(values, Mapping):
        for name, value in values.items():
            yield from _values(value, (*way, name))
    elif isinstance(values, tuple):
        for value in values:
            yield from _values(value, way)
    elif is_dataclass(values):
        yield from _values(
            {field.name: getattr(values, field.name) for field in fields(values)}, way
        )
